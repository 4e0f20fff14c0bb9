"""Serialised messages: the stamp in either byte order, what is decoded, and damage."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import IMAGE_TYPE

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP_NS = 1_700_000_000_123_456_789
PIXELS = np.random.default_rng(0).integers(0, 256, (6, 10, 3), np.uint8)


def serialized(*, little_endian=True):
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=STAMP_NS // 10**9, nanosec=STAMP_NS % 10**9)
    message = types[IMAGE_TYPE](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="left_optical"),
        height=6,
        width=10,
        encoding="bgr8",
        is_bigendian=0,
        step=30,
        data=PIXELS.reshape(-1),
    )
    return bytes(STORE.serialize_cdr(message, IMAGE_TYPE, little_endian=little_endian))


@pytest.mark.parametrize("little_endian", [True, False])
def test_stamp_and_content_in_either_byte_order(little_endian):
    message = SerializedMessage(serialized(little_endian=little_endian), IMAGE_TYPE)
    decoded = message.decode()
    assert message.stamp_ns == STAMP_NS == header_stamp_ns(decoded)
    assert (decoded.header.frame_id, decoded.height, decoded.width) == ("left_optical", 6, 10)
    np.testing.assert_array_equal(decode_message(decoded), PIXELS)


def test_an_image_is_copied_once_out_of_its_message():
    decoded = SerializedMessage(serialized(), IMAGE_TYPE).decode()
    image = decode_message(decoded)
    assert not decoded.data.flags.owndata
    assert image.flags.writeable
    assert not np.shares_memory(image, decoded.data)


@pytest.mark.parametrize("n_bytes", [0, 3, 11])
def test_what_ends_before_the_stamp_is_refused(n_bytes):
    with pytest.raises(ValueError, match=f"damaged message: {n_bytes} bytes are no sensor_msgs/msg/Image"):
        SerializedMessage(serialized()[:n_bytes], IMAGE_TYPE)


@pytest.mark.parametrize("n_bytes", [12, 14, 40, 60, 200])
def test_what_is_cut_off_is_refused_when_it_is_decoded(n_bytes):
    message = SerializedMessage(serialized()[:n_bytes], IMAGE_TYPE)
    assert message.stamp_ns == STAMP_NS
    with pytest.raises(ValueError, match=f"damaged message: {n_bytes} bytes are no sensor_msgs/msg/Image"):
        message.decode()


def test_an_encoding_that_is_no_cdr_is_refused():
    with pytest.raises(ValueError, match="damaged message"):
        SerializedMessage(b"\x09" + serialized()[1:], IMAGE_TYPE).decode()
