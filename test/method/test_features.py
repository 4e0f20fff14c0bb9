"""Tests of the histograms of superpixels, and of their chromaticity."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from sample_images import quadrants

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.method.comparison import feature_distances, histogram_distances
from lrtrav_ros.method.features import (
    colour_histograms,
    joined,
    log_chromaticity,
    pixel_bins,
    superpixel_features,
    texture_histograms,
)
from lrtrav_ros.method.textures import TEXTURES


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


@pytest.mark.parametrize("texture", TEXTURES)
def test_texture_histograms_are_normalised(texture: str) -> None:
    image, labels = quadrants()
    histograms = texture_histograms(image, labels, texture)
    assert histograms.shape == (4, TEXTURES[texture].n_bins)
    np.testing.assert_allclose(histograms.sum(axis=1), 1, rtol=1e-6)


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


@pytest.mark.parametrize("texture", TEXTURES)
def test_features_are_those_that_single_functions_give(texture: str) -> None:
    image, labels = quadrants()
    config = FeaturesConfig(texture=texture)
    for bins in (None, pixel_bins(image, config)):
        features = superpixel_features(image, labels, config, bins=bins)
        assert len(features) == 4
        np.testing.assert_array_equal(features.colour, colour_histograms(image, labels))
        np.testing.assert_array_equal(features.texture, texture_histograms(image, labels, texture))
        np.testing.assert_array_equal(features.chromaticity, log_chromaticity(image, labels))


def test_bins_that_are_none_are_refused() -> None:
    image, labels = quadrants()
    bins, other = pixel_bins(image), pixel_bins(image[1:])
    with pytest.raises(ValueError, match=r"bins\.colour is uint16"):
        superpixel_features(image, labels, bins=other)
    with pytest.raises(ValueError, match=r"bins\.textures is uint8"):
        superpixel_features(image, labels, bins=dataclasses.replace(bins, textures=other.textures))
    with pytest.raises(ValueError, match=r"bins\.colour holds 432; give labels from 0 to 431"):
        superpixel_features(image, labels, bins=dataclasses.replace(bins, colour=np.full_like(bins.colour, 432)))
    with pytest.raises(ValueError, match=r"bins\.textures holds .*; give labels from 0 to 15"):
        superpixel_features(image, labels, bins=dataclasses.replace(bins, n_texture_bins=16))


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


def test_unknown_texture() -> None:
    with pytest.raises(ValueError, match="no texture descriptor 'gabor'; choose one of wld"):
        texture_histograms(*quadrants(), "gabor")
