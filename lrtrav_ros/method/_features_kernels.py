"""Compiled parts of the features. The arguments are checked, and the features explained, in `features`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel


@kernel
def count_colours(
    hsv: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    hue: NDArray[np.uint16],
    saturation: NDArray[np.uint16],
    value: NDArray[np.uint16],
    counts: NDArray[np.int32],
) -> None:
    """Add each pixel to its joint bin, the sum of what its three bytes look up, of its superpixel's histogram."""
    for v in range(hsv.shape[0]):
        for u in range(hsv.shape[1]):
            colour_bin = hue[hsv[v, u, 0]] + saturation[hsv[v, u, 1]] + value[hsv[v, u, 2]]
            counts[superpixels[v, u], colour_bin] += 1


@kernel
def count_bins(bins: NDArray[np.uint16], superpixels: NDArray[np.int32], counts: NDArray[np.int32]) -> None:
    """Add each pixel to its bin of its superpixel's histogram."""
    for v in range(bins.shape[0]):
        for u in range(bins.shape[1]):
            counts[superpixels[v, u], bins[v, u]] += 1


@kernel
def look_up(
    grey: NDArray[np.uint8], sums: NDArray[np.uint16], table: NDArray[np.uint8], described: NDArray[np.uint8]
) -> None:
    """Write the table's entry for each centre and window sum."""
    for v in range(grey.shape[0]):
        for u in range(grey.shape[1]):
            described[v, u] = table[grey[v, u], sums[v, u]]


@kernel
def add_colours(image: NDArray[np.uint8], superpixels: NDArray[np.int32], sums: NDArray[np.int64]) -> None:
    """Add each pixel's blue, green and red, and a count of 1, to the row (n, 4) of its superpixel, run by run."""
    width = image.shape[1]
    for v in range(image.shape[0]):
        u = 0
        while u < width:
            first, label = u, superpixels[v, u]
            blue = green = red = 0
            while u < width and superpixels[v, u] == label:
                blue += image[v, u, 0]
                green += image[v, u, 1]
                red += image[v, u, 2]
                u += 1
            sums[label, 0] += blue
            sums[label, 1] += green
            sums[label, 2] += red
            sums[label, 3] += u - first
