"""Compiled parts of the textures. The arguments are checked, and the descriptors explained, in `textures`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel


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
