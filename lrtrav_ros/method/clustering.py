"""Improved spectral clustering: scale, number of clusters and initial centres come from the data.

References
----------
.. [1] H. Lu et al., "Long Range Traversable Region Detection Based on Superpixels Clustering for Mobile Robots",
       IROS 2015, section IV.
.. [2] A. Ng, M. Jordan and Y. Weiss, "On Spectral Clustering: Analysis and an Algorithm", NIPS 2001.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.spatial.distance import cdist

from lrtrav_ros.config import ClusteringConfig, FeaturesConfig
from lrtrav_ros.method.comparison import compare, landmarks
from lrtrav_ros.method.features import Features
from lrtrav_ros.numerics.blas import one_blas_thread
from lrtrav_ros.numerics.checks import check_array, check_distances, check_finite, check_type

_MAX_ITERATIONS = 100


@one_blas_thread()
def spectral_clusters(distances: NDArray[np.float64], config: ClusteringConfig | None = None) -> NDArray[np.int32]:
    """Cluster items by the distances between them.

    Parameters
    ----------
    distances : (n, n) ndarray of float64
        Symmetric, zero on the diagonal; n may be 0.
    config : ClusteringConfig, optional
        The number of clusters, the initial centres and the seed: more clusters than there are kinds of things keep
        different things apart.

    Returns
    -------
    (n,) ndarray of int32
        The cluster of each item, numbers 0 .. k - 1 without gaps; k is at most n.

    Raises
    ------
    TypeError, ValueError
        If `distances` is not such an array, or holds a value that is negative or not finite.
    """
    config = ClusteringConfig() if config is None else config
    check_type("config", config, ClusteringConfig)
    check_distances("distances", distances)
    if len(distances) < 2:
        return np.zeros(len(distances), np.int32)
    n = len(distances)
    normalised = _normalised(_affinity(distances))
    k = min(config.k or automatic_k(np.linalg.eigvalsh(normalised)[::-1]), n)
    embedded = _last_eigenvectors(normalised, k)
    norm = np.linalg.norm(embedded, axis=1, keepdims=True)
    embedded = embedded / np.where(norm > 0, norm, 1)
    rng = np.random.default_rng(config.seed)
    return _k_means(embedded, CENTRES[config.centres](embedded, k, rng))


def spread_clusters(
    clusters: NDArray[np.int32], features: Features, config: FeaturesConfig | None = None
) -> NDArray[np.int32]:
    """Return the cluster of each superpixel, where only landmarks were clustered: that of the landmark most like it.

    Parameters
    ----------
    clusters : (m,) ndarray of int32
        The cluster of each of the `landmarks`.
    features : Features
        Of n superpixels.
    config : FeaturesConfig, optional
        By what they are compared.

    Returns
    -------
    (n,) ndarray of int32
        `clusters` itself where all superpixels are landmarks.

    Raises
    ------
    TypeError, ValueError
        If the features are none, or `clusters` has not a number for each landmark.
    """
    check_type("features", features, Features)
    check_array("clusters", clusters, np.int32, (len(landmarks(features, config)),))
    if len(clusters) == len(features):
        return clusters
    return clusters[np.argmin(compare(features, config).with_landmarks(), axis=1)]


def affinity(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return exp(-d^2 / 2 sigma^2) with a zero diagonal; sigma is the largest distance to a nearest neighbour.

    Parameters
    ----------
    distances : (n, n) ndarray of float64
        Symmetric, zero on the diagonal.

    Returns
    -------
    (n, n) ndarray of float64
        0 .. 1.

    Raises
    ------
    TypeError, ValueError
        If `distances` is not such an array, or holds a value that is negative or not finite.
    """
    check_distances("distances", distances)
    return _affinity(distances)


def _affinity(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the affinity of distances that have been checked."""
    if len(distances) < 2:
        return np.zeros_like(distances)
    others = distances + np.diag(np.full(len(distances), np.inf))
    sigma = float(others.min(axis=1).max())
    with np.errstate(over="ignore"):  # whatever is so much farther is not alike at all
        similar = np.exp(-((distances / sigma) ** 2) / 2) if sigma > 0 else (distances == 0).astype(np.float64)
    np.fill_diagonal(similar, 0)
    return similar


def automatic_k(eigenvalues: NDArray[np.floating[Any]]) -> int:
    """Return 1 + argmax of the gaps lambda_i - lambda_(i+1), i from 1, the first left out for lambda_1 = 1.

    Parameters
    ----------
    eigenvalues : (n,) ndarray of float32 or float64
        Those of the normalised affinity, in falling order.

    Returns
    -------
    int
        The number of clusters, from 3 up, or n where that is less.

    Raises
    ------
    TypeError, ValueError
        If `eigenvalues` is not such an array, is empty, or holds a value that is not finite.
    """
    check_array("eigenvalues", eigenvalues, (np.float32, np.float64), ("n",))
    check_finite("eigenvalues", eigenvalues)
    gaps = np.abs(np.diff(eigenvalues))[1:]
    return int(np.argmax(gaps)) + 3 if gaps.size else len(eigenvalues)


def _normalised(similar: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return D^-1/2 A D^-1/2; an item that is like no other has a row of zeros."""
    degree = similar.sum(axis=1)
    scale = np.divide(1, np.sqrt(degree), out=np.zeros_like(degree), where=degree > 0)
    return similar * scale * scale[:, None]


def _last_eigenvectors(matrix: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Return the eigenvectors of the k largest eigenvalues, as columns."""
    n = len(matrix)
    try:
        return eigh(matrix, subset_by_index=(n - k, n - 1))[1]
    except np.linalg.LinAlgError:  # many equal eigenvalues, as of an image without anything in it
        return np.linalg.eigh(matrix)[1][:, n - k :]


def _farthest_centres(points: NDArray[np.float64], k: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return k points: the first at random, each next one the farthest from those chosen."""
    chosen = [int(rng.integers(len(points)))]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < k:
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(nearest)))
    return points[chosen]


def _random_centres(points: NDArray[np.float64], k: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return k points at random."""
    return points[rng.choice(len(points), k, replace=False)]


CENTRES: dict[str, Callable[[NDArray[np.float64], int, np.random.Generator], NDArray[np.float64]]] = {
    "farthest": _farthest_centres,
    "random": _random_centres,
}
"""Initial centres of k-means, by the names that the setting ``clustering.centres`` has for them."""


def _k_means(points: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return the nearest centre of each point once none changes (Lloyd); empty clusters drop out."""
    labels = np.full(len(points), -1)
    for _ in range(_MAX_ITERATIONS):
        nearest = np.argmin(cdist(points, centres, "sqeuclidean"), axis=1)
        if np.array_equal(nearest, labels):
            break
        labels = nearest
        used = np.unique(labels)
        centres = np.stack([points[labels == label].mean(axis=0) for label in used])
        labels = np.searchsorted(used, labels)
    return labels.astype(np.int32)
