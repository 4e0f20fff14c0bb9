"""Converts calibration messages, of ROS 1 or ROS 2, to a `StereoCamera` or a `RawPair`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.rectification import Lens, RawPair, Rotation, checked_rotation, unseen_pixels

VIRTUAL_BASELINE_M = 0.12
"""Expresses depth as disparity where a depth camera comes without a baseline; that of small stereo cameras."""


def stereo_camera(left: Any, right: Any) -> StereoCamera:
    """Return the calibration of a rectified pair from its two ``sensor_msgs/CameraInfo``.

    Raises
    ------
    ValueError
        If the projection matrices hold no focal length or no baseline.
    """
    return _camera(left, baseline_m=_baseline_m(right))


def raw_pair_of(left: Any, right: Any) -> RawPair:
    """Return the calibration of a pair of raw images from its two ``sensor_msgs/CameraInfo``.

    Binning and region of interest are those of the images, raw and rectified alike.

    Raises
    ------
    ValueError
        If a camera is not calibrated, its distortion is of a model that is not supported, or the two CameraInfo are for
        different windows of the sensor.
    """
    check_same_window(left, right)
    camera = stereo_camera(left, right)
    if camera.width is None:
        raise ValueError("the left CameraInfo has no size; let the driver fill in width and height")
    return RawPair(
        left=_lens(left),
        right=_lens(right),
        left_rotation=_rotation(left),
        right_rotation=_rotation(right),
        camera=camera,
    )


def check_calibration(
    info: Any, *, is_right: bool = False, is_raw: bool = False, has_focal_length: bool = True
) -> None:
    """Raise ValueError where no frame can be made with a CameraInfo, whatever that of the other camera is.

    Parameters
    ----------
    info : sensor_msgs/CameraInfo
        Calibration of one camera.
    is_right : bool
        Whether it is the right camera, which gives the baseline.
    is_raw : bool
        Whether its images are to be rectified.
    has_focal_length : bool
        False where another message gives the focal length.
    """
    if is_raw:
        _lens(info)
        _rotation(info)
    if is_right:
        _Window.of(info)
        try:
            StereoCamera(fx=1.0, cx=0.0, cy=0.0, baseline_m=_baseline_m(info))  # the rest is the left camera's
        except ValueError as err:
            raise ValueError(f"CameraInfo of {info.header.frame_id!r} is not calibrated: {err}") from err
    else:
        fy = float(info.p[5]) / max(int(info.binning_y), 1)  # in place of that which is still to come
        _camera(info, baseline_m=VIRTUAL_BASELINE_M, fx=None if has_focal_length else fy)


def unseen_of(left: Any, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """Return which pixels of the rectified left image its raw one does not show, by its ``sensor_msgs/CameraInfo``.

    Parameters
    ----------
    left : sensor_msgs/CameraInfo
        Calibration of the left camera.
    shape : tuple of int
        The rectified image's, (height, width, ...).

    Returns
    -------
    (H, W) ndarray of bool or None
        None where it shows all.

    Raises
    ------
    ValueError
        As `raw_pair_of` does, or if the calibration is for another size.
    """
    camera = _camera(left, baseline_m=VIRTUAL_BASELINE_M)
    camera.check_size(shape)  # before maps of whatever size it says are made
    return unseen_pixels(_lens(left), _rotation(left), camera)


def is_distorted(info: Any) -> bool:
    """Return whether a CameraInfo says that the raw images of its camera are distorted."""
    return any(float(value) for value in info.d)


def check_same_window(left: Any, right: Any) -> None:
    """Raise ValueError where two CameraInfo are for another size, binning or region of interest; size 0 fits all."""
    left_window, right_window = _Window.of(left), _Window.of(right)
    if left_window != right_window and right_window.width and left_window.width:
        raise ValueError(
            f"the left CameraInfo is for {left_window}, the right one for {right_window}; "
            "set both cameras to one size, binning and region of interest"
        )


def depth_camera(left: Any, right: Any | None = None) -> StereoCamera:
    """Return the calibration of a depth camera; `VIRTUAL_BASELINE_M` is taken where there is no right camera.

    Raises
    ------
    ValueError
        If the projection matrices hold no focal length, or that of the right camera no baseline.
    """
    return _camera(left, baseline_m=VIRTUAL_BASELINE_M if right is None else _baseline_m(right))


def disparity_camera(disparity: Any, left: Any) -> StereoCamera:
    """Return the calibration that a ``stereo_msgs/DisparityImage`` carries; `left` adds the rest.

    Raises
    ------
    ValueError
        If focal length or baseline are not positive.
    """
    if not 0 < disparity.f < math.inf or not 0 < disparity.t < math.inf:
        raise ValueError(
            f"the disparity image has f = {disparity.f:g} and t = {disparity.t:g}; "
            "both the focal length [px] and the baseline [m] must be positive and finite"
        )
    return _camera(left, baseline_m=disparity.t, fx=float(disparity.f))


def _baseline_m(right: Any) -> float:
    """Return the baseline, of which the right camera's P[3] is -focal length * baseline."""
    focal_length, shift = float(right.p[0]), float(right.p[3])
    if not focal_length > 0 or not shift < 0:
        raise ValueError(
            f"the right camera's CameraInfo has P[0] = {focal_length:g} and P[3] = {shift:g}, thus no baseline; "
            "calibrate the pair, so that P[0] is the focal length and P[3] is -focal length * baseline"
        )
    return -shift / focal_length


