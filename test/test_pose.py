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


@pytest.mark.parametrize(
    ("translation", "quaternion", "message"),
    [
        ((0, 0, 0), (1, 0, 0), r"quaternion \(x y z w\) is \(1, 0, 0\); give 4 numbers"),
        ((0, 0, 0), (0, 0, 0, 1, 0), r"quaternion .* is \(0, 0, 0, 1, 0\); give 4 numbers"),
        ((0, 0, 0), np.array([[0.0, 0.0, 0.0, 1.0]]), "give 4 numbers"),
        ((0, 0, 0), ("x", 0, 0, 1), "give 4 numbers"),
        ((0, 0, 0), None, "quaternion .* is None; give 4 numbers"),
        ((0, 0), (0, 0, 0, 1), r"translation \(x y z\) is \(0, 0\); give 3 numbers"),
        ((0, 0, 10**400), (0, 0, 0, 1), "give 3 numbers"),
        ((0, 0, 0), (1e200, 0, 0, 1), "give one of length 1"),
    ],
)
def test_quaternions_and_translations_have_their_numbers(translation, quaternion, message):
    with pytest.raises(ValueError, match=message):
        Pose.of_quaternion(translation, quaternion)


def test_poses_that_are_taken_may_be_composed_and_inverted_however_often():
    rotation = np.eye(3)
    rotation[0, 0] += 5e-6
    pose = Pose(rotation, np.array([1.0, 0.0, 0.0]))
    composed = pose
    for _ in range(100):
        composed = composed @ pose.inverse().inverse()
    np.testing.assert_allclose(composed.rotation, np.eye(3), atol=1.1e-5)
    np.testing.assert_allclose(composed.translation_m, [101, 0, 0], rtol=1e-3)


def test_usual_poses_are_composed_to_the_bit():
    inner, outer = Pose.parsed("1 2 3 0.1 0.2 0.3"), Pose.parsed("-1 0.5 0 -0.4 0 1.2")
    np.testing.assert_array_equal((outer @ inner).rotation, outer.rotation @ inner.rotation)
