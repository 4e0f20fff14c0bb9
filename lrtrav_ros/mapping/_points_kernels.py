"""Compiled parts of the point clouds. The arguments are checked, and the method explained, in `points`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method.ground import GROUND, OBSTACLE
from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

_BITS = 21  # of each of the three numbers of a cell
_MASK = (1 << _BITS) - 1
_OFFSET = 1 << (_BITS - 1)
_FEW = 1 << 12  # slots of a hash table to begin with, a power of 2
_SUMS = 5  # numbers that are kept of a cell
_SPREAD = np.uint64(0x9E3779B97F4A7C15)  # odd, and its bits are well mixed
_SHIFT = 40  # its upper bits are mixed best
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


@kernel
def obstacle_points(
    disparity: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
    line: NDArray[np.float64],
    camera: NDArray[np.float64],
    up: NDArray[np.float64],
    heights: NDArray[np.float64],
    least_disparity: float,
    cell: float,
    least_share: float,
) -> NDArray[np.float32]:
    """Return the mean of what stands in each voxel, or lies below the ground, in the optical frame.

    `camera` is fx, fy, cx, cy and fx times the baseline; `up` is of unit length; `heights` are the least and the
    greatest of what counts, as shares of the camera's height.
    """
    height, width = disparity.shape
    above, columns = np.empty(width, np.float32), np.empty(width, np.int32)
    least, most, nearest = np.float32(heights[0]), np.float32(heights[1]), np.float32(least_disparity)
    n_pixels = _count(occupancy, OBSTACLE)
    slots, keys, sums = np.zeros(_FEW, np.int32), np.empty(n_pixels, np.int64), np.empty((n_pixels, _SUMS))
    n = 0
    for v in range(height):
        _heights(disparity[v], line, v, above)
        selected = columns[: _select(occupancy[v], disparity[v], above, least, most, nearest, columns)]
        slots = _with_room(slots, keys, n, selected.size)
        n = _add_obstacles(
            disparity[v], above, selected, v, line, camera, up, least_disparity, cell, slots, keys, sums, n
        )
    return _means(sums[:n], least_share)


@kernel
def _add_obstacles(
    disparity: NDArray[np.float32],
    above: NDArray[np.float32],
    columns: NDArray[np.int32],
    v: int,
    line: NDArray[np.float64],
    camera: NDArray[np.float64],
    up: NDArray[np.float64],
    least_disparity: float,
    cell: float,
    slots: NDArray[np.int32],
    keys: NDArray[np.int64],
    sums: NDArray[np.float64],
    n: int,
) -> int:
    """Add some pixels of a row to the `n` voxels that there are, and return how many there are then."""
    right, down, scale = 1 / camera[0], (v - camera[3]) / camera[1], camera[4]
    per_metre = 1 / cell
    per_pixel = per_metre * per_metre / (camera[0] * camera[1])  # of a voxel's face, at a depth of 1 m
    index, last = 0, -1
    for i in range(columns.size):
        u = columns[i]
        z = scale / disparity[u]
        share, lift = z * z * per_pixel, 0.0
        if above[u] < _ZERO:
            ground = _ground(line[0] * v + line[1] + line[2] * u, line[3])
            if ground < least_disparity:
                continue
            z, share, lift = scale / ground, 1.0, cell
        x, y, z = (u - camera[2]) * right * z + lift * up[0], down * z + lift * up[1], z + lift * up[2]
        key = _key(x * per_metre, y * per_metre, z * per_metre)
        if key != last:
            index, last = _find(slots, keys, n, key), key
            if index == n:
                sums[n] = 0.0
                n += 1
        _add(sums[index], x, y, z, share)
    return n


@kernel
def free_points(
    occupancy: NDArray[np.uint8],
    line: NDArray[np.float64],
    camera: NDArray[np.float64],
    rotation: NDArray[np.float64],
    least_disparity: float,
    cell: float,
) -> NDArray[np.float32]:
    """Return the mean of what is free ground in each cell on the ground, in the optical frame.

    `rotation` turns the optical frame into the one of the cells, whose third axis is up.
    """
    height, width = occupancy.shape
    depths = np.empty(width)
    n_pixels = _count(occupancy, GROUND)
    slots, keys, sums = np.zeros(_FEW, np.int32), np.empty(n_pixels, np.int64), np.empty((n_pixels, _SUMS))
    n = 0
    for v in range(height):
        if _count(occupancy[v : v + 1], GROUND) == 0:
            continue
        _depths(line, v, camera[4], least_disparity, depths)
        slots = _with_room(slots, keys, n, width)
        n = _add_ground(occupancy[v], depths, v, camera, rotation, cell, slots, keys, sums, n)
    return _means(sums[:n], 0.0)


@kernel
def _add_ground(
    occupancy: NDArray[np.uint8],
    depths: NDArray[np.float64],
    v: int,
    camera: NDArray[np.float64],
    rotation: NDArray[np.float64],
    cell: float,
    slots: NDArray[np.int32],
    keys: NDArray[np.int64],
    sums: NDArray[np.float64],
    n: int,
) -> int:
    """Add the ground in a row to the `n` cells that there are, and return how many there are then."""
    right, down, per_metre = 1 / camera[0], (v - camera[3]) / camera[1], 1 / cell
    index, last = 0, -1
    for u in range(occupancy.size):
        z = depths[u]
        if occupancy[u] != GROUND or z <= 0:
            continue
        x, y = (u - camera[2]) * right * z, down * z
        ahead = rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z
        left = rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z
        key = _key(ahead * per_metre, left * per_metre, 0.0)
        if key != last:
            index, last = _find(slots, keys, n, key), key
            if index == n:
                sums[n] = 0.0
                n += 1
        _add(sums[index], x, y, z, 1.0)
    return n


@kernel
def _heights(disparity: NDArray[np.float32], line: NDArray[np.float64], v: int, heights: NDArray[np.float32]) -> None:
    """Write the heights of a row's pixels over the ground at their depth, as shares of the camera's height."""
    start, tilt, bend = np.float32(line[0] * v + line[1]), np.float32(line[2]), np.float32(line[3])
    for u in range(disparity.size):
        inverse = _ONE / disparity[u]
        heights[u] = _ONE - (start + tilt * np.float32(u) - bend * inverse) * inverse


@kernel
def _select(
    occupancy: NDArray[np.uint8],
    disparity: NDArray[np.float32],
    heights: NDArray[np.float32],
    least: np.float32,
    most: np.float32,
    nearest: np.float32,
    columns: NDArray[np.int32],
) -> int:
    """Write the columns of a row's obstacles that are near, and of such a height or below the ground; count them."""
    n = 0
    for u in range(occupancy.size):
        columns[n] = u
        fits = (heights[u] < _ZERO) | ((heights[u] >= least) & (heights[u] <= most))
        n += (occupancy[u] == OBSTACLE) & (disparity[u] >= nearest) & fits
    return n


