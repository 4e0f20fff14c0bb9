"""Tests of the spectral clustering."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import ClusteringConfig
from lrtrav_ros.method import comparison
from lrtrav_ros.method.clustering import affinity, automatic_k, spectral_clusters, spread_clusters
from lrtrav_ros.method.features import Features


def groups(*sizes: int, spread: float = 0.05, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the distances of points in well separated groups on a line, and the group of each."""
    group = np.repeat(np.arange(len(sizes)), sizes)
    points = group + np.random.default_rng(seed).uniform(-spread, spread, len(group))
    return np.abs(points[:, None] - points), group


def same_partition(first: NDArray[np.integer], second: NDArray[np.integer]) -> bool:
    return np.array_equal(first[:, None] == first, second[:, None] == second)


def test_sigma_is_the_largest_distance_to_a_nearest_neighbour() -> None:
    distances = np.array([[0, 1, 4], [1, 0, 3], [4, 3, 0]], float)
    expected = np.exp(-(distances**2) / (2 * 3**2))
    np.fill_diagonal(expected, 0)
    np.testing.assert_allclose(affinity(distances), expected)


@pytest.mark.parametrize("centres", ["farthest", "random"])
def test_groups_are_found_with_their_number_given(centres: str) -> None:
    distances, group = groups(9, 5, 7)
    assert same_partition(spectral_clusters(distances, ClusteringConfig(k=3, centres="farthest")), group)
    found = spectral_clusters(distances, ClusteringConfig(k=3, centres=centres))
    assert found.dtype == np.int32
    assert sorted(np.unique(found)) == list(range(found.max() + 1))


@pytest.mark.parametrize("sizes", [(8, 8, 8), (6, 9, 7, 8), (5, 5, 5, 5, 5)])
def test_clusters_of_automatic_number_do_not_mix_groups(sizes: tuple[int, ...]) -> None:
    distances, group = groups(*sizes)
    found = spectral_clusters(distances, ClusteringConfig(k=0))
    assert found.max() + 1 >= len(sizes)
    for label in np.unique(found):
        assert len(np.unique(group[found == label])) == 1


def test_automatic_k_counts_from_one_and_leaves_the_first_gap_out() -> None:
    assert automatic_k(np.array([1.0 - 1e-12, 0.5, 0.45, 0.2, 0.15])) == 4  # the gap after lambda_3
    assert automatic_k(np.array([1.0, 0.9, 0.1, 0.05])) == 3  # the paper's usual case


def test_same_seed_same_clusters() -> None:
    distances, _ = groups(30, 30, spread=0.6)
    config = ClusteringConfig(k=5, seed=3)
    np.testing.assert_array_equal(spectral_clusters(distances, config), spectral_clusters(distances, config))


def test_superpixels_are_of_the_cluster_of_the_landmark_that_looks_most_like_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kind = np.array([0, 0, 1, 1, 0, 1, 0, 0, 1, 1])
    histograms = np.where(kind[:, None] == [0, 0, 1, 1], [0.7, 0.3, 0.6, 0.4], 0).astype(np.float32)
    features = Features(histograms / histograms.sum(axis=1, keepdims=True), histograms / 2, np.zeros((10, 2)))
    of_all = kind.astype(np.int32)
    assert spread_clusters(of_all, features) is of_all
    monkeypatch.setattr(comparison, "MAX_LANDMARKS", 4)
    assert comparison.landmarks(features).tolist() == [0, 3, 6, 9]
    found = spread_clusters(np.array([5, 7, 5, 7], np.int32), features)
    assert found.tolist() == [5, 5, 7, 7, 5, 7, 5, 5, 7, 7]
    with pytest.raises(ValueError, match=r"clusters is int32 \(10,\); give int32 \(4,\)"):
        spread_clusters(of_all, features)


@pytest.mark.parametrize("n", [0, 1, 2, 3])
@pytest.mark.parametrize("k", [0, 10])
def test_few_items(n: int, k: int) -> None:
    found = spectral_clusters(np.ones((n, n)) - np.eye(n), ClusteringConfig(k=k))
    assert found.shape == (n,)


def test_items_that_are_all_alike_and_one_that_is_like_no_other() -> None:
    alike = np.zeros((6, 6))
    assert len(spectral_clusters(alike, ClusteringConfig(k=2))) == 6
    alike[5, :5] = alike[:5, 5] = 1e6
    found = spectral_clusters(alike, ClusteringConfig(k=2))
    assert np.isfinite(found).all()


@pytest.mark.parametrize("distance", [0.0, 1.0])
def test_any_number_of_items_that_are_all_alike(distance: float) -> None:
    for n in range(2, 60):  # LAPACK fails for a few of them
        found = spectral_clusters(distance * (np.ones((n, n)) - np.eye(n)), ClusteringConfig(k=10))
        assert found.shape == (n,)
        assert 0 <= found.min() <= found.max() < 10


@pytest.mark.parametrize(
    ("distances", "message"),
    [
        (np.zeros((2, 3)), r"distances is float64 \(2, 3\); give float64 \(n, n\)"),
        (np.zeros(4), r"distances is float64 \(4,\); give float64 \(n, n\)"),
        (np.array([[0, np.nan], [np.nan, 0]]), "distances holds values from nan to nan; give finite distances"),
        (np.array([[0, -1.5], [-1.5, 0]]), "distances holds values from -1.5 to 0; give finite distances from 0 up"),
    ],
)
def test_what_is_no_distance_matrix_is_refused(distances: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        spectral_clusters(distances)
