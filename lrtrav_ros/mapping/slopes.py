"""Ground that rises from the fitted ground: slopes and ramps, which its curve does not follow."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MapsConfig
from lrtrav_ros.frame import valid_disparity
from lrtrav_ros.mapping import _slopes_kernels as kernels
from lrtrav_ros.mapping._settings import checked_settings
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.numerics.checks import check_array

_STEEPEST = 0.3  # rise over run
_LEAST_RISE_M = 0.2  # lower things are not told from slopes
_STRIP_NOISE_PX = 0.1  # of the median of a strip's row
_CERTAINTY = 3.0  # times that noise
_TOLERANCE_M = 0.1
_BEYOND = 1.5  # times the length of the maps, for a slope is known by what comes after it
_N_STRIPS = 40
_LEAST_STRIP_PX = 8


def with_slopes(
    occupancy: NDArray[np.uint8],
    disparity: NDArray[np.float32],
    line: GroundLine | None,
    camera: StereoCamera,
    config: MapsConfig | None = None,
) -> NDArray[np.uint8]:
    """Return an occupancy in which ground that rises gently is ground, where the fitted ground passes below it.

    Strips of columns are followed from the ground upwards. Where a strip has risen by 0.2 m, or by more where noise
    demands it, it is a slope if the way was long enough for a grade of 30 % at most, and without a gap; an upright
    thing takes no way. In strips beside it, whose foot may be hidden, what lies on it belongs to it too. Pixels that
    stand out from it stay what they are, and so does what would lie on it but is upright: where disparity falls by less
    than 35 % of what it does on the slope, over 0.15 m or more rows where noise demands it.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle or above the horizon, 255 unknown.
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none. What is no number counts as none.
    line : GroundLine or None
        The ground line; without one `occupancy` stays as it is.
    camera : StereoCamera
        Calibration.
    config : MapsConfig, optional
        `length_m` is used: what is farther away stays as it is.

    Returns
    -------
    (H, W) ndarray of uint8
        A copy.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or the two differ in size.
    """
    config = checked_settings(config, line, camera)
    disparity = valid_disparity(disparity)
    check_array("occupancy", occupancy, np.uint8, disparity.shape)
    followed = np.array(occupancy, order="C")
    if line is None:
        return followed
    across, down, forward = GroundFrame.of(line, camera).rotation[0].tolist()
    origin = forward - across * camera.cx / camera.fx - down * camera.cy / camera.fy
    disparity, height = np.ascontiguousarray(disparity), len(disparity)
    blur = _CERTAINTY * _STRIP_NOISE_PX
    width = max(_LEAST_STRIP_PX, disparity.shape[1] // _N_STRIPS)
    surface, fall, above, slack = np.zeros((4, math.ceil(disparity.shape[1] / width), height), np.float32)
    kernels.follow(
        disparity,
        followed,
        np.array([line.slope, line.intercept, line.tilt]),
        np.array([origin, down / camera.fy, across / camera.fx]),
        np.array([line.camera_height_m(camera), camera.fx * camera.baseline_m, camera.fy]),
        np.array([_STEEPEST, _LEAST_RISE_M, blur, _TOLERANCE_M, _BEYOND * config.length_m]),
        width,
        surface,
        fall,
        above,
        slack,
    )
    kernels.spread(disparity, line.tilt, width, surface, fall, above, slack)
    per_metre = camera.fy / (camera.fx * camera.baseline_m)
    kernels.mark(disparity, line.tilt, blur, per_metre, width, surface, fall, above, slack, followed)
    return followed
