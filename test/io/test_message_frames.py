"""Frames of messages: each source, calibration with binning and a region of interest, and sizes that fit."""

import dataclasses

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.camera_info import VIRTUAL_BASELINE_M, stereo_camera
from lrtrav_ros.io.message_frames import FrameMessages, frame_of

TYPES = get_typestore(Stores.ROS2_JAZZY).types
HEIGHT, WIDTH = 20, 30
STAMP_NS = 12_000_000_034
FX, FY, CX, CY, BASELINE_M = 60.0, 61.0, 14.0, 9.0, 0.25
CAMERA = StereoCamera(fx=FX, fy=FY, cx=CX, cy=CY, baseline_m=BASELINE_M, width=WIDTH, height=HEIGHT)


def header(stamp_ns=STAMP_NS):
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")


def region(x_offset=0, y_offset=0, height=0, width=0):
    kind = TYPES["sensor_msgs/msg/RegionOfInterest"]
    return kind(x_offset=x_offset, y_offset=y_offset, height=height, width=width, do_rectify=False)


def info(*, baseline_m=0.0, height=HEIGHT, width=WIDTH, binning=(0, 0), roi=None):
    return TYPES["sensor_msgs/msg/CameraInfo"](
        header=header(),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.eye(3).reshape(-1),
        r=np.eye(3).reshape(-1),
        p=np.array([FX, 0, CX, -FX * baseline_m, 0, FY, CY, 0, 0, 0, 1, 0]),
        binning_x=binning[0],
        binning_y=binning[1],
        roi=roi or region(),
    )


def image(pixels, encoding, stamp_ns=STAMP_NS):
    return TYPES["sensor_msgs/msg/Image"](
        header=header(stamp_ns),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels.strides[0],
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )


def grey(seed, dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, 250, (HEIGHT, WIDTH)).astype(dtype)


def disparity_image(values, *, min_disparity=0.0, f=50.0, t=0.5):
    return TYPES["stereo_msgs/msg/DisparityImage"](
        header=header(),
        image=image(values, "32FC1"),
        f=f,
        t=t,
        valid_window=region(),
        min_disparity=min_disparity,
        max_disparity=99.0,
        delta_d=0.1,
    )


def stereo_messages(**replaced):
    messages = FrameMessages(
        source="stereo",
        left=image(grey(1), "mono8"),
        partner=image(grey(2), "mono8", STAMP_NS + 1),
        left_info=info(),
        right_info=info(baseline_m=BASELINE_M),
    )
    return dataclasses.replace(messages, **replaced)


def test_a_stereo_pair():
    frame = frame_of(stereo_messages())
    assert (frame.name, frame.stamp_ns, frame.source) == (str(STAMP_NS), STAMP_NS, "stereo")
    assert frame.camera == CAMERA
    assert np.array_equal(frame.left, grey(1))
    assert np.array_equal(frame.right, grey(2))


def test_a_disparity_image_brings_focal_length_and_baseline_and_may_come_alone():
    values = grey(3, np.float32) / 8
    values[0, :4] = np.nan, np.inf, -1, 1.9
    frame = frame_of(
        FrameMessages(source="disparity", partner=disparity_image(values, min_disparity=2.0), left_info=info())
    )
    expected = np.where(values >= 2, values, 0)
    expected[0, :4] = 0
    assert np.array_equal(frame.disparity, expected)
    assert frame.left is None
    assert frame.camera == dataclasses.replace(CAMERA, fx=50.0, baseline_m=0.5)


@pytest.mark.parametrize(("dtype", "encoding", "per_metre"), [(np.uint16, "16UC1", 1000), (np.float32, "32FC1", 1)])
def test_depth_is_in_metres(dtype, encoding, per_metre):
    values = grey(4, dtype)
    frame = frame_of(FrameMessages(source="depth", partner=image(values, encoding), left_info=info()))
    assert frame.depth_m == pytest.approx(values.astype(np.float32) / per_metre)
    assert frame.camera.baseline_m == VIRTUAL_BASELINE_M
    with_right = FrameMessages(
        source="depth", partner=image(values, encoding), left_info=info(), right_info=info(baseline_m=BASELINE_M)
    )
    assert frame_of(with_right).camera == CAMERA


def test_depth_of_another_type_is_refused():
    with pytest.raises(ValueError, match=r"16UC1 \[mm\] or 32FC1 \[m\]"):
        frame_of(FrameMessages(source="depth", partner=image(grey(4), "mono8"), left_info=info()))


@pytest.mark.parametrize(
    "replaced",
    [
        {"left_info": info(height=WIDTH, width=HEIGHT)},
        {"left_info": info(binning=(2, 1))},
        {"left_info": info(roi=region(height=HEIGHT, width=WIDTH - 2))},
    ],
)
def test_calibration_for_another_size_is_refused(replaced):
    with pytest.raises(ValueError, match=r"the calibration is for .* pixels, but the image is 30 x 20"):
        frame_of(stereo_messages(**replaced))


def test_a_camera_info_without_size_fits_every_image():
    frame = frame_of(stereo_messages(left_info=info(height=0, width=0)))
    assert frame.camera == dataclasses.replace(CAMERA, width=None, height=None)


def test_binning_and_region_of_interest_are_those_of_the_image():
    window = {"binning": (2, 4), "roi": region(x_offset=6, y_offset=5, height=4 * HEIGHT, width=2 * WIDTH)}
    frame = frame_of(
        stereo_messages(
            left_info=info(height=480, width=640, **window),
            right_info=info(height=480, width=640, baseline_m=BASELINE_M, **window),
        )
    )
    assert frame.camera == StereoCamera(
        fx=FX / 2, fy=FY / 4, cx=(CX - 6) / 2, cy=(CY - 5) / 4, baseline_m=BASELINE_M, width=WIDTH, height=HEIGHT
    )


@pytest.mark.parametrize(
    "right", [{"height": 2 * HEIGHT, "width": 2 * WIDTH}, {"binning": (2, 2)}, {"roi": region(x_offset=5)}]
)
def test_cameras_of_different_windows_are_refused(right):
    with pytest.raises(ValueError, match=r"left CameraInfo is for 30 x 20 pixels at \(0, 0\), the right one for"):
        frame_of(stereo_messages(right_info=info(baseline_m=BASELINE_M, **right)))


def test_cameras_without_baseline_are_refused():
    with pytest.raises(ValueError, match=r"P\[3\] = -?0, thus no baseline"):
        stereo_camera(info(), info())
