"""Messages to arrays and back."""

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_graph import CAMERA, header
from sensor_msgs.msg import CompressedImage, Image, PointField
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import depth_in_metres, disparity_in_pixels, header_stamp_ns
from lrtrav_ros.mapping.grid import Grid
from lrtrav_ros.mapping.ground_frame import GroundFrame
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


def test_points_are_a_cloud_of_floats():
    points = RNG.random((7, 3)).astype(np.float32)
    message = messages.points_to_message(points, header(12_000_000_034))
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 34)
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        (name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate("xyz")
    ]
    assert (message.height, message.width, message.point_step, message.row_step) == (1, 7, 12, 84)
    assert (message.is_bigendian, message.is_dense) == (False, True)
    np.testing.assert_array_equal(np.frombuffer(message.data, "<f4").reshape(7, 3), points)
    empty = messages.points_to_message(points[:0], header(0))
    assert (empty.height, empty.width, len(empty.data), len(empty.fields)) == (1, 0, 0, 3)


def test_an_image_of_points_is_an_organised_cloud():
    points = RNG.random((4, 6, 3)).astype(np.float32)
    points[0] = np.nan
    message = messages.points_to_message(points, header(0))
    assert (message.height, message.width, message.row_step, message.is_dense) == (4, 6, 72, False)
    np.testing.assert_array_equal(np.frombuffer(message.data, "<f4").reshape(4, 6, 3), points)


def test_a_grid_is_drawn_in_its_frame():
    cells = np.array([[0, 100, -1], [-1, 0, 100]], np.int8)
    message = messages.grid_to_message(Grid(cells, 0.25, (1.0, -2.0)), header(12_000_000_034), "base_link")
    assert (message.header.frame_id, message.header.stamp.sec) == ("base_link", 12)
    info = message.info
    assert (info.width, info.height, info.resolution) == (3, 2, 0.25)
    assert (info.origin.position.x, info.origin.position.y, info.origin.orientation.w) == (1.0, -2.0, 1.0)
    assert list(message.data) == [0, 100, -1, -1, 0, 100]  # rows of x, one y after the other


def test_the_cameras_pose_is_in_the_frame_below_it():
    rotation = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # a level camera
    message = messages.pose_to_message(GroundFrame(rotation, 0.75), header(12_000_000_034))
    assert message.header.frame_id == f"{header(0).frame_id}_ground"
    assert message.header.stamp.nanosec == 34
    position, turn = message.pose.position, message.pose.orientation
    assert (position.x, position.y, position.z) == (0.0, 0.0, 0.75)
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((-0.5, 0.5, -0.5, 0.5))
