"""Compiled parts of ELAS. The arguments are checked, and the method explained, in `elas`.

All kernels work on whole rows, so that the compiler vectorises along them, and on bands of rows, so that bands can be
given to several threads: what a band gives does not depend on the others.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

Responses: TypeAlias = NDArray[np.uint8]  # of a Sobel filter, padded by 2
Costs: TypeAlias = NDArray[np.uint16]
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


@inlined_kernel
def _difference(a: np.uint8, b: np.uint8) -> np.int16:
    """Return |a - b|."""
    return abs(np.int16(a) - np.int16(b))


@kernel
def _all_columns(n_disparities: int, width: int) -> Runs:
    """Return the runs (d, d, width) of all disparities: every column that has a counterpart in the right image."""
    runs = np.empty((min(n_disparities, width), 3), np.int64)
    for d in range(runs.shape[0]):
        runs[d, 0], runs[d, 1], runs[d, 2] = d, d, width
    return runs


@kernel
def _row_costs(hl: Responses, vl: Responses, hr: Responses, vr: Responses, v: int, runs: Runs, costs: Costs) -> None:
    """Set costs[d, u], over the runs (d, u0, u1), to the difference of the descriptors at (v, u) and (v, u - d).

    `hl` ... `vr` are the responses of left and right image. The descriptor takes 12 of the horizontal (the centre, next
    to which disparity is decided, twice) and 4 of the vertical ones; which, was chosen to agree with published results.
    """
    for n in range(runs.shape[0]):
        d, u0, u1 = runs[n, 0], runs[n, 1], runs[n, 2]
        a0, a1, a2, a3, a4 = hl[v][u0:], hl[v + 1][u0:], hl[v + 2][u0:], hl[v + 3][u0:], hl[v + 4][u0:]
        e1, e2, e3 = vl[v + 1][u0:], vl[v + 2][u0:], vl[v + 3][u0:]
        w0 = u0 - d
        b0, b1, b2, b3, b4 = hr[v][w0:], hr[v + 1][w0:], hr[v + 2][w0:], hr[v + 3][w0:], hr[v + 4][w0:]
        f1, f2, f3 = vr[v + 1][w0:], vr[v + 2][w0:], vr[v + 3][w0:]
        row = costs[d][u0:u1]
        for i in range(row.size):
            row[i] = np.uint16(
                _difference(a0[i + 2], b0[i + 2])
                + _difference(a1[i], b1[i])
                + _difference(a1[i + 2], b1[i + 2])
                + _difference(a1[i + 4], b1[i + 4])
                + _difference(a2[i + 1], b2[i + 1])
                + _difference(a2[i + 2], b2[i + 2])
                + _difference(a2[i + 2], b2[i + 2])
                + _difference(a2[i + 3], b2[i + 3])
                + _difference(a3[i], b3[i])
                + _difference(a3[i + 2], b3[i + 2])
                + _difference(a3[i + 4], b3[i + 4])
                + _difference(a4[i + 2], b4[i + 2])
                + _difference(e1[i + 2], f1[i + 2])
                + _difference(e2[i + 1], f2[i + 1])
                + _difference(e2[i + 3], f2[i + 3])
                + _difference(e3[i + 2], f3[i + 2])
            )


@kernel
def _window_costs(upper: Costs, lower: Costs, reach: int, window: Costs) -> None:
    """Set window[d, u] to the sum of the costs at the four corners (v +- reach, u +- reach), where all four exist."""
    n_disparities, width = window.shape
    for d in range(min(n_disparities, width)):
        p0, p1 = upper[d][d:], upper[d][min(d + 2 * reach, width) :]
        q0, q1 = lower[d][d:], lower[d][min(d + 2 * reach, width) :]
        row = window[d][min(d + reach, width) :]
        for i in range(p1.size):
            row[i] = p0[i] + p1[i] + q0[i] + q1[i]


@kernel
def _unique_minimum(costs: Costs, start: int, stride: int, count: int, uniqueness: float) -> int:
    """Return the index of the least of `count` values; -1 if the second least is too close."""
    best = second = 65535 << DISPARITY_BITS
    for d in range(count):  # without branches, which are hard to predict here
        key = (int(costs[start + d * stride]) << DISPARITY_BITS) | d
        second = min(second, max(best, key))
        best = min(best, key)
    unique = count > 1 and best >> DISPARITY_BITS < uniqueness * (second >> DISPARITY_BITS)
    return int(best & _DISPARITY_MASK) if unique else -1


@kernel
def match_support(
    hl: Responses, vl: Responses, hr: Responses, vr: Responses, textured_l: Mask, textured_r: Mask,
    first: int, last: int, edge: int, step: int, reach: int, n_disparities: int, uniqueness: float, consistency: int,
    grid: Disparities,
) -> None:  # fmt: skip
    """Set rows first .. last - 1 of the grid of support points to their disparities, -1 for none."""
    width = hl.shape[1] - 4
    upper = np.zeros((n_disparities, width), np.uint16)
    lower = np.zeros((n_disparities, width), np.uint16)
    window = np.zeros((n_disparities, width), np.uint16)
    flat = window.reshape(-1)
    runs = _all_columns(n_disparities, width)
    for i in range(first, last):
        v = i * step
        _row_costs(hl, vl, hr, vr, v - reach, runs, upper)
        _row_costs(hl, vl, hr, vr, v + reach, runs, lower)
        _window_costs(upper, lower, reach, window)
        for j in range(edge, grid.shape[1]):
            u = j * step
            grid[i, j] = -1
            if not textured_l[v, u]:
                continue
            d = _unique_minimum(flat, u, width, min(n_disparities, u - reach + 1), uniqueness)
            if d < 0 or not textured_r[v, u - d]:
                continue
            count = min(n_disparities, width - reach - (u - d))
            back = _unique_minimum(flat, u - d, width + 1, count, uniqueness)
            if back >= 0 and abs(back - d) <= consistency:
                grid[i, j] = d


@kernel
def texture(h: Responses, v: Responses, first: int, last: int, out: Costs) -> None:
    """Set rows first .. last - 1 of `out` to the sum of |descriptor - 128|."""
    flat = np.full_like(h, 128)
    runs = _all_columns(1, out.shape[1])
    for row in range(first, last):
        _row_costs(h, v, flat, flat, row, runs, out[row : row + 1])


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
            before = False
            for x in range(max(j - distance, 0), j):
                before |= grid[i, x] >= 0 and abs(grid[i, x] - d) <= similarity
            after = False
            for x in range(j + 1, min(j + distance + 1, columns)):
                after |= grid[i, x] >= 0 and abs(grid[i, x] - d) <= similarity
            if before and after:
                grid[i, j] = -1


@kernel
def _draw_triangle(corners: NDArray[np.float64], a: float, b: float, c: float, step: int, out: Disparities) -> None:
    """Draw the plane d = a u + b v + c over the pixels of one triangle."""
    low = min(corners[0, 1], corners[1, 1], corners[2, 1])
    high = max(corners[0, 1], corners[1, 1], corners[2, 1])
    for i in range(max(0, int(np.ceil(low / step))), min(out.shape[0], int(np.floor(high / step)) + 1)):
        v = i * step
        left, right = np.inf, -np.inf
        for k in range(3):
            other = k - 1 if k > 0 else 2
            u0, v0 = corners[k, 0], corners[k, 1]
            u1, v1 = corners[other, 0], corners[other, 1]
            if v0 == v:
                left, right = min(left, u0), max(right, u0)
            elif min(v0, v1) < v < max(v0, v1):
                u = u0 + (v - v0) * (u1 - u0) / (v1 - v0)
                left, right = min(left, u), max(right, u)
        start, stop = max(0, int(np.ceil(left / step))), min(out.shape[1], int(np.floor(right / step)) + 1)
        for j in range(start, stop):
            out[i, j] = np.int16(max(np.floor(a * (j * step) + b * v + c), 0.0))


@kernel
def draw_planes(
    points: NDArray[np.float64], triangles: NDArray[np.int32], side: int, step: int, out: Disparities
) -> None:
    """Set out[i, j] to the disparity, rounded down, of the plane over pixel (v, u) = (step * i, step * j).

    `points` (n, 3) are u, v and d; `side` is 1 for the left and -1 for the right image. Planes so steep that one of the
    images would hardly see them are left out. Rounding down was chosen to agree with published results.
    """
    corners = np.empty((3, 3))
    for n in range(triangles.shape[0]):
        for k in range(3):
            for axis in range(3):  # element by element: array expressions take seconds to compile
                corners[k, axis] = points[triangles[n, k], axis]
        u0, v0, d0 = corners[0, 0], corners[0, 1], corners[0, 2]
        u1, v1, d1 = corners[1, 0] - u0, corners[1, 1] - v0, corners[1, 2] - d0
        u2, v2, d2 = corners[2, 0] - u0, corners[2, 1] - v0, corners[2, 2] - d0
        area = u1 * v2 - u2 * v1
        if area == 0:
            continue
        a = (d1 * v2 - d2 * v1) / area
        b = (u1 * d2 - u2 * d1) / area
        c = d0 - a * u0 - b * v0
        if abs(a) < _STEEPEST and abs(a) < _STEEPEST * abs(1 - side * a):
            _draw_triangle(corners, a, b, c, step, out)


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
    for i in range(first, last):
        done_cell, done_plane = -1, -1
        for j in range(planes.shape[1]):
            cell, plane = j * step // cell_size, planes[i, j]
            if plane < 0 or (cell == done_cell and plane == done_plane):
                continue
            done_cell, done_plane = cell, plane
            for d in range(max(plane - radius, 0), min(plane + radius + 1, needed.shape[1])):
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


@kernel
def _best_of_runs(costs: Costs, runs: Runs, shift: int, best: Keys) -> None:
    """Take the least candidate of every pixel over the runs; `shift` is 1 for the right image."""
    for n in range(runs.shape[0]):
        d, u0, u1 = runs[n, 0], runs[n, 1], runs[n, 2]
        row = costs[d][u0 + shift * d : u1 + shift * d]
        out = best[u0:u1]
        for i in range(out.size):
            key = np.int32((np.int32(row[i]) << _COST_SHIFT) | np.int32(d))
            out[i] = min(out[i], key)


@kernel
def _best_of_planes(
    costs: Costs, planes: Disparities, textured: Mask, prior: Keys, step: int, shift: int, best: Keys, out: Disparities
) -> None:
    """Take the least candidate near the plane into account, and set `out` to the winning disparities, -1 for none."""
    n_disparities, width = costs.shape
    radius = prior.size - 1
    flat = costs.reshape(-1)
    for j in range(out.size):
        u = j * step
        out[j] = -1
        if not textured[u]:
            continue
        key, plane = best[u], planes[j]
        highest = min(n_disparities - 1, width - 1 - u if shift else u)
        if plane >= 0:
            for d in range(max(plane - radius, 0), min(plane + radius, highest) + 1):
                cost = np.int32(flat[d * (width + shift) + u])
                key = min(key, ((cost << _COST_SHIFT) | np.int32(d)) - prior[abs(d - plane)])
        if key != _NO_CANDIDATE:
            out[j] = key & _DISPARITY_MASK


@kernel
def _check_consistency(
    left: Disparities, right: Disparities, step: int, tolerance: int, out_left: Disparities, out_right: Disparities
) -> None:
    """Copy the disparities of a row that the other image confirms."""
    width = left.size
    for j in range(width):
        d = left[j]
        other = j - (d + step - 1) // step
        out_left[j] = d if d >= 0 and other >= 0 and right[other] >= 0 and abs(right[other] - d) <= tolerance else -1
        d = right[j]
        other = j + d // step
        out_right[j] = d if d >= 0 and other < width and left[other] >= 0 and abs(left[other] - d) <= tolerance else -1


@kernel
def match_rows(
    hl: Responses, vl: Responses, hr: Responses, vr: Responses, textured_l: Mask, textured_r: Mask,
    planes_l: Disparities, planes_r: Disparities, candidates_l: Mask, candidates_r: Mask, prior: Keys,
    first: int, last: int, step: int, cell_size: int, tolerance: int, out_l: Disparities, out_r: Disparities,
) -> None:  # fmt: skip
    """Set the disparities of both images, -1 for none, in rows of cells first .. last - 1."""
    width, n_disparities = hl.shape[1] - 4, candidates_l.shape[2]
    radius = prior.size - 1
    costs = np.zeros((n_disparities, width), np.uint16)
    best_l, best_r = np.empty(width, np.int32), np.empty(width, np.int32)
    found_l, found_r = np.empty(out_l.shape[1], np.int16), np.empty(out_l.shape[1], np.int16)
    space = np.empty((6, candidates_l.shape[1] * n_disparities, 3), np.int64)
    for cell in range(first, last):
        top, bottom = cell * cell_size, min((cell + 1) * cell_size, textured_l.shape[0])
        start, stop = (top + step - 1) // step, (bottom + step - 1) // step
        needed_l, needed_r = candidates_l[cell].copy(), candidates_r[cell].copy()
        _mark_planes(planes_l, start, stop, step, cell_size, radius, needed_l)
        _mark_planes(planes_r, start, stop, step, cell_size, radius, needed_r)
        needed_runs_l = space[0, : _runs(needed_l, cell_size, width, False, space[0])]
        needed_runs_r = space[1, : _runs(needed_r, cell_size, width, True, space[1])]
        runs_l = space[2, : _runs(candidates_l[cell], cell_size, width, False, space[2])]
        runs_r = space[3, : _runs(candidates_r[cell], cell_size, width, True, space[3])]
        needed = space[4:].reshape(-1, 3)[: _union(needed_runs_l, needed_runs_r, space[4:].reshape(-1, 3))]
        for i in range(start, stop):
            v = i * step
            _row_costs(hl, vl, hr, vr, v, needed, costs)
            best_l[:] = _NO_CANDIDATE
            best_r[:] = _NO_CANDIDATE
            _best_of_runs(costs, runs_l, 0, best_l)
            _best_of_runs(costs, runs_r, 1, best_r)
            _best_of_planes(costs, planes_l[i], textured_l[v], prior, step, 0, best_l, found_l)
            _best_of_planes(costs, planes_r[i], textured_r[v], prior, step, 1, best_r, found_r)
            _check_consistency(found_l, found_r, step, tolerance, out_l[i], out_r[i])


@kernel
def fill_gaps(disparity: NDArray[np.float32], width: int, jump: float) -> None:
    """Fill gaps of up to `width` along each row, with the mean of both ends or, where they differ, the farther one."""
    for row in disparity:
        last = -1
        for u in range(row.size):
            if row[u] < 0:
                continue
            if last >= 0 and 1 < u - last <= width + 1:
                near, far = max(row[last], row[u]), min(row[last], row[u])
                row[last + 1 : u] = (near + far) / 2 if near - far < jump else far
            last = u


@kernel
def _add_similar(
    centre: NDArray[np.float32],
    other: NDArray[np.float32],
    scale: np.float32,
    total: NDArray[np.float32],
    weight: NDArray[np.float32],
) -> None:
    """Add disparities to the weighted sums of the pixels that they are close to."""
    for i in range(other.size):
        w = scale - abs(other[i] - centre[i])
        w = w if w > 0 and other[i] >= 0 else np.float32(0)
        total[i] += w * other[i]
        weight[i] += w


@kernel
def smooth_rows(
    disparity: NDArray[np.float32],
    radius: int,
    scale: float,
    along: bool,
    first: int,
    last: int,
    out: NDArray[np.float32],
) -> None:
    """Set rows first .. last - 1 of `out` to the mean of close disparities, along or across the rows."""
    height, width = disparity.shape
    total, weight = np.empty(width, np.float32), np.empty(width, np.float32)
    for v in range(first, last):
        total[:] = 0
        weight[:] = 0
        row = disparity[v]
        for k in range(-radius, radius + 1):
            if along:
                a, b = min(max(-k, 0), width), max(min(width, width - k), 0)
                if a < b:
                    _add_similar(row[a:b], row[a + k : b + k], np.float32(scale), total[a:b], weight[a:b])
            elif 0 <= v + k < height:
                _add_similar(row, disparity[v + k], np.float32(scale), total, weight)
        line = out[v]
        for i in range(width):
            line[i] = total[i] / weight[i] if row[i] >= 0 else row[i]


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
