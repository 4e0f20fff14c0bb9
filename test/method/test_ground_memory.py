"""The ground of the frame before, where a frame shows too little."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, GroundConfig
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.frame import Frame
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN, GroundLine, ShortRange, detect_ground
from lrtrav_ros.method.ground_memory import GroundMemory

HEIGHT, WIDTH = 120, 160
CAMERA = StereoCamera(fx=150.0, cx=80.0, cy=55.0, baseline_m=0.2)
PITCH_DEG = 8.0
SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS


def line_of(pitch_deg: float = PITCH_DEG, height_m: float = 1.0) -> GroundLine:
    """Return the ground line of a camera that looks down."""
    pitch, per_metre = math.radians(pitch_deg), CAMERA.fx * CAMERA.baseline_m / height_m
    slope = per_metre * math.cos(pitch) / CAMERA.fy
    return GroundLine(slope, per_metre * math.sin(pitch) - slope * CAMERA.cy)


def view(wall_m: float = math.inf, pitch_deg: float = PITCH_DEG) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the noisy disparity of a ground that ends at an upright wall across the view, and where the wall is."""
    ground = line_of(pitch_deg).disparity(HEIGHT, WIDTH)
    pitch, rows = math.radians(pitch_deg), (np.arange(HEIGHT)[:, None] - CAMERA.cy) / CAMERA.fy
    wall = CAMERA.fx * CAMERA.baseline_m / wall_m * (math.cos(pitch) - rows * math.sin(pitch))
    noise = np.random.default_rng(0).normal(0, 0.1, ground.shape)
    seen = np.maximum(ground, wall)
    return np.where(seen > 1, seen + noise, 0).astype(np.float32), np.broadcast_to(wall > ground, ground.shape)


OPEN, _ = view()
NEAR_WALL, IS_WALL = view(wall_m=1.8)
"""Four rows in a hundred are ground, too few for a line."""


def frame(disparity: NDArray[np.float32], *, after_s: float, camera: StereoCamera = CAMERA) -> Frame:
    return Frame(camera=camera, disparity=disparity, stamp_ns=START_NS + round(after_s * SECOND_NS))


def detector(memory_s: float) -> ShortRangeDetector:
    return ShortRangeDetector(Config().updated({"ground.memory_s": memory_s, "threads": 1}))


def test_the_ground_before_tells_wall_and_ground_apart() -> None:
    assert (detect_ground(NEAR_WALL, CAMERA).occupancy == UNKNOWN).all()
    line = line_of()
    found = detect_ground(NEAR_WALL, CAMERA, before=line)
    assert found.line is line
    assert found.is_line_remembered
    assert 0.02 < 1 - IS_WALL.mean() < 0.1
    assert (found.occupancy[~IS_WALL] == GROUND).mean() > 0.99
    assert (found.occupancy[IS_WALL] == OBSTACLE).mean() > 0.95


@pytest.mark.parametrize("off_deg", [-4.0, -2.0, 2.0, 4.0])
def test_little_of_a_wall_is_free_after_the_camera_has_pitched(off_deg: float) -> None:
    occupancy = detect_ground(NEAR_WALL, CAMERA, before=line_of(PITCH_DEG + off_deg)).occupancy
    assert (occupancy[IS_WALL] == GROUND).mean() < 0.1


def test_a_wall_that_hides_all_ground_is_an_obstacle_and_nothing_is_free() -> None:
    wall, is_wall = view(wall_m=1.0)
    found = detect_ground(wall, CAMERA, before=line_of())
    assert is_wall.all()
    assert (found.occupancy == OBSTACLE).mean() > 0.99
    assert (found.occupancy == GROUND).sum() == 0


def test_a_blinded_camera_has_no_ground() -> None:
    few = np.where(np.random.default_rng(1).random(OPEN.shape) < 0.08, NEAR_WALL, np.float32(0))
    for disparity in (np.zeros_like(OPEN), few):
        assert detect_ground(disparity, CAMERA, before=line_of()).line is None
    assert detect_ground(NEAR_WALL, CAMERA, before=line_of()).line is not None


def test_ground_below_the_line_before_contradicts_it() -> None:
    found = detect_ground(NEAR_WALL, CAMERA, before=line_of(PITCH_DEG + 6))
    assert (found.line, found.is_line_remembered) == (None, False)
    assert (found.occupancy == UNKNOWN).all()


def test_a_frame_that_shows_its_ground_has_its_own_line() -> None:
    expected, found = detect_ground(OPEN, CAMERA), detect_ground(OPEN, CAMERA, before=line_of(3.0, 1.3))
    assert found.line == expected.line
    assert not found.is_line_remembered
    np.testing.assert_array_equal(found.occupancy, expected.occupancy)


