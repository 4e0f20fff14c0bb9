"""Rectification of every lens model: spots of known places, seen where a pinhole pair would see them."""

import dataclasses

import cv2
import numpy as np
import pytest
from raw_cameras import DISTORTIONS, HEIGHT, ROTATION, TRANSLATION_M, WIDTH, lens, pair, project, spots, texture

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.rectification import Lens, RawPair, Rectification, raw_pair, rectification

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def spot_centre(image, u, v, radius=9):
    """Return the centre of what is bright around a pixel."""
    top, left = round(v) - radius, round(u) - radius
    weights = image[top : top + 2 * radius + 1, left : left + 2 * radius + 1].astype(float)
    rows, columns = np.mgrid[: weights.shape[0], : weights.shape[1]]
    return left + (weights * columns).sum() / weights.sum(), top + (weights * rows).sum() / weights.sum()


@pytest.mark.parametrize("model", DISTORTIONS)
def test_rows_match_and_disparity_is_that_of_the_plane(model):
    raw, depth_m = pair(model), 4.0
    camera = raw.camera
    disparity = camera.fx * camera.baseline_m / depth_m
    grid = [(u, v) for u in range(50, WIDTH - 30, 40) for v in range(25, HEIGHT - 20, 30)]
    points = [((u - camera.cx) / camera.fx * depth_m, (v - camera.cy) / camera.fy * depth_m, depth_m) for u, v in grid]
    in_left = np.array(points) @ np.reshape(raw.left_rotation, (3, 3))
    in_right = in_left @ ROTATION.T + TRANSLATION_M
    left, right = Rectification(raw).rectify(spots(project(raw.left, in_left)), spots(project(raw.right, in_right)))
    seen = [spot_centre(left, u, v) + spot_centre(right, u - disparity, v) for u, v in grid]
    left_u, left_v, right_u, right_v = np.transpose(seen)
    assert np.abs(left_v - right_v).max() < 0.15
    assert left_u - right_u == pytest.approx(disparity, abs=0.15)
    assert left_u == pytest.approx([u for u, _ in grid], abs=0.25)
    assert left_v == pytest.approx([v for _, v in grid], abs=0.25)


def test_the_baseline_is_the_distance_of_the_cameras_whatever_their_angle():
    raw = pair()
    assert raw.camera.baseline_m == pytest.approx(np.linalg.norm(TRANSLATION_M))
    assert (raw.camera.width, raw.camera.height) == (WIDTH, HEIGHT)
    left, right = (np.reshape(turn, (3, 3)) for turn in (raw.left_rotation, raw.right_rotation))
    assert right @ ROTATION == pytest.approx(left)
    assert right @ TRANSLATION_M == pytest.approx([-raw.camera.baseline_m, 0, 0])


@pytest.mark.parametrize("model", ["none", "plumb_bob of 5", "equidistant"])
def test_parallel_cameras_stay_as_they_are(model):
    one = lens(model)
    raw = raw_pair(one, one, rotation=IDENTITY, translation_m=(-0.2, 0, 0))
    assert raw.left_rotation == raw.right_rotation == IDENTITY
    image = texture()
    left, right = Rectification(raw).rectify(image, image)
    assert np.array_equal(left, right)
    assert np.count_nonzero(left.any(axis=2)) > 0.97 * HEIGHT * WIDTH


def test_a_fisheye_pair_has_the_view_that_opencv_4_chooses():
    camera = pair("equidistant").camera
    assert camera.fx == camera.fy == pytest.approx(167.35180783, abs=1e-6)  # by cv2.fisheye.stereoRectify of OpenCV 4.6
    assert (camera.cx, camera.cy) == pytest.approx((158.62458794, 98.23804725), abs=1e-6)


def test_a_lens_that_sees_half_the_sphere_has_a_view_of_130_degrees():
    one = lens("equidistant", fx=100.0, fy=100.0, cx=160.0, cy=100.0, distortion=(0.0,) * 4)
    camera = raw_pair(one, one, rotation=IDENTITY, translation_m=(-0.2, 0, 0)).camera
    assert camera.fx == pytest.approx(160 / np.tan(np.radians(65)))


