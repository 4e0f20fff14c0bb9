"""Arrays as messages of rclpy."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import Image, RegionOfInterest
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.encodings import encode_image

_NO_DISPARITY = -1.0
_DELTA_DISPARITY = 1 / 16  # what OpenCV's matchers resolve


def header_of(message: Any) -> Header:
    """Return the header of a message that rosbags or rclpy decoded."""
    header = message.header
    return Header(
        stamp=Time(sec=int(header.stamp.sec), nanosec=int(header.stamp.nanosec)), frame_id=str(header.frame_id)
    )


def array_to_image(pixels: NDArray[Any], header: Header) -> Image:
    """Return `pixels`, (H, W) or (H, W, 3), as a message; see `encode_image` for encodings and errors."""
    encoded = encode_image(pixels)
    data = array.array("B")  # the one type that rclpy takes over at once; a NumPy array costs it 50 ms
    data.frombytes(encoded.data.data)
    return Image(
        header=header,
        height=encoded.height,
        width=encoded.width,
        encoding=encoded.encoding,
        is_bigendian=0,
        step=encoded.step,
        data=data,
    )


def as_uint16(values: NDArray[np.int32]) -> NDArray[np.uint16]:
    """Return labels or counts as ``mono16`` holds them; what exceeds it is 65535."""
    return np.clip(values, 0, 65535).astype(np.uint16)


def disparity_to_message(
    disparity: NDArray[np.float32], header: Header, camera: StereoCamera, *, n_disparities: int
) -> DisparityImage:
    """Return a disparity (H, W) in pixels, 0 where there is none, as a message; invalid pixels are -1."""
    height, width = disparity.shape
    return DisparityImage(
        header=header,
        image=array_to_image(np.where(disparity > 0, disparity, np.float32(_NO_DISPARITY)), header),
        f=float(camera.fx),
        t=float(camera.baseline_m),
        valid_window=RegionOfInterest(x_offset=0, y_offset=0, height=height, width=width),
        min_disparity=0.0,
        max_disparity=max(float(n_disparities - 1), float(disparity.max())),
        delta_d=_DELTA_DISPARITY,
    )
