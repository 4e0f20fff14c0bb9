"""Messages to arrays and back; what the fields of messages mean stands here and nowhere else."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image, RegionOfInterest
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io import encodings as images

_NO_DISPARITY = -1.0
_DELTA_DISPARITY = 1 / 16  # what OpenCV's matchers resolve


def stamp_ns(message: Any) -> int:
    """Return the header stamp of `message` in nanoseconds."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def array_to_image(pixels: NDArray[Any], header: Header) -> Image:
    """Return `pixels`, (H, W) or (H, W, 3), as a message; see `images.encode_image` for encodings and errors."""
    encoded = images.encode_image(pixels)
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


def message_to_disparity(message: DisparityImage) -> NDArray[np.float32]:
    """Return the disparity (H, W) in pixels, 0 where there is none; raises ValueError for other than 32FC1."""
    return images.valid_disparity(images.decode_message(message.image), message.min_disparity)


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


def message_to_depth(message: Image | CompressedImage) -> NDArray[np.float32]:
    """Return a depth image (16UC1 in millimetres, 32FC1 in metres) in metres, 0 where there is none."""
    return images.depth_in_metres(images.decode_message(message))
