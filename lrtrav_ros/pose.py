"""Where one coordinate frame is in another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.checks import check_array, check_finite, check_rotation, check_type, is_rotation

_QUATERNION = "quaternion (x y z w)"
_MAX_NORM_ERROR = 0.01
"""A quaternion that was rounded to three digits still counts as a rotation."""


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """The pose of a frame in another one, called the target: `rotation` @ point + `translation_m` is the point there.

    Parameters
    ----------
    rotation : (3, 3) ndarray of float64
        Turns the frame's vectors into those of the target.
    translation_m : (3,) ndarray of float64
        The frame's origin in the target, in metres.

    Raises
    ------
    TypeError, ValueError
        If an array is not such a one, or the rotation is none.
    """

    rotation: NDArray[np.float64]
    translation_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        check_rotation("rotation", self.rotation)
        check_array("translation", self.translation_m, np.float64, (3,))
        check_finite("translation", self.translation_m)

    @classmethod
    def of_quaternion(cls, translation_m: Sequence[float], quaternion: Sequence[float]) -> Pose:
        """Return the pose of a translation x, y, z [m] and a quaternion x, y, z, w, as ROS messages hold them.

        Raises
        ------
        ValueError
            If there are more or fewer numbers, one is not finite, or the quaternion is not of length 1, to within a
            hundredth.
        """
        translation, q = _numbers("translation (x y z)", translation_m, 3), _numbers(_QUATERNION, quaternion, 4)
        norm = float(np.linalg.norm(q.clip(-2, 2)))  # squares of what is much larger may be infinite
        if not abs(norm - 1) <= _MAX_NORM_ERROR:
            raise ValueError(f"{_QUATERNION} {q.tolist()} has length {norm:.3g}; give one of length 1")
        (x, y, z), w = q[:3] / norm, q[3] / norm
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return cls(np.eye(3) + 2 * w * cross + 2 * cross @ cross, translation)

    @classmethod
    def parsed(cls, text: str) -> Pose:
        """Return the pose that seven numbers spell, or six: ``x y z qx qy qz qw`` or ``x y z roll pitch yaw``.

        Metres and radians; roll, pitch and yaw turn about the target's axes x, y and z, one after the other, as in
        URDF. Commas may stand between the numbers.

        Raises
        ------
        ValueError
            If the text is anything else.
        """
        words = text.replace(",", " ").split()
        remedy = "give x y z qx qy qz qw or x y z roll pitch yaw [m, rad]"
        try:
            numbers = [float(word) for word in words]
        except ValueError as err:
            raise ValueError(f"pose is {text!r}; {remedy}") from err
        if len(numbers) not in (6, 7) or not np.isfinite(numbers).all():
            raise ValueError(f"pose is {text!r}, which is not six or seven finite numbers; {remedy}")
        translation, rest = numbers[:3], numbers[3:]
        return cls.of_quaternion(translation, rest if len(rest) == 4 else _quaternion(*rest))

    def inverse(self) -> Pose:
        """Return the pose of the target in this frame."""
        return Pose(np.ascontiguousarray(self.rotation.T), -self.rotation.T @ self.translation_m)

    def __matmul__(self, inner: Pose) -> Pose:
        """Return the pose in this one's target of a frame whose pose in this frame is `inner`."""
        check_type("inner", inner, Pose)
        shift = self.rotation @ inner.translation_m + self.translation_m
        return Pose(_nearest_rotation(self.rotation @ inner.rotation), shift)


def _numbers(name: str, values: Sequence[float], n: int) -> NDArray[np.float64]:
    """Return as many numbers as there have to be; raises ValueError where they are not."""
    try:
        numbers = np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError) as err:
        raise ValueError(f"{name} is {values!r}; give {n} numbers") from err
    if numbers.shape != (n,):
        raise ValueError(f"{name} is {values!r}; give {n} numbers")
    return numbers


def _nearest_rotation(product: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a product of rotations, or the rotation nearest to it where the errors of both add up to too much."""
    if is_rotation(product):
        return product
    left, _, right = np.linalg.svd(product)
    return left @ right


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion x, y, z, w of rotations about the fixed axes x, y and z."""
    halves = (roll / 2, pitch / 2, yaw / 2)
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(half), math.sin(half)) for half in halves)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
