"""Compiled parts of the extension. The arguments are checked, and the method explained, in `extension`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel


@kernel
def count_values(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    columns: NDArray[np.uint8],
    counts: NDArray[np.uint32],
) -> None:
    """Count the pixels of each superpixel (n, 4) in the column that the table (256,) has for their value."""
    height, width = superpixels.shape
    quarter, one = np.uint64(width // 4), np.uint32(1)
    for v in range(height):
        row, labels = occupancy[v], superpixels[v]
        for u in range(quarter):  # each quarter in turn: to add to the count that was just added to has to wait
            second, third, fourth = u + quarter, u + np.uint64(2) * quarter, u + np.uint64(3) * quarter
            counts[np.uint32(labels[u]), columns[row[u]]] += one
            counts[np.uint32(labels[second]), columns[row[second]]] += one
            counts[np.uint32(labels[third]), columns[row[third]]] += one
            counts[np.uint32(labels[fourth]), columns[row[fourth]]] += one
        for u in range(width - width % 4, width):
            counts[labels[u], columns[row[u]]] += one


@kernel
def survey(superpixels: NDArray[np.int32], sums: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Add up pixels, rows and columns of each superpixel (n, 3), and return the pairs that touch, some several times.

    A row is a list of runs of one label: two runs touch where one follows the other, or overlaps one of the row above.
    """
    height, width = superpixels.shape
    of_two_rows = np.empty((2, width), np.int32)  # where runs end
    after, below = np.full(len(sums), -1, np.int32), np.full(len(sums), -1, np.int32)  # the last that was found there
    pairs = np.empty((2, max(4 * width, 1024)), np.int32)
    n_pairs = n_above = 0
    for v in range(height):
        row, ends, ends_above = superpixels[v], of_two_rows[v % 2], of_two_rows[1 - v % 2]
        n_runs = _find_runs(row, ends)
        _add_runs(row, ends[:n_runs], v, sums)
        if n_pairs + n_above + 2 * n_runs > pairs.shape[1]:
            more = np.empty((2, 2 * pairs.shape[1]), np.int32)
            more[:, :n_pairs] = pairs[:, :n_pairs]
            pairs = more
        for k in range(n_runs - 1):
            label, other = row[ends[k] - 1], row[ends[k]]
            pairs[0, n_pairs], pairs[1, n_pairs] = label, other
            n_pairs += after[label] != other
            after[label] = other
        k = m = 0
        while m < n_above:
            label, other = row[ends[k] - 1], superpixels[v - 1, ends_above[m] - 1]
            pairs[0, n_pairs], pairs[1, n_pairs] = label, other
            is_new = (below[other] != label) & (after[label] != other) & (after[other] != label)
            n_pairs += (label != other) & is_new
            below[other] = label if label != other else below[other]
            end, end_above = ends[k], ends_above[m]
            k += end <= end_above
            m += end_above <= end
        n_above = n_runs
    return pairs[0, :n_pairs], pairs[1, :n_pairs]


@kernel
def _find_runs(row: NDArray[np.int32], ends: NDArray[np.int32]) -> int:
    """Write where runs of one label end, and return their number; without branches, for they are short."""
    n_runs = np.uint64(0)
    for u in range(1, len(row)):
        ends[n_runs] = u
        n_runs += np.uint64(row[u] != row[u - 1])
    ends[n_runs] = len(row)
    return int(n_runs) + 1


@kernel
def _add_runs(row: NDArray[np.int32], ends: NDArray[np.int32], v: int, sums: NDArray[np.int64]) -> None:
    """Add a row's runs to the sums of pixels, rows and columns."""
    first = 0
    for end in ends:
        n, total = end - first, sums[row[first]]
        total[0] += n
        total[1] += v * n
        total[2] += (first + end - 1) * n // 2
        first = end


@kernel
def neighbours(
    first: NDArray[np.int32], second: NDArray[np.int32], n: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the neighbours of each of n superpixels, in order, from pairs: where those of each start, and all.

    Both ends of each pair are sorted by the one end, then by the other: each time they are counted and put in place.
    """
    n_ends = 2 * len(first)
    starts = np.zeros(n + 1, np.int32)
    for p in range(len(first)):
        starts[first[p] + 1] += 1
        starts[second[p] + 1] += 1
    for i in range(n):
        starts[i + 1] += starts[i]
    one, other, place = np.empty(n_ends, np.int32), np.empty(n_ends, np.int32), starts[:-1].copy()
    for p in range(len(first)):
        a, b = first[p], second[p]
        one[place[a]], other[place[a]] = a, b
        place[a] += 1
        one[place[b]], other[place[b]] = b, a
        place[b] += 1
    place[:] = starts[:-1]
    in_order = np.empty(n_ends, np.int32)
    for p in range(n_ends):
        in_order[place[other[p]]] = one[p]
        place[other[p]] += 1
    n_unique, start = 0, 0
    for i in range(n):
        last = -1
        for p in range(start, starts[i + 1]):
            if in_order[p] != last:
                last = in_order[p]
                in_order[n_unique] = last
                n_unique += 1
        start = starts[i + 1]
        starts[i + 1] = n_unique
    return starts, in_order[:n_unique]
