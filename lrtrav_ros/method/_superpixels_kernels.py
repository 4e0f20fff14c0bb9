"""Compiled parts of Preemptive SLIC. The arguments are checked, and the method explained, in `superpixels`.

A row of cells that have no pixels surrounds the grid, so that every cell has eight neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel, summing_kernel

# Pixels of a row that are assigned at once: whole SIMD vectors, and few enough that what is known of the clusters
# around them stays in the processor's first cache.
_TILE = 64
# Where a cluster's L, a, b, y and the constant part of its distance stand, one of each for each pixel of a tile.
_L, _A, _B, _Y, _CONSTANT, _CLUSTER = 0, _TILE, 2 * _TILE, 3 * _TILE, 4 * _TILE, 5 * _TILE
_MID = np.float32(128)  # of the scales of L, a and b: products of differences from it are small, and so exact
_INFINITY = np.float32(1e38)  # finite, as `summing_kernel` wants


@kernel
def thin(image: NDArray[np.uint8], first: int, last: int, half: NDArray[np.uint8]) -> None:
    """Copy every second pixel of every second row, to the rows from `first` to `last` of `half`."""
    for y in range(first, last):
        row, row_half = image[2 * y], half[y]
        for x in range(len(row_half)):
            for c in range(3):
                row_half[x, c] = row[2 * x, c]


@kernel
def assign(
    lab: NDArray[np.uint8],
    centres: NDArray[np.float32],
    moved: NDArray[np.bool_],
    cell_row: NDArray[np.int32],
    cell_col: NDArray[np.int32],
    scale: np.float32,
    first: int,
    last: int,
    labels: NDArray[np.uint16],
) -> None:
    """Label the pixels of the rows from `first` to `last` with the nearest of the clusters of their and adjacent cells.

    Pixels around which no cluster moved keep their labels.
    """
    clusters = np.zeros(9 * _CLUSTER, np.float32)
    pixels = np.zeros(3 * _TILE, np.float32)
    slots = np.empty(_TILE, np.int32)
    for left in range(0, labels.shape[1], _TILE):
        cols = cell_col[left : left + _TILE]
        right = left + len(cols)
        gathered, y = -2, first
        while y < last:
            r = cell_row[y]
            due = moved[r - 1 : r + 2, cols[0] - 1 : cols[-1] + 2].any()
            if due:
                for row in range(max(r - 1, gathered + 1), r + 2):
                    _gather(centres[row], cols, left, scale, clusters)
                gathered = r + 1
            while y < last and cell_row[y] == r:
                if due:
                    _read(lab[:, y, left:right], pixels)
                    _find_nearest(pixels, clusters, scale * np.float32(y), slots)
                    _write(slots, cols, (r - 1) * moved.shape[1], moved.shape[1], labels[y, left:right])
                y += 1


@kernel
def _gather(
    centres: NDArray[np.float32], cols: NDArray[np.int32], left: int, scale: np.float32, clusters: NDArray[np.float32]
) -> None:
    """Append what the distance to the clusters of one more row of cells takes, and forget the first of three."""
    for i in range(6 * _CLUSTER):
        clusters[i] = clusters[i + 3 * _CLUSTER]
    for i in range(3):
        for x in range(len(cols)):
            centre = centres[cols[x] + i - 1]
            at = (6 + i) * _CLUSTER + x
            cl, ca, cb = centre[0] - _MID, centre[1] - _MID, centre[2] - _MID
            dx = scale * (np.float32(left + x) - centre[3])
            clusters[at + _L], clusters[at + _A], clusters[at + _B] = -2 * cl, -2 * ca, -2 * cb
            clusters[at + _Y] = scale * centre[4]
            clusters[at + _CONSTANT] = cl * cl + ca * ca + cb * cb + dx * dx


@kernel
def _read(lab: NDArray[np.uint8], pixels: NDArray[np.float32]) -> None:
    """Read a tile's row."""
    for c in range(3):
        plane = lab[c]
        for x in range(len(plane)):
            pixels[c * _TILE + x] = np.float32(plane[x]) - _MID


@summing_kernel
def _find_nearest(
    pixels: NDArray[np.float32], clusters: NDArray[np.float32], y: np.float32, slots: NDArray[np.int32]
) -> None:
    """Find which of the nine clusters is nearest to each pixel of a tile's row.

    The pixel's own L^2 + a^2 + b^2, which the distances have in common, is left out.
    """
    for x in range(_TILE):
        pl, pa, pb = pixels[x], pixels[x + _TILE], pixels[x + 2 * _TILE]
        nearest, slot = _INFINITY, np.int32(0)
        for j in range(9):
            at = x + j * _CLUSTER
            dy = y - clusters[at + _Y]
            d = clusters[at + _CONSTANT] + dy * dy
            d += pl * clusters[at + _L] + pa * clusters[at + _A] + pb * clusters[at + _B]
            is_nearer = d < nearest
            # Selects, not branches: they vectorise.
            nearest = d if is_nearer else nearest
            slot = np.int32(j) if is_nearer else slot
        slots[x] = slot


