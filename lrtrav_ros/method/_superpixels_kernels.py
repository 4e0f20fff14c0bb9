"""Compiled parts of Preemptive SLIC. The arguments are checked, and the method explained, in `superpixels`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel


@kernel
def sweep(
    lab: NDArray[np.uint8],
    centres: NDArray[np.float32],
    visited: NDArray[np.int16],
    weight: np.float32,
    reach: np.float32,
    cell_row: NDArray[np.int64],
    cell_col: NDArray[np.int64],
    distance: NDArray[np.float32],
    labels: NDArray[np.int16],
    sums: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Visit the active clusters, which `visited` holds from top to bottom, row by row of the image.

    Updates `distance`, `labels` and the clusters' `sums`; returns how many pixels changed label in each cell.
    """
    height, width = labels.shape
    changes = np.zeros(len(sums), np.int64)
    before = np.empty(width, labels.dtype)
    columns = np.arange(width).astype(np.float32)
    # Whole SIMD vectors of 16 pixels: leftovers would take longer than the few pixels that the window gains.
    count = min(width, 16 * math.ceil(2 * reach / 16))
    first = last = 0
    for y in range(height):
        while last < len(visited) and centres[visited[last], 4] - reach <= y:
            last += 1
        while first < last and centres[visited[first], 4] + reach < y:
            first += 1
        for x in range(width):
            before[x] = labels[y, x]
        for k in visited[first:last]:
            cl, ca, cb, cx, cy = centres[k, 0], centres[k, 1], centres[k, 2], centres[k, 3], centres[k, 4]
            left = min(max(0, int(cx) - count // 2), width - count)
            right = left + count
            row_l, row_a, row_b = lab[0, y, left:right], lab[1, y, left:right], lab[2, y, left:right]
            across, nearest, owner = columns[left:right], distance[y, left:right], labels[y, left:right]
            dy = np.float32(y) - cy
            for x in range(count):
                dl, da, db = np.float32(row_l[x]) - cl, np.float32(row_a[x]) - ca, np.float32(row_b[x]) - cb
                dx = across[x] - cx
                d = dl * dl + da * da + db * db + weight * (dx * dx + dy * dy)
                # Its own pixels are at a stale distance, since the centre moved. Selects, not branches: they vectorise.
                take = (d < nearest[x]) | (owner[x] == k)
                nearest[x] = d if take else nearest[x]
                owner[x] = k if take else owner[x]
        for x in range(width):
            if labels[y, x] != before[x]:
                _add(sums, labels[y, x], lab, y, x, 1)
                if before[x] >= 0:
                    _add(sums, before[x], lab, y, x, -1)
                changes[cell_row[y] + cell_col[x]] += 1
    return changes


@kernel
def _add(sums: NDArray[np.int64], k: int, lab: NDArray[np.uint8], y: int, x: int, sign: int) -> None:
    """Add a pixel to cluster `k`'s sums of L, a, b, x, y and pixels, or take it away."""
    sums[k, 0] += sign * lab[0, y, x]
    sums[k, 1] += sign * lab[1, y, x]
    sums[k, 2] += sign * lab[2, y, x]
    sums[k, 3] += sign * x
    sums[k, 4] += sign * y
    sums[k, 5] += sign


@kernel
def paint(runs: NDArray[np.int64], values: NDArray[np.int32], flat: NDArray[np.int32]) -> None:
    """Write each run's value to its pixels."""
    for run in range(len(values)):
        flat[runs[run, 0] : runs[run + 1, 0]] = values[run]


@kernel
def cut(lab: NDArray[np.uint8], labels: NDArray[np.int16]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cut the rows into runs of one label.

    Returns, for each run, its first pixel and the sums of L, a, b over all pixels before it, with a last entry for
    the end of the image; and the first run of each row, with a last entry too.
    """
    height, width = labels.shape
    runs = np.empty((height * width + 1, 4), np.int64)
    rows = np.empty(height + 1, np.int64)
    n = sum_l = sum_a = sum_b = 0
    for y in range(height):
        rows[y] = n
        for x in range(width):
            if x == 0 or labels[y, x] != labels[y, x - 1]:
                runs[n, 0], runs[n, 1], runs[n, 2], runs[n, 3] = y * width + x, sum_l, sum_a, sum_b
                n += 1
            sum_l += lab[0, y, x]
            sum_a += lab[1, y, x]
            sum_b += lab[2, y, x]
    rows[height] = n
    runs[n, 0], runs[n, 1], runs[n, 2], runs[n, 3] = height * width, sum_l, sum_a, sum_b
    return runs[: n + 1], rows


@kernel
def link(
    labels: NDArray[np.int16], runs: NDArray[np.int64], rows: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Join the runs of one label that touch to pieces.

    Returns the piece of each run, numbered by their first pixels, and the (E, 2) pairs of pieces that touch.
    """
    height, width = labels.shape
    flat = labels.ravel()
    n_runs = int(rows[height])
    parent = np.arange(n_runs).astype(np.int32)
    edges = np.empty((3 * n_runs, 2), np.int32)
    n_edges = 0
    for y in range(height):
        for run in range(rows[y] + 1, rows[y + 1]):
            edges[n_edges, 0], edges[n_edges, 1] = run - 1, run
            n_edges += 1
        above, run = rows[max(y - 1, 0)], rows[y]
        while above < rows[y] and run < rows[y + 1]:
            if flat[runs[above, 0]] == flat[runs[run, 0]]:
                _join(parent, above, run)
            else:
                edges[n_edges, 0], edges[n_edges, 1] = above, run
                n_edges += 1
            overhang = runs[above + 1, 0] + width - runs[run + 1, 0]
            above += overhang <= 0
            run += overhang >= 0
    _number(parent)
    for i in range(n_edges):
        edges[i, 0], edges[i, 1] = parent[edges[i, 0]], parent[edges[i, 1]]
    return parent, edges[:n_edges]


@kernel
def _find(parent: NDArray[np.int32], i: int) -> int:
    """Return the root of the tree that `i` is in: its smallest member."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def _join(parent: NDArray[np.int32], i: int, j: int) -> tuple[int, int]:
    """Make one tree of those of `i` and `j`; return its root and the root that is none any more."""
    i, j = _find(parent, i), _find(parent, j)
    parent[max(i, j)] = min(i, j)
    return min(i, j), max(i, j)


@kernel
def _number(parent: NDArray[np.int32]) -> None:
    """Replace each entry of a forest by the number of its tree, 0 .. n - 1 in the order of the roots."""
    n = 0
    for i in range(len(parent)):
        if parent[i] == i:
            parent[i] = n
            n += 1
        else:
            parent[i] = parent[parent[i]]


@kernel
def merge(
    runs: NDArray[np.int64], piece: NDArray[np.int32], edges: NDArray[np.int32], min_size: float
) -> NDArray[np.int32]:
    """Return the superpixel of each piece, numbered by their first pixels.

    In each round every piece below `min_size` chooses the adjacent piece of the most similar mean colour, and all
    that chose are joined; it ends when no piece is too small or none has a neighbour left.
    """
    sums = _sums(runs, piece)
    n_pieces, n_edges = len(sums), len(edges)
    owner = np.arange(n_pieces).astype(np.int32)
    while n_edges > 0:
        n_edges, partner = _choose(sums, owner, edges[:n_edges], min_size)
        for p in range(n_pieces):
            if partner[p] >= 0 and _find(owner, p) != _find(owner, partner[p]):
                root, child = _join(owner, p, partner[p])
                for c in range(4):
                    sums[root, c] += sums[child, c]
        for p in range(n_pieces):
            owner[p] = _find(owner, p)
    _number(owner)
    return owner


@kernel
def _sums(runs: NDArray[np.int64], piece: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the number of pixels of each piece and the sums of their L, a, b."""
    sums = np.zeros((piece.max() + 1, 4), np.int64)
    for run in range(len(piece)):
        for c in range(4):
            sums[piece[run], c] += runs[run + 1, c] - runs[run, c]
    return sums


@kernel
def _choose(
    sums: NDArray[np.int64], owner: NDArray[np.int32], edges: NDArray[np.int32], min_size: float
) -> tuple[int, NDArray[np.int32]]:
    """Return the number of edges that matter, moved to the front, and each small piece's choice, else -1.

    `latest` keeps out most of the pairs that come again and again along a border.
    """
    n_pieces = len(sums)
    mean = np.empty((n_pieces, 3), np.float32)
    small = np.empty(n_pieces, np.bool_)
    for p in range(n_pieces):
        small[p] = sums[p, 0] < min_size
        for c in range(3):
            mean[p, c] = sums[p, c + 1] / sums[p, 0]
    nearest = np.full(n_pieces, np.inf, np.float32)
    partner = np.full(n_pieces, -1, np.int32)
    latest = np.full(n_pieces, -1, np.int32)
    kept = 0
    for i in range(len(edges)):
        a, b = owner[edges[i, 0]], owner[edges[i, 1]]
        if a == b or latest[a] == b or latest[b] == a or not (small[a] or small[b]):
            continue
        latest[a], latest[b] = b, a
        edges[kept, 0], edges[kept, 1] = a, b
        kept += 1
        d = (mean[a, 0] - mean[b, 0]) ** 2 + (mean[a, 1] - mean[b, 1]) ** 2 + (mean[a, 2] - mean[b, 2]) ** 2
        if small[a] and d < nearest[a]:
            nearest[a], partner[a] = d, b
        if small[b] and d < nearest[b]:
            nearest[b], partner[b] = d, a
    return kept, partner
