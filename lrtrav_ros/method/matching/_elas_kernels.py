"""Compiled parts of ELAS. The arguments are checked, and the method explained, in `elas`.

All kernels work along rows, so that the compiler vectorises them, and on bands of rows, so that bands can be given to
several threads: what a band gives does not depend on the others. Innermost loops have unsigned indices, for which
nothing has to be known about negative ones.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

Responses: TypeAlias = NDArray[np.uint8]  # of a Sobel filter, padded by 2, on the right by `PADDING` more
Flat: TypeAlias = NDArray[np.uint8]  # responses, one row after the other
Costs: TypeAlias = NDArray[np.uint16]
CostRow: TypeAlias = NDArray[np.uint16]
AnyCosts: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
Mask: TypeAlias = NDArray[np.bool_]
Disparities: TypeAlias = NDArray[np.int16]  # -1 for none
Keys: TypeAlias = NDArray[np.int32]
Runs: TypeAlias = NDArray[np.int64]  # (n, 3): disparity, first column, last column + 1

# A candidate is one int32: 16 x (cost - prior) above, its disparity in the lower bits, so that the least is the best.
DISPARITY_BITS = 9
COST_BITS = 4
_COST_SHIFT = np.int32(DISPARITY_BITS + COST_BITS)
_DISPARITY_MASK = np.int32((1 << DISPARITY_BITS) - 1)
_STEEPEST = 0.7  # px of disparity per px along the row; chosen to agree with published results
_NO_CANDIDATE = np.int32(2**31 - 1)
_CLOSED = np.int32(2**28)  # added to the key of a disparity that is no candidate; exceeds all the others
_NO_COST = np.uint16(2**16 - 1)  # has a key that exceeds `_CLOSED`
_ROUNDING = 1e-6  # px; exceeds errors of rounding, so that planes through whole numbers are not rounded down
REACH_PX = 2  # from a support point to the corners of the window over which its cost is summed
NO_PLANE = -1000  # so far from all disparities that none is near it
_BLOCK = 32  # columns that are computed at a time: loops of known length have no rest that is computed one by one
_HALF_BLOCK = 16
PADDING = 2 * _BLOCK  # columns that arrays need beyond the image's
_MOST_COLUMNS = 128  # of a run that is compared at once: what it works on stays in the first cache


@inlined_kernel
def _difference(a: np.uint8, b: np.uint8) -> np.uint8:
    """Return |a - b|."""
    return np.uint8(max(a, b) - min(a, b))


@inlined_kernel
def _add_rows(
    hl: Flat, vl: Flat, hr: Flat, vr: Flat, left: int, right: int, stride: int, n_blocks: int, outer_sums: CostRow,
    inner_sums: CostRow, centre_sums: CostRow,
) -> None:  # fmt: skip
    """Set the sums over the nine rows that begin at `left` and `right`, of two descriptors that are four rows apart.

    In the descriptors, those called outer count two columns to the left and right, inner one, and centre none.
    """
    row = np.uintp(stride)
    a0, b0 = np.uintp(left), np.uintp(right)
    for k in range(n_blocks * _BLOCK):
        i = np.uintp(k)
        a, b = a0 + i, b0 + i
        outer = np.uint16(
            _difference(hl[a + row], hr[b + row])
            + _difference(hl[a + np.uintp(3) * row], hr[b + np.uintp(3) * row])
            + _difference(hl[a + np.uintp(5) * row], hr[b + np.uintp(5) * row])
            + _difference(hl[a + np.uintp(7) * row], hr[b + np.uintp(7) * row])
        )
        middle = np.uint16(
            _difference(hl[a + np.uintp(2) * row], hr[b + np.uintp(2) * row])
            + _difference(hl[a + np.uintp(6) * row], hr[b + np.uintp(6) * row])
        )
        between = _difference(hl[a + np.uintp(4) * row], hr[b + np.uintp(4) * row])
        ends = np.uint16(
            _difference(hl[a], hr[b])
            + _difference(hl[a + np.uintp(8) * row], hr[b + np.uintp(8) * row])
            + between
            + between
        )
        beside = np.uint16(
            _difference(vl[a + np.uintp(2) * row], vr[b + np.uintp(2) * row])
            + _difference(vl[a + np.uintp(6) * row], vr[b + np.uintp(6) * row])
        )
        above = np.uint16(
            _difference(vl[a + row], vr[b + row])
            + _difference(vl[a + np.uintp(3) * row], vr[b + np.uintp(3) * row])
            + _difference(vl[a + np.uintp(5) * row], vr[b + np.uintp(5) * row])
            + _difference(vl[a + np.uintp(7) * row], vr[b + np.uintp(7) * row])
        )
        outer_sums[i] = outer
        inner_sums[i] = np.uint16(middle + beside)
        centre_sums[i] = np.uint16(outer + middle + middle + ends + above)


@inlined_kernel
def _add_columns(outer: CostRow, inner: CostRow, centre: CostRow, count: int, n_blocks: int) -> None:
    """Replace `outer` by totals, over the four descriptors at the corners of the window, of the sums over its rows."""
    one, two, three, four = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(4)
    for k in range((n_blocks + 1) * _BLOCK):
        i = np.uintp(k)
        centre[i] = np.uint16(centre[i + two] + inner[i + one] + inner[i + three] + outer[i] + outer[i + four])
    for k in range(n_blocks * _BLOCK):
        i = np.uintp(k)
        outer[i] = np.uint16(centre[i] + centre[i + four])
    for k in range(count, n_blocks * _BLOCK):
        outer[np.uintp(k)] = _NO_COST


@inlined_kernel
def _take_least(
    costs: CostRow, n_blocks: int, d: int, first: int, least: CostRow, second: CostRow, disparity: Disparities
) -> None:
    """Take the costs of disparity d into account for the two least ones of the columns from the first one on."""
    number, start = np.int16(d), np.uintp(first)
    for k in range(n_blocks * _BLOCK):
        i = np.uintp(k)
        cost, before = costs[i], least[start + i]
        second[start + i] = min(second[start + i], max(before, cost))
        disparity[start + i] = number if cost < before else disparity[start + i]
        least[start + i] = min(before, cost)


@inlined_kernel
def _unique(least: CostRow, second: CostRow, disparity: Disparities, u: int, count: int, uniqueness: float) -> int:
    """Return the disparity of the least of a column's `count` costs; -1 if the second least is too close."""
    return int(disparity[u]) if count > 1 and least[u] < uniqueness * second[u] else -1


