"""Converts calibration messages, of ROS 1 or ROS 2, to a `StereoCamera`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from lrtrav_ros.camera import StereoCamera

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
        """Return the window of a CameraInfo; a size of 0 is the whole sensor, a binning of 0 none."""
        roi = info.roi
        return cls(
            left=int(roi.x_offset),
            top=int(roi.y_offset),
            width=int(roi.width) or int(info.width),
            height=int(roi.height) or int(info.height),
            binning_x=max(int(info.binning_x), 1),
            binning_y=max(int(info.binning_y), 1),
        )


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