@kernel
def _write(
    slots: NDArray[np.int32], cols: NDArray[np.int32], row_above: int, stride: int, labels: NDArray[np.uint16]
) -> None:
    """Write the labels of a tile's row, given the first cell of the row of cells above."""
    for x in range(len(labels)):
        down = (slots[x] * np.int32(11)) >> np.int32(5)  # a third of it
        across = slots[x] - np.int32(3) * down
        labels[x] = np.int32(row_above - 1) + down * np.int32(stride) + cols[x] + across


@kernel
def count(
    lab: NDArray[np.uint8],
    cell_row: NDArray[np.int32],
    cell_col: NDArray[np.int32],
    first: int,
    last: int,
    labels: NDArray[np.uint16],
    before: NDArray[np.uint16],
    sums: NDArray[np.int64],
    changes: NDArray[np.int32],
) -> None:
    """Count the pixels that changed label, in each cell, of the rows from `first` to `last`.

    Brings `sums`, of the clusters' L, a, b, x, y and pixels, and `before` up to date.
    """
    changes[:] = 0
    for y in range(first, last):
        new, old = labels[y], before[y]
        for x in _differing(new, old):
            _add(sums[new[x]], lab, y, x, 1)
            _add(sums[old[x]], lab, y, x, -1)
            changes[cell_row[y], cell_col[x]] += 1
            old[x] = new[x]


@kernel
def _add(sums: NDArray[np.int64], lab: NDArray[np.uint8], y: int, x: int, sign: int) -> None:
    """Add a pixel to a cluster's sums, or take it away."""
    sums[0] += sign * lab[0, y, x]
    sums[1] += sign * lab[1, y, x]
    sums[2] += sign * lab[2, y, x]
    sums[3] += sign * x
    sums[4] += sign * y
    sums[5] += sign


@kernel
def move(
    sums: NDArray[np.int64],
    changes: NDArray[np.int32],
    min_changes: float,
    centres: NDArray[np.float32],
    moved: NDArray[np.bool_],
) -> None:
    """Move the clusters around whose cells at least `min_changes` pixels changed label to the means of their pixels.

    `sums` are those of several bands of the image.
    """
    rows, stride = moved.shape
    total = np.empty(6, np.int64)
    for r in range(1, rows - 1):
        for c in range(1, stride - 1):
            n = 0
            for i in range(r - 1, r + 2):
                n += changes[i, c - 1] + changes[i, c] + changes[i, c + 1]
            total[:] = 0
            for band in range(len(sums)):
                for i in range(6):
                    total[i] += sums[band, r * stride + c, i]
            moved[r, c] = n >= min_changes and total[5] > 0
            if moved[r, c]:
                for i in range(5):
                    centres[r, c, i] = total[i] / total[5]


