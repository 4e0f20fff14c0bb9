"""Registration of depth images of planes, whose depth in either camera is known."""

import numpy as np
import pytest

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.pose import Pose
from lrtrav_ros.registration import DepthRegistration

DEPTH = StereoCamera(fx=70.0, fy=72.0, cx=41.3, cy=29.1, baseline_m=0.1, width=84, height=60)
LEFT = StereoCamera(fx=160.0, fy=158.0, cx=77.7, cy=52.2, baseline_m=0.1, width=150, height=110)
SMALL = StereoCamera(fx=30.0, cx=20.0, cy=14.0, baseline_m=0.1, width=40, height=27)
BESIDE = Pose.parsed("0.06 -0.02 0.015 0.02 -0.03 0.01")
GROUND = (np.array([0.02, 1.0, 0.0]), 1.0)  # in the left camera: normal . point = distance; all below is ground
WALL = (np.array([0.2, 0.0, 1.0]), 4.0)


def rays(camera):
    """Return the directions (H, W, 3) of a camera's pixels, with z = 1."""
    v, u = np.indices((camera.height, camera.width))
    return np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)


def plane_depth(camera, plane, pose=None):
    """Return the depth of a plane of the left camera in a camera (of a pose), 0 where it is behind."""
    normal, distance = plane
    if pose is not None:
        normal, distance = pose.rotation.T @ normal, distance - normal @ pose.translation_m
    inverse = rays(camera) @ normal / distance
    return np.where(inverse > 1 / 50, 1 / np.maximum(inverse, 1 / 50), 0).astype(np.float32)


def seen_by(camera, points, pose, margin=2):
    """Return which points (H, W, 3) of the left camera lie in another camera's image, not at its edge."""
    x, y, z = np.moveaxis((points - pose.translation_m) @ pose.rotation, -1, 0)
    z = np.where(z > 0, z, np.nan)
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    inside_u = (u > margin) & (u < camera.width - 1 - margin)
    return inside_u & (v > margin) & (v < camera.height - 1 - margin)


def scene(camera, pose=None):
    """Return the depth of a board at 1.5 m, 0.5 m wide, in front of a wall at 3 m, and which pixels show the board."""
    board, wall = (plane_depth(camera, (np.array([0.0, 0.0, 1.0]), z), pose) for z in (1.5, 3.0))
    points = rays(camera) * board[..., None]
    if pose is not None:
        points = points @ pose.rotation.T + pose.translation_m
    is_board = (abs(points[..., 0]) < 0.25) & (abs(points[..., 1]) < 0.2)
    return np.where(is_board, board, wall), is_board


@pytest.mark.parametrize("plane", [GROUND, WALL], ids=["ground", "wall"])
@pytest.mark.parametrize("left", [LEFT, SMALL, DEPTH], ids=["more pixels", "fewer pixels", "as many pixels"])
@pytest.mark.parametrize(
    ("pose", "error"),
    [("0.06 -0.02 0.015 0.02 -0.03 0.01", 2e-4), ("-0.3 0.1 0.2 0.1 0.05 0.5", 2e-3), ("0 0 0 0 0 0", 2e-4)],
)
def test_planes_have_their_depth_and_no_holes(plane, left, pose, error):
    pose = Pose.parsed(pose)
    expected = plane_depth(left, plane)
    found = DepthRegistration(DEPTH, left, pose).registered(plane_depth(DEPTH, plane, pose))
    assert (found.shape, found.dtype) == (expected.shape, np.float32)
    # Far ground is ragged: there, neighbouring rows count as different surfaces.
    certain = seen_by(DEPTH, rays(left) * expected[..., None], pose) & (expected > 0) & (expected < 6)
    assert certain.sum() > 0.12 * certain.size
    assert (found[certain] > 0).all()
    np.testing.assert_allclose(found[certain], expected[certain], rtol=error)


def test_the_nearest_surface_hides_what_is_behind_it():
    pose = Pose.parsed("0.1 0 0 0 0 0")
    depth, _ = scene(DEPTH, pose)
    found = DepthRegistration(DEPTH, LEFT, pose).registered(depth)
    _, is_board = scene(LEFT)
    # One pixel of the depth image is 2.3 of the left one.
    edge = np.zeros_like(is_board)
    for dv in range(-3, 4):
        for du in range(-3, 4):
            edge |= np.roll(is_board, (dv, du), axis=(0, 1)) != is_board
    np.testing.assert_allclose(found[is_board & ~edge], 1.5, rtol=1e-6)
    wall = ~is_board & ~edge & (found > 0)
    np.testing.assert_allclose(found[wall], 3.0, rtol=1e-6)
    # The depth camera is to the right: it does not see a strip of the wall to the left of the board, of 0.1 m * 160 px
    # * (1 / 1.5 m - 1 / 3 m) = 5.3 px, and the left image has no depth there.
    row = found[52, :]
    board = np.flatnonzero(is_board[52])
    strip = np.flatnonzero(row[: board[0]] == 0)
    strip = strip[strip > board[0] - 12]
    assert 4 <= strip.size <= 8
    assert (row[board[-1] + 3 : board[-1] + 20] == 3).all()


def test_pixels_without_depth_give_none():
    depth = np.full((DEPTH.height, DEPTH.width), 2.0, np.float32)
    depth[10:20] = np.array([0, np.nan, np.inf, -1], np.float32)[:, None].repeat(21, 1).T.reshape(-1)
    same = DepthRegistration(DEPTH, DEPTH, Pose.parsed("0 0 0 0 0 0"))
    expected = np.where(np.isfinite(depth) & (depth > 0), depth, 0)
    np.testing.assert_allclose(same.registered(depth), expected, rtol=1e-6)
    behind = DepthRegistration(DEPTH, DEPTH, Pose.parsed("0 0 -3 0 0 0"))
    assert not behind.registered(depth).any()


def test_any_values_and_poses_stay_inside_the_image():
    rng = np.random.default_rng(1)
    for _ in range(30):
        bits = rng.integers(0, 2**32, (DEPTH.height, DEPTH.width), np.uint64).astype(np.uint32)
        pose = Pose.parsed(" ".join(map(str, rng.normal(size=6) * 10.0 ** rng.integers(-2, 6, 6))))
        found = DepthRegistration(DEPTH, LEFT, pose).registered(bits.view(np.float32))
        assert found.shape == (LEFT.height, LEFT.width)
        assert not np.isnan(found).any()


def test_what_does_not_fit_is_refused():
    registration = DepthRegistration(DEPTH, LEFT, BESIDE)
    with pytest.raises(ValueError, match="calibration is for 84 x 60 pixels, but the image is 60 x 84"):
        registration.registered(np.ones((84, 60), np.float32))
    with pytest.raises(ValueError, match="depth is uint16"):
        registration.registered(np.ones((60, 84), np.uint16))
    with pytest.raises(ValueError, match="tells no size"):
        DepthRegistration(DEPTH, StereoCamera(fx=1.0, cx=0.0, cy=0.0, baseline_m=0.1), BESIDE)
    with pytest.raises(ValueError, match=r"translation to the left image is \[1.6e\+302"):
        DepthRegistration(DEPTH, LEFT, Pose.parsed("1e300 0 0 0 0 0"))
