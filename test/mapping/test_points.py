"""Obstacles and free ground as points."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from sample_ground import CAMERA, HEIGHT, WIDTH, Box, Scene, line_of

from lrtrav_ros.config import GroundConfig, MapsConfig
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.points import free_points, obstacle_points
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN, GroundLine, detect_ground

SCALE = CAMERA.fx * CAMERA.baseline_m
CELL = 0.1
POSES = [{"height_m": 0.8}, {"height_m": 0.8, "pitch_deg": 15.0}, {"height_m": 1.1, "pitch_deg": 8.0, "roll_deg": -7.0}]
BOXES = (Box((3.0, 3.5), (0.4, 1.2), (0.0, 0.6)), Box((6.0, 7.0), (-2.5, -0.5), (0.0, 1.7)))


def pixels_as_points(disparity: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the points of all pixels in the optical frame, (H, W, 3)."""
    v, u = np.mgrid[: disparity.shape[0], : disparity.shape[1]]
    z = SCALE / disparity.astype(np.float64)
    return np.stack([(u - CAMERA.cx) / CAMERA.fx * z, (v - CAMERA.cy) / CAMERA.fy * z, z], axis=-1)


def nearest(points: NDArray[np.float64], targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each of the targets is from the nearest point."""
    return np.array([np.linalg.norm(points - target, axis=1).min() for target in targets])


@pytest.mark.parametrize("pose", POSES)
def test_obstacles_are_the_boxes_and_nothing_else(pose: dict[str, float]) -> None:
    scene = Scene(line_of(**pose), BOXES)
    found = obstacle_points(scene.disparity(), scene.occupancy(), scene.line, CAMERA)
    assert found.dtype == np.float32
    points = scene.frame.from_camera(found.astype(np.float64))
    distances = np.stack([box.distance(points) for box in BOXES])
    assert distances.min(axis=0).max() < 1e-3
    seen, which = scene.points(), scene.depths()[1]
    for number in range(len(BOXES)):
        own = points[distances.argmin(axis=0) == number]
        faces = seen[(which == number) & (seen[..., 2] > 0.2)][::29]
        assert len(faces) > 20
        assert nearest(own, faces).max() < CELL * np.sqrt(3)


@pytest.mark.parametrize("pose", POSES)
def test_free_points_are_on_the_ground_one_in_each_cell(pose: dict[str, float]) -> None:
    scene = Scene(line_of(**pose), BOXES)
    points = scene.frame.from_camera(free_points(scene.occupancy(), scene.line, CAMERA).astype(np.float64))
    assert np.abs(points[:, 2]).max() < 1e-5
    assert min(box.distance(points).min() for box in BOXES) > 0.01 * CELL
    cells = {(i, j) for i, j in np.floor(points[:, :2] / CELL).astype(int)}
    assert len(cells) == len(points)
    ground = scene.points()[(scene.occupancy() == GROUND) & (scene.depths()[0] < 30)]
    assert cells == {(i, j) for i, j in np.floor(ground[:, :2] / CELL).astype(int)}


def test_there_is_the_mean_of_each_voxel() -> None:
    rng, line = np.random.default_rng(0), line_of(height_m=0.8, pitch_deg=10, roll_deg=5)
    disparity = rng.uniform(2.2, 20, (90, 200)).astype(np.float32)
    disparity[rng.random(disparity.shape) < 0.1] = 0
    occupancy = rng.choice(np.array([OBSTACLE, UNKNOWN], np.uint8), disparity.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = pixels_as_points(disparity)
        height = GroundFrame.of(line, CAMERA).from_camera(seen)[..., 2]
    points = seen[(occupancy == OBSTACLE) & (disparity > SCALE / 30) & (height >= 0.08) & (height <= 2)]
    voxels, inverse = np.unique(np.floor(points / CELL), axis=0, return_inverse=True)
    counts = np.bincount(inverse.reshape(-1))
    sums = np.stack([np.bincount(inverse.reshape(-1), points[:, axis]) for axis in range(3)], axis=1)
    shares = np.bincount(inverse.reshape(-1), points[:, 2] ** 2 / (CAMERA.fx * CAMERA.fy * CELL**2))
    expected = (sums / counts[:, None])[shares >= 0.03]
    assert len(voxels) > 3000  # which is more than the kernel begins with room for
    assert 500 < len(expected) < len(voxels)
    occupancy[(occupancy == OBSTACLE) & (height < 0)] = UNKNOWN
    found = obstacle_points(disparity, occupancy, line, CAMERA)
    order, expected_order = np.lexsort(np.floor(found / CELL).T), np.lexsort(np.floor(expected / CELL).T)
    np.testing.assert_allclose(found[order], expected[expected_order], rtol=1e-5)
    np.testing.assert_array_equal(obstacle_points(disparity, occupancy, line, CAMERA), found)


def test_larger_cells_give_fewer_points() -> None:
    scene = Scene(line_of(height_m=0.8), BOXES)
    numbers = [
        (
            len(obstacle_points(scene.disparity(), scene.occupancy(), scene.line, CAMERA, MapsConfig(cell_m=cell))),
            len(free_points(scene.occupancy(), scene.line, CAMERA, MapsConfig(cell_m=cell))),
        )
        for cell in (0.1, 0.2, 0.4)
    ]
    assert all(fine > 2 * coarse for pair in itertools.pairwise(numbers) for fine, coarse in zip(*pair, strict=True))


@pytest.mark.parametrize("pose", [{"height_m": 0.8}, {"height_m": 1.0, "pitch_deg": 10.0, "roll_deg": 4.0}])
@pytest.mark.parametrize("slope_from", [2.0, 5.0])
def test_a_slope_is_no_obstacle_but_what_stands_on_it_is(pose: dict[str, float], slope_from: float) -> None:
    box = Box((7.0, 7.5), (-0.5, 0.7), (0.0, 1.6))
    rng = np.random.default_rng(0)
    for boxes in ((), (box,)):
        scene = Scene(line_of(**pose), boxes, slope=0.15, slope_from=slope_from)
        disparity = scene.disparity()
        disparity += rng.normal(0, 0.1, disparity.shape).astype(np.float32) * (disparity > 0)
        found = detect_ground(disparity, CAMERA, GroundConfig(shape="curved"))
        assert found.line is not None
        points = obstacle_points(found.disparity, found.occupancy, found.line, CAMERA)
        points = scene.frame.from_camera(points.astype(np.float64))
        points = points[points[:, 0] < 15]
        if not boxes:
            assert len(points) == 0
            continue
        assert len(points) > 50
        assert box.distance(points).max() < 0.4  # noise of depth at 7 m
        assert scene.ground_height(points).min() > 0.0  # the foot of its face counts as well
        assert points[:, 2].max() > 1.4


def test_height_is_that_over_ground_that_bends() -> None:
    line = GroundLine(slope=0.3, intercept=-27.0, bend=4.0)  # it falls away
    height = line.camera_height_m(CAMERA)
    v, d = np.mgrid[:HEIGHT, 60:200:2].astype(np.float32) * np.float32([1, 0.1])[:, None, None]
    above = height * (1 - (line.slope * v + line.intercept - line.bend / d) / d)  # the ground is at -height bend / d^2
    for low, n_cells in ((0.09, None), (0.07, 0)):
        occupancy = np.where(np.abs(above - low) < 0.01, np.uint8(OBSTACLE), np.uint8(UNKNOWN))
        assert (occupancy == OBSTACLE).sum() > 20
        occupancy[above < 0.08 if n_cells is None else above >= 0.08] = UNKNOWN
        found = obstacle_points(d.astype(np.float32), occupancy, line, CAMERA)
        assert len(found) == 0 if n_cells == 0 else len(found) > 20


def test_a_thin_pole_is_kept_and_mismatches_are_not() -> None:
    line = line_of(height_m=0.8)
    disparity, occupancy = np.zeros((HEIGHT, WIDTH), np.float32), np.full((HEIGHT, WIDTH), UNKNOWN, np.uint8)
    pole = (slice(80, 160), slice(100, 101))  # a pixel wide: 8 mm
    disparity[pole], occupancy[pole] = SCALE / 2, OBSTACLE
    for v, u in ((70, 200), (100, 250), (130, 40)):  # a voxel has 169 pixels
        disparity[v : v + 2, u : u + 2], occupancy[v : v + 2, u : u + 2] = SCALE / 2, OBSTACLE
    far = (slice(88, 89), slice(160, 161))
    disparity[far], occupancy[far] = SCALE / 20, OBSTACLE  # there a pixel covers most of a voxel
    found = obstacle_points(disparity, occupancy, line, CAMERA)
    near = found[found[:, 2] < 3]
    np.testing.assert_allclose(near[:, [0, 2]], [[(100 - CAMERA.cx) / CAMERA.fx * 2, 2]] * len(near), rtol=1e-5)
    heights = 0.8 - near[:, 1]
    assert len(near) == len(np.unique(np.floor(near[:, 1] / CELL))) == 7
    assert 0.24 < heights.min() < 0.35
    assert 0.8 < heights.max() < 0.9
    assert len(found) == 8
    assert found[:, 2].max() == pytest.approx(20)


def test_a_ditch_is_marked_across_above_the_ground() -> None:
    scene = Scene(line_of(height_m=1.0, pitch_deg=12.0), ditch=(4.0, 5.0, 0.8))
    found = detect_ground(scene.disparity(), CAMERA)
    assert found.line is not None
    points = obstacle_points(found.disparity, found.occupancy, found.line, CAMERA)
    points = scene.frame.from_camera(points.astype(np.float64))
    np.testing.assert_allclose(points[:, 2], CELL, atol=0.03)
    assert points[:, 0].min() > 3.9
    assert points[:, 0].max() < 5.1
    middle = points[np.abs(points[:, 1]) < 1]
    assert len(np.unique(np.floor(middle[:, 1] / CELL))) == 20  # no gap to drive through
    assert middle[:, 0].min() < 4.3


def test_what_is_far_or_high_or_sky_is_left_out() -> None:
    scene = Scene(
        line_of(height_m=0.8), (Box((5.0, 6.0), (-1.0, 1.0), (0.0, 4.0)), Box((12.0, 13.0), (2.0, 4.0), (0.0, 1.5)))
    )
    disparity, occupancy = scene.disparity(), scene.occupancy()
    points = scene.frame.from_camera(obstacle_points(disparity, occupancy, scene.line, CAMERA).astype(np.float64))
    assert points[:, 2].max() <= 2.0
    assert points[points[:, 0] < 6, 2].max() > 1.9
    assert (points[:, 0] > 11).any()
    near = MapsConfig(length_m=10.0, clearance_m=3.0)
    points = scene.frame.from_camera(obstacle_points(disparity, occupancy, scene.line, CAMERA, near).astype(np.float64))
    assert points[:, 2].max() > 0.8 + 5 * 90 / 250 - 0.1  # the image's upper edge
    assert points[:, 0].max() < 6
    assert free_points(occupancy, scene.line, CAMERA, near)[:, 2].max() <= 10
    high = obstacle_points(disparity, occupancy, scene.line, CAMERA, near, least_height_m=1.0)
    assert scene.frame.from_camera(high.astype(np.float64))[:, 2].min() >= 1.0


def test_without_ground_there_are_no_points() -> None:
    occupancy = np.full((4, 6), UNKNOWN, np.uint8)
    for found in (
        obstacle_points(np.ones((4, 6), np.float32), occupancy, None, CAMERA),
        free_points(occupancy, None, CAMERA),
    ):
        assert found.shape == (0, 3)
        assert found.dtype == np.float32
    line = line_of(height_m=0.8)
    assert obstacle_points(np.ones((4, 6), np.float32), occupancy, line, CAMERA).shape == (0, 3)
    assert free_points(occupancy, line, CAMERA).shape == (0, 3)
