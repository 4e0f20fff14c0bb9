"""Compiled parts of the registration of depth images; see `registration`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel

_ZERO, _ONE = np.float32(0), np.float32(1)
_MIN_DEPTH_M, _MAX_DEPTH_M = np.float32(1e-3), np.float32(1e6)
_MAX_PX = np.float32(1e6)  # what is seen farther outside the image is none
_MAX_STEP = np.float32(0.1)  # neighbours whose inverse depths differ by a larger part are of different surfaces
_MAX_HALF_PX = np.float32(16)  # largest half of a pixel's footprint: bounds the time, whatever the pose
_HALF = np.float32(0.55)  # footprints are a tenth larger than the pixels, so that rounding leaves no gaps
_MIN_AREA = np.float32(1e-6)


@kernel
def project(
    depth_m: NDArray[np.float32], matrix: NDArray[np.float32], shift: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return u, v and inverse depth of each pixel in the other image (3, H + 2, W + 2), within a border of 0.

    A pixel is seen at depth * (`matrix` @ (u, v, 1)) + `shift`, in homogeneous coordinates; inverse depth is 0 where
    there is none.
    """
    height, width = depth_m.shape
    points = np.zeros((3, height + 2, width + 2), np.float32)
    m00, m01, m02 = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    m10, m11, m12 = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    m20, m21, m22 = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    for v in range(height):
        y = np.float32(v)
        x0, y0, z0 = m01 * y + m02, m11 * y + m12, m21 * y + m22
        row_x, row_y, row_inverse = points[0, v + 1, 1:-1], points[1, v + 1, 1:-1], points[2, v + 1, 1:-1]
        for u in range(width):
            depth, x = depth_m[v, u], np.float32(u)
            z = depth * (m20 * x + z0) + shift[2]
            seen_x = (depth * (m00 * x + x0) + shift[0]) / z
            seen_y = (depth * (m10 * x + y0) + shift[1]) / z
            is_seen = (depth > _ZERO) & (depth < _MAX_DEPTH_M) & (z >= _MIN_DEPTH_M)
            is_seen &= (abs(seen_x) < _MAX_PX) & (abs(seen_y) < _MAX_PX)
            row_x[u] = seen_x if is_seen else _ZERO
            row_y[u] = seen_y if is_seen else _ZERO
            row_inverse[u] = _ONE / z if is_seen else _ZERO
    return points


@kernel
def _step(
    points: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    v: int,
    way: tuple[int, int],
    direction: NDArray[np.float32],
    steps: NDArray[np.float32],
) -> None:
    """Write how u, v and inverse depth (3, W) change from the pixels of row v to the next one of their surface.

    It is the change to the one of two neighbours that is more alike, thus likelier of the same surface; where neither
    is, to a pixel of the same depth. `way` is (0, 1) or (1, 0), `direction` how the projection changes along it.
    """
    dv, du = way
    for u in range(steps.shape[1]):
        x, y, inverse = points[0, v + 1, u + 1], points[1, v + 1, u + 1], points[2, v + 1, u + 1]
        x_after, x_before = points[0, v + 1 + dv, u + 1 + du] - x, x - points[0, v + 1 - dv, u + 1 - du]
        y_after, y_before = points[1, v + 1 + dv, u + 1 + du] - y, y - points[1, v + 1 - dv, u + 1 - du]
        w_after, w_before = points[2, v + 1 + dv, u + 1 + du] - inverse, inverse - points[2, v + 1 - dv, u + 1 - du]
        is_after = abs(w_after) <= abs(w_before)
        change = w_after if is_after else w_before
        is_same = abs(change) < _MAX_STEP * inverse
        scale = depth_m[v, u] * inverse if inverse > _ZERO else _ZERO
        x_square, y_square = scale * (direction[0] - x * direction[2]), scale * (direction[1] - y * direction[2])
        x_step, y_step = x_after if is_after else x_before, y_after if is_after else y_before
        steps[0, u] = x_step if is_same else x_square
        steps[1, u] = y_step if is_same else y_square
        steps[2, u] = change if is_same else _ZERO


