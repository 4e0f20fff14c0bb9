"""Compiled parts of the refinement of disparities. The arguments are checked, and the steps explained, in `refinement`.

All but `find_runs` work on bands of rows or of columns: what a band gives does not depend on the others.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

Found: TypeAlias = NDArray[np.int16]  # -1 for none
Disparity: TypeAlias = NDArray[np.float32]  # -1 for none
Runs: TypeAlias = NDArray[np.int32]  # (n, 4): first column, last column + 1, another run of the segment, pixels

MEAN_RADIUS_PX = 4
_N_TAPS = 2 * MEAN_RADIUS_PX + 1
_START, _STOP, _PARENT, _SIZE = 0, 1, 2, 3


@inlined_kernel
def _root(runs: Runs, run: int) -> int:
    """Return the run that stands for a run's segment, and shorten the way to it."""
    while runs[run, _PARENT] != run:
        runs[run, _PARENT] = runs[runs[run, _PARENT], _PARENT]
        run = runs[run, _PARENT]
    return run


@kernel
def _join(runs: Runs, one: int, other: int) -> None:
    """Make the segments of two runs one."""
    one, other = _root(runs, one), _root(runs, other)
    if one != other:
        low, high = min(one, other), max(one, other)
        runs[high, _PARENT] = low
        runs[low, _SIZE] += runs[high, _SIZE]


@kernel
def find_runs(found: Found, similarity: int, runs: Runs, first_runs: NDArray[np.int32]) -> None:
    """List the runs of similar disparities along each row, joined where they touch similar ones above.

    The runs of row v are those from first_runs[v] to first_runs[v + 1] - 1.
    """
    height, width = found.shape
    labels = np.full((2, width), -1, np.int32)
    run = -1
    for v in range(height):
        row, above = found[v], found[max(v - 1, 0)]
        row_labels, labels_above = labels[v % 2], labels[1 - v % 2]
        first_runs[v] = run + 1
        before = np.int16(-1)
        joined = -1
        for u in range(width):
            d = row[u]
            if d < 0:
                row_labels[u] = -1
                before = d
                continue
            if before < 0 or abs(d - before) > similarity:
                run += 1
                runs[run, _START], runs[run, _PARENT], runs[run, _SIZE] = u, run, 0
                joined = -1
            runs[run, _STOP] = u + 1
            before = d
            row_labels[u] = run
            other = labels_above[u]
            if other >= 0 and other != joined and abs(d - above[u]) <= similarity:
                joined = other
                _join(runs, run, other)
        for k in range(first_runs[v], run + 1):
            runs[_root(runs, k), _SIZE] += runs[k, _STOP] - runs[k, _START]
    first_runs[height] = run + 1


@kernel
def fill_rows(
    found: Found, runs: Runs, first_runs: NDArray[np.int32], least: int, width: int, jump: float, first: int, last: int,
    out: Disparity,
) -> None:  # fmt: skip
    """Set rows first .. last - 1 of `out`, which has a margin on both sides, without small segments.

    Gaps of up to `width` get the mean of both ends or, where they differ by `jump`, the farther one.
    """
    for v in range(first, last):
        row = out[v]
        row[:MEAN_RADIUS_PX] = -1
        row[MEAN_RADIUS_PX + found.shape[1] :] = -1
        inside = row[MEAN_RADIUS_PX : MEAN_RADIUS_PX + found.shape[1]]
        source = found[v]
        for u in range(inside.size):
            inside[u] = np.float32(source[u])
        end = -width - 1
        for run in range(first_runs[v], first_runs[v + 1]):
            start, stop = runs[run, _START], runs[run, _STOP]
            root = run
            while runs[root, _PARENT] != root:  # changes nothing: other bands look here, too
                root = runs[root, _PARENT]
            if runs[root, _SIZE] < least:
                inside[start:stop] = -1
                continue
            if 0 < start - end <= width:
                inside[end:start] = _filling(inside[end - 1], inside[start], jump)
            end = stop


@inlined_kernel
def _filling(one: np.float32, other: np.float32, jump: float) -> np.float32:
    """Return the disparity of a gap."""
    near, far = max(one, other), min(one, other)
    return np.float32((near + far) / 2 if near - far < jump else far)


@kernel
def fill_columns(disparity: Disparity, width: int, jump: float, first: int, last: int) -> None:
    """Fill gaps along columns first .. last - 1 as `fill_rows` does along rows."""
    for v in range(1, disparity.shape[0]):
        row, above = disparity[v], disparity[v - 1]
        for u in range(first, last):
            if row[u] < 0 or above[u] >= 0:
                continue
            top = v - 1
            while top >= max(v - width - 1, 0) and disparity[top, u] < 0:
                top -= 1
            if top >= max(v - width - 1, 0):
                filling = _filling(disparity[top, u], row[u], jump)
                for y in range(top + 1, v):
                    disparity[y, u] = filling


@kernel
def smooth(
    source: NDArray[np.float32], start: int, distance: int, scale: np.float32, least: np.float32, out: Disparity
) -> None:
    """Set a row to the mean of close disparities, or to `least` where this is higher.

    Those of `out[i]` stand in `source`, `distance` from each other, from `start` + i on.
    """
    begin, step = np.uintp(start), np.uintp(distance)
    for u in range(out.size):
        at = begin + np.uintp(u)
        centre = source[at + np.uintp(MEAN_RADIUS_PX) * step]
        total = weight = np.float32(0)
        for k in range(_N_TAPS):
            other = source[at + np.uintp(k) * step]
            w = scale - abs(other - centre)
            w = w if w > 0 and other >= 0 else np.float32(0)
            total += w * other
            weight += w
        mean = total / weight if centre >= 0 else centre
        out[u] = max(mean, least)


@kernel
def smooth_rows(disparity: Disparity, scale: np.float32, first: int, last: int, out: Disparity) -> None:
    """Set rows first .. last - 1 to their means along rows: from an array with a margin at its sides to one above."""
    flat = disparity.reshape(-1)
    for v in range(first, last):
        smooth(flat, v * disparity.shape[1], 1, scale, np.float32(-1), out[v + MEAN_RADIUS_PX])


@kernel
def smooth_columns(disparity: Disparity, scale: np.float32, first: int, last: int, out: Disparity) -> None:
    """Set rows first .. last - 1 to their means along columns, 0 for none, from an array with a margin above."""
    flat = disparity.reshape(-1)
    for v in range(first, last):
        smooth(flat, v * disparity.shape[1], disparity.shape[1], scale, np.float32(0), out[v])
