"""Compiled parts of propagation. The arguments are checked, and the method explained, in `propagation`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel


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
def label_pixels(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    labels: NDArray[np.uint8],
    confidences: NDArray[np.uint8],
    ground: int,
    obstacle: int,
    extended: NDArray[np.uint8],
    confidence: NDArray[np.uint8],
) -> None:
    """Write the label and the confidence of each pixel: rows of both are for ground, obstacle and unknown pixels."""
    has_ground_above = np.zeros(occupancy.shape[1], np.bool_)  # what has none may be above the horizon
    for v in range(occupancy.shape[0]):
        for u in range(occupancy.shape[1]):
            label, row = superpixels[v, u], 2
            if occupancy[v, u] == ground:
                row, has_ground_above[u] = 0, True
            elif occupancy[v, u] == obstacle:
                row = 1
            if row == 1 and not has_ground_above[u]:
                extended[v, u], confidence[v, u] = obstacle, max(confidences[row, label], 255 - confidences[row, label])
            else:
                extended[v, u], confidence[v, u] = labels[row, label], confidences[row, label]
