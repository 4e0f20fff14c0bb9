"""The smoothed pose of the camera over the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.pose_smoothing import PoseSmoother

SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS


def pose(height_m: float = 1.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> GroundFrame:
    """Return the pose of a camera that looks down, and whose right side hangs lower."""
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    down = [math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch), math.sin(pitch)]
    return GroundFrame.from_up(-np.array(down), height_m)


def values(frame: GroundFrame) -> tuple[float, float, float]:
    """Return height [m], pitch and roll [deg] of a frame."""
    down = -frame.up
    pitch, roll = math.asin(down[2]), math.atan2(down[0], down[1])
    return (frame.height_m, math.degrees(pitch), math.degrees(roll))


def follow(smoother: PoseSmoother, frames: list[GroundFrame], *, rate_hz: float, first: int = 0) -> list[GroundFrame]:
    return [
        smoother.add(frame, START_NS + round((first + index) / rate_hz * SECOND_NS))
        for index, frame in enumerate(frames)
    ]


def test_a_camera_that_stays_as_it_is_stays() -> None:
    for found in follow(PoseSmoother(), [pose(0.8, 12, -3)] * 6, rate_hz=10):
        assert values(found) == pytest.approx((0.8, 12, -3), abs=1e-9)


@pytest.mark.parametrize("rate_hz", [5, 10, 30, 100])
def test_a_step_is_followed_with_the_time_constant_whatever_the_rate(rate_hz: int) -> None:
    smoother, n = PoseSmoother(), round(0.2 * rate_hz)
    follow(smoother, [pose(1.0, 2, -4)] * 5, rate_hz=rate_hz)
    found = follow(smoother, [pose(1.4, 6, 4)] * (n + 1), rate_hz=rate_hz, first=5)[-1]  # the first counts as wrong
    share = 1 - math.exp(-0.2 / 0.1)
    assert values(found) == pytest.approx((1 + 0.4 * share, 2 + 4 * share, -4 + 8 * share), abs=0.02)


@pytest.mark.parametrize(
    ("wrong", "height_m"), [(pose(3.0, -30, 20), 1.0), (pose(0.2, 40, -30), 1.0)], ids=["far up", "far down"]
)
def test_a_single_frame_that_is_wrong_moves_nothing(wrong: GroundFrame, height_m: float) -> None:
    right = pose(height_m, 5, 2)
    for found in follow(PoseSmoother(), [right, right, right, wrong, right, right], rate_hz=10):
        assert values(found) == pytest.approx((1.0, 5, 2), abs=1e-9)


@pytest.mark.parametrize("rate_hz", [10, 30])
def test_a_camera_that_sways_is_followed(rate_hz: int) -> None:
    sway = 2 * np.sin(4 * np.arange(4 * rate_hz) / rate_hz)  # degrees
    found = [values(frame)[1] for frame in follow(PoseSmoother(), [pose(1.0, 8 + x) for x in sway], rate_hz=rate_hz)]
    assert np.abs(np.array(found) - 8 - sway).max() < 0.8


def test_noise_becomes_less() -> None:
    rng = np.random.default_rng(0)
    noisy = [pose(*row) for row in rng.normal((1.0, 5, 1), (0.01, 0.2, 0.2), (300, 3))]
    found = np.array([values(frame) for frame in follow(PoseSmoother(), noisy, rate_hz=30)[60:]])
    np.testing.assert_allclose(found.mean(axis=0), (1.0, 5, 1), atol=0.03)
    assert (found.std(axis=0) < 0.5 * np.array([0.01, 0.2, 0.2])).all()


@pytest.mark.parametrize("passed_s", [1.1, -0.1, -100.0])
def test_gaps_and_jumps_back_begin_anew(passed_s: float) -> None:
    smoother = PoseSmoother()
    follow(smoother, [pose(0.8, 12, -3)] * 4, rate_hz=10)
    found = smoother.add(pose(1.5, 3, 1), START_NS + round((0.3 + passed_s) * SECOND_NS))
    assert values(found) == pytest.approx((1.5, 3, 1), abs=1e-9)


def test_without_a_time_nothing_is_smoothed() -> None:
    smoother = PoseSmoother()
    follow(smoother, [pose(0.8, 12, -3)] * 4, rate_hz=10)
    assert values(smoother.add(pose(1.5, 3, 1), None)) == pytest.approx((1.5, 3, 1), abs=1e-9)
    assert values(smoother.add(pose(1.4, 2, 0), START_NS)) == pytest.approx((1.4, 2, 0), abs=1e-9)


def test_times_of_numpy_are_as_good_as_those_of_python() -> None:
    smoother, plain = PoseSmoother(), PoseSmoother()
    for stamp_ns in (np.int8(100), np.uint64(127), 2**40, np.int64(2**62), np.int64(-(2**62)), np.uint64(5)):
        found, expected = smoother.add(pose(), stamp_ns), plain.add(pose(), int(stamp_ns))
        assert values(found) == values(expected)