@kernel
def _boxes(
    points: NDArray[np.float32],
    v: int,
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    shape: tuple[int, int],
    boxes: NDArray[np.int32],
    slopes: NDArray[np.float32],
) -> None:
    """Write first and last column and row that each pixel of row v covers, and how inverse depth changes there."""
    right, bottom = np.float32(shape[1] - 1), np.float32(shape[0] - 1)
    for u in range(a.shape[1]):
        x, y, inverse = points[0, v + 1, u + 1], points[1, v + 1, u + 1], points[2, v + 1, u + 1]
        half_x = min(_HALF * (abs(a[0, u]) + abs(b[0, u])), _MAX_HALF_PX)
        half_y = min(_HALF * (abs(a[1, u]) + abs(b[1, u])), _MAX_HALF_PX)
        x_low, x_high = max(np.ceil(x - half_x), _ZERO), min(np.floor(x + half_x), right)
        y_low, y_high = max(np.ceil(y - half_y), _ZERO), min(np.floor(y + half_y), bottom)
        boxes[0, u] = np.int32(min(x_low, right + _ONE))
        boxes[1, u] = np.int32(max(x_high if inverse > _ZERO else -_ONE, -_ONE))
        boxes[2, u] = np.int32(min(y_low, bottom + _ONE))
        boxes[3, u] = np.int32(max(y_high, -_ONE))
        area = a[0, u] * b[1, u] - a[1, u] * b[0, u]
        scale = _ONE / area if abs(area) > _MIN_AREA else _ZERO
        slopes[0, u] = scale * (a[2, u] * b[1, u] - b[2, u] * a[1, u])
        slopes[1, u] = scale * (a[0, u] * b[2, u] - b[0, u] * a[2, u])
        slopes[2, u] = _HALF * (abs(a[2, u]) + abs(b[2, u]))


@kernel
def _draw(
    points: NDArray[np.float32],
    v: int,
    boxes: NDArray[np.int32],
    slopes: NDArray[np.float32],
    nearest: NDArray[np.float32],
) -> None:
    """Draw the pixels of row v into their boxes."""
    for u in range(boxes.shape[1]):
        x, y, inverse = points[0, v + 1, u + 1], points[1, v + 1, u + 1], points[2, v + 1, u + 1]
        low, high = inverse - slopes[2, u], inverse + slopes[2, u]
        for row in range(boxes[2, u], boxes[3, u] + 1):
            in_row = inverse + slopes[1, u] * (np.float32(row) - y)
            for column in range(boxes[0, u], boxes[1, u] + 1):
                value = min(max(in_row + slopes[0, u] * (np.float32(column) - x), low), high)
                nearest[row, column] = max(value, nearest[row, column])


@kernel
def draw_nearest(
    points: NDArray[np.float32], depth_m: NDArray[np.float32], matrix: NDArray[np.float32], nearest: NDArray[np.float32]
) -> None:
    """Write into `nearest`, which is 0, the inverse depth of the nearest surface that each of its pixels sees.

    A point covers the box around the parallelogram that half the steps to its neighbours span; there, inverse depth
    changes as towards them, which is exact on planes. Without neighbours it is a square across the line of sight.
    """
    height, width = depth_m.shape
    a, b = np.empty((3, width), np.float32), np.empty((3, width), np.float32)
    boxes, slopes = np.empty((4, width), np.int32), np.empty((3, width), np.float32)
    for v in range(height):
        _step(points, depth_m, v, (0, 1), matrix[:, 0], a)
        _step(points, depth_m, v, (1, 0), matrix[:, 1], b)
        _boxes(points, v, a, b, nearest.shape, boxes, slopes)
        _draw(points, v, boxes, slopes, nearest)
