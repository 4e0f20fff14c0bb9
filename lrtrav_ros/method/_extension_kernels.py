"""Compiled parts of the extension. The arguments are checked, and the method explained, in `extension`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel


@kernel
def survey(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], values: NDArray[np.uint8], sums: NDArray[np.int64]
) -> None:
    """Add up pixels of each of three values, all pixels, their rows and their columns in each superpixel, (n, 6)."""
    width = superpixels.shape[1]
    for v in range(superpixels.shape[0]):
        u = 0
        while u < width:
            first, label = u, superpixels[v, u]
            first_value = second_value = third_value = 0
            while u < width and superpixels[v, u] == label:
                first_value += occupancy[v, u] == values[0]
                second_value += occupancy[v, u] == values[1]
                third_value += occupancy[v, u] == values[2]
                u += 1
            row, area = sums[label], u - first
            row[0] += first_value
            row[1] += second_value
            row[2] += third_value
            row[3] += area
            row[4] += v * area
            row[5] += (first + u - 1) * area // 2


@kernel
def mark_neighbours(superpixels: NDArray[np.int32], touching: NDArray[np.bool_]) -> None:
    """Mark each pair of different labels (n, n) that meet in a row or a column."""
    height, width = superpixels.shape
    for v in range(height):
        for u in range(width - 1):
            if superpixels[v, u] != superpixels[v, u + 1]:
                touching[superpixels[v, u], superpixels[v, u + 1]] = True
    for v in range(height - 1):
        for u in range(width):
            if superpixels[v, u] != superpixels[v + 1, u]:
                touching[superpixels[v, u], superpixels[v + 1, u]] = True
