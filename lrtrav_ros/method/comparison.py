"""Distances between superpixels, by the histograms of their colours and textures.

References
----------
.. [1] H. Lu et al., "Long Range Traversable Region Detection Based on Superpixels Clustering for Mobile Robots",
       IROS 2015, section III.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.method import _comparison_kernels as kernels
from lrtrav_ros.method.features import Features
from lrtrav_ros.numerics.blas import one_blas_thread
from lrtrav_ros.numerics.checks import check_array, check_distances, check_labels, check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

MAX_LANDMARKS = 640
"""Superpixels that all are compared with, at most: time and memory grow with n times this, not with n squared."""

MAX_PAIRS = 250_000
"""Pairs of superpixels and landmarks, where the distance is another one than correlation, which is far quicker."""

_MAX_SHARE = 1 + 1e-3  # of a histogram in one bin: its sum is not exact
_MAX_DISTANCE = 1e100  # products of sums of these are numbers still
_SPARSE = 0.8  # share of bins in use, below which it is worth the time to leave the others out
_LEAST_ROWS = 64  # of a matrix of distances, that are worth a thread
_PAIRS_AT_ONCE = 1024
_ROWS_AT_ONCE = 64
_FLAT = 1e-7  # spread of a histogram, against its mean, that rounding makes


def feature_distances(features: Features, config: FeaturesConfig | None = None) -> NDArray[np.float64]:
    """Return the distance of each superpixel to each, by colour and texture.

    Parameters
    ----------
    features : Features
        Of n superpixels.
    config : FeaturesConfig, optional
        The cues and the distance between histograms; the defaults are the best of [1].

    Returns
    -------
    (n, n) ndarray of float64
        Symmetric but for rounding, with a zero diagonal.

    Raises
    ------
    TypeError, ValueError
        If the histograms are none.
    """
    config = _checked_config(features, config)
    return CUES[config.cues](features, config.distance)


def _colour_distances(features: Features, distance: str) -> NDArray[np.float64]:
    """Return the distances by colour."""
    return histogram_distances(features.colour, distance)


def _texture_distances(features: Features, distance: str) -> NDArray[np.float64]:
    """Return the distances by texture."""
    return histogram_distances(features.texture, distance)


def _weighted_distances(features: Features, distance: str) -> NDArray[np.float64]:
    """Return the distances by colour and texture together."""
    return weighted_sum(_colour_distances(features, distance), _texture_distances(features, distance))


CUES: dict[str, Callable[[Features, str], NDArray[np.float64]]] = {
    "both": _weighted_distances,
    "colour": _colour_distances,
    "texture": _texture_distances,
}
"""Distances between superpixels, by the names that the setting ``features.cues`` has for them."""


def weighted_sum(colour: NDArray[np.float64], texture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of two distance matrices, each weighted by its mean: the cue that tells more counts more.

    Parameters
    ----------
    colour, texture : (n, n) ndarray of float64
        Distances, 1e100 at most.

    Returns
    -------
    (n, n) ndarray of float64

    Raises
    ------
    TypeError, ValueError
        If one is no matrix of distances, or they differ in size.
    """
    check_distances("colour", colour, highest=_MAX_DISTANCE)
    check_distances("texture", texture, highest=_MAX_DISTANCE)
    n = len(colour)
    check_array("texture", texture, np.float64, (n, n), may_be_empty=True)
    pairs = max(n * (n - 1), 1)
    mean_colour, mean_texture = colour.sum() / pairs, texture.sum() / pairs
    total = mean_colour + mean_texture
    if total == 0:
        return np.zeros_like(colour)
    return (colour * mean_colour + texture * mean_texture) / total


