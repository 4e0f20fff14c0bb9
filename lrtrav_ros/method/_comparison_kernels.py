"""Compiled parts of the comparison. The arguments are checked, and the distances explained, in `comparison`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel, summing_kernel

STEP = 8  # entries of a sparse row that are multiplied at a time; each row has a multiple of it


@summing_kernel
def standardise(
    shares: NDArray[np.float32],
    flat: float,
    means: NDArray[np.float64],
    inverse_norms: NDArray[np.float64],
    used: NDArray[np.int64],
    total: NDArray[np.float64],
) -> None:
    """Write each row's mean and 1 / norm about it, 0 for flat ones, count its bins, and add up standardised rows."""
    n_bins = shares.shape[1]
    for i in range(shares.shape[0]):
        row = shares[i]
        added, squared = 0.0, 0.0
        for b in range(n_bins):
            share = np.float64(row[b])
            added += share
            squared += share * share
            used[i] += share > 0
        mean = added / n_bins
        norm = np.sqrt(max(squared - added * mean, 0.0))
        inverse = 1 / norm if norm > flat * mean else 0.0
        means[i], inverse_norms[i] = mean, inverse
        for b in range(n_bins):
            total[b] += inverse * (np.float64(row[b]) - mean)


@kernel
def compress(
    colour: NDArray[np.float32],
    texture: NDArray[np.float32],
    scales: NDArray[np.float32],
    constants: NDArray[np.float32],
    starts: NDArray[np.int64],
    bins: NDArray[np.uint32],
    values: NDArray[np.float32],
) -> None:
    """Write the bins of both histograms (n, b), scaled (n, 2), that are not 0, and a constant (n, 2) after each."""
    n_colours, n_textures = colour.shape[1], texture.shape[1]
    for i in range(colour.shape[0]):
        k, end = np.uint64(starts[i]), np.uint64(starts[i + 1])
        row, scale = colour[i], scales[i, 0]
        for b in range(n_colours):
            bins[k], values[k] = b, row[b] * scale
            k += np.uint64(row[b] > 0)
        bins[k], values[k] = n_colours, constants[i, 0]
        k += np.uint64(1)
        row, scale = texture[i], scales[i, 1]
        for b in range(n_textures):
            bins[k], values[k] = n_colours + 1 + b, row[b] * scale
            k += np.uint64(row[b] > 0)
        bins[k], values[k] = n_colours + 1 + n_textures, constants[i, 1]
        bins[k + np.uint64(1) : end] = 0
        values[k + np.uint64(1) : end] = 0


@kernel
def expand(
    starts: NDArray[np.int64],
    bins: NDArray[np.uint32],
    values: NDArray[np.float32],
    constants: tuple[int, int],
    rows: NDArray[np.int64],
    columns: NDArray[np.float32],
) -> None:
    """Write the sparse rows of these numbers as columns (bins, m), both constants with the other sign."""
    for j in range(len(rows)):
        for k in range(starts[rows[j]], starts[rows[j] + 1]):
            columns[bins[k], j] += values[k]
        for b in constants:
            columns[b, j] = -columns[b, j]


@summing_kernel
def distances_to_columns(
    starts: NDArray[np.int64],
    bins: NDArray[np.uint32],
    values: NDArray[np.float32],
    columns: NDArray[np.float32],
    first: int,
    last: int,
    triangle: bool,
    distances: NDArray[np.float32],
) -> None:
    """Write (1 - product) / 2, within 0 and 1, of sparse rows and columns; of a triangle up to the diagonal or more."""
    half = np.float32(0.5)
    for i in range(first, last):
        n = min((i | 15) + 1, columns.shape[1]) if triangle else columns.shape[1]
        row = distances[i, :n]
        row[:] = 0
        for k in range(starts[i], starts[i + 1], STEP):
            v0, v1, v2, v3 = values[k], values[k + 1], values[k + 2], values[k + 3]
            v4, v5, v6, v7 = values[k + 4], values[k + 5], values[k + 6], values[k + 7]
            c0, c1, c2, c3 = columns[bins[k]], columns[bins[k + 1]], columns[bins[k + 2]], columns[bins[k + 3]]
            c4, c5, c6, c7 = columns[bins[k + 4]], columns[bins[k + 5]], columns[bins[k + 6]], columns[bins[k + 7]]
            for j in range(n):
                row[j] += (
                    v0 * c0[j] + v1 * c1[j] + v2 * c2[j] + v3 * c3[j]
                    + v4 * c4[j] + v5 * c5[j] + v6 * c6[j] + v7 * c7[j]
                )  # fmt: skip
        for j in range(n):
            row[j] = min(max(half - half * row[j], np.float32(0)), np.float32(1))


@kernel
def mirror(matrix: NDArray[np.float32]) -> None:
    """Copy the lower triangle of a matrix to the upper one, block by block."""
    n, side = len(matrix), 32
    for top in range(0, n, side):
        for left in range(0, top + 1, side):
            for i in range(top, min(top + side, n)):
                for j in range(left, min(left + side, i)):
                    matrix[j, i] = matrix[i, j]


@kernel
def distances_of_pairs(
    starts: NDArray[np.int64],
    bins: NDArray[np.uint32],
    values: NDArray[np.float32],
    constants: tuple[int, int],
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    row: NDArray[np.float32],
    distances: NDArray[np.float32],
) -> None:
    """Write (1 - product) / 2, within 0 and 1, of pairs of sparse rows, those with the same first one together."""
    last = -1
    for p in range(len(first)):
        if first[p] != last:
            last = first[p]
            row[:] = 0
            for k in range(starts[last], starts[last + 1]):
                row[bins[k]] += values[k]
            for b in constants:
                row[b] = -row[b]
        product = np.float32(0)
        for k in range(starts[second[p]], starts[second[p] + 1]):
            product += values[k] * row[bins[k]]
        distances[p] = min(max(np.float32(0.5) - np.float32(0.5) * product, np.float32(0)), np.float32(1))
