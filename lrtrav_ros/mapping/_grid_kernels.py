"""Compiled parts of the grid. The arguments are checked, and the method explained, in `grid`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN
from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

FREE, OCCUPIED, UNSEEN = 0, 100, -1

_LEAST_HEIGHT_M = 0.05  # of a thing: what covers fewer rows is a speck
_LEAST_GROUND_PX = 3  # rows: less ground than this within a thing is a speck
_FACE_M = 0.3  # so much of a face, from its foot up, tells its disparity
_FACE_PX = (4, 32)  # rows, at least and at most
_FACE_ROWS = 10  # that are looked at
_BESIDE_PX = 2  # columns that are looked at besides, to the left and the right
_LEAST_SAMPLES = 3
_SAME, _SAME_PX = (
    0.9,
    0.6,
)  # a face farther away than the ground at its foot, by more than this, is mismatched or a drop
_NEARER, _NEARER_PX = 1.03, 0.6  # what is nearer than a face by more than this is a thing of its own
_STREAK_M, _STREAK_PX = 0.1, 4  # height from which on such a thing hides what is seen below it
_FEET_SHARE = 0.5  # of the columns that see a cell
_HANGING_SHARE, _LEAST_HANGING_PX = 0.25, 3  # of the pixels that a cell's side covers
_FREE_MARGIN_PX = 1.0  # rows on either side of what is free
_PARTS = 3  # along each side of a cell that is drawn anew
_ZERO, _TINY = np.float32(0), np.float32(1e-3)


class View(NamedTuple):
    """The camera over the ground: calibration, fx times the baseline, height, rotation (3, 3), and the ground line."""

    fx: float
    fy: float
    cx: float
    cy: float
    focal_baseline: float
    height: float
    rotation: NDArray[np.float64]
    slope: float
    intercept: float
    tilt: float
    bend: float


class Layout(NamedTuple):
    """Size of cells, half the grid's width, length of the longest row, and clearance, in metres."""

    cell: float
    half_width: float
    longest_row: float
    clearance: float


class _Columns(NamedTuple):
    """What a column has shown up to a row: whether that is a thing, its disparity, what is nearer, and ground."""

    inside: NDArray[np.uint8]  # whether what is seen is a thing, or hidden by one
    nearer: NDArray[np.float32]  # from this disparity on, something else is before that thing
    n_ground: NDArray[np.uint8]  # pixels of ground since the last of a thing, as far as they matter
    n_hanging: NDArray[np.int32]  # pixels on end of what is before the thing
    hanging: NDArray[np.float32]  # their least disparity
    hides: NDArray[np.float32]  # ground farther away than this disparity is seen below something that hangs


@inlined_kernel
def _ground_disparity(v: float, u: float, view: View) -> float:
    """Disparity of the ground line at a pixel; 0 from the horizon up, and beyond a crest."""
    line = view.slope * v + view.intercept + view.tilt * u
    squared = line * line - 4 * view.bend
    return (line + math.sqrt(squared)) / 2 if line > 0 and squared > 0 else 0.0


@inlined_kernel
def _height(disparity: float, v: float, u: float, view: View) -> float:
    """Height of a pixel over the ground below it, in metres."""
    line = view.slope * v + view.intercept + view.tilt * u
    return view.height * (disparity + view.bend / disparity - line) / disparity


@inlined_kernel
def _row_length(disparity: float, view: View) -> float:
    """How much of the way ahead a row covers where the ground has a disparity, in metres."""
    squared = disparity * disparity - view.bend
    return view.focal_baseline * view.slope / squared if squared > 0 else math.inf


@inlined_kernel
def _rows_of(height_m: float, disparity: float, view: View) -> float:
    """How many rows something upright covers at a disparity."""
    return height_m * disparity * view.fy / view.focal_baseline


@inlined_kernel
def _cell_of(
    disparity: float, v: float, u: float, view: View, layout: Layout, shape: tuple[int, int]
) -> tuple[int, int]:
    """Row and column of the cell that a pixel is in; -1 for none."""
    depth = view.focal_baseline / disparity
    right, down = (u - view.cx) / view.fx, (v - view.cy) / view.fy
    turn = view.rotation
    x = depth * (turn[0, 0] * right + turn[0, 1] * down + turn[0, 2]) / layout.cell
    y = (depth * (turn[1, 0] * right + turn[1, 1] * down + turn[1, 2]) + layout.half_width) / layout.cell
    if not (0 <= x < shape[1] and 0 <= y < shape[0]):
        return -1, -1
    return int(y), int(x)


