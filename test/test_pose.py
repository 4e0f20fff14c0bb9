"""Poses against rotations that SciPy makes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lrtrav_ros.pose import Pose

POINTS = np.random.default_rng(0).normal(size=(5, 3))


def moved(pose, points=POINTS):
    return points @ pose.rotation.T + pose.translation_m


def test_quaternion_and_angles_are_those_of_ros():
    rotation = Rotation.from_euler("xyz", [0.1, -0.2, 0.3])
    quaternion = " ".join(map(repr, rotation.as_quat().tolist()))
    for text in (f"0.5 -1 2 {quaternion}", "0.5, -1, 2, 0.1, -0.2, 0.3"):
        pose = Pose.parsed(text)
        np.testing.assert_allclose(pose.rotation, rotation.as_matrix(), atol=1e-12)
        assert pose.translation_m.tolist() == [0.5, -1.0, 2.0]


def test_poses_in_a_row_and_back():
    inner, outer = Pose.parsed("1 2 3 0.1 0.2 0.3"), Pose.parsed("-1 0.5 0 -0.4 0 1.2")
    np.testing.assert_allclose(moved(outer @ inner), moved(outer, moved(inner)))
    np.testing.assert_allclose(moved(inner.inverse(), moved(inner)), POINTS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not six or seven finite numbers; give x y z qx qy qz qw or x y z roll pitch yaw"),
        ("1 2 3", "'1 2 3', which is not six or seven"),
        ("1 2 3 0 0 nan", "not six or seven finite"),
        ("left right 3 0 0 0", "pose is 'left right 3 0 0 0'; give x y z"),
        ("0 0 0 0 0 0 0", "has length 0; give one of length 1"),
        ("0 0 0 0 0 0 2", "has length 2"),
    ],
)
def test_texts_that_are_no_pose_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        Pose.parsed(text)


def test_what_is_no_rotation_is_refused():
    for rotation in (np.eye(3) * 2, np.diag([1.0, 1.0, -1.0]), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="rotation"):
            Pose(rotation, np.zeros(3))
    with pytest.raises(ValueError, match="translation is float64"):
        Pose(np.eye(3), np.zeros(2))
