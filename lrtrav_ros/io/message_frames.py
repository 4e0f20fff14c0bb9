"""Converts the messages of one instant, from rclpy or rosbags, to a frame; bags and nodes share this code."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.frame import Frame, Image
from lrtrav_ros.io.camera_info import check_same_window, depth_camera, disparity_camera, raw_pair_of, stereo_camera
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.image_headers import check_pixels
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.numerics.checks import check_type
from lrtrav_ros.pose import Pose
from lrtrav_ros.rectification import rectification
from lrtrav_ros.registration import DepthRegistration

_MILLIMETRES = 1000


class PartError(ValueError):
    """A message that no frame can be made of.

    Parameters
    ----------
    part : str
        Which one of a frame's messages it is: ``left`` or ``partner``.
    reason : str
        What is wrong with it.
    """

    def __init__(self, part: str, reason: str) -> None:
        super().__init__(reason)
        self.part = part


@contextmanager
def blaming(part: str) -> Iterator[None]:
    """Raise each ValueError within as `PartError` of a part of the frame."""
    try:
        yield
    except ValueError as err:
        raise PartError(part, str(err)) from err


@dataclass(frozen=True, slots=True, eq=False)
class FrameMessages:
    """The messages of one moment.

    Attributes
    ----------
    source : str
        Source of disparity: ``stereo``, ``disparity`` or ``depth``.
    partner : sensor_msgs/Image, sensor_msgs/CompressedImage or stereo_msgs/DisparityImage
        The right image, the disparity image or the depth image; it and `left` may be serialised until `decoded`.
    left_info : sensor_msgs/CameraInfo
        Calibration of the left image.
    right_info : sensor_msgs/CameraInfo, optional
        That of the right one, which gives the baseline; a depth camera may do without.
    left : sensor_msgs/Image or sensor_msgs/CompressedImage, optional
        The left image; disparity and depth may do without.
    is_raw : bool
        Whether the two images of a stereo pair are to be rectified.
    depth_info : sensor_msgs/CameraInfo, optional
        Calibration of a depth image that is to be registered to the left one.
    depth_pose : Pose, optional
        Pose of its camera in the left one; needed with `depth_info`.
    """

    source: str
    partner: Any
    left_info: Any
    right_info: Any | None = None
    left: Any | None = None
    is_raw: bool = False
    depth_info: Any | None = None
    depth_pose: Pose | None = None

    @property
    def header(self) -> Any:
        """The ``std_msgs/Header`` of the left image, or else of its partner."""
        return (self.partner if self.left is None else self.left).header

    @property
    def stamp_ns(self) -> int:
        """Time of the frame in nanoseconds."""
        return header_stamp_ns(self)

    def decoded(self) -> FrameMessages:
        """Return the messages with no image serialised any more; raises PartError where one is damaged."""
        images = {"left": self.left, "partner": self.partner}
        return dataclasses.replace(self, **{part: _decoded(part, image) for part, image in images.items()})


def _decoded(part: str, image: Any) -> Any:
    with blaming(part):
        return image.decode() if isinstance(image, SerializedMessage) else image


def header_stamp_ns(message: Any) -> int:
    """Return the header stamp of a message in nanoseconds."""
    return stamp_to_ns(message.header.stamp)


def stamp_to_ns(stamp: Any) -> int:
    """Return a ``builtin_interfaces/Time`` in nanoseconds; below 0 before 1970."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def frame_of(messages: FrameMessages, *, max_pixels: int = MAX_PIXELS) -> Frame:
    """Return the frame that messages hold, named by its stamp in nanoseconds.

    Parameters
    ----------
    messages : FrameMessages
        The messages.
    max_pixels : int
        Most pixels that each of its images may have.

    Raises
    ------
    ValueError
        If a message is not whole (`PartError`), the calibration has no focal length or baseline or cannot rectify, or
        sizes or types do not fit each other; see `Frame`.
    """
    stamp_ns = messages.stamp_ns
    with blaming("left"):
        left = None if messages.left is None else decode_message(messages.left, max_pixels=max_pixels)
    right = disparity = depth_m = None
    with blaming("partner"):
        if messages.source == "stereo":
            right = decode_message(messages.partner, max_pixels=max_pixels)
        elif messages.source == "disparity":
            disparity = disparity_in_pixels(messages.partner, max_pixels=max_pixels)
        else:
            depth_m = depth_in_metres(decode_message(messages.partner, max_pixels=max_pixels))
    camera = _camera(messages)
    if camera.width is not None and camera.height is not None:
        # Depth is registered to an image of this size, whatever the size of its own.
        check_pixels("left CameraInfo", height=camera.height, width=camera.width, max_pixels=max_pixels)
    if depth_m is not None:
        depth_m = _registered(depth_m, messages)
    frame = Frame(
        camera=camera,
        left=left,
        right=right,
        disparity=disparity,
        depth_m=depth_m,
        name=str(stamp_ns),
        stamp_ns=stamp_ns,
    )
    if messages.source == "stereo":
        check_same_window(messages.left_info, messages.right_info)
    return _rectified(frame, messages) if messages.is_raw else frame


