"""Frames: valid by construction, scaled to 8 bits by both images, and none of what is no disparity."""

import dataclasses

import numpy as np
import pytest

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Frame, as_8bit, pair_as_8bit, valid_depth, valid_disparity

HEIGHT, WIDTH = 4, 6
CAMERA = StereoCamera(fx=5.0, cx=3.0, cy=2.0, baseline_m=0.1)
LEFT = np.arange(HEIGHT * WIDTH * 3, dtype=np.uint8).reshape(HEIGHT, WIDTH, 3)
DISPARITY = np.ones((HEIGHT, WIDTH), np.float32)


def test_sources_and_shapes():
    stereo = Frame(camera=CAMERA, left=LEFT, right=LEFT)
    disparity = Frame(camera=CAMERA, left=LEFT, disparity=DISPARITY)
    depth = Frame(camera=CAMERA, depth_m=DISPARITY)
    assert [frame.source for frame in (stereo, disparity, depth)] == ["stereo", "disparity", "depth"]
    assert {frame.shape for frame in (stereo, disparity, depth)} == {(HEIGHT, WIDTH)}
    assert stereo.image is LEFT
    with pytest.raises(ValueError, match="no left image"):
        _ = depth.image


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "exactly one of"),
        ({"left": LEFT}, "exactly one of"),
        ({"left": LEFT, "right": LEFT, "disparity": DISPARITY}, "exactly one of"),
        ({"right": LEFT}, "needs a left one"),
        ({"left": LEFT, "right": LEFT[1:]}, "the right image is 6 x 3 pixels, but the left image is 6 x 4"),
        ({"left": LEFT, "right": LEFT[..., 0]}, "number of channels"),
        ({"left": LEFT, "right": LEFT.astype(np.uint16)}, "type"),
        ({"left": LEFT.astype(np.int16), "right": LEFT.astype(np.int16)}, "left image is int16"),
        ({"left": LEFT[..., :2], "right": LEFT[..., :2]}, r"left image is uint8 \(4, 6, 2\)"),
        ({"left": LEFT[:0], "right": LEFT[:0]}, "not empty"),
        ({"left": LEFT, "disparity": DISPARITY.T}, "the disparity is 4 x 6 pixels, but the left image is 6 x 4"),
        ({"left": LEFT, "disparity": DISPARITY.astype(np.float64)}, "disparity is float64"),
        ({"left": LEFT, "depth_m": LEFT.astype(np.float32)}, r"depth is float32 \(4, 6, 3\)"),
    ],
)
def test_frames_that_do_not_fit_are_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        Frame(camera=CAMERA, **fields)


@pytest.mark.parametrize("fields", [{"left": LEFT, "right": LEFT}, {"disparity": DISPARITY}, {"depth_m": DISPARITY}])
def test_images_have_the_size_that_the_camera_is_calibrated_for(fields):
    fitting = dataclasses.replace(CAMERA, width=WIDTH, height=HEIGHT)
    assert Frame(camera=fitting, **fields).shape == (HEIGHT, WIDTH)
    with pytest.raises(ValueError, match="calibration is for 4 x 6 pixels, but the image is 6 x 4"):
        Frame(camera=dataclasses.replace(CAMERA, width=HEIGHT, height=WIDTH), **fields)


def test_12_bits_are_scaled_by_a_power_of_two():
    left = np.array([[0, 160, 3000], [16, 2048, 4095]], np.uint16)
    assert as_8bit(left).tolist() == [[0, 10, 187], [1, 128, 255]]
    dark = np.array([[0, 7, 200]], np.uint16)
    assert as_8bit(dark).tolist() == [[0, 7, 200]]
    assert as_8bit(np.full((2, 3, 3), 65535, np.uint16)).tolist() == np.full((2, 3, 3), 255).tolist()
    assert as_8bit(dark.astype(np.uint8)).dtype == np.uint8
    with pytest.raises(ValueError, match="float32"):
        as_8bit(dark.astype(np.float32))


def test_a_pair_is_scaled_by_both_images_and_none_is_clipped():
    left = np.array([[0, 160, 3000], [16, 2048, 4095]], np.uint16)
    right = np.array([[0, 160, 5000], [16, 32, 8191]], np.uint16)
    scaled_left, scaled_right = pair_as_8bit(left, right)
    assert scaled_left.tolist() == [[0, 5, 93], [0, 64, 127]]
    assert scaled_right.tolist() == [[0, 5, 156], [0, 1, 255]]
    assert [image.tolist() for image in pair_as_8bit(right, left)] == [scaled_right.tolist(), scaled_left.tolist()]


def test_values_that_are_no_disparity_are_none():
    values = np.array([[-1, 0, 1.5, 60, np.nan, np.inf], [-np.inf, 32767, 32768, 3e38, -0.0, 2]], np.float32)
    expected = [[0, 0, 1.5, 60, 0, 0], [0, 32767, 0, 0, 0, 2]]
    assert valid_disparity(values).tolist() == expected
    assert Frame(camera=CAMERA, disparity=values).disparity.tolist() == expected
    good = np.ones((2, 3), np.float32)
    assert valid_disparity(good) is good


def test_values_that_are_no_depth_are_none():
    values = np.array([[-1, 0, 1.5, np.nan, np.inf, 1e6]], np.float32)
    assert valid_depth(values).tolist() == [[0, 0, 1.5, 0, 0, 1e6]]
    assert Frame(camera=CAMERA, depth_m=values).depth_m.tolist() == [[0, 0, 1.5, 0, 0, 1e6]]
