"""The check of the rows of a pair, on a clock of the test's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Frame
from lrtrav_ros.nodes.row_check import RowCheck

HEIGHT, WIDTH = 150, 240
DISPARITY = np.full((HEIGHT, WIDTH), 9.0, np.float32)
CAMERA = StereoCamera(fx=200.0, cx=120.0, cy=70.0, baseline_m=0.1)
TEXTURE = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH), np.uint8), (0, 0), 1.5)


def frame(lower_px: float) -> Frame:
    move = np.array([[1, 0, -9.0], [0, 1, lower_px]])
    right = cv2.warpAffine(TEXTURE, move, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return Frame(camera=CAMERA, left=TEXTURE, right=right)


class Clock:
    """Time that the test sets."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def check(clock: Clock) -> RowCheck:
    return RowCheck(clock)


def look(check: RowCheck, clock: Clock, lower_px: float, *, n: int, after_s: float = 1.0) -> None:
    for _ in range(n):
        check.look(frame(lower_px), DISPARITY)
        clock.now_s += after_s


@pytest.mark.parametrize(("lower_px", "words"), [(1.3, "1.3 px lower"), (-0.9, "0.9 px higher")])
def test_rows_apart_are_a_problem_from_the_fifth_measurement_on(
    check: RowCheck, clock: Clock, lower_px: float, words: str
) -> None:
    look(check, clock, lower_px, n=4)
    assert (check.offset_px, check.problem()) == (None, "")
    look(check, clock, lower_px, n=1)
    assert check.offset_px == pytest.approx(lower_px, abs=0.05)
    assert check.problem() == (
        f"the rows of the pair do not match: the right image is {words} than the left (median of 5 frames); "
        "calibrate the cameras again"
    )


def test_up_to_the_limit_rows_match(check: RowCheck, clock: Clock) -> None:
    look(check, clock, 0.6, n=6)
    assert check.problem() == ""
    assert check.offset_px == pytest.approx(0.6, abs=0.05)


def test_the_last_20_measurements_count_and_a_few_that_are_off_do_not(check: RowCheck, clock: Clock) -> None:
    look(check, clock, 0.0, n=25)
    look(check, clock, 2.0, n=9)
    assert check.problem() == ""
    look(check, clock, 2.0, n=2)
    assert "2.0 px lower than the left (median of 20 frames)" in check.problem()


def test_it_measures_once_a_second_at_most(check: RowCheck, clock: Clock) -> None:
    look(check, clock, 1.3, n=32, after_s=0.125)  # measures at 0, 1, 2 and 3 s
    assert check.offset_px is None
    look(check, clock, 1.3, n=1)
    assert check.offset_px == pytest.approx(1.3, abs=0.05)


def test_frames_that_tell_nothing_count_for_nothing(check: RowCheck, clock: Clock) -> None:
    depth = Frame(camera=CAMERA, left=TEXTURE, depth_m=np.ones((HEIGHT, WIDTH), np.float32))
    for _ in range(6):
        check.look(depth, DISPARITY)
        check.look(frame(1.3), np.zeros_like(DISPARITY))
        clock.now_s += 1.0
    assert check.offset_px is None


def test_what_was_measured_long_ago_counts_no_longer(check: RowCheck, clock: Clock) -> None:
    look(check, clock, 1.3, n=6)
    clock.now_s = 41.0  # the measurements of seconds 1 to 5 are left
    assert "(median of 5 frames)" in check.problem()
    clock.now_s = 41.1
    assert (check.offset_px, check.problem()) == (None, "")
