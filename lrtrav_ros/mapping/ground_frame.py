"""The frame on the ground that maps are drawn in, and the camera's pose over it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.numerics.checks import check_array, check_number, check_range, check_rotation, check_type
from lrtrav_ros.pose import Pose

_LONGEST = 1e100  # of the direction up: squares stay finite, and those of its inverse above 0
_LEAST_ACROSS = 1e-6  # of the direction up: less is lost in rounding


@dataclass(frozen=True, slots=True, eq=False)
class GroundFrame:
    """Where a camera is over the ground.

    The origin is the camera's foot point, x points ahead (where the camera looks, along the ground), y to the left and
    z up. Where the ground bends, z = 0 is the plane that touches it below the camera.

    Parameters
    ----------
    rotation : (3, 3) ndarray of float64
        Turns vectors of the camera's optical frame (x right, y down, z forward) into this frame.
    height_m : float
        Height of the camera over the ground, in metres.

    Raises
    ------
    TypeError, ValueError
        If the rotation is not such an array, or no rotation, or the height is not above 0.
    """

    rotation: NDArray[np.float64]
    height_m: float

    def __post_init__(self) -> None:
        check_rotation("rotation", self.rotation)
        object.__setattr__(self, "height_m", check_number("height_m", self.height_m, above=0))

    @classmethod
    def of(cls, line: GroundLine, camera: StereoCamera) -> GroundFrame:
        """Return the frame of a ground line, seen by a camera; raises TypeError if one is something else."""
        check_type("line", line, GroundLine)
        check_type("camera", camera, StereoCamera)
        # The ground's disparity fB / Z = line(u, v), times Z, is a plane in space: down . P = fB.
        at_centre = line.slope * camera.cy + line.intercept + line.tilt * camera.cx
        down = np.array([line.tilt * camera.fx, line.slope * camera.fy, at_centre])
        return cls.from_up(-down, line.camera_height_m(camera))

    @classmethod
    def from_up(cls, up: NDArray[np.float64], height_m: float) -> GroundFrame:
        """Return the frame of a camera that knows where up is.

        Parameters
        ----------
        up : (3,) ndarray of float64
            The direction up, of any length from 1e-100 to 1e100, in the camera's optical frame; not along the camera's
            axis.
        height_m : float
            Height of the camera over the ground, in metres.

        Raises
        ------
        TypeError, ValueError
            If there is no such frame.
        """
        check_array("up", up, np.float64, (3,))
        check_range("up", up, -_LONGEST, _LONGEST)
        length = float(np.linalg.norm(up))
        if length * _LONGEST < 1 or not _LEAST_ACROSS * length < math.hypot(up[0], up[1]):
            raise ValueError(f"up is {up.tolist()}; give a direction across the camera's axis, or nothing is ahead")
        up = up / length
        ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
        ahead /= np.linalg.norm(ahead)
        return cls(np.stack([ahead, np.cross(up, ahead), up]), height_m)

    @property
    def up(self) -> NDArray[np.float64]:
        """The direction up in the camera's optical frame, a unit vector (3,) of float64."""
        return self.rotation[2]

    def from_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of the camera's optical frame in this one.

        Parameters
        ----------
        points : (..., 3) ndarray of float64
            In metres.

        Returns
        -------
        (..., 3) ndarray of float64

        Raises
        ------
        TypeError, ValueError
            If `points` is not such an array.
        """
        _check_points(points)
        with np.errstate(invalid="ignore"):  # what is not finite stays so
            return points @ self.rotation.T + np.array([0.0, 0.0, self.height_m])

    def to_camera(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points of this frame in the camera's optical frame.

        Parameters
        ----------
        points : (..., 3) ndarray of float64
            In metres.

        Returns
        -------
        (..., 3) ndarray of float64

        Raises
        ------
        TypeError, ValueError
            If `points` is not such an array.
        """
        _check_points(points)
        with np.errstate(invalid="ignore"):  # what is not finite stays so
            return (points - np.array([0.0, 0.0, self.height_m])) @ self.rotation

    @property
    def pose_in_camera(self) -> Pose:
        """The pose of this frame in the camera's optical frame."""
        return Pose(np.ascontiguousarray(self.rotation.T), -self.height_m * self.up)

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """The rotation as a unit quaternion x, y, z, w, with w at least 0: the camera's orientation in this frame."""
        from scipy.spatial.transform import Rotation

        x, y, z, w = Rotation.from_matrix(self.rotation).as_quat()
        sign = -1.0 if w < 0 else 1.0
        return (sign * float(x), sign * float(y), sign * float(z), sign * float(w))


def _check_points(points: NDArray[np.float64]) -> None:
    check_array("points", points, np.float64, (3,), ("N", 3), ("H", "W", 3), may_be_empty=True)


def ground_frame_id(camera_frame_id: str) -> str:
    """Return the name of the ground frame below a camera, of which `camera_frame_id` names the optical frame."""
    return f"{camera_frame_id}_ground"
