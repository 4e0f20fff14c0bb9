"""Tests of the histograms of superpixels and the distances between them."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.method import features as features_module
from lrtrav_ros.method.features import (
    DISTANCES,
    TEXTURES,
    Features,
    centre_symmetric_pattern,
    colour_histograms,
    compare,
    feature_distances,
    histogram_distances,
    joined,
    local_binary_pattern,
    local_homogeneity,
    local_ternary_patterns,
    log_chromaticity,
    superpixel_distances,
    superpixel_features,
    texture_histograms,
    weber_descriptor,
    weighted_sum,
)


def quadrants() -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Return a noisy 40 x 42 BGR image of red, green, blue and rough grey quadrants, and their labels."""
    rng = np.random.default_rng(0)
    labels = np.zeros((40, 42), np.int32)
    labels[:20, 21:], labels[20:, :21], labels[20:, 21:] = 1, 2, 3
    colours = np.array([[20, 20, 200], [20, 200, 20], [200, 20, 20], [100, 100, 100]])
    noise = rng.integers(-4, 5, (40, 42, 1)) * np.where(labels == 3, 12, 1)[..., None]
    return np.clip(colours[labels] + noise, 0, 255).astype(np.uint8), labels


def test_colour_histogram_has_the_bins_of_the_paper() -> None:
    image = np.zeros((2, 3, 3), np.uint8)
    image[:, 1:] = (0, 0, 255)  # pure red: hue 0, full saturation, full value
    histograms = colour_histograms(image, np.array([[0, 1, 1], [0, 1, 1]], np.int32))
    assert histograms.shape == (2, 9 * 8 * 6)
    assert histograms[0, 0] == 1
    assert histograms[1, 7 * 6 + 5] == 1
    np.testing.assert_allclose(histograms.sum(axis=1), 1)


def test_colour_histogram_of_grey_is_that_of_bgr_without_colour() -> None:
    grey = np.random.default_rng(0).integers(0, 256, (20, 30), np.uint8)
    labels = np.zeros((20, 30), np.int32)
    np.testing.assert_array_equal(
        colour_histograms(grey, labels), colour_histograms(np.repeat(grey[..., None], 3, axis=2), labels)
    )


def test_weber_descriptor_is_the_formula() -> None:
    grey = np.random.default_rng(0).integers(0, 256, (12, 15), np.uint8)
    grey[3, 4] = 0
    found = weber_descriptor(grey)
    values = grey.astype(float)
    for v, u in itertools.product(range(1, 11), range(1, 14)):
        if grey[v, u]:
            around = values[v - 1 : v + 2, u - 1 : u + 2]
            angle = np.arctan((3 * (around - values[v, u]) / values[v, u]).sum())
            assert found[v, u] == round((angle / np.pi + 0.5) * 255)
    assert found[3, 4] == 255  # a black centre among brighter neighbours


@pytest.mark.parametrize("level", [0, 1, 128, 255])
def test_weber_descriptor_of_a_flat_image_is_the_middle(level: int) -> None:
    np.testing.assert_array_equal(weber_descriptor(np.full((7, 9), level, np.uint8)), 128)


def test_weber_descriptor_does_not_change_with_brightness() -> None:
    grey = np.random.default_rng(0).integers(40, 64, (20, 25), np.uint8)
    np.testing.assert_array_equal(weber_descriptor(grey), weber_descriptor(grey * 2))


def test_binary_patterns_of_a_bright_right_side() -> None:
    grey = np.array([[10, 10, 200]] * 3, np.uint8)
    assert local_binary_pattern(grey)[1, 1] == 0b11111111  # all are at least as bright as the centre
    assert local_binary_pattern(grey)[1, 2] == 0b00111110  # what lies left is darker; edges repeat
    upper, lower = local_ternary_patterns(grey)
    assert (upper[1, 1], lower[1, 1]) == (0b00011100, 0)
    assert (upper[1, 2], lower[1, 2]) == (0, 0b11000001)
    assert centre_symmetric_pattern(grey)[1, 1] == 0b1100


