"""Compiled parts of u-v-disparity. The arguments are checked, and the method explained, in `ground`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel, summing_kernel

GROUND = 0
OBSTACLE = 100
UNKNOWN = 255

HORIZON_STEP = 2  # rows between the horizons of the Hough transform
_MIN_DISPARITY = 3  # nearer to the horizon, rounding leaves the slope open
_LANES = 4  # a row is counted in as many histograms, for adding to a number at once again has to wait
_RUN = 64  # most rows that vote together
_ITERATIONS = 20
_MIN_ROW_SPREAD = 0.01  # of the image's height: in fewer rows the slope is left open
_CONVERGED_PX = 1e-3
_STIFFNESS = 1e-4  # of the bend: with little ground in sight it stays flat
_MAX_STEEPNESS = np.float32(3.0)
_ABOVE = np.float32(1.75)  # residuals count more above the ground than below it: all that is not ground stands on it
_SIGNIFICANT = 2.0  # times the noise
_SAME = np.float32(0.1)  # share by which disparity may change from pixel to pixel of a face, and pixels
_SAME_PX = np.float32(0.5)
_WORD = 8  # flags that are looked at in one go
_LEAST_FACE = 0.03  # of the camera's height
_NEARER = np.float32(0.06)  # share by which something nearer or farther than a face differs from it
_SEEN_THROUGH = 2  # pixels farther away than a face that end it
_DROP_MARGIN = np.float32(0.03)  # share by which the ground is nearer than what is seen below it, where that ends
_BEYOND_PX = 4  # rows, in which the ground beyond what is no drop shows that it is no mismatch itself
_RIM_PX = 4  # without disparity, between the rim of a drop and what is seen below it
_CLEAR_PX = np.float32(4.0)  # ground of less disparity says little about noise
_MAX_BELOW = np.float32(0.25)  # of the ground's disparity: what is farther below is a drop or a mismatch

_ZERO, _HALF, _ONE, _TINY = np.float32(0.0), np.float32(0.5), np.float32(1.0), np.float32(1e-6)


@inlined_kernel
def _round(disparity: NDArray[np.float32], n_disparities: int, rounded: NDArray[np.uint16]) -> None:
    """Write the rounded disparities of a row; 0 for those that are not below `n_disparities`."""
    limit = np.float32(n_disparities)
    for u in range(disparity.size):
        whole = np.float32(np.int32(disparity[u]))
        nearest = whole + (_ONE if disparity[u] - whole >= _HALF else _ZERO)
        rounded[u] = np.uint16(nearest if nearest < limit else _ZERO)


@kernel
def count_columns(disparity: NDArray[np.float32], first: int, end: int, histogram: NDArray[np.uint16]) -> None:
    """Write the histogram (D, W) of the rounded disparities of the columns first .. end - 1."""
    rounded = np.empty(end - first, np.uint16)
    counts = np.zeros((histogram.shape[0], end - first), np.uint16)
    for v in range(disparity.shape[0]):
        _round(disparity[v, first:end], histogram.shape[0], rounded)
        for u in range(rounded.size):
            counts[rounded[u], u] += np.uint16(1)
    counts[0] = 0
    histogram[:, first:end] = counts


@kernel
def count_rows(
    disparity: NDArray[np.float32], counted: NDArray[np.uint8], first: int, end: int, histogram: NDArray[np.int32]
) -> None:
    """Write the histogram (H, D) of the rounded disparities of the rows first .. end - 1 in cells (D, W) that are 1."""
    rounded = np.empty(disparity.shape[1], np.uint16)
    counts = np.empty((_LANES, histogram.shape[1]), np.int32)
    for v in range(first, end):
        _round(disparity[v], histogram.shape[1], rounded)
        counts[:] = 0
        for u in range(rounded.size):
            counts[u % _LANES, rounded[u]] += np.int32(counted[rounded[u], u])
        for lane in range(1, _LANES):
            for d in range(histogram.shape[1]):
                counts[0, d] += counts[lane, d]
        histogram[v] = counts[0]
        histogram[v, 0] = 0


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
    first: int,
    n_horizons: int,
    n_slopes: int,
    disparity_bins: NDArray[np.float64],
    row_bins: NDArray[np.float64],
) -> NDArray[np.int32]:
    """Return the votes (slopes, horizons) of all cells (v, d): log slope = log d - log(v - horizon).

    The cells of one disparity that are `below` to `end` - 1 rows below a horizon vote for one slope. Their number is
    the difference between two running sums over the rows; for horizons in turn, these stand one after the other.
    """
    n_rows = row_bins.size  # below the first horizon
    votes = np.zeros((n_slopes, n_horizons), np.int32)
    sums = np.zeros((HORIZON_STEP, (n_rows + _RUN) // HORIZON_STEP + 1), np.int32)
    for d in range(_MIN_DISPARITY, histogram.shape[1]):
        low, high = _sum_up(histogram, d, first, sums)
        below, end = 1, 1
        while below < high:
            k = math.floor(disparity_bins[d] - row_bins[below])
            if k < 0:
                break
            while end < min(n_rows, below + _RUN) and math.floor(disparity_bins[d] - row_bins[end]) == k:
                end += 1
            if k < n_slopes:
                start = max((low - end) // HORIZON_STEP, 0)
                stop = min((high - below) // HORIZON_STEP + 1, n_horizons)
                lower = sums[below % HORIZON_STEP, below // HORIZON_STEP + start :]
                upper = sums[end % HORIZON_STEP, end // HORIZON_STEP + start :]
                line = votes[k, start:stop]
                for i in range(line.size):
                    line[i] += upper[i] - lower[i]
            below = end
    return votes


@kernel
def _sum_up(histogram: NDArray[np.int32], d: int, first: int, sums: NDArray[np.int32]) -> tuple[int, int]:
    """Write how many pixels of a disparity are above row first + r, for each r; return the first and last + 1 with any.

    That stands at [r % HORIZON_STEP, r // HORIZON_STEP], so that those of successive horizons do side by side.
    """
    height = histogram.shape[0]
    low, high, total = height - first, 0, np.int32(0)
    for r in range(max(-first, 0), max(height - first, 0) + _RUN + 1):
        sums[r % HORIZON_STEP, r // HORIZON_STEP] = total
        if first + r < height and histogram[first + r, d] > 0:
            total += histogram[first + r, d]
            low, high = min(low, r), r + 1
    return low, high


@summing_kernel
def fit(
    samples: NDArray[np.float32],
    spacing: int,
    line: NDArray[np.float64],
    n_terms: int,
    noise: float,
    relative: float,
    min_support: float,
) -> bool:
    """Fit a line, in place, to every `spacing`-th pixel of an image; False where too few are near it.

    What sums numbers is compiled into this function: the order of the sums would differ between copies of a function.
    """
    height, width = spacing * samples.shape[0], spacing * samples.shape[1]
    for _ in range(_ITERATIONS):
        near, below, normal, right = _normal_equations(samples, spacing, line, noise, relative)
        if near < max(min_support * below, n_terms) or _row_spread(normal) < _MIN_ROW_SPREAD * height:
            return False
        weight = normal[1, 1]
        normal[0, 0] += 1e-9 * weight
        normal[2, 2] += 1e-6 * width**2 * weight
        normal[3, 3] += _STIFFNESS * weight
        right[3] -= _STIFFNESS * weight * line[3]
        _solve(normal[:n_terms, :n_terms], right)
        line[:n_terms] += right[:n_terms]
        if abs(right[0]) * height + abs(right[1]) < _CONVERGED_PX:
            break
    return True


@inlined_kernel
def _normal_equations(
    samples: NDArray[np.float32], spacing: int, line: NDArray[np.float64], noise: float, relative: float
) -> tuple[float, float, NDArray[np.float64], NDArray[np.float64]]:
    """Return pixels near the ground and below its horizon, and the normal equations of a Gauss-Newton step."""
    near = below = 0.0
    normal, right = np.zeros((4, 4)), np.zeros(4)
    noise_, tilt, bend4 = np.float32(noise), np.float32(spacing * line[2]), np.float32(4 * line[3])
    for row in range(samples.shape[0]):
        v = spacing * row
        start = np.float32(line[0] * v + line[1])
        highest = max(start, start + tilt * np.float32(samples.shape[1]))
        if highest + np.sqrt(max(highest * highest - bend4, _TINY)) <= noise_:
            continue  # all of the row is above the horizon
        n, m, s11, s12, s22, s13, s23, s33, r1, r2, r3 = _row_sums(
            samples[row], start, tilt, bend4, noise_, np.float32(relative)
        )
        near += n
        below += m
        normal[0, 0] += v * v * s11
        normal[0, 1] += v * s11
        normal[0, 2] += v * spacing * s12
        normal[0, 3] += v * s13
        normal[1, 1] += s11
        normal[1, 2] += spacing * s12
        normal[1, 3] += s13
        normal[2, 2] += spacing * spacing * s22
        normal[2, 3] += spacing * s23
        normal[3, 3] += s33
        right[0] += v * r1
        right[1] += r1
        right[2] += spacing * r2
        right[3] += r3
    for i in range(4):
        for j in range(i):
            normal[i, j] = normal[j, i]
    return near, below, normal, right


@inlined_kernel
def _row_sums(
    values: NDArray[np.float32],
    start: np.float32,
    tilt: np.float32,
    bend4: np.float32,
    noise: np.float32,
    relative: np.float32,
) -> tuple[float, ...]:
    """Return what a row adds to the pixels near the ground and below its horizon, and to the normal equations.

    The derivatives by intercept, tilt and bend are g1, g2 and g3. The loop has no branches and sums numbers of one
    type, so that the compiler vectorises it.
    """
    n = m = s11 = s12 = s22 = s13 = s23 = s33 = r1 = r2 = r3 = _ZERO
    for i in range(values.size):
        u = np.float32(i)
        at = start + tilt * u
        root = np.sqrt(max(at * at - bend4, _TINY))
        expected = (at + root) * _HALF
        counts = _ONE if (expected > noise) & (values[i] > _ZERO) else _ZERO
        expected = max(expected, _TINY)
        inverse = _ONE / (noise + relative * expected)
        difference = values[i] - expected
        residual = difference * inverse
        residual = residual * _ABOVE if residual > _ZERO else residual
        biweight = max(_ONE - residual * residual, _ZERO) * counts
        m += counts
        n += _ONE if biweight > _ZERO else _ZERO
        g1 = min(expected / root, _MAX_STEEPNESS)  # at a crest it grows without bounds
        g2, g3 = g1 * u, -g1 / expected
        weight = biweight * inverse * biweight * inverse
        w1, w2, w3 = weight * g1, weight * g2, weight * g3
        s11 += w1 * g1
        s12 += w1 * g2
        s22 += w2 * g2
        s13 += w1 * g3
        s23 += w2 * g3
        s33 += w3 * g3
        r1 += w1 * difference
        r2 += w2 * difference
        r3 += w3 * difference
    return (
        float(n),
        float(m),
        float(s11),
        float(s12),
        float(s22),
        float(s13),
        float(s23),
        float(s33),
        float(r1),
        float(r2),
        float(r3),
    )


@inlined_kernel
def _row_spread(normal: NDArray[np.float64]) -> float:
    """Return the standard deviation of the rows that normal equations were made from."""
    mean = normal[0, 1] / normal[1, 1]
    return np.sqrt(max(normal[0, 0] / normal[1, 1] - mean * mean, 0.0))


@inlined_kernel
def _solve(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> None:
    """Replace `right` by the solution of equations with a symmetric positive definite matrix, which is overwritten."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1, n):
            factor = matrix[j, i] / matrix[i, i]
            for k in range(i, n):
                matrix[j, k] -= factor * matrix[i, k]
            right[j] -= factor * right[i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]


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


@inlined_kernel
def _ground_disparities(
    start: float, tilts: NDArray[np.float64], bend: float, disparities: NDArray[np.float32]
) -> None:
    """Write what `_ground_disparity` returns for the pixels of a row, without a branch."""
    for u in range(disparities.size):
        line = start + tilts[u]
        squared = line * line - 4 * bend
        root = (line + np.sqrt(max(squared, 0.0))) / 2
        below = root if squared > 0 else 0.0
        disparities[u] = below if line > 0 else line


@kernel
def classify_by_height(
    disparity: NDArray[np.float32],
    top: int,
    line: NDArray[np.float64],
    noise: float,
    step: float,
    stands: float,
    first: int,
    end: int,
    expected: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
) -> None:
    """Write the ground's disparity, and by the height above it, whether pixels are ground or obstacles.

    The images begin in row `top`, and their columns first .. end - 1 are written; `step` and `stands` are shares of the
    camera's height.
    """
    noise_, step_, stands_ = np.float32(noise), np.float32(step), np.float32(stands)
    significant = np.float32(_SIGNIFICANT * noise)
    tilts = line[2] * np.arange(first, end)
    for v in range(disparity.shape[0]):
        disparities, grounds, classes = disparity[v, first:end], expected[v, first:end], occupancy[v, first:end]
        _ground_disparities(line[0] * (top + v) + line[1], tilts, line[3], grounds)
        for u in range(grounds.size):
            d, ground = disparities[u], grounds[u]
            stands_out = (d > _ZERO) & (d - max(ground, _ZERO) > max(significant, stands_ * d))
            is_obstacle = stands_out | (ground <= -noise_)
            is_ground = (d > _ZERO) & (stands_ * ground > noise_) & (abs(d - ground) < noise_ + step_ * ground)
            seen = np.uint8(GROUND) if is_ground else np.uint8(UNKNOWN)
            classes[u] = np.uint8(OBSTACLE) if is_obstacle else seen


@kernel
def residuals_below(
    disparity: NDArray[np.float32], top: int, line: NDArray[np.float64], spacing: int
) -> NDArray[np.float32]:
    """Return how far pixels are below the ground, every `spacing`-th of an image that begins in row `top`."""
    residuals = np.empty((disparity.shape[0] // spacing + 1) * (disparity.shape[1] // spacing + 1), np.float32)
    n = 0
    for v in range(0, disparity.shape[0], spacing):
        for u in range(0, disparity.shape[1], spacing):
            d, ground = disparity[v, u], np.float32(_ground_disparity(line, top + v, u))
            residuals[n] = ground - d
            n += (d > _ZERO) & (ground > _CLEAR_PX) & (ground > d) & (ground - d < _MAX_BELOW * ground)
    return residuals[:n]


@kernel
def mark_faces(
    disparity: NDArray[np.float32],
    expected: NDArray[np.float32],
    noise: float,
    least: float,
    step: float,
    margin: float,
    first: int,
    end: int,
    occupancy: NDArray[np.uint8],
) -> None:
    """Mark what stands upright down to its contact with the ground, from the top of the columns first .. end - 1.

    A face begins at a pixel above the ground by `least` pixels and by `step`, a share of the camera's height. It goes
    on while disparity stays as it is: where it grows along with the ground's, ground rises, and no face is there.
    """
    noise_, least_, step_ = np.float32(noise), np.float32(least), np.float32(step)
    n = end - first
    begin, top, top_ground, face = np.zeros(n, np.int32), _zeros(n), _zeros(n), _zeros(n)  # of the face in each column
    goes_on, stands, seen_through = _flags(n), _flags(n), _flags(n)
    busy, columns = _flags(n), np.empty(n + _WORD, np.int32)
    for v in range(disparity.shape[0]):
        disparities, grounds, classes = disparity[v, first:end], expected[v, first:end], occupancy[v, first:end]
        _flag_faces(disparities, grounds, goes_on, noise_, least_, step_, busy)
        for i in range(_nonzero(busy, columns)):
            u = columns[i]
            d, ground = disparities[u], max(grounds[u], _ZERO)
            in_contact = ground >= (1 - margin) * face[u] - noise / 2
            grown, risen = ground - top_ground[u], d - top[u]
            if goes_on[u] and risen <= grown / 2 + noise and abs(d - face[u]) <= _SAME * face[u] + _SAME_PX:
                if in_contact:
                    goes_on[u] = 0
                    continue
                face[u], seen_through[u] = d, 0
                if not stands[u] and grown - risen >= max(noise, _LEAST_FACE * d):
                    stands[u] = 1
                    _mark_above(disparity, first + u, begin[u], v, occupancy)
                if stands[u]:
                    classes[u] = OBSTACLE
            elif d - ground > max(least_, step_ * d):
                begin[u], top[u], top_ground[u], face[u] = v, d, ground, d
                goes_on[u], stands[u], seen_through[u] = 1, 0, 0
            elif not stands[u] or in_contact:
                goes_on[u] = 0
            elif d < (1 - _NEARER) * face[u] - _SAME_PX:
                seen_through[u] += 1
                goes_on[u] = seen_through[u] < _SEEN_THROUGH
            elif d <= (1 + _NEARER) * face[u] + _SAME_PX:
                classes[u] = OBSTACLE


@kernel
def _flag_faces(
    disparities: NDArray[np.float32],
    grounds: NDArray[np.float32],
    goes_on: NDArray[np.uint8],
    noise: np.float32,
    least: np.float32,
    step: np.float32,
    busy: NDArray[np.uint8],
) -> None:
    """Flag the pixels of a row below the horizon at which a face may begin, or one goes on."""
    for u in range(disparities.size):
        d, ground = disparities[u], grounds[u]
        begins = d - max(ground, _ZERO) > max(least, step * d)
        busy[u] = (begins | (goes_on[u] > 0)) & (d > _ZERO) & (ground > -noise)


@inlined_kernel
def _zeros(n: int) -> NDArray[np.float32]:
    """Return a disparity of 0 for each of `n` columns."""
    return np.zeros(n, np.float32)


@inlined_kernel
def _flags(n: int) -> NDArray[np.uint8]:
    """Return a 0 for each of `n` columns, and more up to a whole word."""
    return np.zeros((n + _WORD - 1) // _WORD * _WORD, np.uint8)


@kernel
def _nonzero(flags: NDArray[np.uint8], places: NDArray[np.int32]) -> int:
    """Write the places of flags that are 1, and return how many; words of flags that are all 0 are passed over."""
    n = 0
    words = flags.view(np.uint64)
    for word in range(words.size):
        if words[word] > 0:
            for place in range(_WORD * word, _WORD * (word + 1)):
                places[n] = place
                n += flags[place]
    return n


@kernel
def _mark_above(disparity: NDArray[np.float32], u: int, first: int, end: int, occupancy: NDArray[np.uint8]) -> None:
    """Mark what has disparity in the rows first .. end - 1 of a column."""
    for v in range(first, end):
        if disparity[v, u] > 0:
            occupancy[v, u] = OBSTACLE


@kernel
def mark_drops(
    disparity: NDArray[np.float32],
    expected: NDArray[np.float32],
    occupancy: NDArray[np.uint8],
    noise: float,
    least: float,
    step: float,
    deep: float,
    first: int,
    end: int,
    found: NDArray[np.uint8],
) -> None:
    """Set to 1 what lies below the ground, from the bottom of the columns first .. end - 1.

    It begins behind a rim of ground, for mismatches have none, by `least` pixels and by `step`, a share of the camera's
    height, below the ground. It is a drop if it is `deep` or upright, as the far wall of a ditch, and goes on to where
    the ground has its disparity. Farther up, nothing is nearer: where ground is, all was a mismatch.
    """
    height, n = disparity.shape[0], end - first
    least_, step_ = np.float32(least), np.float32(step)
    begin, edge, edge_ground, face = (
        np.zeros(n, np.int32),
        _zeros(n),
        _zeros(n),
        _zeros(n),
    )  # of the drop in each column
    rim_px, goes_on = np.full(n, 255, np.uint8), _flags(n)
    busy, columns = _flags(n), np.empty(n + _WORD, np.int32)
    for v in range(height - 1, -1, -1):
        disparities, grounds, classes = disparity[v, first:end], expected[v, first:end], occupancy[v, first:end]
        _flag_drops(disparities, grounds, goes_on, least_, step_, busy)
        _follow_rims(classes, busy, rim_px)
        for i in range(_nonzero(busy, columns)):
            u = columns[i]
            d, ground = disparities[u], grounds[u]
            is_drop = goes_on[u] > 0 and found[begin[u], first + u] > 0
            is_same = abs(d - face[u]) <= _SAME * face[u] + _SAME_PX and ground > (1 + _DROP_MARGIN) * d + noise / 2
            if goes_on[u] and is_same:
                face[u], fallen = d, edge_ground[u] - ground
                is_deep = ground - d > (deep * d if is_drop else max(least, deep * d))
                if not is_deep and edge[u] - d > fallen / 2 + noise:
                    goes_on[u] = 0
                elif is_drop or is_deep or fallen - (edge[u] - d) >= max(noise, _LEAST_FACE * d):
                    for row in range(v, v + 1 if is_drop else begin[u] + 1):
                        found[row, first + u] = 1
            elif ground - d > max(least_, step_ * d) and rim_px[u] <= _RIM_PX:
                begin[u], edge[u], edge_ground[u], face[u], goes_on[u] = v, d, ground, d, 1
            else:
                if is_drop and d - face[u] > max((ground - face[u]) / 2, least):
                    is_ground = classes[u] == GROUND and occupancy[max(v - _BEYOND_PX, 0), first + u] == GROUND
                    for row in range(v, begin[u] + 1 if is_ground else v):
                        found[row, first + u] = 0
                goes_on[u] = 0
                rim_px[u] = 0 if classes[u] == GROUND else rim_px[u]


@kernel
def _flag_drops(
    disparities: NDArray[np.float32],
    grounds: NDArray[np.float32],
    goes_on: NDArray[np.uint8],
    least: np.float32,
    step: np.float32,
    busy: NDArray[np.uint8],
) -> None:
    """Flag the pixels of a row at which a drop may begin, or one goes on."""
    for u in range(disparities.size):
        d, ground = disparities[u], grounds[u]
        begins = ground - d > max(least, step * d)
        busy[u] = (begins | (goes_on[u] > 0)) & (d > _ZERO) & (ground > _ZERO)


@kernel
def _follow_rims(classes: NDArray[np.uint8], busy: NDArray[np.uint8], rim_px: NDArray[np.uint8]) -> None:
    """Write how far the rim, the last ground that is not flagged, is below the pixels of a row; 255 for farther."""
    for u in range(classes.size):
        farther = np.uint8(rim_px[u] + (rim_px[u] < np.uint8(255)))
        rim_px[u] = np.uint8(0) if (classes[u] == GROUND) & (busy[u] == 0) else farther


@kernel
def fill_holes(closed: NDArray[np.uint8], disparity: NDArray[np.float32], occupancy: NDArray[np.uint8]) -> None:
    """Set to ground what `closed` has and disparity lacks, unless an obstacle is next to it above or below."""
    above, below = np.empty(closed.shape, np.uint8), np.empty(closed.shape, np.uint8)
    last = np.full(closed.shape[1], OBSTACLE, np.uint8)
    for v in range(closed.shape[0]):
        _carry(occupancy[v], last, above[v])
    last[:] = UNKNOWN
    for v in range(closed.shape[0] - 1, -1, -1):
        _carry(occupancy[v], last, below[v])
    for v in range(closed.shape[0]):
        classes, closeds, disparities, aboves, belows = occupancy[v], closed[v], disparity[v], above[v], below[v]
        for u in range(classes.size):
            current = classes[u]
            is_hole = (current == UNKNOWN) & (closeds[u] > 0) & (disparities[u] <= _ZERO)
            fills = is_hole & (aboves[u] == GROUND) & (belows[u] != OBSTACLE)
            classes[u] = np.uint8(GROUND) if fills else current


@kernel
def _carry(classes: NDArray[np.uint8], last: NDArray[np.uint8], carried: NDArray[np.uint8]) -> None:
    """Write the classes of a row, or the last ones that are known; `last` is updated."""
    for u in range(classes.size):
        current, previous = classes[u], last[u]
        current = previous if current == UNKNOWN else current
        last[u] = current
        carried[u] = current