def _rectified(frame: Frame, messages: FrameMessages) -> Frame:
    """Return the rectified frame of a raw one."""
    if frame.left is None or frame.right is None:
        raise ValueError(f"the source is {messages.source!r}; only a stereo pair can be rectified")
    pair = rectification(raw_pair_of(messages.left_info, messages.right_info))
    left, right = pair.rectify(frame.left, frame.right)
    return dataclasses.replace(frame, left=left, right=right, unseen=pair.unseen)


def _registered(depth_m: NDArray[np.float32], messages: FrameMessages) -> NDArray[np.float32]:
    """Return the depth of each pixel of the left image, in metres."""
    camera = depth_camera(messages.left_info)
    if messages.depth_info is not None and messages.depth_pose is not None:
        return DepthRegistration(depth_camera(messages.depth_info), camera, messages.depth_pose).registered(depth_m)
    if camera.width is not None and depth_m.shape != (camera.height, camera.width):
        raise ValueError(
            f"the depth image is {depth_m.shape[1]} x {depth_m.shape[0]} pixels, but the left CameraInfo is for "
            f"{camera.width} x {camera.height}; if it is of a camera of its own, set source.depth_registered to false"
        )
    return depth_m


def _camera(messages: FrameMessages) -> StereoCamera:
    if messages.source == "stereo":
        return stereo_camera(messages.left_info, messages.right_info)
    if messages.source == "disparity":
        return disparity_camera(messages.partner, messages.left_info)
    return depth_camera(messages.left_info, messages.right_info)


def disparity_in_pixels(message: Any, *, max_pixels: int = MAX_PIXELS) -> NDArray[np.float32]:
    """Return the image of a ``stereo_msgs/DisparityImage`` (H, W), with 0 for what is below its least disparity.

    Raises
    ------
    ValueError
        If the message is not whole, or its image is not (H, W) of float32.
    """
    image = decode_message(message.image, max_pixels=max_pixels)
    if image.ndim != 2 or image.dtype != np.float32:
        raise ValueError(f"disparity image has shape {image.shape} and type {image.dtype}; give 32FC1")
    return np.where(image >= message.min_disparity, image, np.float32(0))


def depth_in_metres(image: Image) -> NDArray[np.float32]:
    """Return a depth image (uint16 in millimetres, float32 in metres) as metres.

    Raises
    ------
    ValueError
        If the image is not (H, W) of uint16 or float32.
    """
    check_type("depth image", image, np.ndarray)
    if image.ndim != 2 or image.dtype not in (np.uint16, np.float32):
        raise ValueError(f"depth image has shape {image.shape} and type {image.dtype}; give 16UC1 [mm] or 32FC1 [m]")
    return image.astype(np.float32) / np.float32(_MILLIMETRES) if image.dtype == np.uint16 else image