def test_a_pair_without_distortion_keeps_its_view():
    one = lens("none", fx=190.0, fy=190.0)
    camera = raw_pair(one, one, rotation=IDENTITY, translation_m=(-0.2, 0, 0)).camera
    assert (camera.fx, camera.cx, camera.cy) == pytest.approx((190.0, 163.0, 96.0), abs=1e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_images_of_each_type_are_rectified_alike(dtype, channels):
    rectify = Rectification(pair()).rectify
    image = texture(channels=channels)
    expected = rectify(image, image)[0]
    left, right = rectify(image.astype(dtype) * dtype(1), image.astype(dtype))
    assert (left.dtype, left.shape, right.shape) == (dtype, image.shape, image.shape)
    assert np.abs(left.astype(int) - expected).max() <= 1


def test_what_the_raw_image_does_not_show_is_black():
    one = lens("plumb_bob of 4")
    wide = StereoCamera(fx=60.0, cx=160.0, cy=100.0, baseline_m=0.2, width=WIDTH, height=HEIGHT)
    raw = RawPair(left=one, right=one, left_rotation=IDENTITY, right_rotation=IDENTITY, camera=wide)
    left, _ = Rectification(raw).rectify(
        np.full((HEIGHT, WIDTH), 200, np.uint8), np.full((HEIGHT, WIDTH), 200, np.uint8)
    )
    u, v = np.meshgrid((np.arange(WIDTH) - 160) / 60, (np.arange(HEIGHT) - 100) / 60)
    pixels = project(one, np.dstack([u, v, np.ones_like(u)])).reshape(HEIGHT, WIDTH, 2)
    inside = ((pixels > 1) & (pixels < (WIDTH - 2, HEIGHT - 2))).all(axis=2) & (np.hypot(u, v) < 1.0)
    assert (left[inside] == 200).all()
    outside = ((pixels < -1) | (pixels > (WIDTH, HEIGHT))).any(axis=2) | (np.hypot(u, v) > 1.6)
    assert not left[outside].any()


def test_pixels_without_a_source_are_named():
    parallel = Rectification(pair("none"))
    wide = dataclasses.replace(parallel.pair, camera=dataclasses.replace(parallel.pair.camera, fx=100.0, fy=100.0))
    found = Rectification(wide)
    bright = np.full((HEIGHT, WIDTH), 200, np.uint8)
    left, _ = found.rectify(bright, bright)
    assert 0.3 < found.unseen.mean() < 0.9
    assert np.all(left[~found.unseen] == 200)
    # But for the seam, where bright and black are mixed, all the rest is black.
    assert np.mean(left[found.unseen] > 0) < 0.03


def test_a_calibration_that_leaves_nothing_to_see_is_refused():
    raw = pair("none")
    behind = dataclasses.replace(raw, left_rotation=(-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0))
    with pytest.raises(ValueError, match="the rectified left image would show nothing"):
        Rectification(behind)


def test_a_view_within_the_image_leaves_nothing_unseen():
    parallel = pair("none")
    narrow = dataclasses.replace(parallel, camera=dataclasses.replace(parallel.camera, fx=400.0, fy=400.0))
    assert Rectification(narrow).unseen is None


def test_a_lens_shows_nothing_beyond_where_its_polynomial_turns_back():
    # r (1 - 0.3 r^2) is greatest at r = 1.054; at r = 1.826 it is 0 again, the middle of the image.
    one = lens(distortion_model="plumb_bob", distortion=(-0.3, 0.0, 0.0, 0.0), fx=100.0, fy=100.0)
    wide = StereoCamera(fx=60.0, cx=160.0, cy=100.0, baseline_m=0.2, width=WIDTH, height=HEIGHT)
    raw = RawPair(left=one, right=one, left_rotation=IDENTITY, right_rotation=IDENTITY, camera=wide)
    white = np.full((HEIGHT, WIDTH), 255, np.uint8)
    left, _ = Rectification(raw).rectify(white, white)
    u, v = np.meshgrid((np.arange(WIDTH) - 160) / 60, (np.arange(HEIGHT) - 100) / 60)
    assert (left[np.hypot(u, v) < 0.9] == 255).all()
    assert not left[np.hypot(u, v) > 1.06].any()


def test_directions_behind_a_camera_are_black():
    turn = cv2.Rodrigues(np.array([0.0, np.radians(60), 0.0]))[0]
    wide = StereoCamera(fx=60.0, cx=160.0, cy=100.0, baseline_m=0.2, width=WIDTH, height=HEIGHT)
    raw = RawPair(
        left=lens("none"),
        right=lens("none"),
        left_rotation=tuple(turn.reshape(-1)),
        right_rotation=tuple(turn.T.reshape(-1)),
        camera=wide,
    )
    white = np.full((HEIGHT, WIDTH), 255, np.uint8)
    left, right = Rectification(raw).rectify(white, white)
    assert not (left.any(axis=0) & right.any(axis=0)).any()


def test_a_rectification_is_made_once_for_each_calibration():
    assert rectification(pair()) is rectification(pair())
    assert rectification(pair()) is not rectification(pair("equidistant"))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"distortion_model": "fov"},
            "distortion model 'fov' is not supported; give plumb_bob, rational_polynomial, equi",
        ),
        ({"distortion_model": ""}, "distortion model '' is not supported"),
        ({"distortion": (0.1, 0.2, 0.3)}, "distortion has 3 coefficients; plumb_bob has 4 or 5 or 8 or 12 or 14"),
        ({"distortion_model": "fisheye"}, "distortion has 5 coefficients; equidistant has 4"),
        ({"distortion": (0.1, float("nan"), 0, 0)}, "nan.*give finite numbers"),
        ({"distortion": (0.1, "x", 0, 0)}, "'x'.*give finite numbers"),
        ({"fx": 0.0}, "fx is 0.0; give a positive number"),
        ({"cy": float("inf")}, "cy is inf; give a finite number"),
        ({"fy": None}, "fy is None; give a finite number"),
        ({"width": 0}, "width is 0; give a whole number of pixels"),
        ({"width": None, "height": None}, "images of None x None pixels; give a size"),
        ({"width": 40_000}, "images of 40000 x 200 pixels; give a size up to 32767"),
    ],
)
def test_a_lens_that_cannot_be_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        lens(**fields)