def test_homogeneity_is_least_at_the_strongest_edge() -> None:
    grey = np.zeros((20, 30), np.uint8)
    grey[:, 15:] = 255
    found = local_homogeneity(grey)
    assert found[:, :10].min() == 255
    assert found[10, 14:16].max() == 0


@pytest.mark.parametrize("texture", TEXTURES)
def test_texture_histograms_are_normalised(texture: str) -> None:
    image, labels = quadrants()
    histograms = texture_histograms(image, labels, texture)
    assert histograms.shape == (4, TEXTURES[texture].n_bins)
    np.testing.assert_allclose(histograms.sum(axis=1), 1, rtol=1e-6)


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


@pytest.mark.parametrize("cues", ["both", "colour", "texture"])
def test_quadrants_of_one_kind_are_closer(cues: str) -> None:
    image, labels = quadrants()
    halves = labels * 2 + (np.arange(40)[:, None] % 20 >= 10)
    found = superpixel_distances(image, halves.astype(np.int32), FeaturesConfig(cues=cues))
    for i, j in itertools.combinations(range(4), 2):
        if cues != "texture" or 3 in (i, j):
            assert found[2 * i, 2 * i + 1] < found[2 * i, 2 * j]


BROWN, GREEN = np.array([60, 90, 120]), np.array([50, 140, 90])  # blue, green, red


def stripes(*colours: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.int32]]:
    """Return an image of 20 rows with a stripe of 15 columns for each colour, and the stripes as superpixels."""
    labels = np.repeat(np.arange(len(colours), dtype=np.int32), 15)[None].repeat(20, axis=0)
    return np.array(colours, np.uint8)[labels], labels


def test_chromaticity_is_the_logarithm_of_the_ratios_to_green() -> None:
    found = log_chromaticity(*stripes(BROWN, GREEN))
    assert found.dtype == np.float64
    # some grey levels are added to each, so that ratios in the dark are not all noise
    np.testing.assert_allclose(found[0], [np.log(60 / 90), np.log(120 / 90)], atol=0.03)
    np.testing.assert_allclose(found[1], [np.log(50 / 140), np.log(90 / 140)], atol=0.06)


def test_chromaticity_of_what_lies_in_the_shade_is_nearly_the_same() -> None:
    image, labels = stripes(BROWN, GREEN, (0.4 * BROWN).astype(int), (0.4 * GREEN).astype(int))
    chromaticity = log_chromaticity(image, labels)
    shaded = np.linalg.norm(chromaticity[:2] - chromaticity[2:], axis=1)
    assert shaded.max() < 0.1
    assert np.linalg.norm(chromaticity[0] - chromaticity[1]) > 5 * shaded.max()
    colours = histogram_distances(colour_histograms(image, labels))
    assert colours[0, 2] == pytest.approx(colours[0, 1])  # to a histogram, shade is another colour


