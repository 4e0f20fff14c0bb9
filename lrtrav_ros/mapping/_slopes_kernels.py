"""Compiled parts of slopes. The arguments are checked, and the method explained, in `slopes`.

A strip of columns that sees a slope sees a plane: `surface` is its disparity in each row, 0 where there is none,
`fall` by how much it falls to the row above, `above` the camera's height over the plane, and `slack` how far above or
below it a pixel may be; each (strips, rows).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method.ground import GROUND
from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

_ROWS = 2  # from one row that is looked at to the next
_LEAST = 4  # pixels of a strip's row that have to have disparity
_STEEPEST_FALL = 0.05  # what falls more steeply may be the floor of a ditch
_LEAST_CLIMB = 0.02  # of a line of sight against the ground
_STEPS = 3  # times as far as the next row of ground, something behind it is seen
_GRAZING = 0.1  # share by which disparity may differ, besides so many pixels
_GRAZING_PX = 0.4
_BACK = 16  # rows at the foot of a slope in which some pixels are no ground yet
_LEAST_FALL = 1.8  # times the error of a difference, along a slope; less may be noise's
_FACE_SHARE = 0.35  # of the fall of the slope that it would be; a third of it may be the steps of disparity
_LEAST_FACE_M = 0.15  # what is lower is not told from slopes
_ZERO = np.float32(0.0)
_TINY = 1e-3


@kernel
def follow(
    disparity: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
    line: NDArray[np.float64],
    ahead: NDArray[np.float64],
    view: NDArray[np.float64],
    limits: NDArray[np.float64],
    width: int,
    surface: NDArray[np.float32],
    fall: NDArray[np.float32],
    above: NDArray[np.float32],
    slack: NDArray[np.float32],
) -> None:
    """Write the slopes that go on from the ground and are no steeper than a grade, in each strip from the bottom up.

    `ahead` is the way along the ground, per metre of depth, of row 0 and column 0, per row and per column; `view` is
    the camera's height, fx times the baseline and fy; `limits` are the steepest grade, the least rise that is judged,
    the error of a strip's disparity, the tolerance of heights and the greatest distance; `width` is that of strips.
    """
    least_fall = _LEAST_FALL * math.sqrt(2) * limits[2]
    grade, least_rise, blur, tolerance, farthest = limits[0], limits[1], limits[2] / view[1], limits[3], limits[4]
    height = disparity.shape[0]
    values = np.empty(width, np.float32)
    for strip in range(surface.shape[0]):
        left, right = strip * width, min((strip + 1) * width, disparity.shape[1])
        u = (left + right - 1) / 2
        from_row, from_d, from_x, from_z, last_row, last_x, back = -1, 0.0, 0.0, 0.0, -1, 0.0, 0
        for v in range(height - 1, -1, -_ROWS):
            if from_row < 0 and line[0] * v + line[1] + line[2] * u <= 0:
                break
            n, is_ground = _values(disparity[v, left:right], occupancy[v, left:right], values)
            if n < _LEAST or (from_row < 0 and not is_ground):
                continue
            if is_ground:
                from_row, last_row, back = v, -1, _BACK
                continue
            d = _median(values[:n])
            x, z = _place(d, v, u, line, ahead, view)
            if last_row < 0:
                n, _ = _values(disparity[from_row, left:right], occupancy[from_row, left:right], values)
                from_d = _median(values[:n])
                from_x, from_z = _place(from_d, from_row, u, line, ahead, view)
                last_row, last_x = from_row, from_x
            if x > farthest:
                break
            rise, run, error = z - from_z, x - from_x, x * x * blur
            climb = max((view[0] - z) / x + rise / max(run, least_rise), _LEAST_CLIMB)
            is_next = -error <= x - last_x <= _STEPS * (last_row - v) * x / (view[2] * climb) + error
            is_judged = max(abs(rise), grade * run) >= max(least_rise, grade * error)
            if not is_next or (is_judged and not -_STEEPEST_FALL * run <= rise <= grade * run):
                from_row = -1
                continue
            last_row, last_x = v, x
            if is_judged and from_d - d >= least_fall:
                steepness = rise / run
                over = view[0] - from_z + steepness * from_x
                per_row = (view[0] * line[0] + steepness * view[1] * ahead[1]) / over
                for row in range(v if v >= _ROWS else 0, min(from_row + back, height)):
                    at = line[0] * row + line[1] + line[2] * u
                    along = ahead[0] + ahead[1] * row + ahead[2] * u
                    surface[strip, row] = max((view[0] * at + steepness * view[1] * along) / over, 0.0)
                    fall[strip, row], above[strip, row], slack[strip, row] = per_row, over, tolerance + grade * error
                from_row, from_d, from_x, from_z, back = v, d, x, z, 0


@kernel
def spread(
    disparity: NDArray[np.float32],
    tilt: float,
    width: int,
    surface: NDArray[np.float32],
    fall: NDArray[np.float32],
    above: NDArray[np.float32],
    slack: NDArray[np.float32],
) -> None:
    """Carry slopes over to the strips beside them in rows in which a pixel of these lies on it, both ways."""
    last = surface.shape[0] - 1
    for i in range(2 * last):
        source = i if i < last else 2 * last - i
        strip = source + 1 if i < last else source - 1
        left, right = strip * width, min((strip + 1) * width, disparity.shape[1])
        step = tilt * (strip - source) * width
        for v in range(surface.shape[1]):
            if surface[strip, v] > 0 or surface[source, v] <= 0:
                continue
            expected = surface[source, v] + step
            for u in range(left, right):
                if disparity[v, u] > 0 and _agrees(disparity[v, u], expected, above[source, v], slack[source, v]):
                    surface[strip, v], fall[strip, v] = expected, fall[source, v]
                    above[strip, v], slack[strip, v] = above[source, v], slack[source, v]
                    break


@kernel
def mark(
    disparity: NDArray[np.float32],
    tilt: float,
    blur: float,
    per_metre: float,
    width: int,
    surface: NDArray[np.float32],
    fall: NDArray[np.float32],
    above: NDArray[np.float32],
    slack: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
) -> None:
    """Set to ground what lies on slopes, but for upright faces.

    `blur` is the error of a strip's disparity, `per_metre` the rows that an upright metre covers, per disparity.
    """
    for v in range(disparity.shape[0]):
        for strip in range(surface.shape[0]):
            if surface[strip, v] <= 0:
                continue
            left, right = strip * width, min((strip + 1) * width, disparity.shape[1])
            if _is_ground(occupancy[v, left:right]):
                continue
            top, bottom, most = _face(disparity[:, left:right], surface[strip], fall[strip, v], v, blur, per_metre)
            for u in range(left, right):
                d, expected = disparity[v, u], surface[strip, v] + tilt * (u - (left + right - 1) / 2)
                lies = (d > 0) & _agrees(d, expected, above[strip, v], slack[strip, v])
                lies &= disparity[bottom, u] - disparity[top, u] >= most
                occupancy[v, u] = GROUND if lies else occupancy[v, u]


@kernel
def _face(
    strip: NDArray[np.float32], surface: NDArray[np.float32], fall: float, v: int, blur: float, per_metre: float
) -> tuple[int, int, np.float32]:
    """Return the rows between which a strip is upright, up to a row or around it, and the most that a pixel may fall.

    Without such rows, no pixel falls so little.
    """
    least = math.sqrt(2) * blur / _FACE_SHARE
    n = int(max(least / max(fall, _TINY), _LEAST_FACE_M * per_metre * surface[v])) + 1
    for top in (v, v - n // 2):
        bottom = top + n
        if top < 0 or bottom >= strip.shape[0]:
            continue
        expected = fall * n
        if surface[top] > 0 and surface[bottom] > 0:
            expected = min(expected, surface[bottom] - surface[top])
        if expected >= least and _stays(strip[top], strip[bottom], np.float32(_FACE_SHARE * expected)):
            return top, bottom, np.float32(expected / 2)
    return v, v, np.float32(-math.inf)


@inlined_kernel
def _stays(upper: NDArray[np.float32], lower: NDArray[np.float32], most: np.float32) -> bool:
    """Return whether the disparity of most pixels that have one falls by less from one row to another."""
    n, n_upright = 0, 0
    for u in range(upper.size):
        is_measured = (upper[u] > _ZERO) & (lower[u] > _ZERO)
        n += is_measured
        n_upright += is_measured & (lower[u] - upper[u] < most)
    return n >= _LEAST and 2 * n_upright > n


@inlined_kernel
def _is_ground(occupancy: NDArray[np.uint8]) -> bool:
    """Return whether a strip's row is all ground."""
    n = 0
    for u in range(occupancy.size):
        n += occupancy[u] == GROUND
    return n == occupancy.size