def test_a_line_with_little_support_yields_to_the_one_before_where_it_has_the_camera_elsewhere() -> None:
    disparity, foot = NEAR_WALL.copy(), 110
    steep = line_of().disparity(HEIGHT, WIDTH)[foot] + 0.06 * (np.arange(HEIGHT)[:, None] - foot)  # a bank, on the left
    disparity[:foot, :48] = (disparity - disparity.mean(axis=1, keepdims=True) + steep)[:foot, :48]
    alone, found = detect_ground(disparity, CAMERA), detect_ground(disparity, CAMERA, before=line_of())
    assert alone.line is not None
    assert alone.line.camera_height_m(CAMERA) > 1.8
    assert (alone.occupancy == GROUND).mean() > 0.2
    assert found.is_line_remembered
    assert (found.occupancy == GROUND).mean() < 0.1


def test_a_line_that_most_of_the_view_supports_is_believed_whatever_was_before() -> None:
    nodded, _ = view(pitch_deg=PITCH_DEG + 12)
    found = detect_ground(nodded, CAMERA, before=line_of())
    assert not found.is_line_remembered
    assert found.line is not None
    assert math.degrees(found.line.pitch_rad(CAMERA)) == pytest.approx(PITCH_DEG + 12, abs=0.3)


def line_after(first: ShortRange, second: ShortRange) -> bool:
    """Return whether the second frame has the line of the first."""
    assert first.line is not None
    assert not first.is_line_remembered
    return second.line == first.line


@pytest.mark.parametrize(
    ("memory_s", "after_s", "helps"),
    [(0.5, 0.1, True), (0.5, 0.5, True), (0.5, 0.6, False), (0.5, -0.1, False), (0.0, 0.1, False), (0.0, 0.0, False)],
)
def test_the_detector_remembers_for_as_long_as_it_is_told(memory_s: float, after_s: float, helps: bool) -> None:
    remembering = detector(memory_s)
    first = remembering.detect(frame(OPEN, after_s=0))
    second = remembering.detect(frame(NEAR_WALL, after_s=after_s))
    assert line_after(first, second) == helps
    assert second.is_line_remembered == helps


def test_what_is_remembered_does_not_prolong_itself() -> None:
    remembering = detector(0.5)
    remembering.detect(frame(OPEN, after_s=0))
    found = [remembering.detect(frame(NEAR_WALL, after_s=0.2 * n)).line is not None for n in range(1, 5)]
    assert found == [True, True, False, False]


def test_the_ground_of_another_camera_or_of_no_time_is_of_no_use() -> None:
    other = dataclasses.replace(CAMERA, fx=140.0, fy=140.0)
    remembering = detector(0.5)
    remembering.detect(frame(OPEN, after_s=0))
    assert remembering.detect(frame(NEAR_WALL, after_s=0.1, camera=other)).line is None
    assert remembering.detect(frame(NEAR_WALL, after_s=0.1)).line is None  # it is forgotten
    remembering.detect(Frame(camera=CAMERA, disparity=OPEN))
    assert remembering.detect(Frame(camera=CAMERA, disparity=NEAR_WALL)).line is None


def test_a_memory_gives_back_what_it_was_given_last() -> None:
    memory = GroundMemory(GroundConfig(memory_s=1.0))
    assert memory.recall(CAMERA, START_NS) is None
    memory.remember(line_of(3.0), CAMERA, START_NS)
    memory.remember(line_of(4.0), CAMERA, START_NS + SECOND_NS)
    assert memory.recall(CAMERA, START_NS + 2 * SECOND_NS) == line_of(4.0)
    assert memory.recall(CAMERA, START_NS + 2 * SECOND_NS + 1) is None


def test_times_of_numpy_are_as_good_as_those_of_python() -> None:
    memory, line = GroundMemory(GroundConfig(memory_s=1.0)), line_of()
    memory.remember(line, CAMERA, np.int8(100))  # type: ignore[arg-type]
    assert memory.recall(CAMERA, np.uint8(200)) == line  # type: ignore[arg-type]
    assert memory.recall(CAMERA, -(2**63)) is None


@pytest.mark.parametrize("stamp_ns", [1.5, "1", 2**63])
def test_what_is_no_time_is_refused(stamp_ns: int) -> None:
    memory = GroundMemory(GroundConfig(memory_s=1.0))
    for use in (lambda: memory.remember(line_of(), CAMERA, stamp_ns), lambda: memory.recall(CAMERA, stamp_ns)):
        with pytest.raises((TypeError, ValueError), match=r"^stamp_ns is .*; give"):
            use()
