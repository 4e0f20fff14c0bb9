"""Registration: depth as the left camera sees it, from the image of a depth camera beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros._registration_kernels import draw_nearest, project
from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.numerics.checks import check_array, check_type
from lrtrav_ros.pose import Pose

_MAX_PROJECTION = 1e9
"""No numbers of a projection, in pixels and in pixels times metres, are as large."""


class DepthRegistration:
    """Makes a depth image of the left camera from that of another camera.

    Each pixel of the depth image is a piece of a surface, as large as the distance to its neighbours, and each pixel
    of the left image sees the nearest of these: surfaces have no gaps where the left image has more pixels, and nothing
    is seen through them. Where the depth camera saw nothing, there is no depth.

    Parameters
    ----------
    depth_camera : StereoCamera
        Calibration of the depth image, which is rectified; the baseline does not matter.
    left_camera : StereoCamera
        Calibration of the left image, with its width and height.
    pose : Pose
        Of the depth camera's optical frame (x right, y down, z forward) in the left camera's one.

    Raises
    ------
    TypeError, ValueError
        If an argument is something else, the left camera's calibration does not tell the images' size, or focal length
        or distance are absurd.
    """

    def __init__(self, depth_camera: StereoCamera, left_camera: StereoCamera, pose: Pose) -> None:
        check_type("depth_camera", depth_camera, StereoCamera)
        check_type("left_camera", left_camera, StereoCamera)
        check_type("pose", pose, Pose)
        if left_camera.width is None or left_camera.height is None:
            raise ValueError("the left camera's calibration tells no size; give width and height, to register depth to")
        self._depth_camera = depth_camera
        self._shape = (left_camera.height, left_camera.width)
        left = _matrix(left_camera)
        self._rotation = _single("rotation", left @ pose.rotation @ np.linalg.inv(_matrix(depth_camera)))
        self._shift = _single("translation", left @ pose.translation_m)

    def registered(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the depth of each pixel of the left image.

        Parameters
        ----------
        depth_m : (h, w) ndarray of float32
            The depth camera's image, in metres; what is not positive or not finite is none.

        Returns
        -------
        (H, W) ndarray of float32
            In metres, in the left camera; 0 where there is none.

        Raises
        ------
        TypeError, ValueError
            If the depth image is not such an array, or not of the size that its camera is calibrated for.
        """
        check_array("depth", depth_m, np.float32, ("h", "w"))
        self._depth_camera.check_size(depth_m.shape)
        depth_m = np.ascontiguousarray(depth_m)
        nearest = np.zeros(self._shape, np.float32)
        draw_nearest(project(depth_m, self._rotation, self._shift), depth_m, self._rotation, nearest)
        return np.divide(np.float32(1), nearest, out=nearest, where=nearest > 0)


def _matrix(camera: StereoCamera) -> NDArray[np.float64]:
    """Return the matrix (3, 3) that projects points of a camera into its left image."""
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], np.float64)


def _single(name: str, projection: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return a part of the projection in single precision; raises ValueError where it is absurdly large."""
    if not np.abs(projection).max() < _MAX_PROJECTION:
        raise ValueError(f"{name} to the left image is {projection.tolist()} [px, px m]; check pose and focal lengths")
    return projection.astype(np.float32)