@one_blas_thread()
def histogram_distances(histograms: NDArray[np.floating[Any]], distance: str = "correlation") -> NDArray[np.float64]:
    """Return the distance of each histogram to each.

    Parameters
    ----------
    histograms : (n, bins) ndarray of float32 or float64
        One a row, each with sum 1.
    distance : str
        ``correlation``: 1 - (corr + 1) / 2 with Pearson's correlation, in 0 .. 1; ``chi_square``: half the sum of
        (a - b)^2 / (a + b); ``intersection``: 1 - sum of min(a, b); ``bhattacharyya``: sqrt(1 - sum of sqrt(a b));
        ``euclidean``; ``earth_mover``: along the bins in their order, as a share of their number.

    Returns
    -------
    (n, n) ndarray of float64
        Symmetric but for rounding, with a zero diagonal.

    Raises
    ------
    TypeError, ValueError
        If `histograms` is not such an array, or there is no such distance.
    """
    if not isinstance(distance, str) or distance not in DISTANCES:
        raise ValueError(f"no histogram distance {distance!r}; choose one of {', '.join(DISTANCES)}")
    _check_histograms("histograms", histograms)
    result = DISTANCES[distance](histograms.astype(np.float64, order="C"))
    np.fill_diagonal(result, 0)
    return result


def _check_histograms(
    name: str, histograms: NDArray[np.floating[Any]], n: int | str = "n", n_bins: int | str = "bins"
) -> None:
    """Check n rows of shares."""
    check_array(name, histograms, (np.float32, np.float64), (n, n_bins))
    low, high = float(histograms.min()), float(histograms.max())
    if not (low >= 0 and high <= _MAX_SHARE):
        raise ValueError(f"{name} hold values from {low:g} to {high:g}; give rows with sum 1")


