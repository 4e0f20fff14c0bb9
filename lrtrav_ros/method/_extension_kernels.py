"""Compiled parts of the extension. The arguments are checked, and the method explained, in `extension`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel


@kernel
def count_values(image: NDArray[np.uint8], superpixels: NDArray[np.int32], counts: NDArray[np.int64]) -> None:
    """Add each pixel of an 8-bit image to its value's count (n, 256) in its superpixel."""
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            counts[superpixels[v, u], image[v, u]] += 1


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
