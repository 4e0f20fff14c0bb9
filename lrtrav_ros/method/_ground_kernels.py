"""Compiled parts of u-v-disparity. The arguments are checked, and the method explained, in `ground`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel, summing_kernel

GROUND = 0
OBSTACLE = 100
UNKNOWN = 255

HORIZON_STEP = 2  # rows between the horizons of the Hough transform
_MIN_DISPARITY = 3  # nearer to the horizon, rounding leaves the slope open
_MAX_STEEPNESS = 3.0
_SIGNIFICANT = 2.0  # times the noise
_SAME = 0.1  # share by which disparity may change from pixel to pixel of a face, and pixels
_SAME_PX = 0.5
_LEAST_FACE = 0.03  # of the camera's height
_NEARER = 0.06  # share by which something nearer or farther than a face differs from it
_SEEN_THROUGH = 2  # pixels farther away than a face that end it
_DROP_MARGIN = 0.03  # share by which the ground is nearer than what is seen below it, where that ends
_RIM_PX = 4  # without disparity, between the rim of a drop and what is seen below it
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


@inlined_kernel
def _ground_disparity(coefficients: NDArray[np.float64], v: int, u: int) -> float:
    """Disparity of the ground line at a pixel; below 0 above the horizon, 0 beyond a crest."""
    line = coefficients[0] * v + coefficients[1] + coefficients[2] * u
    if line <= 0:
        return line
    squared = line * line - 4 * coefficients[3]
    return (line + np.sqrt(squared)) / 2 if squared > 0 else 0.0


@kernel
def classify(
    disparity: NDArray[np.float32],
    obstacles: NDArray[np.float32],
    coefficients: NDArray[np.float64],
    noise: float,
    step: float,
    occupancy: NDArray[np.uint8],
) -> None:
    """Write ground and obstacle pixels by the u-disparity's obstacles; `step` is a share of the camera's height."""
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d, expected = disparity[v, u], _ground_disparity(coefficients, v, u)
            if expected <= 0 or obstacles[v, u] > 0:
                occupancy[v, u] = OBSTACLE
            elif expected > noise and d > 0 and abs(d - expected) < noise + step * expected:
                occupancy[v, u] = GROUND


@kernel
def classify_by_height(
    disparity: NDArray[np.float32],
    expected: NDArray[np.float32],
    noise: float,
    step: float,
    stands: float,
    occupancy: NDArray[np.uint8],
) -> None:
    """Write ground and obstacle pixels by their height; `step` and `stands` are shares of the camera's height."""
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d, ground = disparity[v, u], expected[v, u]
            stands_out = d > 0 and d - max(ground, 0.0) > max(_SIGNIFICANT * noise, stands * d)
            if stands_out or ground <= -noise:
                occupancy[v, u] = OBSTACLE
            elif d > 0 and stands * ground > noise and abs(d - ground) < noise + step * ground:
                occupancy[v, u] = GROUND


@kernel
def ground_disparity(coefficients: NDArray[np.float64], height: int, width: int) -> NDArray[np.float32]:
    """Return the disparity of the ground line, below 0 above the horizon, and 0 beyond a crest."""
    expected = np.empty((height, width), np.float32)
    for v in range(height):
        for u in range(width):
            expected[v, u] = _ground_disparity(coefficients, v, u)
    return expected


