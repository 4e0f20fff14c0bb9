"""Obstacles and free ground as points in space, thinned to what a costmap resolves.

All points are in the camera's optical frame (x right, y down, z forward), in metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MapsConfig
from lrtrav_ros.frame import valid_disparity
from lrtrav_ros.mapping import _points_kernels as kernels
from lrtrav_ros.mapping._settings import checked_settings
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.slopes import with_slopes
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.numerics.checks import check_array, check_number

_FARTHEST_M = 1e9  # farther than anything on earth
_LEAST_SHARE = 0.03  # of a voxel's face: a wire of 3 mm in one of 0.1 m; a mismatch is smaller


def obstacle_points(
    disparity: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
    line: GroundLine | None,
    camera: StereoCamera,
    config: MapsConfig | None = None,
    *,
    least_height_m: float = 0.08,
) -> NDArray[np.float32]:
    """Return what a robot must not drive into, as points.

    Of the pixels that the occupancy calls obstacles, those count that have a disparity and stand above the ground; what
    rises gently is ground (`with_slopes`). In each voxel there is one point, the mean of its pixels; where they cover
    less than 3 % of its face, as mismatches do but thin poles and wires do not, there is none. A pixel below the ground
    (ditches, steps down, edges) is a hole in the ground: its point is where its line of sight crosses the fitted
    ground, lifted by `cell_m`, so that a costmap that ignores the ground does not ignore it.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none. What is no number counts as none.
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle or above the horizon, 255 unknown.
    line : GroundLine or None
        The ground line; without one there are no points.
    camera : StereoCamera
        Calibration.
    config : MapsConfig, optional
        `cell_m`, the size of a voxel, `length_m`, the greatest depth, and `clearance_m`, the greatest height, are used.
    least_height_m : float
        What is lower is left out; what the robot can climb. Things that are higher show by what is above it.

    Returns
    -------
    (N, 3) ndarray of float32
        No two in the same voxel ``floor(point / cell_m)``, but for rounding.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or the two differ in size.
    """
    config = checked_settings(config, line, camera)
    least_height_m = check_number("least_height_m", least_height_m, most=_FARTHEST_M)
    disparity = valid_disparity(disparity)
    check_array("occupancy", occupancy, np.uint8, disparity.shape)
    if line is None:
        return np.empty((0, 3), np.float32)
    occupancy = with_slopes(occupancy, disparity, line, camera, config)
    frame, scale = GroundFrame.of(line, camera), camera.fx * camera.baseline_m
    return kernels.obstacle_points(
        np.ascontiguousarray(disparity),
        np.ascontiguousarray(occupancy),
        line.coefficients,
        camera.coefficients,
        frame.rotation[2].copy(),
        np.array([least_height_m, config.clearance_m]) / frame.height_m,
        scale / config.length_m,
        config.cell_m,
        _LEAST_SHARE,
    )


def free_points(
    occupancy: NDArray[np.uint8], line: GroundLine | None, camera: StereoCamera, config: MapsConfig | None = None
) -> NDArray[np.float32]:
    """Return the free ground as points, to clear a costmap with.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle, 255 unknown.
    line : GroundLine or None
        The ground line; without one there are no points.
    camera : StereoCamera
        Calibration.
    config : MapsConfig, optional
        `cell_m`, the size of a cell on the ground, and `length_m`, the greatest depth, are used.

    Returns
    -------
    (N, 3) ndarray of float32
        On the fitted ground, one in each cell of `GroundFrame` that has a pixel of ground: the mean of those pixels.

    Raises
    ------
    TypeError, ValueError
        If `occupancy` is not such an array.
    """
    config = checked_settings(config, line, camera)
    check_array("occupancy", occupancy, np.uint8, ("H", "W"))
    if line is None:
        return np.empty((0, 3), np.float32)
    return kernels.free_points(
        np.ascontiguousarray(occupancy),
        line.coefficients,
        camera.coefficients,
        np.ascontiguousarray(GroundFrame.of(line, camera).rotation),
        camera.fx * camera.baseline_m / config.length_m,
        config.cell_m,
    )
