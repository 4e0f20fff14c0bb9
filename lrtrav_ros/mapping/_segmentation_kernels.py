"""Compiled parts of the segmentation. The arguments are checked, and the method explained, in `segmentation`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method.ground import OBSTACLE
from lrtrav_ros.numerics.kernels import kernel

_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_NONE = np.float32(np.nan)
_FARTHEST_M = np.float32(1e30)  # what is aside of the camera is farther still, and has to stay finite


@kernel
def points(
    disparity: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
    line: NDArray[np.float64],
    camera: NDArray[np.float64],
    clearance: float,
) -> NDArray[np.float32]:
    """Return the point of each pixel, in the optical frame; NaN for none.

    `camera` is fx, fy, cx, cy and fx times the baseline; `clearance` is a share of the camera's height.
    """
    height, width = disparity.shape
    found = np.empty((height, width, 3), np.float32)
    at, ground, standing = np.empty(width, np.float32), np.empty(width, np.float32), np.zeros(width, np.float32)
    across = ((np.arange(width) - camera[2]) / camera[0]).astype(np.float32)
    for v in range(height - 1, -1, -1):
        _ground_disparities(line, v, at, ground)
        down = np.float32((v - camera[3]) / camera[1])
        _stand(disparity[v], occupancy[v], at, ground, np.float32(line[3]), np.float32(clearance), standing)
        _write(ground, across, down, np.float32(camera[4]), found[v])
    return found


@kernel
def _ground_disparities(
    line: NDArray[np.float64], v: int, at: NDArray[np.float32], disparities: NDArray[np.float32]
) -> None:
    """Write the line in a row, and the disparity of the ground; 0 where it ends."""
    start, tilt, bend4 = np.float32(line[0] * v + line[1]), np.float32(line[2]), np.float32(4 * line[3])
    for u in range(at.size):
        at[u] = start + tilt * np.float32(u)
        squared = at[u] * at[u] - bend4
        root = (at[u] + np.sqrt(max(squared, _ZERO))) * _HALF
        disparities[u] = root if (at[u] > _ZERO) & (squared > _ZERO) else _ZERO


@kernel
def _stand(
    disparity: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
    at: NDArray[np.float32],
    ground: NDArray[np.float32],
    bend: np.float32,
    clearance: np.float32,
    standing: NDArray[np.float32],
) -> None:
    """Replace the ground's disparity in a row by that of what is seen; 0 for none.

    The rows come from the bottom up; `standing` is the disparity of the obstacle that stands in each column.
    """
    for u in range(disparity.size):
        d, below = disparity[u], ground[u]
        if occupancy[u] != OBSTACLE:
            standing[u] = _ZERO
            ground[u] = d if d > _ZERO else below
            continue
        if d > _ZERO:
            standing[u] = max(d, below)
        elif standing[u] == _ZERO:
            standing[u] = below
        ground[u] = standing[u] if max(d, below) > _ZERO else _ZERO
        if ground[u] > _ZERO and _ONE - (at[u] - bend / ground[u]) / ground[u] > clearance:
            ground[u] = _ZERO


@kernel
def _write(
    disparity: NDArray[np.float32],
    across: NDArray[np.float32],
    down: np.float32,
    scale: np.float32,
    row: NDArray[np.float32],
) -> None:
    """Write the points of a row; NaN where there is no disparity, or so little that the point is no number."""
    for u in range(disparity.size):
        z = scale / disparity[u]
        z = z if z < _FARTHEST_M else _NONE
        row[u, 0] = across[u] * z
        row[u, 1] = down * z
        row[u, 2] = z