@inlined_kernel
def _agrees(disparity: float, expected: float, above: float, slack: float) -> bool:
    """Return whether a pixel lies on a surface: near it in height, and also along lines of sight that graze it."""
    difference = abs(disparity - expected)
    return (above * difference < slack * disparity) & (difference < _GRAZING_PX + _GRAZING * expected)


@kernel
def _values(
    disparity: NDArray[np.float32], occupancy: NDArray[np.uint8], values: NDArray[np.float32]
) -> tuple[int, bool]:
    """Write the disparities of a strip's row, and return how many, and whether most of them are ground's."""
    n, n_ground = 0, 0
    for u in range(disparity.size):
        values[n] = disparity[u]
        n_ground += (disparity[u] > 0) & (occupancy[u] == GROUND)
        n += disparity[u] > 0
    return n, 2 * n_ground >= n


@inlined_kernel
def _place(
    disparity: float,
    v: float,
    u: float,
    line: NDArray[np.float64],
    ahead: NDArray[np.float64],
    view: NDArray[np.float64],
) -> tuple[float, float]:
    """Return how far ahead a pixel is, and how high above the plane that touches the ground below the camera."""
    along = view[1] / disparity * (ahead[0] + ahead[1] * v + ahead[2] * u)
    return along, view[0] * (1 - (line[0] * v + line[1] + line[2] * u) / disparity)


@kernel
def _median(values: NDArray[np.float32]) -> float:
    """Return the middle of a few values, which are put in order."""
    for i in range(1, values.size):
        value, j = values[i], i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return float(values[values.size // 2])
