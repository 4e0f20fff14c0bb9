"""The traversable region as a semantic segmentation: class, confidence and position of each pixel."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MapsConfig
from lrtrav_ros.frame import valid_disparity
from lrtrav_ros.mapping import _segmentation_kernels as kernels
from lrtrav_ros.mapping._settings import checked_settings
from lrtrav_ros.method.ground import GROUND, OBSTACLE, GroundLine
from lrtrav_ros.numerics.checks import check_array

CLASSES: Mapping[str, int] = MappingProxyType({"unknown": 0, "free": 1, "obstacle": 2})
"""The classes, and the values that stand for them in a mask."""

_DECIDED = 255  # confidence where the method does not say how sure it is
_CLASS_OF = np.zeros(256, np.uint8)
_CLASS_OF[[GROUND, OBSTACLE]] = CLASSES["free"], CLASSES["obstacle"]


def segmentation_mask(occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the class of each pixel.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Long range: 0 free, 100 occupied, 255 unknown.

    Returns
    -------
    (H, W) ndarray of uint8
        0 unknown, 1 free, 2 obstacle: `CLASSES`.

    Raises
    ------
    TypeError, ValueError
        If `occupancy` is not such an array.
    """
    check_array("occupancy", occupancy, np.uint8, ("H", "W"))
    return cv2.LUT(np.ascontiguousarray(occupancy), _CLASS_OF)


def segmentation_confidence(
    occupancy: NDArray[np.uint8], confidence: NDArray[np.uint8] | None = None
) -> NDArray[np.uint8]:
    """Return how sure the class of each pixel is.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Long range: 0 free, 100 occupied, 255 unknown.
    confidence : (H, W) ndarray of uint8, optional
        What the method says: a probability times 255.

    Returns
    -------
    (H, W) ndarray of uint8
        `confidence` itself; where the method does not say, 255 for what is free or occupied and 0 for what is unknown.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or the two differ in size.
    """
    check_array("occupancy", occupancy, np.uint8, ("H", "W"))
    if confidence is None:
        return np.where((occupancy == GROUND) | (occupancy == OBSTACLE), np.uint8(_DECIDED), np.uint8(0))
    check_array("confidence", confidence, np.uint8, occupancy.shape)
    return confidence


def segmentation_points(
    occupancy: NDArray[np.uint8],
    disparity: NDArray[np.float32],
    line: GroundLine | None,
    camera: StereoCamera,
    config: MapsConfig | None = None,
) -> NDArray[np.float32]:
    """Return where each pixel is: by its disparity, and by the fitted ground where it has none.

    What is free or unknown and has no disparity lies on the ground. An obstacle without disparity is as far away as
    what is seen of it below, or as the ground at its foot, for the ground behind it is not what is seen. An obstacle
    below the ground (ditches, steps down, edges) is where its line of sight crosses the ground.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Long range: 0 free, 100 occupied, 255 unknown.
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none. What is no number counts as none.
    line : GroundLine or None
        The ground line; without one, pixels without disparity have no point.
    camera : StereoCamera
        Calibration.
    config : MapsConfig, optional
        `clearance_m` is used: obstacles that hang higher have no point, for a robot passes below them.

    Returns
    -------
    (H, W, 3) ndarray of float32
        x right, y down and z forward, in metres, in the camera's optical frame; NaN where there is no point: above the
        horizon without disparity, and above `clearance_m`.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or the two differ in size.
    """
    config = checked_settings(config, line, camera)
    disparity = valid_disparity(disparity)
    check_array("occupancy", occupancy, np.uint8, disparity.shape)
    coefficients, clearance = np.zeros(4), np.inf
    if line is not None:
        coefficients = line.coefficients
        clearance = config.clearance_m / line.camera_height_m(camera)
    return kernels.points(
        np.ascontiguousarray(disparity),
        np.ascontiguousarray(occupancy),
        coefficients,
        camera.coefficients,
        clearance,
    )