@kernel
def cut(labels: NDArray[np.uint16], first: int, last: int, counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the first pixel of each run of one label, of the rows from `first` to `last`; count the runs of a row."""
    width = labels.shape[1]
    runs = np.empty((last - first) * width + 1, np.int32)
    n = 0
    for y in range(first, last):
        row = labels[y]
        before = n
        runs[n] = y * width
        n += 1
        for x in range(1, width):
            runs[n] = y * width + x
            n += row[x] != row[x - 1]
        counts[y] = n - before
    return runs[:n]


@kernel
def link(
    labels: NDArray[np.uint16],
    runs: NDArray[np.int64],
    rows: NDArray[np.int64],
    first: int,
    last: int,
    parent: NDArray[np.int32],
) -> None:
    """Join the runs of one label that touch, of the rows from `first` to `last` and those above them."""
    width = labels.shape[1]
    for y in range(first, last):
        row_above, row = labels[y - 1], labels[y]
        start_above, start = (y - 1) * width, y * width
        i, j = rows[y - 1], rows[y]
        while i < rows[y]:
            if row_above[runs[i] - start_above] == row[runs[j] - start]:
                _join(parent, i, j)
            overhang = runs[i + 1] + width - runs[j + 1]
            i += overhang <= 0
            j += overhang >= 0


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
def _number(parent: NDArray[np.int32]) -> int:
    """Replace each entry of a forest by the number of its tree, 0 .. n - 1 in the order of the roots; return n."""
    n = 0
    for i in range(len(parent)):
        if parent[i] == i:
            parent[i] = n
            n += 1
        else:
            parent[i] = parent[parent[i]]
    return n


@kernel
def merge(
    lab: NDArray[np.uint8],
    runs: NDArray[np.int64],
    rows: NDArray[np.int64],
    piece: NDArray[np.int32],
    min_size: float,
) -> None:
    """Replace each run's tree in the forest `piece` by its superpixel, numbered by their first pixels.

    In each round every piece below `min_size` chooses the adjacent piece of the most similar mean colour, and all
    that chose are joined; it ends when no piece is too small or none has a neighbour left.
    """
    n_pieces = _number(piece)
    sums = _sums(lab.reshape(3, -1), runs, piece, n_pieces)
    edges = _edges(lab.shape[2], runs, rows, piece, sums[:, 0] < min_size)
    n_edges = len(edges)
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
    for run in range(len(piece)):
        piece[run] = owner[piece[run]]


@kernel
def _sums(
    lab: NDArray[np.uint8], runs: NDArray[np.int64], piece: NDArray[np.int32], n_pieces: int
) -> NDArray[np.int64]:
    """Return the number of pixels of each piece and the sums of their L, a, b."""
    sums = np.zeros((n_pieces, 4), np.int64)
    for run in range(len(piece)):
        p = piece[run]
        sum_l = sum_a = sum_b = 0
        for i in range(runs[run], runs[run + 1]):
            sum_l += lab[0, i]
            sum_a += lab[1, i]
            sum_b += lab[2, i]
        sums[p, 0] += runs[run + 1] - runs[run]
        sums[p, 1] += sum_l
        sums[p, 2] += sum_a
        sums[p, 3] += sum_b
    return sums


@kernel
def _edges(
    width: int, runs: NDArray[np.int64], rows: NDArray[np.int64], piece: NDArray[np.int32], small: NDArray[np.bool_]
) -> NDArray[np.int32]:
    """Return the (E, 2) pairs of pieces that touch, of which one is small, over and over again."""
    n_runs = len(piece)
    edges = np.empty((3 * n_runs, 2), np.int32)
    n = 0
    for y in range(len(rows) - 1):
        for run in range(rows[y] + 1, rows[y + 1]):
            a, b = piece[run - 1], piece[run]
            edges[n, 0], edges[n, 1] = a, b
            n += small[a] | small[b]
        i, j = rows[max(y - 1, 0)], rows[y]
        while i < rows[y]:
            a, b = piece[i], piece[j]
            edges[n, 0], edges[n, 1] = a, b
            n += (small[a] | small[b]) & (a != b)
            overhang = runs[i + 1] + width - runs[j + 1]
            i += overhang <= 0
            j += overhang >= 0
    return edges[:n]


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


@kernel
def paint(runs: NDArray[np.int64], values: NDArray[np.int32], first: int, last: int, flat: NDArray[np.int32]) -> None:
    """Write the values of the runs from `first` to `last` to their pixels."""
    for run in range(first, last):
        flat[runs[run] : runs[run + 1]] = values[run]


@kernel
def mean_colours(image: NDArray[np.uint8], labels: NDArray[np.int32], n: int) -> NDArray[np.float32]:
    """Return the mean colour of each of `n` labels; (n, 3)."""
    sums = np.zeros((n, 4), np.int64)
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            of_label = sums[labels[y, x]]
            of_label[3] += 1
            for c in range(3):
                of_label[c] += image[y, x, c]
    means = np.empty((n, 3), np.float32)
    for k in range(n):
        for c in range(3):
            means[k, c] = sums[k, c] / sums[k, 3]
    return means


@kernel
def refine(
    image: NDArray[np.uint8],
    half: NDArray[np.int32],
    colours: NDArray[np.float32],
    first: int,
    last: int,
    labels: NDArray[np.int32],
) -> None:
    """Label every pixel, given the labels of every second one of every second row, of which do those `first` to `last`.

    A pixel between two takes over the label of one of them, and so each label's pixels stay connected.
    """
    height, width = labels.shape
    below = np.empty(width, np.int32)
    _fill_row(image[2 * first], half[first], colours, below)
    for i in range(first, last):
        y = 2 * i
        labels[y] = below
        if y + 2 < height:
            _fill_row(image[y + 2], half[i + 1], colours, below)
        if y + 1 < height:
            row, above = labels[y + 1], labels[y]
            row[:] = above
            for x in _differing(above, below):
                if _is_nearer(image[y + 1, x], colours[below[x]], colours[above[x]]):
                    row[x] = below[x]


@kernel
def _fill_row(
    image: NDArray[np.uint8], half: NDArray[np.int32], colours: NDArray[np.float32], labels: NDArray[np.int32]
) -> None:
    """Label a row, given the labels of every second pixel."""
    for x in range(len(labels)):
        labels[x] = half[x // 2]
    for j in _differing(half[:-1], half[1:]):
        if _is_nearer(image[2 * j + 1], colours[half[j + 1]], colours[half[j]]):
            labels[2 * j + 1] = half[j + 1]


@kernel
def _differing(one: NDArray[np.int32], other: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return where two rows of labels differ."""
    places = np.empty(len(one) + 1, np.int32)
    n = 0
    for x in range(len(one)):
        places[n] = x
        n += one[x] != other[x]
    return places[:n]


@kernel
def _is_nearer(pixel: NDArray[np.uint8], one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    """Return whether a pixel's colour is nearer to one colour than to the other."""
    difference = np.float32(0)
    for c in range(3):
        to_one, to_other = np.float32(pixel[c]) - one[c], np.float32(pixel[c]) - other[c]
        difference += to_one * to_one - to_other * to_other
    return bool(difference < 0)
