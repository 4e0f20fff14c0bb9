"""Compiled parts of propagation. The arguments are checked, and the method explained, in `propagation`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel, summing_kernel

_FAR = np.float32(1e30)
_LANES = 16  # more than the nearest that are wanted
_LARGEST_EXPONENT = np.float32(64)


@inlined_kernel
def exp_of_minus(y: np.float32) -> np.float32:
    """Return exp(-y) of y from 0 to 64, by a polynomial for exp(-y / 64), which the compiler can vectorise."""
    t = y * np.float32(-1 / 64)
    p = np.float32(1 / 24) + t * np.float32(1 / 120)
    p = np.float32(1 / 6) + t * p
    p = np.float32(1 / 2) + t * p
    p = np.float32(1) + t * p
    p = np.float32(1) + t * p
    p *= p
    p *= p
    p *= p
    p *= p
    p *= p
    return p * p


@summing_kernel
def weigh(
    distances: NDArray[np.float32],
    scale: np.float32,
    looks: NDArray[np.float32],
    other_looks: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    """Replace distances, in some rows, by exp(-((scale * distance)^2 + squared difference of looks, two by n) / 2)."""
    half_squared, half, most = np.float32(0.5) * scale * scale, np.float32(0.5), _LARGEST_EXPONENT
    others, more_others = other_looks[0], other_looks[1]
    for i in range(first, last):
        row, look, more = distances[i], looks[0, i], looks[1, i]
        for j in range(len(row)):
            a, b = others[j] - look, more_others[j] - more
            row[j] = exp_of_minus(min(half_squared * row[j] * row[j] + half * (a * a + b * b), most))


@summing_kernel
def add_votes(
    weights: NDArray[np.float32],
    shares: NDArray[np.float32],
    grounds: NDArray[np.float32],
    total: NDArray[np.float64],
    ground: NDArray[np.float64],
) -> None:
    """Add to each row's total the weighted sum of shares, and to its ground that of `grounds`."""
    for i in range(len(weights)):
        row = weights[i]
        of_all, of_ground = np.float32(0), np.float32(0)
        for j in range(len(row)):
            of_all += row[j] * shares[j]
            of_ground += row[j] * grounds[j]
        total[i] += of_all
        ground[i] += of_ground


