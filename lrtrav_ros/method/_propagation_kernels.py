"""Compiled parts of propagation. The arguments are checked, and the method explained, in `propagation`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel

GROUND = 0
OBSTACLE = 100
UNKNOWN = 255


@kernel
def nearest(
    distances: NDArray[np.float64], scale: float, places: NDArray[np.float64], n_nearest: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the nearest others of each item by scaled matrix and place, (n, n_nearest), and how far squared."""
    n = len(distances)
    others = np.zeros((n, n_nearest), np.int64)
    squared = np.full((n, n_nearest), np.inf)
    for i in range(n):
        for j in range(n):
            d = (scale * distances[i, j]) ** 2
            if i == j or n_nearest == 0 or d >= squared[i, n_nearest - 1]:
                continue
            for k in range(places.shape[1]):
                d += (places[i, k] - places[j, k]) ** 2
            if d >= squared[i, n_nearest - 1]:
                continue
            k = n_nearest - 1
            while k > 0 and squared[i, k - 1] > d:
                squared[i, k], others[i, k] = squared[i, k - 1], others[i, k - 1]
                k -= 1
            squared[i, k], others[i, k] = d, j
    return others, squared


@kernel
def survey(occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], sums: NDArray[np.int64]) -> None:
    """Add up ground, obstacle and unknown pixels, all pixels, their rows and columns in each superpixel, (n, 6)."""
    width = superpixels.shape[1]
    for v in range(superpixels.shape[0]):
        u = 0
        while u < width:
            first, label = u, superpixels[v, u]
            ground = obstacle = unknown = 0
            while u < width and superpixels[v, u] == label:
                ground += occupancy[v, u] == GROUND
                obstacle += occupancy[v, u] == OBSTACLE
                unknown += occupancy[v, u] == UNKNOWN
                u += 1
            row, area = sums[label], u - first
            row[0] += ground
            row[1] += obstacle
            row[2] += unknown
            row[3] += area
            row[4] += v * area
            row[5] += (first + u - 1) * area // 2


@kernel
def label_pixels(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    labels: NDArray[np.uint8],
    confidences: NDArray[np.uint8],
    extended: NDArray[np.uint8],
    confidence: NDArray[np.uint8],
) -> None:
    """Write the label and the confidence of each pixel: rows of both are for ground, obstacle and unknown pixels."""
    has_ground_above = np.zeros(occupancy.shape[1], np.bool_)  # what has none may be above the horizon
    for v in range(occupancy.shape[0]):
        for u in range(occupancy.shape[1]):
            label, row = superpixels[v, u], 2
            if occupancy[v, u] == GROUND:
                row, has_ground_above[u] = 0, True
            elif occupancy[v, u] == OBSTACLE:
                row = 1
            if row == 1 and not has_ground_above[u]:
                extended[v, u], confidence[v, u] = OBSTACLE, max(confidences[row, label], 255 - confidences[row, label])
            else:
                extended[v, u], confidence[v, u] = labels[row, label], confidences[row, label]