@kernel
def _columns(n: int) -> CostRow:
    """Return an array for a row of costs."""
    return np.full(n, _NO_COST, np.uint16)


@kernel
def match_support(
    hl: Responses, vl: Responses, hr: Responses, vr: Responses, texture_l: Costs, texture_r: Costs,
    least_texture: int, first: int, last: int, edge: int, step: int, n_disparities: int, uniqueness: float,
    consistency: int, grid: Disparities,
) -> None:  # fmt: skip
    """Set rows first .. last - 1 of the grid of support points to their disparities, -1 for none."""
    stride = hl.shape[1]
    width, reach = stride - 4 - PADDING, REACH_PX
    flat_hl, flat_vl, flat_hr, flat_vr = hl.reshape(-1), vl.reshape(-1), hr.reshape(-1), vr.reshape(-1)
    outer, inner, centre = _columns(stride), _columns(stride), _columns(stride)
    least_l, least_r, second_l, second_r = _columns(stride), _columns(stride), _columns(stride), _columns(stride)
    disparity_l, disparity_r = np.zeros(stride, np.int16), np.zeros(stride, np.int16)
    for i in range(first, last):
        v = i * step
        least_l[:] = least_r[:] = second_l[:] = second_r[:] = _NO_COST
        top = (v - reach) * stride
        for d in range(min(n_disparities, width - 2 * reach)):
            count = width - d - 2 * reach
            n_blocks = -(-count // _BLOCK)
            _add_rows(flat_hl, flat_vl, flat_hr, flat_vr, top + d, top, stride, n_blocks + 1, outer, inner, centre)
            _add_columns(outer, inner, centre, count, n_blocks)
            _take_least(outer, n_blocks, d, d + reach, least_l, second_l, disparity_l)
            _take_least(outer, n_blocks, d, reach, least_r, second_r, disparity_r)
        for j in range(edge, grid.shape[1]):
            u = j * step
            grid[i, j] = -1
            if texture_l[v, u] < least_texture:
                continue
            d = _unique(least_l, second_l, disparity_l, u, min(n_disparities, u - reach + 1), uniqueness)
            if d < 0 or texture_r[v, u - d] < least_texture:
                continue
            count = min(n_disparities, width - reach - (u - d))
            back = _unique(least_r, second_r, disparity_r, u - d, count, uniqueness)
            if back >= 0 and abs(back - d) <= consistency:
                grid[i, j] = d


@inlined_kernel
def _descriptor_costs(h: AnyCosts, v: AnyCosts, row: int, n_blocks: int, out: CostRow) -> None:
    """Set `out` to the sums of the elements of descriptors; the upper left one of the first stands at (row, 0).

    A descriptor takes 12 of the horizontal responses (the centre, next to which disparity is decided, twice) and 4 of
    the vertical ones; which, was chosen to agree with published results.
    """
    h0, h1, h2, h3, h4 = h[row], h[row + 1], h[row + 2], h[row + 3], h[row + 4]
    v1, v2, v3 = v[row + 1], v[row + 2], v[row + 3]
    one, two, three, four = np.uintp(1), np.uintp(2), np.uintp(3), np.uintp(4)
    for block in range(n_blocks):
        for k in range(_BLOCK):
            i = np.uintp(block * _BLOCK + k)
            outer = h0[i + two] + h4[i + two] + v1[i + two] + v3[i + two] + v2[i + one] + v2[i + three]
            corners = h1[i] + h1[i + two] + h1[i + four] + h3[i] + h3[i + two] + h3[i + four]
            out[i] = np.uint16(outer + corners + h2[i + one] + h2[i + two] + h2[i + two] + h2[i + three])


@kernel
def texture(h: Responses, v: Responses, width: int, first: int, last: int, out: Costs) -> None:
    """Set rows first .. last - 1 of `out`, which is padded, to the sums of |descriptor - 128|.

    `h` and `v` are |response - 128|.
    """
    for row in range(first, last):
        _descriptor_costs(h, v, row, (width + _BLOCK - 1) // _BLOCK, out[row])


@kernel
def drop_isolated(grid: Disparities, window: int, similarity: int, least: int, out: Disparities) -> None:
    """Copy the support points that at least `least` of the window around them, themselves included, agree with."""
    rows, columns = grid.shape
    for i in range(rows):
        for j in range(columns):
            out[i, j] = -1
            d = grid[i, j]
            if d < 0:
                continue
            support = 0
            for y in range(max(i - window, 0), min(i + window + 1, rows)):
                for x in range(max(j - window, 0), min(j + window + 1, columns)):
                    other = grid[y, x]
                    if other >= 0 and abs(other - d) <= similarity:
                        support += 1
                if support > least:
                    break
            if support >= least:
                out[i, j] = d


@kernel
def drop_redundant(grid: Disparities, distance: int, similarity: int) -> None:
    """Drop, along each row, the support points that have a similar one on both sides within `distance`."""
    rows, columns = grid.shape
    for i in range(rows):
        for j in range(columns):
            d = grid[i, j]
            if d < 0:
                continue
            x, low = j - 1, max(j - distance, 0)
            while x >= low and not (grid[i, x] >= 0 and abs(grid[i, x] - d) <= similarity):
                x -= 1
            y, high = j + 1, min(j + distance + 1, columns)
            while x >= low and y < high and not (grid[i, y] >= 0 and abs(grid[i, y] - d) <= similarity):
                y += 1
            if x >= low and y < high:
                grid[i, j] = -1


@inlined_kernel
def _slope(points: NDArray[np.float64], upper: int, lower: int) -> float:
    """Return how far an edge moves along u per px of v; 0 if it is horizontal."""
    rows = points[lower, 1] - points[upper, 1]
    return (points[lower, 0] - points[upper, 0]) / rows if rows else 0.0


@kernel
def _draw_triangle(
    points: NDArray[np.float64], p: int, q: int, r: int, a: float, b: float, c: float, step: int, width: int,
    out: Disparities,
) -> None:  # fmt: skip
    """Draw the plane d = a u + b v + c over the pixels, borders included, of a triangle of which p is uppermost.

    Corners q and r follow from top to bottom. `out` is flat, and `width` the length of its rows.
    """
    u0, v0, middle = points[p, 0], points[p, 1], points[q, 1]
    along, upper, lower = _slope(points, p, r), _slope(points, p, q), _slope(points, q, r)
    above = v0 < middle
    scale = a * step
    for i in range(max(0, -int(-v0 // step)), int(points[r, 1] // step) + 1):
        v = float(i * step)
        one = u0 + (v - v0) * along
        other = u0 + (v - v0) * upper if above and v <= middle else points[q, 0] + (v - middle) * lower
        start = max(0, int(np.ceil((min(one, other) - _ROUNDING) / step)))
        stop = min(width - PADDING, int(np.floor((max(one, other) + _ROUNDING) / step)) + 1)
        d0 = b * v + c + _ROUNDING
        at = i * width
        for j in range(start, stop):
            out[np.uintp(at + j)] = np.int16(np.int32(max(scale * j + d0, 0.0)))


@kernel
def draw_planes(
    points: NDArray[np.float64], triangles: NDArray[np.int32], side: int, step: int, out: Disparities
) -> None:
    """Set out[i, j] to the disparity, rounded down, of the plane over pixel (v, u) = (step * i, step * j).

    `points` (n, 3) are u, v and d; `side` is 1 for the left and -1 for the right image. Planes so steep that one of the
    images would hardly see them are left out. Rounding down was chosen to agree with published results.
    """
    flat = out.reshape(-1)
    for n in range(triangles.shape[0]):
        p, q, r = triangles[n, 0], triangles[n, 1], triangles[n, 2]
        if points[p, 1] > points[q, 1]:
            p, q = q, p
        if points[q, 1] > points[r, 1]:
            q, r = r, q
        if points[p, 1] > points[q, 1]:
            p, q = q, p
        u0, v0, d0 = points[p, 0], points[p, 1], points[p, 2]
        u1, v1, d1 = points[q, 0] - u0, points[q, 1] - v0, points[q, 2] - d0
        u2, v2, d2 = points[r, 0] - u0, points[r, 1] - v0, points[r, 2] - d0
        area = u1 * v2 - u2 * v1
        if area == 0:
            continue
        a = (d1 * v2 - d2 * v1) / area
        b = (u1 * d2 - u2 * d1) / area
        if abs(a) < _STEEPEST and abs(a) < _STEEPEST * abs(1 - side * a):
            _draw_triangle(points, p, q, r, a, b, d0 - a * u0 - b * v0, step, out.shape[1], flat)


@kernel
def mark_candidates(points: NDArray[np.float64], cell_size: int, candidates: Mask) -> None:
    """Mark, in candidates[y, x, d], the disparities of points and those next to them, in their and next cells."""
    for n in range(len(points)):
        x, y, d = int(points[n, 0]) // cell_size, int(points[n, 1]) // cell_size, int(points[n, 2])
        for row in range(max(y - 1, 0), min(y + 2, candidates.shape[0])):
            for column in range(max(x - 1, 0), min(x + 2, candidates.shape[1])):
                for disparity in range(max(d - 1, 0), min(d + 2, candidates.shape[2])):
                    candidates[row, column, disparity] = True


@kernel
def _runs(candidates: Mask, cell_size: int, width: int, shift: bool, runs: Runs) -> int:
    """List where each disparity is a candidate, as (d, first column, last column + 1), in coordinates of the image."""
    count = 0
    n_cells, n_disparities = candidates.shape
    for d in range(n_disparities):
        low, high = (0, width - d) if shift else (d, width)
        x = 0
        while x < n_cells:
            if not candidates[x, d]:
                x += 1
                continue
            start = x
            while x < n_cells and candidates[x, d]:
                x += 1
            u0, u1 = max(start * cell_size, low), min(x * cell_size, high)
            if u0 < u1:
                runs[count, 0], runs[count, 1], runs[count, 2] = d, u0, u1
                count += 1
    return count


@kernel
def _mark_planes(
    planes: Disparities, first: int, last: int, step: int, cell_size: int, radius: int, needed: Mask
) -> None:
    """Mark, in needed[cell, d], the disparities near the planes of the pixels in rows first .. last - 1."""
    n_columns, n_disparities = planes.shape[1], needed.shape[1]
    for cell in range(needed.shape[0]):
        start, stop = -(-cell * cell_size // step), min(-(-(cell + 1) * cell_size // step), n_columns)
        for i in range(first, last):
            row = planes[i]
            done = NO_PLANE
            for j in range(start, stop):
                plane = row[j]
                if plane != done:
                    done = plane
                    for d in range(max(plane - radius, 0), min(plane + radius + 1, n_disparities)):
                        needed[cell, d] = True


@kernel
def _union(runs_l: Runs, runs_r: Runs, out: Runs) -> int:
    """Join the runs of both images in columns of the left one; short gaps between them cost less than a new run."""
    gap = 16
    a, b, count = 0, 0, 0
    while a < runs_l.shape[0] or b < runs_r.shape[0]:
        left = b >= runs_r.shape[0]
        if not left and a < runs_l.shape[0]:
            d, e = runs_l[a, 0], runs_r[b, 0]
            left = d < e or (d == e and runs_l[a, 1] <= runs_r[b, 1] + e)
        if left:
            d, u0, u1 = runs_l[a, 0], runs_l[a, 1], runs_l[a, 2]
            a += 1
        else:
            d = runs_r[b, 0]
            u0, u1 = runs_r[b, 1] + d, runs_r[b, 2] + d
            b += 1
        if count and out[count - 1, 0] == d and u0 <= out[count - 1, 2] + gap:
            out[count - 1, 2] = max(out[count - 1, 2], u1)
        else:
            out[count, 0], out[count, 1], out[count, 2] = d, u0, u1
            count += 1
    return count


class _Space(NamedTuple):
    """What `_match_run` works on: differences of responses, a row of costs, and closed candidates."""

    horizontal: Costs
    vertical: Costs
    costs: Costs
    closed_l: Keys
    closed_r: Keys


@inlined_kernel
def _difference_row(left: Flat, left_start: int, right: Flat, right_start: int, n_blocks: int, out: CostRow) -> None:
    """Set `out` to the differences of two rows."""
    a, b = np.uintp(left_start), np.uintp(right_start)
    for block in range(n_blocks):
        for k in range(_BLOCK):
            i = np.uintp(block * _BLOCK + k)
            out[i] = _difference(left[a + i], right[b + i])


@inlined_kernel
def _take_candidates(
    costs: Costs, offset: int, step: int, d: int, planes: Disparities, closed: Keys, prior: Keys, first: int,
    count: int, best: Keys,
) -> None:  # fmt: skip
    """Replace the keys that disparity d has less than, where it is near the plane or else not closed.

    Takes every `step`-th of the costs from `offset` on, for the keys from `first` on.
    """
    number = np.int32(d)
    radius = prior.size - 1
    start, begin = np.uintp(first), np.uintp(offset)
    for k0 in range(0, radius + 1, 3):  # three distances from the plane at a time: all of them, by default
        k1, k2 = min(k0 + 1, radius), min(k0 + 2, radius)
        gain0, gain1, gain2 = prior[k0], prior[k1], prior[k2]
        near0, near1, near2 = np.int32(k0), np.int32(k1), np.int32(k2)
        for row in range(planes.shape[0]):
            for block in range(-(-count // _HALF_BLOCK)):
                for k in range(_HALF_BLOCK):
                    i = np.uintp(block * _HALF_BLOCK + k)
                    cost = costs[row, begin + i] if step == 1 else costs[row, begin + i + i]
                    distance = np.int32(abs(np.int32(np.int32(planes[row, start + i]) - number)))
                    gain = np.int32(-closed[i])
                    gain = gain2 if distance == near2 else gain
                    gain = gain1 if distance == near1 else gain
                    gain = gain0 if distance == near0 else gain
                    key = np.int32(np.int32((np.int32(cost) << _COST_SHIFT) | number) - gain)
                    best[row, start + i] = min(best[row, start + i], key)


@kernel
def _close(candidates: Mask, d: int, first: int, count: int, step: int, cell_size: int, out: Keys) -> None:
    """Set `out`, for every `step`-th column from the first one on, to 0 where a cell has the candidate d."""
    out[:] = _CLOSED
    done = 0
    while done < count:
        cell = (first + done) * step // cell_size
        stop = min(-(-(cell + 1) * cell_size // step) - first, count)
        if candidates[cell, d]:
            out[done:stop] = 0
        done = stop


@kernel
def _match_run(
    hl: Flat, vl: Flat, hr: Flat, vr: Flat, planes_l: Disparities, planes_r: Disparities,
    candidates_l: Mask, candidates_r: Mask, prior: Keys, d: int, u0: int, u1: int, start: int, stop: int, step: int,
    cell_size: int, stride: int, space: _Space, best_l: Keys, best_r: Keys,
) -> None:  # fmt: skip
    """Compare disparity d over columns u0 .. u1 - 1 of the left image, in every `step`-th row."""
    h, v, costs, closed_l, closed_r = space
    width, w0 = u1 - u0, u0 - d
    n_blocks = (width + _BLOCK - 1) // _BLOCK
    for row in range((stop - 1 - start) * step + 5):
        y = (start * step + row) * stride
        _difference_row(hl, y + u0, hr, y + w0, n_blocks + 1, h[row])
        _difference_row(vl, y + u0, vr, y + w0, n_blocks + 1, v[row])
    j0, j1 = (u0 + step - 1) // step, (u1 + step - 1) // step
    k0, k1 = (w0 + step - 1) // step, (w0 + width + step - 1) // step
    _close(candidates_l, d, j0, j1 - j0, step, cell_size, closed_l)
    _close(candidates_r, d, k0, k1 - k0, step, cell_size, closed_r)
    for i in range(stop - start):
        _descriptor_costs(h, v, i * step, n_blocks, costs[i])
    beyond = stride - 4 - PADDING - u0  # the image's end; what the blocks hold between u1 and it are costs, too
    if beyond < (n_blocks + 1) * _BLOCK:
        costs[: stop - start, beyond : (n_blocks + 1) * _BLOCK] = _NO_COST
    _take_candidates(costs, j0 * step - u0, step, d, planes_l[start:stop], closed_l, prior, j0, j1 - j0, best_l)
    _take_candidates(costs, k0 * step - w0, step, d, planes_r[start:stop], closed_r, prior, k0, k1 - k0, best_r)


@kernel
def _winners(best: Keys, texture: CostRow, least_texture: int, out: Disparities) -> None:
    """Set `out` to the disparities of the least keys, -1 for none."""
    for j in range(out.size):
        found = (texture[j] >= least_texture) & (best[j] < _CLOSED)
        out[j] = np.int16(best[j] & _DISPARITY_MASK) if found else np.int16(-1)


@kernel
def _confirm(own: Disparities, other: Disparities, side: int, step: int, tolerance: int, out: Disparities) -> None:
    """Copy the disparities of a row that the other image confirms; `side` is 1 for the left image, -1 for the right.

    None points out of the other image.
    """
    halvings = step - 1
    round_up = halvings if side == 1 else 0
    for j in range(own.size):
        d = own[j]
        out[j] = -1
        if d >= 0:
            back = other[np.uintp(j - side * ((d + round_up) >> halvings))]
            if back >= 0 and abs(back - d) <= tolerance:
                out[j] = d


@kernel
def match_rows(
    hl: Responses, vl: Responses, hr: Responses, vr: Responses, texture_l: Costs, texture_r: Costs,
    least_texture: int, planes_l: Disparities, planes_r: Disparities, candidates_l: Mask, candidates_r: Mask,
    prior: Keys, first: int, last: int, step: int, cell_size: int, tolerance: int, out_l: Disparities,
    out_r: Disparities,
) -> None:  # fmt: skip
    """Set the disparities of both images, -1 for none, in rows of cells first .. last - 1; `out_r` may be empty."""
    width, n_disparities = hl.shape[1] - 4 - PADDING, candidates_l.shape[2]
    radius = prior.size - 1
    flat = hl.reshape(-1), vl.reshape(-1), hr.reshape(-1), vr.reshape(-1)
    most = _MOST_COLUMNS + 3 * _BLOCK
    space = _Space(
        np.empty((cell_size + 4, most), np.uint16), np.empty((cell_size + 4, most), np.uint16),
        np.empty((cell_size, most), np.uint16), np.empty(most, np.int32), np.empty(most, np.int32),
    )  # fmt: skip
    best = np.empty((2, -(-cell_size // step), planes_l.shape[1]), np.int32)
    found_l, found_r = np.empty(out_l.shape[1], np.int16), np.empty(out_l.shape[1], np.int16)
    runs_of = np.empty((4, candidates_l.shape[1] * n_disparities, 3), np.int64)
    for cell in range(first, last):
        top, bottom = cell * cell_size, min((cell + 1) * cell_size, hl.shape[0] - 4)
        start, stop = (top + step - 1) // step, (bottom + step - 1) // step
        if start >= stop:
            continue
        needed_l, needed_r = candidates_l[cell].copy(), candidates_r[cell].copy()
        _mark_planes(planes_l, start, stop, step, cell_size, radius, needed_l)
        _mark_planes(planes_r, start, stop, step, cell_size, radius, needed_r)
        runs_l = runs_of[0, : _runs(needed_l, cell_size, width, False, runs_of[0])]
        runs_r = runs_of[1, : _runs(needed_r, cell_size, width, True, runs_of[1])]
        runs = runs_of[2:].reshape(-1, 3)[: _union(runs_l, runs_r, runs_of[2:].reshape(-1, 3))]
        best[:] = _NO_CANDIDATE
        for n in range(runs.shape[0]):
            for u0 in range(runs[n, 1], runs[n, 2], _MOST_COLUMNS):
                _match_run(
                    *flat, planes_l, planes_r,
                    candidates_l[cell], candidates_r[cell], prior, runs[n, 0], u0, min(u0 + _MOST_COLUMNS, runs[n, 2]),
                    start, stop, step, cell_size, hl.shape[1], space, best[0], best[1],
                )  # fmt: skip
        for i in range(start, stop):
            _winners(best[0, i - start], texture_l[i], least_texture, found_l)
            _winners(best[1, i - start], texture_r[i], least_texture, found_r)
            _confirm(found_l, found_r, 1, step, tolerance, out_l[i])
            if out_r.size:
                _confirm(found_r, found_l, -1, step, tolerance, out_r[i])


@kernel
def _between(
    first: NDArray[np.float32], second: NDArray[np.float32], similarity: np.float32, out: NDArray[np.float32]
) -> None:
    """Set `out` to the mean of both where they are alike, else to the first."""
    for i in range(out.size):
        a, b = first[i], second[i]
        alike = a > 0 and b > 0 and abs(a - b) <= similarity
        out[i] = np.float32(0.5) * (a + b) if alike else a


@kernel
def double(disparity: NDArray[np.float32], similarity: float, out: NDArray[np.float32]) -> None:
    """Set `out`, of twice the size or one less, to `disparity`, interpolated linearly where neighbours are alike."""
    height, width = out.shape
    half_width = disparity.shape[1]
    row, odd = np.empty(half_width, np.float32), np.empty(half_width, np.float32)
    for v in range(height):
        below = min((v + 1) // 2, disparity.shape[0] - 1)
        _between(disparity[v // 2], disparity[below], np.float32(similarity), row)
        odd[half_width - 1] = row[half_width - 1]
        _between(row[: half_width - 1], row[1:], np.float32(similarity), odd[: half_width - 1])
        line = out[v]
        for u in range(width // 2):
            line[2 * u] = row[u]
            line[2 * u + 1] = odd[u]
        if width % 2:
            line[width - 1] = row[half_width - 1]