@summing_kernel
def nearest(
    distances: NDArray[np.float32],
    scale: np.float32,
    places: NDArray[np.float32],
    columns: NDArray[np.int64],
    first: int,
    last: int,
    others: NDArray[np.int64],
    squared: NDArray[np.float32],
) -> None:
    """Write the nearest columns but its own to some rows, by scaled distance and place (3, n), and how far squared.

    Each lane, every `_LANES`-th column, has a nearest one: as many columns as are wanted, and one more, are not farther
    than that of the lane which as many lanes are nearer than, so that only few columns need to be ranked.
    """
    n, n_nearest = distances.shape[1], others.shape[1]
    a, b, c = places[0, columns], places[1, columns], places[2, columns]
    far, lanes = np.full(-(-n // _LANES) * _LANES, _FAR), np.empty(_LANES, np.float32)
    candidates, values = np.empty(n + 1, np.uint32), np.empty(n + 1, np.float32)
    for i in range(first, last):
        row, x, y, z = distances[i], places[0, i], places[1, i], places[2, i]
        for j in range(n):
            d = scale * row[j]
            far[j] = d * d + (a[j] - x) * (a[j] - x) + (b[j] - y) * (b[j] - y) + (c[j] - z) * (c[j] - z)
        lanes[:] = _FAR
        for start in range(0, len(far), _LANES):
            for lane in range(_LANES):
                lanes[lane] = min(lanes[lane], far[start + lane])
        limit = _FAR
        for lane in range(_LANES):
            n_nearer = 0
            for other in range(_LANES):
                n_nearer += lanes[other] < lanes[lane]
            limit = min(limit, lanes[lane]) if n_nearer >= n_nearest else limit
        n_candidates = np.uint64(0)
        for j in range(n):
            candidates[n_candidates], values[n_candidates] = j, far[j]
            n_candidates += np.uint64((far[j] <= limit) & (columns[j] != i))
        for k in range(n_candidates):
            rank = np.uint64(0)
            for other in range(n_candidates):
                is_first = (values[other] == values[k]) & (other < k)
                rank += np.uint64((values[other] < values[k]) | is_first)
            if rank < n_nearest:
                others[i, rank], squared[i, rank] = candidates[k], values[k]


@kernel
def join_ties(
    starts: NDArray[np.int32],
    others: NDArray[np.int32],
    weights: NDArray[np.float32],
    tied: NDArray[np.int64],
    tie_weights: NDArray[np.float32],
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
    """Return ties of superpixels: where those of each start, where its neighbours end, all others, and all weights.

    After its neighbours come the superpixels that it is tied with (n, k), and those that are tied with it.
    """
    n, n_ties = tied.shape
    all_starts, ends = np.zeros(n + 1, np.int32), np.empty(n, np.int32)
    for i in range(n):
        all_starts[i + 1] += starts[i + 1] - starts[i] + n_ties
        for k in range(n_ties):
            all_starts[tied[i, k] + 1] += 1
    for i in range(n):
        all_starts[i + 1] += all_starts[i]
    all_others, all_weights = np.empty(all_starts[n], np.int32), np.empty(all_starts[n])
    for i in range(n):
        p = all_starts[i]
        for k in range(starts[i], starts[i + 1]):
            all_others[p], all_weights[p] = others[k], weights[k]
            p += 1
        ends[i] = p
    place = ends.copy()
    for i in range(n):
        for k in range(n_ties):
            j = tied[i, k]
            all_others[place[i]], all_weights[place[i]] = j, tie_weights[i, k]
            place[i] += 1
            all_others[place[j]], all_weights[place[j]] = i, tie_weights[i, k]
            place[j] += 1
    return all_starts, ends, all_others, all_weights


@summing_kernel
def settle(
    starts: NDArray[np.int32],
    ends: NDArray[np.int32],
    others: NDArray[np.int32],
    weights: NDArray[np.float64],
    held: NDArray[np.float64],
    right: NDArray[np.float64],
    tolerance: float,
    x: NDArray[np.float64],
) -> None:
    """Solve ``(H + L) x = right`` by conjugate gradients from x on, H diagonal and L the Laplacian of the ties.

    The diagonal is the preconditioner; the residual's norm falls below the tolerance times that of the right side.
    """
    n = len(x)
    diagonal = held.copy()
    for i in range(n):
        for k in range(starts[i], ends[i]):
            diagonal[i] += weights[k]
    product, direction = np.empty(n), np.zeros(n)
    _multiply(starts, ends, others, weights, diagonal, x, product)
    residual = right - product
    limit, before = tolerance * tolerance * (right * right).sum(), 1.0
    for _ in range(10 * n):
        if (residual * residual).sum() <= limit:
            break
        now = (residual * residual / diagonal).sum()
        for i in range(n):
            direction[i] = residual[i] / diagonal[i] + now / before * direction[i]
        _multiply(starts, ends, others, weights, diagonal, direction, product)
        step = now / (direction * product).sum()
        for i in range(n):
            x[i] += step * direction[i]
            residual[i] -= step * product[i]
        before = now


@summing_kernel
def _multiply(
    starts: NDArray[np.int32],
    ends: NDArray[np.int32],
    others: NDArray[np.int32],
    weights: NDArray[np.float64],
    diagonal: NDArray[np.float64],
    x: NDArray[np.float64],
    product: NDArray[np.float64],
) -> None:
    """Write the product of x and a symmetric matrix, of which the ties are the elements off the diagonal, negative."""
    for i in range(len(x)):
        total = 0.0
        for k in range(starts[i], ends[i]):
            total += weights[k] * x[others[k]]
        product[i] = diagonal[i] * x[i] - total


@summing_kernel
def recognise(
    looks: NDArray[np.float32],
    looks_before: NDArray[np.float32],
    values: NDArray[np.float32],
    reach: np.float32,
    weights: NDArray[np.float64],
    totals: NDArray[np.float64],
    sums: NDArray[np.float64],
) -> None:
    """Write the highest weight, the sum of weights and that of weighted values of what looked so, in order of look 0.

    The weight is exp(-(squared difference of looks, four by n) / 2); what is out of reach by the first look has none.
    """
    half, alike = np.float32(0.5), np.empty(len(values), np.float32)
    for i in range(looks.shape[1]):
        low = np.searchsorted(looks_before[0], looks[0, i] - reach)
        high = np.searchsorted(looks_before[0], looks[0, i] + reach)
        a, b = looks_before[0, low:high], looks_before[1, low:high]
        c, d = looks_before[2, low:high], looks_before[3, low:high]
        x, y, z, t = looks[0, i], looks[1, i], looks[2, i], looks[3, i]
        for j in range(len(a)):
            p, q, r, s = a[j] - x, b[j] - y, c[j] - z, d[j] - t
            alike[j] = exp_of_minus(min(half * (p * p + q * q + r * r + s * s), _LARGEST_EXPONENT))
        of_those = values[low:high]
        highest = total = found = np.float32(0)
        for j in range(len(a)):
            highest = max(highest, alike[j])
            total += alike[j]
            found += alike[j] * of_those[j]
        weights[i], totals[i], sums[i] = highest, total, found


@kernel
def spread(
    starts: NDArray[np.int32], others: NDArray[np.int32], free: NDArray[np.bool_], reached: NDArray[np.bool_]
) -> None:
    """Mark as reached whatever is free and connected by free ones with one that is reached and free."""
    n = len(free)
    waiting = np.empty(n, np.int64)
    n_waiting = 0
    for i in range(n):
        if reached[i]:
            waiting[n_waiting] = i
            n_waiting += 1
    while n_waiting:
        n_waiting -= 1
        i = waiting[n_waiting]
        for k in range(starts[i], starts[i + 1]):
            j = others[k]
            if free[j] and not reached[j]:
                reached[j] = True
                waiting[n_waiting] = j
                n_waiting += 1


@kernel
def label_pixels(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    table: NDArray[np.uint16],
    ground: int,
    obstacle: int,
    first: int,
    last: int,
    extended: NDArray[np.uint8],
    confidence: NDArray[np.uint8],
) -> None:
    """Write the label and the confidence of each pixel in some columns.

    The table (3 n,) has the label, plus 256 times the confidence, of the ground, obstacle and unknown pixels of each
    superpixel.
    """
    for v in range(occupancy.shape[0]):
        row, labels = occupancy[v, first:last], superpixels[v, first:last]
        extended_row, confidence_row = extended[v, first:last], confidence[v, first:last]
        for u in range(last - first):
            kind = np.uint32(1) if row[u] == np.uint8(obstacle) else np.uint32(2)
            kind = np.uint32(0) if row[u] == np.uint8(ground) else kind
            both = table[np.uint32(3) * np.uint32(labels[u]) + kind]
            extended_row[u] = both & np.uint16(255)
            confidence_row[u] = both >> np.uint16(8)
