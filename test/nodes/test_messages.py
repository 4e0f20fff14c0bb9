"""Messages to arrays and back."""

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_graph import CAMERA, header
from sensor_msgs.msg import CompressedImage, Image
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import depth_in_metres, disparity_in_pixels, header_stamp_ns
from lrtrav_ros.nodes import messages

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("shape", "dtype", "encoding", "step"),
    [
        ((4, 6), np.uint8, "mono8", 6),
        ((4, 6, 3), np.uint8, "bgr8", 18),
        ((4, 6), np.uint16, "mono16", 12),
        ((4, 6), np.float32, "32FC1", 24),
    ],
)
def test_images_go_both_ways(shape, dtype, encoding, step):
    pixels = RNG.integers(0, 200, shape).astype(dtype)
    message = messages.array_to_image(pixels, header(12_000_000_034))
    assert (message.encoding, message.height, message.width, message.step) == (encoding, 4, 6, step)
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.is_bigendian) == (12, 34, 0)
    assert header_stamp_ns(message) == 12_000_000_034
    np.testing.assert_array_equal(decode_message(message), pixels)


def test_a_part_of_a_larger_array_is_written_as_it_looks():
    pixels = RNG.integers(0, 256, (8, 12), np.uint8)[::2, 1::2]
    np.testing.assert_array_equal(decode_message(messages.array_to_image(pixels, header(0))), pixels)


def test_compressed_images_are_decoded():
    pixels = RNG.integers(0, 256, (4, 6, 3), np.uint8)
    data = cv2.imencode(".png", pixels)[1].tobytes()
    np.testing.assert_array_equal(decode_message(CompressedImage(format="png", data=data)), pixels)


def test_padded_rows_of_other_byte_order():
    values = np.array([[1, 500], [1000, 65535]], ">u2")
    data = b"".join(row.tobytes() + b"\xff\xff\xff" for row in values)
    message = Image(encoding="mono16", height=2, width=2, step=7, is_bigendian=1, data=data)
    np.testing.assert_array_equal(decode_message(message), values.astype(np.uint16))


def test_disparity_goes_both_ways_without_nan():
    disparity = np.array([[0, 1.5, 60.25], [0.01, 0, 31]], np.float32)
    message = messages.disparity_to_message(disparity, header(7), CAMERA, n_disparities=32)
    pixels = decode_message(message.image)
    np.testing.assert_array_equal(pixels < message.min_disparity, disparity == 0)
    np.testing.assert_array_equal(disparity_in_pixels(message), disparity)
    assert (message.min_disparity, message.max_disparity, message.delta_d) == (0.0, 60.25, 0.0625)
    assert (message.valid_window.height, message.valid_window.width) == (2, 3)
    assert message.f == pytest.approx(CAMERA.fx)
    assert message.t == pytest.approx(CAMERA.baseline_m)


def test_disparity_of_others_is_read_by_their_bounds():
    pixels = np.array([[np.nan, np.inf, 4.0], [2.0, 1.9, -1.0]], np.float32)
    message = DisparityImage(image=messages.array_to_image(pixels, header(0)), min_disparity=2.0, max_disparity=60.0)
    np.testing.assert_array_equal(disparity_in_pixels(message), [[0, np.inf, 4], [2, 0, 0]])


def test_depth_in_either_encoding():
    millimetres = messages.array_to_image(np.array([[0, 1500, 65535]], np.uint16), header(0))
    millimetres.encoding = "16UC1"
    np.testing.assert_allclose(depth_in_metres(decode_message(millimetres)), [[0, 1.5, 65.535]])
    metres = messages.array_to_image(np.array([[0, 1.5, 0.25]], np.float32), header(0))
    np.testing.assert_array_equal(depth_in_metres(decode_message(metres)), np.array([[0, 1.5, 0.25]], np.float32))
    with pytest.raises(ValueError, match="16UC1"):
        depth_in_metres(np.zeros((2, 3), np.uint8))


def test_labels_beyond_16_bits_are_cut():
    np.testing.assert_array_equal(messages.as_uint16(np.array([[0, 65535, 70000]], np.int32)), [[0, 65535, 65535]])
