"""Compiled parts of the features. The arguments are checked, and the features explained, in `features`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel

# Bins of the colour histogram. They are constants, so that divisions become multiplications.
HUES, SATURATIONS, VALUES = 9, 8, 6


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