@kernel
def find_things(
    short_range: NDArray[np.uint8],
    rising: NDArray[np.uint8],
    disparity: NDArray[np.float32],
    view: View,
    layout: Layout,
    occupancy: NDArray[np.uint8],
    feet: NDArray[np.int32],
    hanging: NDArray[np.int32],
) -> None:
    """Count for each cell the columns in which a thing begins there, and the pixels of things before others.

    Columns are followed from the bottom up. Ground in `occupancy` that is not sure is overwritten with unknown.
    """
    height, width = occupancy.shape
    columns = _Columns(
        np.zeros(width, np.uint8),
        np.zeros(width, np.float32),
        np.full(width, _LEAST_GROUND_PX, np.uint8),
        np.zeros(width, np.int32),
        np.zeros(width, np.float32),
        np.zeros(width, np.float32),
    )
    samples = np.empty(_FACE_PX[1] * (2 * _BESIDE_PX + 1), np.float32)
    is_new = np.empty(width, np.uint8)
    tilt, bend, low = np.float32(view.tilt), np.float32(view.bend), np.float32(layout.clearance / view.height)
    for v in range(height - 1, -1, -1):
        disparities = disparity[v]
        start = np.float32(view.slope * v + view.intercept)
        _follow(occupancy[v], short_range[v], rising[v], disparities, start, tilt, bend, low, columns, is_new)
        for u in range(width):
            if is_new[u]:
                if columns.inside[u]:
                    _pass_nearer(disparities[u], v, u, view, layout, columns, hanging)
                else:
                    _begin_thing(occupancy, disparity, v, u, view, layout, samples, columns, feet)
    for u in range(width):
        if columns.hides[u] > 0:
            _hide_behind(columns.hides[u], 0, u, view, occupancy)


@kernel
def _follow(
    classes: NDArray[np.uint8],
    shorts: NDArray[np.uint8],
    risings: NDArray[np.uint8],
    disparities: NDArray[np.float32],
    start: np.float32,
    tilt: np.float32,
    bend: np.float32,
    low: np.float32,
    columns: _Columns,
    is_new: NDArray[np.uint8],
) -> None:
    """Go on by a row, and flag where a thing begins, or something lower than the clearance is nearer than it.

    `start` is the ground line in column 0, and `low` the clearance as a share of the camera's height. What is
    measured and contradicts its class becomes unknown: ground that is not on the ground, a thing that is. There is no
    branch.
    """
    inside, nearer, n_ground, n_hanging = columns.inside, columns.nearer, columns.n_ground, columns.n_hanging
    for u in range(classes.size):
        current, is_measured, is_inside = classes[u], disparities[u] > _ZERO, inside[u] > 0
        is_off = (current == GROUND) & (shorts[u] != GROUND) & is_measured
        is_on = (current == OBSTACLE) & (risings[u] == GROUND) & is_measured & (not is_inside)
        is_ground, is_thing = (current == GROUND) & (not is_off), (current == OBSTACLE) & (not is_on)
        count = np.uint8(0) if is_thing & is_inside else n_ground[u] + np.uint8(is_ground)
        count = min(count, np.uint8(_LEAST_GROUND_PX))
        is_inside &= count < np.uint8(_LEAST_GROUND_PX)
        above = disparities[u] - (start + tilt * np.float32(u)) + bend / max(disparities[u], _TINY)
        is_low = (above > _ZERO) & (above < low * disparities[u])
        is_nearer = (disparities[u] > nearer[u]) & is_low
        classes[u] = np.uint8(UNKNOWN) if is_off | is_on else current
        n_ground[u], inside[u] = count, np.uint8(is_inside)
        is_new[u] = np.uint8(is_thing & (is_nearer | (not is_inside)))
        n_hanging[u] = 0 if is_thing & (not is_nearer) else n_hanging[u]


