"""Improved spectral clustering: scale, number of clusters and initial centres come from the data.

Lu et al., IROS 2015, section IV; Ng, Jordan and Weiss, NIPS 2001.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from lrtrav_ros.config import ClusteringConfig
from lrtrav_ros.numerics.blas import one_blas_thread

_MAX_ITERATIONS = 100


@one_blas_thread()
def spectral_clusters(
    distances: NDArray[np.float64],
    config: ClusteringConfig = ClusteringConfig(),  # noqa: B008 - frozen
) -> NDArray[np.int32]:
    """Cluster items by the distances between them.

    Parameters
    ----------
    distances
        float64 (n, n), symmetric, zero on the diagonal.

    Returns
    -------
    NDArray[np.int32]
        The cluster of each item, (n,), numbers 0 .. k - 1 without gaps; k is at most n.

    Raises
    ------
    ValueError
        If `distances` is not square, or holds a value that is not finite.
    """
    if distances.ndim != 2 or distances.shape[0] != distances.shape[1] or not np.isfinite(distances).all():
        raise ValueError(f"distances are {distances.shape}; give a square matrix of finite numbers")
    if len(distances) < 2:
        return np.zeros(len(distances), np.int32)
    n = len(distances)
    normalised = _normalised(affinity(distances))
    k = min(config.k or automatic_k(np.linalg.eigvalsh(normalised)[::-1]), n)
    embedded = eigh(normalised, subset_by_index=(n - k, n - 1))[1]
    norm = np.linalg.norm(embedded, axis=1, keepdims=True)
    embedded = embedded / np.where(norm > 0, norm, 1)
    rng = np.random.default_rng(config.seed)
    centres = _farthest_centres(embedded, k, rng) if config.centres == "farthest" else _random_centres(embedded, k, rng)
    return _k_means(embedded, centres)


def affinity(distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return exp(-d^2 / 2 sigma^2) with a zero diagonal; sigma is the largest distance to a nearest neighbour."""
    others = distances + np.diag(np.full(len(distances), np.inf))
    sigma = float(others.min(axis=1).max())
    similar = np.exp(-((distances / sigma) ** 2) / 2) if sigma > 0 else (distances == 0).astype(np.float64)
    np.fill_diagonal(similar, 0)
    return similar


def automatic_k(eigenvalues: NDArray[np.floating]) -> int:
    """Return 1 + argmax of the gaps lambda_i - lambda_(i+1), i from 1, the first left out for lambda_1 = 1.

    Parameters
    ----------
    eigenvalues
        Of the normalised affinity, in falling order.
    """
    gaps = np.abs(np.diff(eigenvalues))[1:]
    return int(np.argmax(gaps)) + 3 if gaps.size else len(eigenvalues)


def _normalised(similar: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return D^-1/2 A D^-1/2; an item that is like no other has a row of zeros."""
    degree = similar.sum(axis=1)
    scale = np.divide(1, np.sqrt(degree), out=np.zeros_like(degree), where=degree > 0)
    return similar * scale * scale[:, None]


def _farthest_centres(points: NDArray[np.float64], k: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return k points: the first at random, each next one the farthest from those chosen."""
    chosen = [int(rng.integers(len(points)))]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < k:
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(nearest)))
    return points[chosen]


def _random_centres(points: NDArray[np.float64], k: int, rng: np.random.Generator) -> NDArray[np.float64]:
    return points[rng.choice(len(points), k, replace=False)]


def _k_means(points: NDArray[np.float64], centres: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return the nearest centre of each point once none changes (Lloyd); empty clusters drop out."""
    labels = np.full(len(points), -1)
    for _ in range(_MAX_ITERATIONS):
        squared = ((points[:, None, :] - centres[None, :, :]) ** 2).sum(axis=2)
        nearest = np.argmin(squared, axis=1)
        if np.array_equal(nearest, labels):
            break
        labels = nearest
        used = np.unique(labels)
        centres = np.stack([points[labels == label].mean(axis=0) for label in used])
        labels = np.searchsorted(used, labels)
    return labels.astype(np.int32)