def test_chromaticity_of_a_blend_is_that_of_the_mean_colour() -> None:
    image, labels = stripes(BROWN, BROWN, (BROWN + GREEN) // 2)
    image[::2, :15] = GREEN  # every other row, in all of the first stripe
    chromaticity = log_chromaticity(image, labels)
    np.testing.assert_allclose(chromaticity[0], chromaticity[2], atol=1e-12)
    assert np.linalg.norm(chromaticity[0] - chromaticity[1]) > 0.2


def test_chromaticity_of_grey_is_zero() -> None:
    image, labels = stripes(*(np.full(3, level) for level in (0, 1, 128, 255)))
    np.testing.assert_array_equal(log_chromaticity(image, labels), np.zeros((4, 2)))
    np.testing.assert_array_equal(log_chromaticity(image[..., 1], labels), np.zeros((4, 2)))


def test_chromaticity_of_a_label_without_pixels_is_zero() -> None:
    image, labels = stripes(BROWN, GREEN)
    found = log_chromaticity(image, labels * 2)
    np.testing.assert_array_equal(found[1], [0, 0])
    np.testing.assert_array_equal(found[::2], log_chromaticity(image, labels))


@pytest.mark.parametrize("cues", ["both", "colour", "texture"])
@pytest.mark.parametrize("texture", ["wld", "cs_lbp"])
def test_distances_of_features_are_those_of_the_image(cues: str, texture: str) -> None:
    image, labels = quadrants()
    config = FeaturesConfig(cues=cues, texture=texture)
    features = superpixel_features(image, labels, config)
    assert (len(features), features.texture.shape) == (4, (4, TEXTURES[texture].n_bins))
    np.testing.assert_array_equal(features.colour, colour_histograms(image, labels))
    np.testing.assert_array_equal(features.chromaticity, log_chromaticity(image, labels))
    np.testing.assert_array_equal(feature_distances(features, config), superpixel_distances(image, labels, config))


def test_features_of_several_images_are_joined_in_their_order() -> None:
    image, labels = quadrants()
    features = superpixel_features(image, labels)
    others = features.chosen(np.array([3, 1]))
    both = joined([features, others])
    assert (len(others), len(both)) == (2, 6)
    for name in ("colour", "texture", "chromaticity"):
        np.testing.assert_array_equal(getattr(both, name), getattr(features, name)[[0, 1, 2, 3, 3, 1]])
    distances = feature_distances(both)
    np.testing.assert_allclose(distances[[3, 1], [4, 5]], 0, atol=1e-6)
    assert distances[0, 1] > 0.1
    assert len(features.chosen(np.array([], np.intp))) == 0
    with pytest.raises(ValueError, match="at least one array"):
        joined([])


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
    monkeypatch.setattr(features_module, "MAX_LANDMARKS", bound)
    comparison, marks = compare(features, config), features.landmarks
    expected = feature_distances(features.chosen(marks), config)
    found = comparison.with_landmarks()
    assert (found.dtype, found.shape) == (np.float32, (11, len(marks)))
    np.testing.assert_allclose(found[marks], expected, atol=2e-4)  # roots of differences near 0 are less exact
    if len(marks) == 11:
        np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(comparison.with_others(features.chosen(marks)), found, atol=2e-4)
    first, second = np.divmod(np.arange(11 * len(marks)), len(marks))
    np.testing.assert_allclose(comparison.of_pairs(first, marks[second]), found.ravel(), atol=2e-4)


def test_comparison_of_superpixels_without_colour_or_pixels() -> None:
    shares = np.zeros((4, 16), np.float32)
    shares[1], shares[2:, 3] = 1 / 16, 1  # the first has no pixels, the second is flat
    found = compare(Features(shares, shares, np.zeros((4, 2)))).with_landmarks()
    np.testing.assert_allclose(
        found, [[0, 0.5, 0.5, 0.5], [0.5, 0, 0.5, 0.5], [0.5, 0.5, 0, 0], [0.5, 0.5, 0, 0]], atol=1e-6
    )


def test_hue_saturation_and_value_are_those_of_opencv() -> None:
    steps = np.array([*range(0, 256, 5), 1, 2, 3, 31, 32, 63, 64, 127, 128, 253, 254], np.uint8)
    image = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(len(steps), -1, 3)
    labels = np.arange(image[..., 0].size, dtype=np.int32).reshape(image.shape[:2])
    hue, saturation, value = cv2.cvtColor(image, cv2.COLOR_BGR2HSV).reshape(-1, 3).T.astype(int)
    expected = (hue * 9 // 180 * 8 + saturation * 8 // 256) * 6 + value * 6 // 256
    for first in range(0, len(steps), 8):
        rows = slice(first, first + 8)
        found = colour_histograms(image[rows], labels[rows] - labels[first, 0]).argmax(axis=1)
        np.testing.assert_array_equal(found, expected[labels[rows].ravel()])


def test_features_need_histograms() -> None:
    none = np.zeros((4, 0), np.float32)
    with pytest.raises(ValueError, match=r"histograms is float32 \(4, 0\); give float32 or float64 \(n, bins\)"):
        feature_distances(Features(none, none, np.zeros((4, 2))))


def test_unknown_names() -> None:
    image, labels = quadrants()
    with pytest.raises(ValueError, match="no texture descriptor 'gabor'; choose one of wld"):
        texture_histograms(image, labels, "gabor")
    with pytest.raises(ValueError, match="no histogram distance 'cosine'; choose one of correlation"):
        histogram_distances(np.eye(3, dtype=np.float32), "cosine")