def test_zero_coefficients_of_no_model_are_no_distortion():
    assert lens(distortion_model="", distortion=(0.0,) * 5) == lens("none")
    assert isinstance(lens("none"), Lens)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ({"rotation": (1.0,) * 9}, r"rotation is \[1.0.*give a rotation matrix of 9 numbers, row by row"),
        ({"rotation": (0.0,) * 9}, "give a rotation matrix"),
        ({"rotation": (1.0, 0.0, 0.0)}, "give a rotation matrix"),
        ({"translation_m": (0.2, 0.0, 0.0)}, "the right camera is not to the right of the left one"),
        ({"translation_m": (-0.1, 0.2, 0.0)}, "the right camera is not to the right of the left one"),
        ({"translation_m": (0.0, 0.0, 0.0)}, "give three finite numbers, not all 0"),
        ({"translation_m": (-1e-200, 0.0, 0.0)}, "give three finite numbers, not all 0"),
        ({"translation_m": (-1e200, 0.0, 0.0)}, "give three finite numbers, not all 0"),
        ({"translation_m": (-0.1, 0.2)}, "give three finite numbers"),
    ],
)
def test_a_pose_that_cannot_be_is_refused(pose, message):
    with pytest.raises(ValueError, match=message):
        raw_pair(lens(), lens(), **{"rotation": IDENTITY, "translation_m": (-0.2, 0.0, 0.0), **pose})


def test_a_pair_without_size_or_rotation_is_refused():
    raw = pair()
    with pytest.raises(ValueError, match="the rectified camera has no size"):
        dataclasses.replace(raw, camera=dataclasses.replace(raw.camera, width=None, height=None))
    with pytest.raises(ValueError, match="right_rotation is"):
        dataclasses.replace(raw, right_rotation=(0.0,) * 9)


def test_images_of_another_size_or_type_are_refused():
    rectify, image = Rectification(pair()).rectify, texture()
    with pytest.raises(ValueError, match="is for 320 x 200 pixels, but the right image is 320 x 199; calibrate"):
        rectify(image, image[:-1])
    with pytest.raises(ValueError, match="left image is float64"):
        rectify(image.astype(float), image)


@pytest.mark.parametrize("value", [1e7, -1e308])
def test_distortion_that_no_lens_has_is_refused(value):
    with pytest.raises(ValueError, match=r"distortion is .*; give numbers up to 1e"):
        Lens(width=40, height=30, fx=30.0, fy=30.0, cx=20.0, cy=15.0, distortion=(value, 0.0, 0.0, 0.0))


def test_a_rotation_of_huge_numbers_is_refused_without_overflow():
    with pytest.raises(ValueError, match=r"left_rotation is .*; give a rotation matrix"):
        dataclasses.replace(pair(), left_rotation=(1.0, 1e300, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