@kernel
def _begin_thing(
    occupancy: NDArray[np.uint8],
    disparity: NDArray[np.float32],
    v: int,
    u: int,
    view: View,
    layout: Layout,
    samples: NDArray[np.float32],
    columns: _Columns,
    feet: NDArray[np.int32],
) -> None:
    """Place what begins at a pixel, above ground, the unknown or the image's edge; a speck becomes unknown."""
    ground = _ground_disparity(v + 0.5, u, view)
    place = 0.0
    if ground > 0:
        n_rows = int(min(max(_rows_of(_FACE_M, ground, view), _FACE_PX[0]), _FACE_PX[1]))
        measured, n_marked = _face(occupancy, disparity, v, u, n_rows, samples)
        if n_marked < min(_rows_of(_LEAST_HEIGHT_M, ground, view), n_rows):
            occupancy[v, u] = UNKNOWN
            return
        # The face's disparity is more precise than the row of its foot, which is lost among what a robot can climb.
        place = measured if measured > _SAME * ground - _SAME_PX and measured > 0 else ground
    columns.inside[u], columns.n_ground[u], columns.n_hanging[u] = 1, 0, 0
    columns.nearer[u] = _NEARER * place + _NEARER_PX
    if place > 0 and _height(place, v, u, view) < layout.clearance:
        _hide_behind(place, v + 1, u, view, occupancy)
        if _row_length(place, view) <= layout.longest_row:
            _count_foot(place, v, u, view, layout, feet)


