"""Compiled parts of the features. The arguments are checked, and the features explained, in `features`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel, summing_kernel

HUES, SATURATIONS, VALUES = (
    9,
    8,
    6,
)  # bins of the colour histogram; constants, so that the divisions are multiplications
STEP = 8  # entries of a sparse row that are multiplied at a time; each row has a multiple of it


@kernel
def find_colour_bins(
    blue: NDArray[np.uint8], green: NDArray[np.uint8], red: NDArray[np.uint8], bins: NDArray[np.uint16]
) -> None:
    """Write each pixel's joint bin of H (0 .. 179), S and V as OpenCV has them, in steps of 1 / 4096, rounded.

    All numbers are whole, but for quotients that are rounded at once, and so small that float32 holds them exactly.
    """
    one, two, four, half = np.float32(1), np.float32(2), np.float32(4), np.float32(2048)
    for v in range(bins.shape[0]):
        blues, greens, reds, row = blue[v], green[v], red[v], bins[v]
        for u in range(len(row)):
            b, g, r = np.float32(blues[u]), np.float32(greens[u]), np.float32(reds[u])
            value = max(max(b, g), r)
            spread = value - min(min(b, g), r)
            per_saturation = np.rint(np.float32(255 << 12) / max(value, one))
            per_hue = np.rint(np.float32((180 << 12) // 6) / max(spread, one))
            saturation = np.uint32(spread * per_saturation + half) >> np.uint32(12)
            sixths = b - r + two * spread if value == g else r - g + four * spread
            sixths = g - b if value == r else sixths
            hue = np.uint32(sixths * per_hue + half + np.float32(180 << 12)) >> np.uint32(12)  # from 150 up
            hue = hue - np.uint32(180) if hue >= np.uint32(180) else hue
            of_hue = hue * np.uint32(HUES) // np.uint32(180) * np.uint32(SATURATIONS)
            of_saturation = (saturation * np.uint32(SATURATIONS)) >> np.uint32(8)
            of_value = (np.uint32(value) * np.uint32(VALUES)) >> np.uint32(8)
            row[u] = (of_hue + of_saturation) * np.uint32(VALUES) + of_value


@kernel
def count_bins(
    bins: NDArray[np.uint8] | NDArray[np.uint16], superpixels: NDArray[np.int32], counts: NDArray[np.uint32]
) -> None:
    """Add each pixel to its bin of its superpixel's histogram.

    Both halves of a row in turn: to add to the count that was just added to has to wait.
    """
    width = superpixels.shape[1]
    half, one = np.uint64(width // 2), np.uint32(1)
    for v in range(superpixels.shape[0]):
        row, labels = bins[v], superpixels[v]
        for u in range(half):
            counts[np.uint32(labels[u]), row[u]] += one
            counts[np.uint32(labels[u + half]), row[u + half]] += one
        if width % 2:
            counts[labels[-1], row[-1]] += one


@kernel
def count_both(
    colours: NDArray[np.uint16],
    textures: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    colour_counts: NDArray[np.uint32],
    texture_counts: NDArray[np.uint32],
) -> None:
    """Do as `count_bins` with two images of bins."""
    width = superpixels.shape[1]
    half, one = np.uint64(width // 2), np.uint32(1)
    for v in range(superpixels.shape[0]):
        colour, texture, labels = colours[v], textures[v], superpixels[v]
        for u in range(half):
            w = u + half
            left, right = np.uint32(labels[u]), np.uint32(labels[w])
            colour_counts[left, colour[u]] += one
            colour_counts[right, colour[w]] += one
            texture_counts[left, texture[u]] += one
            texture_counts[right, texture[w]] += one
        if width % 2:
            colour_counts[labels[-1], colour[-1]] += one
            texture_counts[labels[-1], texture[-1]] += one


@kernel
def divide_by_sums(counts: NDArray[np.uint32], shares: NDArray[np.float32]) -> None:
    """Write each row of counts, divided by its sum; those without counts are 0."""
    for i in range(counts.shape[0]):
        row, total = counts[i], np.uint32(0)
        for b in range(len(row)):
            total += row[b]
        total = max(total, np.uint32(1))
        for b in range(len(row)):
            shares[i, b] = np.float32(row[b]) / np.float32(total)


@kernel
def describe_weber(grey: NDArray[np.uint8], table: NDArray[np.uint8], described: NDArray[np.uint8]) -> None:
    """Write the table's entry (256, 2296) for each pixel and the sum of its 3 x 3 window; edges repeat."""
    height, width = grey.shape
    entries, n_sums = table.ravel(), np.uint32(table.shape[1])
    columns = np.empty(width + 2, np.uint16)
    indices = np.empty(width, np.uint32)
    for v in range(height):
        above, row, below = grey[max(v - 1, 0)], grey[v], grey[min(v + 1, height - 1)]
        for u in range(width):
            columns[u + 1] = np.uint16(above[u]) + np.uint16(row[u]) + np.uint16(below[u])
        columns[0], columns[width + 1] = columns[1], columns[width]
        left, right = columns[:width], columns[2:]
        for u in range(width):
            total = np.uint32(left[u]) + np.uint32(columns[u + 1]) + np.uint32(right[u])
            indices[u] = np.uint32(row[u]) * n_sums + total
        for u in range(width):
            described[v, u] = entries[indices[u]]


@kernel
def add_colours(image: NDArray[np.uint8], superpixels: NDArray[np.int32], sums: NDArray[np.int64]) -> None:
    """Add each pixel's blue, green and red, and a count of 1, to the row (n, 4) of its superpixel, run by run."""
    width = image.shape[1]
    for v in range(image.shape[0]):
        row, labels = image[v], superpixels[v]
        u = 0
        while u < width:
            first, label = u, labels[u]
            blue = green = red = 0
            while u < width and labels[u] == label:
                blue += row[u, 0]
                green += row[u, 1]
                red += row[u, 2]
                u += 1
            sums[label, 0] += blue
            sums[label, 1] += green
            sums[label, 2] += red
            sums[label, 3] += u - first


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