@kernel
def mark_faces(
    disparity: NDArray[np.float32],
    expected: NDArray[np.float32],
    noise: float,
    least: float,
    step: float,
    margin: float,
    occupancy: NDArray[np.uint8],
) -> None:
    """Mark what stands upright down to its contact with the ground, column by column from the top.

    A face begins at a pixel above the ground by `least` pixels and by `step`, a share of the camera's height. It goes
    on while disparity stays as it is: where it grows along with the ground's, ground rises, and no face is there.
    """
    for u in range(disparity.shape[1]):
        first, top, top_ground, face = -1, 0.0, 0.0, 0.0  # of the face; no row where there is none
        stands = False
        seen_through = 0
        for v in range(disparity.shape[0]):
            d = disparity[v, u]
            if d <= 0 or expected[v, u] <= -noise:  # all is an obstacle above the horizon
                continue
            ground = max(expected[v, u], 0.0)
            in_contact = ground >= (1 - margin) * face - noise / 2
            grown = ground - top_ground
            if first >= 0 and d - top <= grown / 2 + noise and abs(d - face) <= _SAME * face + _SAME_PX:
                if in_contact:
                    first, stands = -1, False
                    continue
                face, seen_through = d, 0
                if not stands and grown - (d - top) >= max(noise, _LEAST_FACE * d):
                    stands = True
                    _mark_above(disparity, u, first, v, occupancy)
                if stands:
                    occupancy[v, u] = OBSTACLE
            elif d - ground > max(least, step * d):
                first, top, top_ground, face, stands, seen_through = v, d, ground, d, False, 0
            elif not stands or in_contact:
                first, stands = -1, False
            elif d < (1 - _NEARER) * face - _SAME_PX:
                seen_through += 1
                if seen_through >= _SEEN_THROUGH:
                    first, stands = -1, False
            elif d <= (1 + _NEARER) * face + _SAME_PX:
                occupancy[v, u] = OBSTACLE


@kernel
def _mark_above(disparity: NDArray[np.float32], u: int, first: int, end: int, occupancy: NDArray[np.uint8]) -> None:
    """Mark what has disparity in the rows first .. end - 1 of a column."""
    for v in range(first, end):
        if disparity[v, u] > 0:
            occupancy[v, u] = OBSTACLE


@kernel
def drops(
    disparity: NDArray[np.float32],
    expected: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
    noise: float,
    least: float,
    step: float,
    deep: float,
) -> NDArray[np.uint8]:
    """Return 1 for what lies below the ground, column by column from the bottom.

    It begins behind a rim of ground, for mismatches have none, by `least` pixels and by `step`, a share of the camera's
    height, below the ground. It is a drop if it is `deep` or upright, as the far wall of a ditch, and goes on to where
    the ground has its disparity.
    """
    found = np.zeros(disparity.shape, np.uint8)
    height = disparity.shape[0]
    for u in range(disparity.shape[1]):
        rim, first, edge, edge_ground, face = 2 * height, -1, 0.0, 0.0, 0.0
        for v in range(height - 1, -1, -1):
            d, ground = disparity[v, u], expected[v, u]
            if ground <= 0:
                break
            if d <= 0:
                continue
            if first >= 0 and abs(d - face) <= _SAME * face + _SAME_PX and ground > (1 + _DROP_MARGIN) * d + noise / 2:
                face, fallen = d, edge_ground - ground
                is_deep = ground - d > (deep * d if found[first, u] > 0 else max(least, deep * d))
                if not is_deep and edge - d > fallen / 2 + noise:
                    first = -1
                elif found[first, u] > 0 or is_deep or fallen - (edge - d) >= max(noise, _LEAST_FACE * d):
                    for row in range(v, first + 1 if found[first, u] == 0 else v + 1):
                        found[row, u] = 1
            elif ground - d > max(least, step * d) and rim - v <= _RIM_PX:
                first, edge, edge_ground, face = v, d, ground, d
            else:
                first = -1
                rim = v if occupancy[v, u] == GROUND else rim
    return found


@kernel
def fill_holes(closed: NDArray[np.uint8], disparity: NDArray[np.float32], occupancy: NDArray[np.uint8]) -> None:
    """Set to ground what `closed` has and disparity lacks, unless an obstacle is next to it above or below."""
    height = disparity.shape[0]
    for u in range(disparity.shape[1]):
        below, bottom = UNKNOWN, height
        for v in range(height - 1, -1, -1):
            if occupancy[v, u] == UNKNOWN:
                continue
            if below != OBSTACLE and occupancy[v, u] != OBSTACLE:
                for row in range(v + 1, bottom):
                    if closed[row, u] > 0 and disparity[row, u] <= 0:
                        occupancy[row, u] = GROUND
            below, bottom = occupancy[v, u], v
