"""Tests of the distances between histograms, and between superpixels."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from sample_images import quadrants

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.method import comparison as comparison_module
from lrtrav_ros.method.comparison import (
    DISTANCES,
    MAX_LANDMARKS,
    MAX_PAIRS,
    compare,
    feature_distances,
    histogram_distances,
    landmarks,
    weighted_sum,
)
from lrtrav_ros.method.features import Features, superpixel_features


@pytest.mark.parametrize("distance", DISTANCES)
def test_distances_are_symmetric_with_zero_diagonal(distance: str) -> None:
    histograms = np.random.default_rng(0).dirichlet(np.ones(16), 7).astype(np.float32)
    found = histogram_distances(histograms, distance)
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_array_equal(np.diag(found), 0)
    assert (found[~np.eye(7, dtype=bool)] > 0).all()


@pytest.mark.parametrize(
    ("distance", "expected"),
    [
        ("correlation", (1 + 1 / 3) / 2),  # Pearson's correlation of two different unit bins out of 4 is -1/3
        ("chi_square", 1.0),
        ("intersection", 1.0),
        ("bhattacharyya", 1.0),
        ("euclidean", np.sqrt(2)),
        ("earth_mover", 2 / 4),
    ],
)
def test_distance_of_two_unit_histograms(distance: str, expected: float) -> None:
    found = histogram_distances(np.array([[1, 0, 0, 0], [0, 0, 1, 0]], np.float32), distance)
    assert found[0, 1] == pytest.approx(expected)


def test_flat_histograms_have_no_correlation_and_no_error() -> None:
    found = histogram_distances(np.full((2, 4), 0.25, np.float32), "correlation")
    assert found[0, 1] == 0.5


def test_weights_follow_the_mean_distances() -> None:
    colour = np.array([[0, 0.6], [0.6, 0]])
    texture = np.array([[0, 0.2], [0.2, 0]])
    assert weighted_sum(colour, texture)[0, 1] == pytest.approx(0.6 * 0.6 / 0.8 + 0.2 * 0.2 / 0.8)
    np.testing.assert_array_equal(weighted_sum(colour * 0, texture * 0), np.zeros((2, 2)))
    np.testing.assert_allclose(weighted_sum(colour * 0, texture), texture)


def test_weighted_distances_whose_products_are_no_numbers_are_refused() -> None:
    distances = np.array([[0, 2e100], [2e100, 0]])
    np.testing.assert_allclose(weighted_sum(distances / 2, distances / 2), distances / 2)
    with pytest.raises(ValueError, match=r"texture holds values from 0 to 2e\+100; give finite distances"):
        weighted_sum(distances / 2, distances)


@pytest.mark.parametrize("cues", ["both", "colour", "texture"])
def test_quadrants_of_one_kind_are_closer(cues: str) -> None:
    image, labels = quadrants()
    halves = labels * 2 + (np.arange(40)[:, None] % 20 >= 10)
    features = superpixel_features(image, halves.astype(np.int32))
    found = feature_distances(features, FeaturesConfig(cues=cues))
    for i, j in itertools.combinations(range(4), 2):
        if cues != "texture" or 3 in (i, j):
            assert found[2 * i, 2 * i + 1] < found[2 * i, 2 * j]


@pytest.mark.parametrize("bound", [640, 6])
@pytest.mark.parametrize("cues", ["both", "colour", "texture"])
@pytest.mark.parametrize("distance", DISTANCES)
def test_comparison_has_the_distances_of_the_matrix(
    monkeypatch: pytest.MonkeyPatch, distance: str, cues: str, bound: int
) -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (30, 44, 3), np.uint8) // rng.integers(1, 9, (30, 44, 1), np.uint8)
    labels = np.arange(11, dtype=np.int32).repeat(4)[None].repeat(30, axis=0)
    features, config = superpixel_features(image, labels), FeaturesConfig(cues=cues, distance=distance)
    monkeypatch.setattr(comparison_module, "MAX_LANDMARKS", bound)
    comparison, marks = compare(features, config), landmarks(features, config)
    expected = feature_distances(features.chosen(marks), config)
    found = comparison.with_landmarks()
    assert (found.dtype, found.shape) == (np.float32, (11, len(marks)))
    np.testing.assert_allclose(found[marks], expected, atol=2e-4)  # roots of differences near 0 are less exact
    if len(marks) == 11:
        np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(comparison.with_others(features.chosen(marks)), found, atol=2e-4)
    first, second = np.divmod(np.arange(11 * len(marks)), len(marks))
    np.testing.assert_allclose(comparison.of_pairs(first, marks[second]), found.ravel(), atol=2e-4)


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize("n", [0, 1, 500, 640, 1537, 20_000, 300_000])
def test_what_is_compared_is_bounded_by_what_is_found(distance: str, n: int) -> None:
    """An image may have several times as many superpixels as were asked for."""
    histograms = np.ones((n, 1), np.float32)
    found = landmarks(Features(histograms, histograms, np.zeros((n, 2))), FeaturesConfig(distance=distance))
    assert len(found) == min(n, MAX_LANDMARKS if distance == "correlation" else max(MAX_PAIRS // max(n, 1), 1))
    assert found.tolist() == sorted(set(found.tolist()) & set(range(n)))


def test_comparison_of_superpixels_without_colour_or_pixels() -> None:
    shares = np.zeros((4, 16), np.float32)
    shares[1], shares[2:, 3] = 1 / 16, 1  # the first has no pixels, the second is flat
    found = compare(Features(shares, shares, np.zeros((4, 2)))).with_landmarks()
    np.testing.assert_allclose(
        found, [[0, 0.5, 0.5, 0.5], [0.5, 0, 0.5, 0.5], [0.5, 0.5, 0, 0], [0.5, 0.5, 0, 0]], atol=1e-6
    )


def test_features_need_histograms() -> None:
    none = np.zeros((4, 0), np.float32)
    with pytest.raises(ValueError, match=r"histograms is float32 \(4, 0\); give float32 or float64 \(n, bins\)"):
        feature_distances(Features(none, none, np.zeros((4, 2))))


def test_unknown_distance() -> None:
    with pytest.raises(ValueError, match="no histogram distance 'cosine'; choose one of correlation"):
        histogram_distances(np.eye(3, dtype=np.float32), "cosine")