def _correlation(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (1 - correlation) / 2; flat rows have no correlation.

    Bins that are empty in all rows, which is most of the colours, only enter by the means.
    """
    n_bins, mean = rows.shape[1], rows.mean(axis=1)
    used = rows.any(axis=0)
    if np.count_nonzero(used) < _SPARSE * n_bins:
        rows = np.compress(used, rows, axis=1)
    covariance = rows @ rows.T
    covariance -= np.outer(n_bins * mean, mean)
    norm = np.sqrt(np.maximum(covariance.diagonal(), 0))
    norm[norm <= _FLAT * mean] = np.inf
    covariance /= np.outer(norm, norm)
    np.clip(covariance, -1, 1, out=covariance)
    return np.subtract(0.5, np.multiply(covariance, 0.5, out=covariance), out=covariance)


def _bhattacharyya(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the square root of 1 - the Bhattacharyya coefficient."""
    roots = np.sqrt(rows)
    return np.sqrt(np.maximum(1 - roots @ roots.T, 0))


def _bhattacharyya_of_rows(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the square root of 1 - the Bhattacharyya coefficient."""
    coefficient = np.sqrt(rows * row).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(1 - coefficient, 0)))


def _chi_square(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return half the sum of (a - b)^2 / (a + b), over the bins that are not empty."""
    total = rows + row
    total += total == 0  # a bin that is empty in both adds 0
    return np.asarray(((rows - row) ** 2 / total).sum(axis=1) / 2)


def _intersection(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 - the sum of the lesser values."""
    return np.asarray(np.maximum(1 - np.minimum(rows, row).sum(axis=1), 0))


def _euclidean(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Euclidean distance."""
    return np.asarray(np.linalg.norm(rows - row, axis=1))


def _earth_mover(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean difference of the cumulated rows."""
    return np.asarray(np.abs(np.cumsum(rows - row, axis=1)).mean(axis=1))


def _distances_to(
    rows: NDArray[np.float64],
    others: NDArray[np.float64],
    distance: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return the distance of each row to each of others, for as many rows at once as stay in the processor's cache."""
    result = np.empty((len(rows), len(others)))
    for start in range(0, len(rows), _ROWS_AT_ONCE):
        chunk = slice(start, start + _ROWS_AT_ONCE)
        for column, other in enumerate(others):
            result[chunk, column] = distance(rows[chunk], other)
    return result


def _row_by_row(
    distance: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return a function of all rows from one of all rows and one of them, which needs less memory."""

    def distances(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        result = _distances_to(rows, rows, distance)
        return (result + result.T) / 2

    return distances


ROW_DISTANCES: dict[str, Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]] = {
    "chi_square": _chi_square,
    "intersection": _intersection,
    "bhattacharyya": _bhattacharyya_of_rows,
    "euclidean": _euclidean,
    "earth_mover": _earth_mover,
}
"""Distances of rows to one row, or to as many; correlation has a way of its own."""

DISTANCES: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "correlation": _correlation,
    "chi_square": _row_by_row(_chi_square),
    "intersection": _row_by_row(_intersection),
    "bhattacharyya": _bhattacharyya,
    "euclidean": _row_by_row(_euclidean),
    "earth_mover": _row_by_row(_earth_mover),
}
"""Distances between histograms, by the names that the setting ``features.distance`` has for them."""


def landmarks(features: Features, config: FeaturesConfig | None = None) -> NDArray[np.intp]:
    """Return the numbers of the superpixels that all are compared with: all of them, or some evenly spread over them.

    Parameters
    ----------
    features : Features
        Of n superpixels.
    config : FeaturesConfig, optional
        The distance between histograms, by which there are `MAX_LANDMARKS` or what `MAX_PAIRS` allows.

    Returns
    -------
    (m,) ndarray of intp
        In rising order.

    Raises
    ------
    TypeError, ValueError
        If the histograms are none.
    """
    config = _checked_config(features, config)
    check_array("colour", features.colour, (np.float32, np.float64), ("n", "bins"), may_be_empty=True)
    n = len(features)
    most = MAX_LANDMARKS if config.distance == "correlation" else min(MAX_LANDMARKS, max(MAX_PAIRS // max(n, 1), 1))
    return np.arange(n) if n <= most else np.linspace(0, n - 1, most).astype(np.intp)


@runtime_checkable
class Comparison(Protocol):
    """Compares the n superpixels of an image by colour and texture, each weighted as suits the image."""

    landmarks: NDArray[np.intp]
    """Numbers of those that all are compared with, (m,)."""

    def with_landmarks(self, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each landmark, (n, m), 0 to itself."""
        ...

    def with_others(self, others: Features, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each of those of other images, (n, len(others)).

        Raises TypeError or ValueError if their histograms are none, or have not as many bins.
        """
        ...

    def of_pairs(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the distances of pairs of superpixels, (p,), given by two arrays of their numbers.

        Raises TypeError or ValueError if these are no such arrays, or a number is that of no superpixel.
        """
        ...


def compare(features: Features, config: FeaturesConfig | None = None) -> Comparison:
    """Return what compares superpixels; its distances are those of `feature_distances`, but for rounding.

    Where not all superpixels are `landmarks`, the weights of the cues are those of the landmarks.

    Parameters
    ----------
    features : Features
        Of n superpixels.
    config : FeaturesConfig, optional
        The cues and the distance between histograms; the defaults are the best of [1].

    Raises
    ------
    TypeError, ValueError
        If the histograms are none, or not as many of colour as of texture.
    """
    config = _checked_config(features, config)
    _check_histograms("colour", features.colour)
    _check_histograms("texture", features.texture, len(features))
    return (_Correlation if config.distance == "correlation" else _RowByRow)(features, config)


def _checked_config(features: Features, config: FeaturesConfig | None) -> FeaturesConfig:
    """Return the settings, the default ones for None, and check that both are what they should be."""
    config = FeaturesConfig() if config is None else config
    check_type("features", features, Features)
    check_type("config", config, FeaturesConfig)
    return config


def _check_pairs(first: NDArray[np.intp], second: NDArray[np.intp], n: int) -> None:
    """Check the numbers of pairs of n superpixels."""
    check_array("first", first, np.intp, ("p",), may_be_empty=True)
    check_array("second", second, np.intp, first.shape, may_be_empty=True)
    if len(first):
        check_labels("first", first, n)
        check_labels("second", second, n)


def _check_others(others: Features, features: Features) -> None:
    """Check that features of other images can be compared with those of one."""
    check_type("others", others, Features)
    _check_histograms("colour of the others", others.colour, n_bins=features.colour.shape[1])
    _check_histograms("texture of the others", others.texture, len(others), features.texture.shape[1])


@dataclass(frozen=True, slots=True)
class _Weights:
    """What colour and texture count in a distance; the sum is 1."""

    colour: float
    texture: float

    @classmethod
    def of(cls, cues: str, mean_colour: float, mean_texture: float) -> _Weights:
        """Return the weights for mean distances: the cue that tells more counts more."""
        if cues != "both":
            return cls(float(cues == "colour"), float(cues == "texture"))
        total = mean_colour + mean_texture
        return cls(mean_colour / total, mean_texture / total) if total > 0 else cls(0.5, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class _Standard:
    """Histograms (n, b) as points of mean 0 and norm 1: products of these are correlations."""

    shares: NDArray[np.float32]
    means: NDArray[np.float64]
    inverse_norms: NDArray[np.float64]
    n_used: NDArray[np.int64]
    total: NDArray[np.float64]

    @classmethod
    def of(cls, histograms: NDArray[np.floating[Any]]) -> _Standard:
        """Return the points of histograms; flat ones are 0, which correlates with nothing."""
        n, n_bins = histograms.shape
        shares = np.ascontiguousarray(histograms, np.float32)
        result = cls(shares, np.empty(n), np.empty(n), np.zeros(n, np.int64), np.zeros(n_bins))
        kernels.standardise(shares, _FLAT, result.means, result.inverse_norms, result.n_used, result.total)
        return result

    @property
    def mean_distance(self) -> float:
        """Mean of (1 - correlation) / 2 over all pairs: products of all with all are those of the sum with itself."""
        n = len(self.means)
        of_pairs = float((self.total**2).sum()) - np.count_nonzero(self.inverse_norms)
        return max(0.5 - of_pairs / max(n * (n - 1), 1) / 2, 0.0)

    def chosen(self, which: NDArray[np.intp]) -> _Standard:
        """Return those with the given numbers, all of them or some."""
        return self if len(which) == len(self.means) else _Standard.of(self.shares[which])


class _SparseRows:
    """Points of colour and texture whose products are weighted correlations; most bins of a superpixel are empty.

    The mean, which standard points have subtracted in every bin, is an entry of its own.
    """

    def __init__(self, colour: _Standard, texture: _Standard, weights: _Weights) -> None:
        n, n_colours, n_textures = len(colour.means), colour.shares.shape[1], texture.shares.shape[1]
        roots = np.sqrt([weights.colour, weights.texture])
        scales = roots * np.stack([colour.inverse_norms, texture.inverse_norms], axis=1)
        means = np.sqrt([n_colours, n_textures]) * np.stack([colour.means, texture.means], axis=1)
        self.n_bins = n_colours + n_textures + 2
        self.means = (n_colours, n_colours + 1 + n_textures)
        n_entries = colour.n_used + texture.n_used + 3  # one is overwritten
        self.starts = np.zeros(n + 1, np.int64)
        np.cumsum(-(-n_entries // kernels.STEP) * kernels.STEP, out=self.starts[1:])
        self.bins = np.empty(self.starts[-1], np.uint32)
        self.values = np.empty(self.starts[-1], np.float32)
        kernels.compress(
            colour.shares,
            texture.shares,
            scales.astype(np.float32),
            (scales * means).astype(np.float32),
            self.starts,
            self.bins,
            self.values,
        )

    def columns(self, which: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return some of the rows as the columns (bins, m) of a matrix, their means with the other sign."""
        columns = np.zeros((self.n_bins, len(which)), np.float32)
        kernels.expand(self.starts, self.bins, self.values, self.means, which, columns)
        return columns

    def distances(self, columns: NDArray[np.float32], team: ThreadTeam, *, symmetric: bool) -> NDArray[np.float32]:
        """Return (1 - product) / 2 of each row and each column; of a symmetric matrix, one half is computed."""
        n = len(self.starts) - 1
        result = np.empty((n, columns.shape[1]), np.float32)

        def fill(first: int, last: int) -> None:
            kernels.distances_to_columns(self.starts, self.bins, self.values, columns, first, last, symmetric, result)

        team.for_bands(fill, n, least_rows=_LEAST_ROWS)
        if symmetric:
            kernels.mirror(result)
        return result

    def distances_of_pairs(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return (1 - product) / 2 of pairs."""
        result, row = np.empty(len(first), np.float32), np.empty(self.n_bins, np.float32)
        kernels.distances_of_pairs(self.starts, self.bins, self.values, self.means, first, second, row, result)
        return result


class _Correlation:
    """Compares by (1 - correlation) / 2."""

    def __init__(self, features: Features, config: FeaturesConfig) -> None:
        colour, texture = _Standard.of(features.colour), _Standard.of(features.texture)
        self._features = features
        self.landmarks = landmarks(features, config)
        means = (cue.chosen(self.landmarks).mean_distance for cue in (colour, texture))
        self._weights = _Weights.of(config.cues, *means)
        self._rows = _SparseRows(colour, texture, self._weights)

    def with_landmarks(self, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each landmark."""
        n = len(self._rows.starts) - 1
        columns = self._rows.columns(self.landmarks)
        result = self._rows.distances(columns, team, symmetric=len(self.landmarks) == n)
        result[self.landmarks, np.arange(len(self.landmarks))] = 0
        return result

    def with_others(self, others: Features, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each of those of other images."""
        _check_others(others, self._features)
        rows = _SparseRows(_Standard.of(others.colour), _Standard.of(others.texture), self._weights)
        return self._rows.distances(rows.columns(np.arange(len(others))), team, symmetric=False)

    def of_pairs(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the distances of pairs of superpixels."""
        _check_pairs(first, second, len(self._features))
        pairs = (np.require(numbers, requirements=("C", "W")) for numbers in (first, second))
        return self._rows.distances_of_pairs(*pairs)


class _RowByRow:
    """Compares by any distance but correlation."""

    def __init__(self, features: Features, config: FeaturesConfig) -> None:
        self.landmarks = landmarks(features, config)
        self._features = features
        self._distance = ROW_DISTANCES[config.distance]
        some, pairs = features.chosen(self.landmarks), max(len(self.landmarks) * (len(self.landmarks) - 1), 1)
        self._to_landmarks = (
            self._between(features.colour, some.colour),
            self._between(features.texture, some.texture),
        )
        means = (float(distances[self.landmarks].sum()) / pairs for distances in self._to_landmarks)
        self._weights = _Weights.of(config.cues, *means)

    def with_landmarks(self, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each landmark."""
        return self._weighted(*self._to_landmarks)

    def with_others(self, others: Features, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each of those of other images."""
        _check_others(others, self._features)
        colour, texture = team.map(
            lambda cue: self._between(*cue),
            [(self._features.colour, others.colour), (self._features.texture, others.texture)],
        )
        return self._weighted(colour, texture)

    def of_pairs(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the distances of pairs of superpixels."""
        _check_pairs(first, second, len(self._features))
        parts = []
        for start in range(0, len(first), _PAIRS_AT_ONCE):
            chunk = slice(start, start + _PAIRS_AT_ONCE)
            one, other = self._features.chosen(first[chunk]), self._features.chosen(second[chunk])
            colour = self._distance(one.colour.astype(np.float64), other.colour.astype(np.float64))
            texture = self._distance(one.texture.astype(np.float64), other.texture.astype(np.float64))
            parts.append(self._weighted(colour, texture))
        return np.concatenate(parts) if parts else np.empty(0, np.float32)

    def _between(self, rows: NDArray[np.floating[Any]], others: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
        """Return the distance of each histogram to each of others."""
        shares = rows.astype(np.float64, order="C")
        return _distances_to(shares, others.astype(np.float64), self._distance).astype(np.float32)

    def _weighted(self, colour: NDArray[Any], texture: NDArray[Any]) -> NDArray[np.float32]:
        """Return the weighted sum of distances by colour and texture."""
        return np.asarray(self._weights.colour * colour + self._weights.texture * texture, np.float32)
