"""Calibration from serialised CameraInfo: what counts is the last good one."""

import struct

import pytest

pytest.importorskip("rclpy")

from rclpy.serialization import serialize_message
from ros_graph import camera_info

from lrtrav_ros.io.camera_info import check_calibration
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import INFO_TYPE
from lrtrav_ros.nodes.calibration import Calibration

pytestmark = pytest.mark.usefixtures("ros")  # without whose environment the first message warns


def message(info, stamp_s=0):
    data = serialize_message(info)
    return SerializedMessage(data[:4] + struct.pack("<iI", stamp_s, 0) + data[12:], INFO_TYPE)


@pytest.fixture
def reasons():
    return []


@pytest.fixture
def calibration(reasons):
    return Calibration("left/camera_info", reasons.append, check_calibration)


def test_the_last_good_one_stays(calibration, reasons):
    assert calibration.info is None
    assert calibration.take(message(camera_info()))
    assert not calibration.take(message(camera_info(fx=float("nan"))))
    assert not calibration.take(SerializedMessage(message(camera_info()).data[:60], INFO_TYPE))
    assert calibration.info.p[0] == 150.0
    assert calibration.take(message(camera_info(fx=99.0)))
    assert calibration.info.p[0] == 99.0
    queue, refusals = calibration.topic.queue, calibration.topic.refusals
    assert (queue.received, refusals.n, len(reasons)) == (4, 2, 2)
    assert refusals.last.reason.startswith("damaged message: 60 bytes are no sensor_msgs/msg/CameraInfo")


def test_one_that_differs_in_its_stamp_alone_is_not_decoded_again(calibration):
    assert calibration.take(message(camera_info()))
    info = calibration.info
    assert calibration.take(message(camera_info(), stamp_s=-7))
    assert calibration.info is info
    assert calibration.topic.queue.last_stamp_ns == -7 * 10**9


def test_forgetting(calibration):
    assert calibration.take(message(camera_info()))
    calibration.forget()
    assert (calibration.info, calibration.topic.queue.received) == (None, 0)
    assert calibration.take(message(camera_info()))
    assert calibration.info.p[0] == 150.0
