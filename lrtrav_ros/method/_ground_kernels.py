"""Compiled parts of u-v-disparity. The arguments are checked, and the method explained, in `ground`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel, summing_kernel

GROUND = 0
OBSTACLE = 100

HORIZON_STEP = 2  # rows between the horizons of the Hough transform
_MIN_DISPARITY = 3  # nearer to the horizon, rounding leaves the slope open
_MAX_STEEPNESS = 3.0
_ABOVE = 1.75  # residuals count more above the ground than below it: all that is not ground stands on it


@kernel
def count_columns(disparity: NDArray[np.float32], n_disparities: int) -> NDArray[np.uint16]:
    """Return the histogram (D, W) of the rounded disparities of each column."""
    histogram = np.zeros((n_disparities, disparity.shape[1]), np.uint16)
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = int(disparity[v, u] + 0.5)
            if 0 < d < histogram.shape[0]:
                histogram[d, u] += 1
    return histogram


@kernel
def count_rows(disparity: NDArray[np.float32], n_disparities: int) -> NDArray[np.int32]:
    """Return the histogram (H, D) of the rounded disparities of each row."""
    histogram = np.zeros((disparity.shape[0], n_disparities), np.int32)
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = int(disparity[v, u] + 0.5)
            if 0 < d < histogram.shape[1]:
                histogram[v, d] += 1
    return histogram


@kernel
def select(disparity: NDArray[np.float32], cells: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the disparities whose cell (D, W) is set, and 0 elsewhere."""
    selected = np.zeros_like(disparity)
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = int(disparity[v, u] + 0.5)
            if 0 < d < cells.shape[0] and cells[d, u]:
                selected[v, u] = disparity[v, u]
    return selected


@kernel
def vote(
    histogram: NDArray[np.int32],
    votes: NDArray[np.float32],
    first: int,
    disparity_bins: NDArray[np.float64],
    row_bins: NDArray[np.float64],
) -> None:
    """Let each cell (v, d) vote for horizon and slope: log slope = log d - log(v - horizon)."""
    for v in range(max(first, 0), histogram.shape[0]):
        for d in range(_MIN_DISPARITY, histogram.shape[1]):
            count = histogram[v, d]
            if count > 0:
                for i in range(votes.shape[0]):
                    below = v - first - i * HORIZON_STEP
                    if below <= 0:
                        break
                    k = disparity_bins[d] - row_bins[below]
                    if 0 <= k < votes.shape[1]:
                        votes[i, int(k)] += count


@summing_kernel
def normal_equations(
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    values: NDArray[np.float64],
    fitted: NDArray[np.float64],
    noise: float,
    relative: float,
) -> tuple[float, float, NDArray[np.float64], NDArray[np.float64]]:
    """Return pixels near the ground and below its horizon, and the normal equations of a Gauss-Newton step.

    The loop has no branches and sums numbers of one type, so that the compiler vectorises it: six times as fast.
    """
    slope, intercept, tilt, bend = fitted
    near = below = n00 = n01 = n02 = n03 = n11 = n12 = n13 = n22 = n23 = n33 = r0 = r1 = r2 = r3 = 0.0
    for i in range(values.size):
        v, u = rows[i], columns[i]
        line = slope * v + intercept + tilt * u
        root = np.sqrt(max(line * line - 4 * bend, 1e-6))
        expected = (line + root) / 2
        counts = 1.0 if expected > noise else 0.0
        expected = max(expected, 1e-6)
        inverse = 1 / (noise + relative * expected)
        difference = values[i] - expected
        residual = difference * inverse
        residual = residual * _ABOVE if residual > 0 else residual
        biweight = max(1 - residual * residual, 0.0) * counts
        below += counts
        near += 1.0 if biweight > 0 else 0.0
        weight = (biweight * inverse) ** 2
        g1 = min(expected / root, _MAX_STEEPNESS)  # at a crest it grows without bounds
        g0, g2, g3 = g1 * v, g1 * u, -g1 / expected
        n00 += weight * g0 * g0
        n01 += weight * g0 * g1
        n02 += weight * g0 * g2
        n03 += weight * g0 * g3
        n11 += weight * g1 * g1
        n12 += weight * g1 * g2
        n13 += weight * g1 * g3
        n22 += weight * g2 * g2
        n23 += weight * g2 * g3
        n33 += weight * g3 * g3
        weight *= difference
        r0 += weight * g0
        r1 += weight * g1
        r2 += weight * g2
        r3 += weight * g3
    normal = np.array([[n00, n01, n02, n03], [n01, n11, n12, n13], [n02, n12, n22, n23], [n03, n13, n23, n33]])
    return near, below, normal, np.array([r0, r1, r2, r3])


@kernel
def classify(
    disparity: NDArray[np.float32],
    obstacles: NDArray[np.float32],
    coefficients: NDArray[np.float64],
    noise: float,
    step: float,
    stands: float,
    occupancy: NDArray[np.uint8],
) -> None:
    """Write ground and obstacle pixels; `step` and `stands` are heights as shares of the camera's height."""
    slope, intercept, tilt, bend = coefficients
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = disparity[v, u]
            line = slope * v + intercept + tilt * u
            squared = line * line - 4 * bend
            if line <= 0 or squared <= 0 or (stands == np.inf and obstacles[v, u] > 0):
                occupancy[v, u] = OBSTACLE
            elif d > 0:
                expected = (line + np.sqrt(squared)) / 2
                if d - expected > max(noise, stands * d):
                    occupancy[v, u] = OBSTACLE
                if expected > noise and abs(d - expected) < noise + step * expected:
                    occupancy[v, u] = GROUND
