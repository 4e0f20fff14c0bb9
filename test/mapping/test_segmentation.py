"""Class, confidence and position of each pixel."""

from __future__ import annotations

import numpy as np
import pytest
from sample_ground import CAMERA, HEIGHT, WIDTH, Box, Scene, line_of

from lrtrav_ros.config import MapsConfig
from lrtrav_ros.mapping.segmentation import (
    CLASSES,
    segmentation_confidence,
    segmentation_mask,
    segmentation_points,
)
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN

SCALE = CAMERA.fx * CAMERA.baseline_m
POSES = [{"height_m": 0.8}, {"height_m": 1.1, "pitch_deg": 8.0, "roll_deg": -7.0}]


def test_classes_of_pixels() -> None:
    occupancy = np.array([[0, 100, 255], [255, 0, 100]], np.uint8)
    np.testing.assert_array_equal(segmentation_mask(occupancy), [[1, 2, 0], [0, 1, 2]])
    assert segmentation_mask(occupancy).dtype == np.uint8
    assert dict(CLASSES) == {"unknown": 0, "free": 1, "obstacle": 2}


def test_confidence_is_the_methods_or_certain_where_it_does_not_say() -> None:
    occupancy = np.array([[0, 100, 255]], np.uint8)
    np.testing.assert_array_equal(segmentation_confidence(occupancy), [[255, 255, 0]])
    confidence = np.array([[7, 8, 9]], np.uint8)
    np.testing.assert_array_equal(segmentation_confidence(occupancy, confidence), confidence)
    with pytest.raises(ValueError, match=r"confidence is uint8 \(1, 2\); give uint8 \(1, 3\)"):
        segmentation_confidence(occupancy, confidence[:, :2])


@pytest.mark.parametrize("pose", POSES)
def test_points_are_where_disparity_says(pose: dict[str, float]) -> None:
    scene = Scene(line_of(**pose), (Box((5.0, 6.0), (-1.0, 0.5), (0.0, 1.5)),))
    points = segmentation_points(scene.occupancy(), scene.disparity(), scene.line, CAMERA)
    assert points.shape == (HEIGHT, WIDTH, 3)
    assert points.dtype == np.float32
    depth = scene.depths()[0]
    seen = np.isfinite(depth) & (depth < 100)
    np.testing.assert_allclose(points[seen][:, 2], depth[seen], rtol=1e-4)
    np.testing.assert_allclose(
        scene.frame.from_camera(points[seen].astype(float)), scene.points()[seen], rtol=1e-3, atol=1e-3
    )
    assert np.isnan(points[~np.isfinite(depth)]).all()


@pytest.mark.parametrize("pose", POSES)
def test_ground_without_disparity_is_where_the_fitted_ground_is(pose: dict[str, float]) -> None:
    scene = Scene(line_of(**pose))
    depth = scene.depths()[0]
    none = np.zeros((HEIGHT, WIDTH), np.float32)
    near = np.isfinite(depth) & (depth < 100)
    for value in (GROUND, UNKNOWN):
        points = segmentation_points(np.full(none.shape, value, np.uint8), none, scene.line, CAMERA)
        np.testing.assert_allclose(points[near][:, 2], depth[near], rtol=1e-3)
        assert np.isnan(points[~np.isfinite(depth)]).all()
    assert np.isnan(segmentation_points(np.zeros(none.shape, np.uint8), none, None, CAMERA)).all()


def test_an_obstacle_without_disparity_is_at_its_foot() -> None:
    box = Box((5.0, 6.0), (-1.0, 1.0), (0.0, 0.7))
    scene = Scene(line_of(height_m=0.8), (box,))
    disparity, occupancy, which = scene.disparity(), scene.occupancy(), scene.depths()[1]
    disparity[which == 0] = 0
    points = segmentation_points(occupancy, disparity, scene.line, CAMERA)[which == 0].astype(float)
    assert len(points) > 1500
    assert np.isfinite(points).all()
    on_ground = scene.frame.from_camera(points)
    assert box.distance(on_ground).max() < 0.2  # a row of ground is 0.14 m there
    half = disparity.copy()
    half[100:120][which[100:120] == 0] = SCALE / 3  # something nearer stands before its lower half
    points = segmentation_points(occupancy, half, scene.line, CAMERA)
    np.testing.assert_allclose(points[96:120][which[96:120] == 0][:, 2], 3.0, rtol=1e-5)


def test_what_hangs_higher_than_the_robot_has_no_point() -> None:
    scene = Scene(line_of(height_m=0.8), (Box((5.0, 6.0), (-1.0, 1.0), (0.0, 4.0)),))
    which = scene.depths()[1]
    for clearance in (1.0, 2.0):
        config = MapsConfig(clearance_m=clearance)
        points = segmentation_points(scene.occupancy(), scene.disparity(), scene.line, CAMERA, config)[which == 0]
        height = scene.points()[which == 0][:, 2]
        np.testing.assert_array_equal(np.isnan(points[:, 2]), height > clearance)
    free = segmentation_points(np.zeros_like(scene.occupancy()), scene.disparity(), scene.line, CAMERA)[which == 0]
    assert np.isfinite(free).all()


def test_a_ditch_is_where_it_opens() -> None:
    scene = Scene(line_of(height_m=1.0, pitch_deg=12.0), ditch=(4.0, 5.0, 0.8))
    disparity, ground = scene.disparity(), scene.line.disparity(HEIGHT, WIDTH)
    inside = disparity < 0.98 * ground
    occupancy = np.where(inside, np.uint8(OBSTACLE), np.uint8(GROUND))
    points = segmentation_points(occupancy, disparity, scene.line, CAMERA)[inside]
    on_ground = scene.frame.from_camera(points.astype(float))
    np.testing.assert_allclose(on_ground[:, 2], 0, atol=1e-4)
    assert on_ground[:, 0].min() > 3.99
    assert on_ground[:, 0].max() < 5.01


def test_points_that_are_no_numbers_are_none() -> None:
    disparity = np.array([[1e-45, 1e-38, 1e-3]], np.float32)  # depth of the first two is infinite, or nearly so
    points = segmentation_points(np.full((1, 3), UNKNOWN, np.uint8), disparity, None, CAMERA)
    np.testing.assert_array_equal(np.isnan(points).all(axis=2), [[True, True, False]])
    assert points[0, 2, 2] == pytest.approx(CAMERA.fx * CAMERA.baseline_m / 1e-3)
