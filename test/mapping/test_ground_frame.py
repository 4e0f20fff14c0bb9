"""The camera's pose over the ground."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.method.ground import GroundLine

CAMERA = StereoCamera(fx=400.0, fy=380.0, cx=310.0, cy=250.0, baseline_m=0.12)


def line_of(*, height_m, pitch, roll):
    """Return the ground line of a camera at a height, pitched down and rolled to the right (radians)."""
    down = np.array([math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch), math.sin(pitch)])
    per_metre = CAMERA.fx * CAMERA.baseline_m / height_m
    tilt, slope = per_metre * down[0] / CAMERA.fx, per_metre * down[1] / CAMERA.fy
    return GroundLine(slope, per_metre * down[2] - slope * CAMERA.cy - tilt * CAMERA.cx, tilt)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0, 0), (20, 0), (-5, 0), (0, 7), (12, -9)])
def test_points_on_the_ground_line_lie_at_height_0_of_the_frame(pitch_deg, roll_deg):
    line = line_of(height_m=0.8, pitch=math.radians(pitch_deg), roll=math.radians(roll_deg))
    frame = GroundFrame.of(line, CAMERA)
    assert frame.height_m == pytest.approx(0.8)
    v, u = np.array([470.0, 400.0, 460.0]), np.array([5.0, 320.0, 630.0])
    depth = CAMERA.fx * CAMERA.baseline_m / (line.slope * v + line.intercept + line.tilt * u)
    points = np.stack([(u - CAMERA.cx) / CAMERA.fx * depth, (v - CAMERA.cy) / CAMERA.fy * depth, depth], axis=-1)
    on_ground = frame.from_camera(points)
    np.testing.assert_allclose(on_ground[:, 2], 0, atol=1e-9)
    assert np.all(on_ground[:, 0] > 0)
    assert on_ground[0, 1] > 0 > on_ground[2, 1]  # the left edge is to the left
    np.testing.assert_allclose(frame.to_camera(on_ground), points, atol=1e-9)


def test_camera_is_above_the_origin_and_looks_ahead_and_down():
    frame = GroundFrame.of(line_of(height_m=1.5, pitch=math.radians(10), roll=0.0), CAMERA)
    np.testing.assert_allclose(frame.from_camera(np.zeros(3)), [0, 0, 1.5], atol=1e-12)
    axis = frame.from_camera(np.array([0.0, 0.0, 1.0])) - [0, 0, 1.5]
    np.testing.assert_allclose(axis, [math.cos(math.radians(10)), 0, -math.sin(math.radians(10))], atol=1e-12)


def test_quaternion_is_the_rotation():
    frame = GroundFrame.of(line_of(height_m=1.5, pitch=0.2, roll=-0.1), CAMERA)
    np.testing.assert_allclose(Rotation.from_quat(frame.quaternion).as_matrix(), frame.rotation, atol=1e-12)
    assert frame.quaternion[3] >= 0


@pytest.mark.parametrize(
    ("rotation", "height_m", "reason"),
    [
        (np.eye(3), 0.0, "height_m is 0.0"),
        (np.eye(3), math.nan, "height_m is nan"),
        (2 * np.eye(3), 1.0, "orthonormal"),
        (np.diag([1.0, 1.0, -1.0]), 1.0, "determinant 1"),
        (np.eye(4), 1.0, "rotation"),
    ],
)
def test_no_rotation_and_no_height_are_refused(rotation, height_m, reason):
    with pytest.raises(ValueError, match=reason):
        GroundFrame(rotation, height_m)


@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(0, 0), (20, 4), (-5, -30)])
def test_up_gives_the_frame_back(pitch_deg, roll_deg):
    frame = GroundFrame.of(line_of(height_m=0.8, pitch=math.radians(pitch_deg), roll=math.radians(roll_deg)), CAMERA)
    again = GroundFrame.from_up(3 * frame.up, frame.height_m)
    np.testing.assert_allclose(again.rotation, frame.rotation, atol=1e-12)
    assert again.height_m == frame.height_m


@pytest.mark.parametrize(
    "up",
    [np.zeros(3), np.array([0.0, 0.0, -1.0]), np.array([0.0, np.nan, 0.0]), np.ones(2), np.full(3, 5e-324)],
)
def test_no_direction_up_is_refused(up):
    with pytest.raises(ValueError, match=r"up .*; give"):
        GroundFrame.from_up(up, 1.0)


@pytest.mark.parametrize("length", [1e-99, 1e99])
def test_up_may_be_of_any_length(length):
    np.testing.assert_allclose(GroundFrame.from_up(np.array([0.0, -length, 0.0]), 1.0).up, [0, -1, 0])


@pytest.mark.parametrize("length", [1e200, -1e-200])
def test_up_of_a_length_whose_square_is_no_number_is_refused(length):
    with pytest.raises(ValueError, match=r"^up .*; give"):
        GroundFrame.from_up(np.array([0.0, length, 0.0]), 1.0)
