"""Distances on the ground, and how far a mask reaches."""

import numpy as np
import pytest

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.evaluation.scoring.ground_distances import MAX_REACH_M, GroundDistances
from lrtrav_ros.method.ground import GroundLine

# One metre above flat ground, looking level: row 20 + n is 100 / n metres ahead.
CAMERA = StereoCamera(fx=100.0, cx=39.5, cy=20.0, baseline_m=0.5)
LEVEL = GroundLine(slope=0.5, intercept=-10.0)
SHAPE = (60, 80)


def reach_m(mask, truth):
    return GroundDistances(LEVEL, CAMERA, SHAPE).reach_m(mask, truth)


def test_distance_on_the_ground_follows_the_line():
    distance_m = GroundDistances(LEVEL, CAMERA, SHAPE).distance_m
    assert distance_m.shape == SHAPE
    assert distance_m[21:, 5] == pytest.approx(100 / np.arange(1, 40))
    assert np.isinf(distance_m[:21]).all()


def test_distance_follows_a_camera_that_rolls():
    tilted = GroundLine(slope=0.5, intercept=-10.0 - 0.05 * 39.5, tilt=0.05)
    distance_m = GroundDistances(tilted, CAMERA, SHAPE).distance_m
    assert distance_m[40, 0] == pytest.approx(depth_at(tilted, 40, 0), rel=0.02)
    assert distance_m[40, 79] == pytest.approx(depth_at(tilted, 40, 79), rel=0.02)


def depth_at(line, v, u):
    """Depth of the ground in a pixel, in metres."""
    return CAMERA.fx * CAMERA.baseline_m / line.disparity(*SHAPE)[v, u]


@pytest.mark.parametrize(("first_row", "expected_m"), [(40, 5.0), (25, 20.0), (21, 100.0), (0, 100.0)])
def test_reach_is_the_distance_of_the_farthest_row(first_row, expected_m):
    truth = np.zeros(SHAPE, np.uint8)
    truth[21:, 20:60] = 255
    mask = np.zeros(SHAPE, np.uint8)
    mask[first_row:] = 255
    assert reach_m(mask, truth) == pytest.approx(expected_m)
    assert MAX_REACH_M == 100.0


def test_reach_ends_at_an_interruption_but_not_at_noise_or_where_nothing_is_traversable():
    truth = np.zeros(SHAPE, np.uint8)
    truth[21:] = 255
    mask = truth.copy()
    mask[30] = 0  # one row
    mask[::2, ::5] = 0  # grains
    assert reach_m(mask, truth) == pytest.approx(100.0)
    gap = truth.copy()
    gap[30:38] = 0
    assert reach_m(gap, truth) == pytest.approx(100 / (38 - 20))
    assert reach_m(gap, gap) == pytest.approx(100.0)


def test_reach_starts_at_the_first_row_that_is_found():
    truth = np.zeros(SHAPE, np.uint8)
    truth[21:] = 255
    mask = truth.copy()
    mask[50:] = 0
    assert reach_m(mask, truth) == pytest.approx(100.0)
    assert reach_m(np.zeros(SHAPE, np.uint8), truth) == 0.0
    assert reach_m(truth, np.zeros(SHAPE, np.uint8)) == 0.0
