"""Points as the bytes of a point cloud message."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.checks import check_array

FIELDS = MappingProxyType({"x": 0, "y": 4, "z": 8})
"""The fields of a point, float32 each, and where they begin in its bytes."""

FLOAT32 = 7
"""The type of the fields, as ``sensor_msgs/PointField`` numbers it."""

_POINT_BYTES = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EncodedPoints:
    """The fields of a ``sensor_msgs/PointCloud2``, little-endian and without padding; `data` is flat uint8."""

    height: int
    width: int
    point_step: int
    row_step: int
    is_dense: bool
    data: NDArray[np.uint8]


def encode_points(points: NDArray[np.float32]) -> EncodedPoints:
    """Return points as the fields of a ``sensor_msgs/PointCloud2``.

    Parameters
    ----------
    points : (N, 3) or (H, W, 3) ndarray of float32
        x, y and z; (N, 3), which may be empty, becomes one row, and (H, W, 3) an organised cloud. It is dense where no
        value is infinite or NaN.

    Raises
    ------
    TypeError, ValueError
        If it is not such an array.
    """
    check_array("points", points, np.float32, ("N", len(FIELDS)), ("H", "W", len(FIELDS)), may_be_empty=True)
    height, width = points.shape[:2] if points.ndim == 3 else (1, len(points))
    return EncodedPoints(
        height=height,
        width=width,
        point_step=_POINT_BYTES,
        row_step=_POINT_BYTES * width,
        is_dense=bool(np.isfinite(points).all()),
        data=np.ascontiguousarray(points, "<f4").reshape(-1).view(np.uint8),
    )
