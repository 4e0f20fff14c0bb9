"""Ground that rises from the fitted ground."""

from __future__ import annotations

import numpy as np
import pytest
from sample_ground import CAMERA, HEIGHT, WIDTH, Box, Scene, line_of

from lrtrav_ros.config import MapsConfig
from lrtrav_ros.mapping.slopes import with_slopes
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN

NEAR_M = 15.0


def judged(scene: Scene, *, noise_px: float = 0.1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the occupancy by a flat ground, what becomes of it, and the depth of each pixel."""
    depth = scene.depths()[0]
    disparity = scene.disparity()
    disparity += np.random.default_rng(0).normal(0, noise_px, depth.shape).astype(np.float32) * (disparity > 0)
    ground = scene.line.disparity(*depth.shape)
    off = (disparity - ground) / np.maximum(disparity, 1e-3)  # a share of the camera's height
    is_ground = (ground > 0) & (np.abs(disparity - ground) < 0.4 + 0.1 * ground)
    occupancy = np.where(off > 0.3, np.uint8(OBSTACLE), np.where(is_ground, np.uint8(GROUND), np.uint8(UNKNOWN)))
    return occupancy, with_slopes(occupancy, disparity, scene.line, CAMERA), depth


@pytest.mark.parametrize("pose", [{"height_m": 0.8}, {"height_m": 1.2, "pitch_deg": 10.0, "roll_deg": -6.0}])
@pytest.mark.parametrize("slope", [0.08, 0.15, 0.2])
def test_slopes_are_ground(pose: dict[str, float], slope: float) -> None:
    scene = Scene(line_of(**pose), slope=slope, slope_from=4.0)
    before, after, depth = judged(scene)
    near = depth < NEAR_M
    assert (before[near] == OBSTACLE).mean() > 0.02
    assert (after[near] == OBSTACLE).mean() < 0.0005
    assert (after[near] == GROUND).mean() > 0.99


@pytest.mark.parametrize("slope", [0.5, 1.0, 5.0])
def test_what_is_steep_is_none(slope: float) -> None:
    before, after, depth = judged(Scene(line_of(height_m=0.8), slope=slope, slope_from=4.0))
    is_obstacle = (before == OBSTACLE) & (depth < NEAR_M)
    assert is_obstacle.sum() > 2000
    assert (after[is_obstacle] == OBSTACLE).mean() > 0.98


def test_what_stands_on_a_slope_stays_an_obstacle() -> None:
    boxes = (Box((7.0, 8.0), (-0.5, 0.7), (0.0, 1.5)), Box((6.0, 6.1), (1.5, 1.6), (0.0, 1.6)))  # a crate and a pole
    scene = Scene(line_of(height_m=0.8), boxes, slope=0.15, slope_from=4.0)
    before, after, depth = judged(scene)
    which = scene.depths()[1]
    for number in range(len(boxes)):
        own = (which == number) & (scene.ground_height(scene.points()) > 0.4) & (before == OBSTACLE)
        assert own.sum() > 50
        assert (after[own] == OBSTACLE).mean() > 0.97
    ground = (which < 0) & (depth < NEAR_M) & (np.abs(np.arange(WIDTH) - 150) > 60)
    assert (after[ground] == GROUND).mean() > 0.99


@pytest.mark.parametrize("slope", [0.08, 0.15])
@pytest.mark.parametrize("ahead", [8.0, 10.0])
def test_low_things_on_a_slope_stay_obstacles(slope: float, ahead: float) -> None:
    up = (-1.0, 0.4 + slope * (ahead - 4.0))
    boxes = tuple(Box((ahead, ahead + 0.5), left, up) for left in ((1.5, 2.3), (-0.4, 0.4), (-2.4, -1.4)))
    scene = Scene(line_of(height_m=0.8), boxes, slope=slope, slope_from=4.0)
    before, after, depth = judged(scene)
    which = scene.depths()[1]
    own = (which >= 0) & (scene.ground_height(scene.points()) > 0.1) & (before == OBSTACLE)
    assert own.sum() > 400
    assert (after[own] == OBSTACLE).mean() > 0.88  # by tolerance alone 0.59 to 0.86
    ground = (which < 0) & (depth < NEAR_M)
    assert (after[ground] == OBSTACLE).mean() < 0.001


def test_flat_tops_and_what_is_behind_a_gap_are_no_slopes() -> None:
    table = Box((4.0, 9.0), (-1.0, 1.0), (0.0, 0.5))
    before, after, _ = judged(Scene(line_of(height_m=0.8), (table,)))
    np.testing.assert_array_equal(after[before == OBSTACLE], OBSTACLE)
    hidden = Scene(
        line_of(height_m=0.8), (Box((4.0, 4.2), (-3.0, 3.0), (0.0, 0.4)), Box((14.0, 15.0), (-9.0, 9.0), (0.0, 3.0)))
    )
    before, after, _ = judged(hidden)
    assert (after[before == OBSTACLE] == OBSTACLE).all()


def test_a_ditch_is_no_slope() -> None:
    scene = Scene(line_of(height_m=1.0, pitch_deg=10.0), ditch=(4.0, 6.0, 0.3))
    disparity, ground = scene.disparity(), scene.line.disparity(HEIGHT, WIDTH)
    occupancy = np.where(ground > disparity + 0.2, np.uint8(OBSTACLE), np.uint8(GROUND))
    assert (occupancy == OBSTACLE).sum() > 3000
    np.testing.assert_array_equal(with_slopes(occupancy, disparity, scene.line, CAMERA), occupancy)


def test_far_slopes_stay_what_they_are() -> None:
    scene = Scene(line_of(height_m=0.8), slope=0.15, slope_from=4.0)
    before, _, depth = judged(scene)
    after = with_slopes(before, scene.disparity(), scene.line, CAMERA, MapsConfig(length_m=6.0))
    np.testing.assert_array_equal(after[depth > 10], before[depth > 10])
    assert (after[depth < 6] == GROUND).mean() > 0.99
    np.testing.assert_array_equal(with_slopes(before, scene.disparity(), None, CAMERA), before)