@dataclass(frozen=True, slots=True)
class _Window:
    """The part of the sensor that images show (ROI), in its pixels, and how many of those make one of theirs."""

    left: int
    top: int
    width: int
    height: int
    binning_x: int
    binning_y: int

    def __str__(self) -> str:
        part = f"{self.width} x {self.height} pixels at ({self.left}, {self.top})"
        return part if self.binning_x == self.binning_y == 1 else f"{part}, binned {self.binning_x} x {self.binning_y}"

    @classmethod
    def of(cls, info: Any) -> _Window:
        """Return the window of a CameraInfo; a size of 0 is the whole sensor, a binning of 0 none.

        Raises ValueError where the window is not on the sensor, or binning leaves no pixel of it.
        """
        roi = info.roi
        window = cls(
            left=int(roi.x_offset),
            top=int(roi.y_offset),
            width=int(roi.width) or int(info.width),
            height=int(roi.height) or int(info.height),
            binning_x=max(int(info.binning_x), 1),
            binning_y=max(int(info.binning_y), 1),
        )
        if not window._fits(int(info.width), int(info.height)):
            raise ValueError(
                f"CameraInfo of {info.header.frame_id!r} has a sensor of {info.width} x {info.height} pixels, of which "
                f"images show {window}; set region of interest and binning to what the driver does"
            )
        return window

    def _fits(self, width: int, height: int) -> bool:
        """Return whether the window is no larger than a sensor of this size, and holds a pixel; 0 is not known."""
        is_inside = not width or not height or (self.left + self.width <= width and self.top + self.height <= height)
        is_whole = self.width == width and self.height == height  # an offset beside the whole sensor is of no account
        has_pixels = (
            not self.width or not self.height or min(self.width // self.binning_x, self.height // self.binning_y)
        )
        return bool((is_inside or is_whole) and has_pixels)


def _lens(info: Any) -> Lens:
    """Return the lens that K and D, which are for the whole sensor, describe."""
    window = _Window.of(info)
    k_fx, k_cx, k_fy, k_cy = (float(info.k[i]) for i in (0, 2, 4, 5))
    try:
        return Lens(
            width=window.width // window.binning_x,
            height=window.height // window.binning_y,
            fx=k_fx / window.binning_x,
            fy=k_fy / window.binning_y,
            cx=(k_cx - window.left) / window.binning_x,
            cy=(k_cy - window.top) / window.binning_y,
            distortion_model=str(info.distortion_model),
            distortion=tuple(map(float, info.d)),
        )
    except ValueError as err:
        raise _cannot_rectify(info, err) from err


def _rotation(info: Any) -> Rotation:
    try:
        return checked_rotation("R", tuple(map(float, info.r)))
    except ValueError as err:
        raise _cannot_rectify(info, err) from err


def _cannot_rectify(info: Any, err: ValueError) -> ValueError:
    return ValueError(f"CameraInfo of {info.header.frame_id!r} cannot rectify: {err}")


def _camera(info: Any, *, baseline_m: float, fx: float | None = None) -> StereoCamera:
    """Return the camera that a projection matrix, which is for the whole sensor, describes; `fx` is the images' own."""
    window = _Window.of(info)
    p_fx, p_cx, p_fy, p_cy = (float(info.p[i]) for i in (0, 2, 5, 6))
    try:
        return StereoCamera(
            fx=p_fx / window.binning_x if fx is None else fx,
            fy=p_fy / window.binning_y,
            cx=(p_cx - window.left) / window.binning_x,
            cy=(p_cy - window.top) / window.binning_y,
            baseline_m=float(baseline_m),
            # CameraInfo of size 0 tells none.
            width=window.width // window.binning_x or None,
            height=window.height // window.binning_y or None,
        )
    except ValueError as err:
        raise ValueError(f"CameraInfo of {info.header.frame_id!r} is not calibrated: {err}") from err