@kernel
def _depths(
    line: NDArray[np.float64], v: int, scale: float, least_disparity: float, depths: NDArray[np.float64]
) -> None:
    """Write the depths of the ground in a row; 0 where it ends or is too far away."""
    for u in range(depths.size):
        disparity = _ground(line[0] * v + line[1] + line[2] * u, line[3])
        depths[u] = scale / disparity if disparity >= least_disparity else 0.0


@inlined_kernel
def _ground(at: float, bend: float) -> float:
    """Return the disparity d of the ground, d + bend / d = `at`; 0 where it ends."""
    squared = at * at - 4 * bend
    root = (at + np.sqrt(max(squared, 0.0))) / 2
    return root if at > 0 and squared > 0 else 0.0


@kernel
def _count(occupancy: NDArray[np.uint8], value: int) -> int:
    """Return how many pixels have a value."""
    n = 0
    for v in range(occupancy.shape[0]):
        row = occupancy[v]
        for u in range(row.size):
            n += row[u] == value
    return n


@kernel
def _with_room(slots: NDArray[np.int32], keys: NDArray[np.int64], n: int, more: int) -> NDArray[np.int32]:
    """Return the slots of a hash table of `n` keys, or larger ones where it would be over half full with `more`."""
    size = slots.size
    while size < 2 * (n + more):
        size *= 2
    if size == slots.size:
        return slots
    larger = np.zeros(size, np.int32)
    for index in range(n):
        _find(larger, keys, index, keys[index])
    return larger


@inlined_kernel
def _key(i: float, j: float, k: float) -> int:
    """Return the number of the cell in which a point lies."""
    a, b, c = int(i + _OFFSET) & _MASK, int(j + _OFFSET) & _MASK, int(k + _OFFSET) & _MASK
    return (a << _BITS | b) << _BITS | c


@kernel
def _find(slots: NDArray[np.int32], keys: NDArray[np.int64], n: int, key: int) -> int:
    """Return the index of a key among the first `n`; `n` where it is new, and then it is entered."""
    last = slots.size - 1
    slot = np.int64((np.uint64(key) * _SPREAD) >> np.uint64(_SHIFT)) & last
    while slots[slot] > 0:
        index = int(slots[slot]) - 1
        if keys[index] == key:
            return index
        slot = (slot + 1) & last
    slots[slot] = n + 1
    keys[n] = key
    return n


@inlined_kernel
def _add(total: NDArray[np.float64], x: float, y: float, z: float, share: float) -> None:
    """Add a point to the sums of a cell: x, y, z, how many, and the share of its face that they cover."""
    total[0] += x
    total[1] += y
    total[2] += z
    total[3] += 1.0
    total[4] += share


@kernel
def _means(sums: NDArray[np.float64], least_share: float) -> NDArray[np.float32]:
    """Return the mean points of the cells of which such a share is covered."""
    points = np.empty((sums.shape[0], 3), np.float32)
    n = 0
    for i in range(sums.shape[0]):
        if sums[i, 4] >= least_share:
            for axis in range(3):
                points[n, axis] = sums[i, axis] / sums[i, 3]
            n += 1
    return points[:n].copy()