@kernel
def _face(
    occupancy: NDArray[np.uint8],
    disparity: NDArray[np.float32],
    v: int,
    u: int,
    n_rows: int,
    samples: NDArray[np.float32],
) -> tuple[float, int]:
    """Return the median disparity of a face from its foot up, 0 for none, and how many rows go on without ground."""
    n, row, step = 0, v, max(n_rows // _FACE_ROWS, 1)
    left, right = max(u - _BESIDE_PX, 0), min(u + _BESIDE_PX + 1, occupancy.shape[1])
    while row > v - n_rows and row >= 0 and occupancy[row, u] != GROUND:
        if (v - row) % step == 0:
            for column in range(left, right, _BESIDE_PX):
                samples[n] = disparity[row, column]
                n += (disparity[row, column] > 0) & (occupancy[row, column] != GROUND)
        row -= 1
    return (_median(samples, n) if n >= _LEAST_SAMPLES else 0.0), v - row


@kernel
def _median(values: NDArray[np.float32], n: int) -> float:
    """Return the median of the first n values, which are put in order."""
    for i in range(1, n):
        value, k = values[i], i
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value
    return (values[(n - 1) // 2] + values[n // 2]) / 2


@kernel
def _count_foot(disparity: float, v: int, u: int, view: View, layout: Layout, feet: NDArray[np.int32]) -> None:
    """Count a column's foot in the cells that it covers, half a cell behind where it begins; there are no gaps."""
    depth = view.focal_baseline / disparity
    behind = view.focal_baseline / (depth + layout.cell / 4)
    n = max(1, math.ceil(depth / view.fx / layout.cell))
    for i in range(n):
        row, column = _cell_of(behind, v, u - 0.5 + (i + 0.5) / n, view, layout, feet.shape)
        if row >= 0:
            feet[row, column] += 1


@kernel
def _pass_nearer(
    disparity: float, v: int, u: int, view: View, layout: Layout, columns: _Columns, hanging: NDArray[np.int32]
) -> None:
    """Count a pixel of something before the thing that the column shows: a branch over it, a crown, a table's top."""
    least = columns.hanging[u] if columns.n_hanging[u] > 0 else disparity
    columns.hanging[u] = min(least, disparity)
    columns.n_hanging[u] += 1
    if columns.n_hanging[u] >= max(_STREAK_PX, _rows_of(_STREAK_M, disparity, view)):
        columns.hides[u] = max(columns.hides[u], columns.hanging[u])
    row, column = _cell_of(disparity, v, u, view, layout, hanging.shape)
    if row >= 0:
        hanging[row, column] += 1


@kernel
def _hide_behind(disparity: float, first: int, u: int, view: View, occupancy: NDArray[np.uint8]) -> None:
    """Set ground of a column to unknown, from a row down to where it is as near as a disparity."""
    for v in range(first, occupancy.shape[0]):
        if _ground_disparity(v, u, view) >= disparity:
            break
        if occupancy[v, u] == GROUND:
            occupancy[v, u] = UNKNOWN


@kernel
def fill_cells(
    occupancy: NDArray[np.uint8],
    view: View,
    layout: Layout,
    feet: NDArray[np.int32],
    hanging: NDArray[np.int32],
    cells: NDArray[np.int8],
) -> None:
    """Write the cells: occupied by what was counted in them, free where nothing but ground is seen in them."""
    n_y, n_x = cells.shape
    turn, cell, aspect, width = view.rotation, layout.cell, view.fy / view.fx, occupancy.shape[1]
    fall = view.height * view.bend / view.focal_baseline**2
    for i_y in range(n_y):
        y = (i_y + 0.5) * cell - layout.half_width
        for i_x in range(n_x):
            x = (i_x + 0.5) * cell
            z = -view.height  # below the camera
            depth = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z
            for _ in range(2 if fall else 0):
                z = -view.height - fall * depth * depth
                depth = turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z
            cells[i_y, i_x] = UNSEEN
            if not depth > 0:
                continue
            per_metre = view.fx / depth
            if feet[i_y, i_x] | hanging[i_y, i_x] and _is_occupied(
                feet, hanging, i_y, i_x, max(cell * per_metre, 1.0), aspect
            ):
                cells[i_y, i_x] = OCCUPIED
                continue
            u = view.cx + per_metre * (turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z)
            if not 0 <= u < width:
                continue
            length = _row_length(per_metre * view.focal_baseline / view.fx, view)
            if length <= layout.longest_row:
                v = view.cy + per_metre * aspect * (turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z)
                half_v = max(cell * turn[0, 2] / length / 2, _FREE_MARGIN_PX)
                if _is_free(occupancy, v, u, half_v, cell * per_metre / 2):
                    cells[i_y, i_x] = FREE


@inlined_kernel
def _is_occupied(
    feet: NDArray[np.int32], hanging: NDArray[np.int32], row: int, column: int, seen_columns: float, aspect: float
) -> bool:
    """Return whether enough was counted in a cell that `seen_columns` see; feet count with those in its neighbours."""
    if hanging[row, column] >= max(_HANGING_SHARE * seen_columns * seen_columns * aspect, _LEAST_HANGING_PX):
        return True
    if feet[row, column] == 0:
        return False
    total = 0
    for i in range(max(row - 1, 0), min(row + 2, feet.shape[0])):
        for k in range(max(column - 1, 0), min(column + 2, feet.shape[1])):
            total += feet[i, k]
    return total >= _FEET_SHARE * seen_columns


@inlined_kernel
def _is_free(occupancy: NDArray[np.uint8], v: float, u: float, half_v: float, half_u: float) -> bool:
    """Return whether there is ground in the middle and on the edges of a part of the image, all of which is seen."""
    height, width = occupancy.shape
    if not (half_u <= u + 0.5 < width - half_u and half_v <= v + 0.5 < height - half_v):
        return False
    if occupancy[int(v + 0.5), int(u + 0.5)] != GROUND:
        return False
    is_free = True
    for k in range(-1, 2):
        for m in range(-1, 2):
            is_free &= occupancy[int(v + k * half_v + 0.5), int(u + m * half_u + 0.5)] == GROUND
    return is_free


@kernel
def resample(
    cells: NDArray[np.int8], cos: float, sin: float, offset_x: float, offset_y: float, turned: NDArray[np.int8]
) -> None:
    """Write the cells of a grid that is turned to the left against another, whose corner is at an offset, in cells."""
    n_rows, n_columns = cells.shape
    for i_y in range(turned.shape[0]):
        for i_x in range(turned.shape[1]):
            value = UNSEEN
            for part in range(_PARTS * _PARTS):
                a, b = i_x + (part % _PARTS + 0.5) / _PARTS, i_y + (part // _PARTS + 0.5) / _PARTS
                x, y = cos * a + sin * b + offset_x, cos * b - sin * a + offset_y
                if not (0 <= x < n_columns and 0 <= y < n_rows):
                    continue
                row, column = int(y), int(x)
                if cells[row, column] == OCCUPIED:
                    value = OCCUPIED
                    break
                if part == _PARTS * _PARTS // 2:
                    value = cells[row, column]
            turned[i_y, i_x] = value
