"""Colour and texture histograms of superpixels, and their chromaticity.

References
----------
.. [1] H. Lu et al., "Long Range Traversable Region Detection Based on Superpixels Clustering for Mobile Robots",
       IROS 2015, section III.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.frame import to_grey
from lrtrav_ros.method import _features_kernels as kernels
from lrtrav_ros.method.textures import TEXTURES
from lrtrav_ros.numerics.checks import check_array, check_count, check_image, check_labels, check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

HSV_BINS = (kernels.HUES, kernels.SATURATIONS, kernels.VALUES)
"""Bins of the colour histogram along hue, saturation and value."""

_N_COLOURS = math.prod(HSV_BINS)
_MOST_TEXTURE_BINS = 2**15
_DARK = 4.0  # grey levels: in the dark, the ratios of colours are noise


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """What superpixels look like.

    Parameters
    ----------
    colour : (n, 432) ndarray of float32
        HSV histograms, each with sum 1.
    texture : (n, bins) ndarray of float32
        Histograms of a texture descriptor, each with sum 1.
    chromaticity : (n, 2) ndarray of float64
        Logarithms of blue and of red over green, which neither shade nor distance changes much; 0 for a grey image.
    """

    colour: NDArray[np.float32]
    texture: NDArray[np.float32]
    chromaticity: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.colour)

    def chosen(self, which: NDArray[np.intp]) -> Features:
        """Return the features of superpixels given by their numbers, (m,) ndarray of intp.

        Raises TypeError or ValueError if it is no such array, or a number is that of no superpixel.
        """
        check_array("which", which, np.intp, ("m",), may_be_empty=True)
        check_array("colour", self.colour, (np.float32, np.float64), ("n", "bins"), may_be_empty=True)
        check_array("texture", self.texture, (np.float32, np.float64), ("n", "bins"), may_be_empty=True)
        check_array("chromaticity", self.chromaticity, np.float64, ("n", 2), may_be_empty=True)
        if len(which):
            check_labels("which", which, min(len(self.colour), len(self.texture), len(self.chromaticity)))
        return Features(self.colour[which], self.texture[which], self.chromaticity[which])


def joined(parts: Sequence[Features]) -> Features:
    """Return the features of several images as if they were of one, in their order; ValueError where there are none."""
    return Features(
        np.concatenate([part.colour for part in parts]),
        np.concatenate([part.texture for part in parts]),
        np.concatenate([part.chromaticity for part in parts]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class PixelBins:
    """The bins of the histograms of colour and texture that each pixel of an image counts in.

    Parameters
    ----------
    colour : (H, W) ndarray of uint16
        Bin of the HSV histogram.
    textures : tuple of (H, W) ndarray of uint8
        Bin in each of the texture descriptor's histograms.
    n_texture_bins : int
        Bins of each of those.
    """

    colour: NDArray[np.uint16]
    textures: tuple[NDArray[np.uint8], ...]
    n_texture_bins: int


def pixel_bins(
    image: NDArray[np.uint8], config: FeaturesConfig | None = None, *, team: ThreadTeam = ALONE
) -> PixelBins:
    """Return the part of `superpixel_features` that needs no superpixels, which can be done beside finding them.

    Parameters
    ----------
    image, config, team
        As `superpixel_features` takes them.

    Raises
    ------
    TypeError, ValueError
        If the image is not as there.
    """
    check_image("image", image)
    config = FeaturesConfig() if config is None else config
    check_type("config", config, FeaturesConfig)
    image = np.ascontiguousarray(image)
    texture = TEXTURES[config.texture]
    with team.start(lambda: texture.describe(to_grey(image))) as described:
        colour, patterns = _colour_bins(image), described.result()
        return PixelBins(colour, patterns, texture.n_bins // len(patterns))


def superpixel_features(
    image: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    config: FeaturesConfig | None = None,
    *,
    bins: PixelBins | None = None,
    team: ThreadTeam = ALONE,
) -> Features:
    """Return what each superpixel looks like.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR. Of a grey image, the colour histogram captures brightness only.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    config : FeaturesConfig, optional
        `texture` is used; the default is the best of [1].
    bins : PixelBins, optional
        What `pixel_bins` gives for the image, where that has been done already; `config` is of no use then.
    team : ThreadTeam, optional
        The threads that share the work; the result does not depend on it.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, the two differ in size, or `bins` are not of such an image.
    """
    n = _count_superpixels(image, superpixels)
    image, superpixels = np.ascontiguousarray(image), np.ascontiguousarray(superpixels)
    bins = pixel_bins(image, config, team=team) if bins is None else bins
    n_bins = _check_bins(bins, image.shape[:2])
    with team.start(_log_chromaticity, image, superpixels, n) as chromaticity:
        colours = np.zeros((n, _N_COLOURS), np.uint32)
        textures = np.zeros((len(bins.textures), n, n_bins), np.uint32)
        kernels.count_both(bins.colour, bins.textures[0], superpixels, colours, textures[0])
        for texture, counts in zip(bins.textures[1:], textures[1:], strict=True):
            kernels.count_bins(texture, superpixels, counts)
        return Features(_with_unit_sum(colours), _joined_textures(textures), chromaticity.result())


def _check_bins(bins: PixelBins, shape: tuple[int, ...]) -> int:
    """Check the bins of an image of some size, and return how many there are of each texture."""
    check_type("bins", bins, PixelBins)
    n_bins = check_count("bins.n_texture_bins", bins.n_texture_bins, most=_MOST_TEXTURE_BINS)
    if not isinstance(bins.textures, tuple) or not bins.textures:
        raise TypeError(f"bins.textures is of type {type(bins.textures).__name__}; give a tuple of one array or more")
    check_array("bins.colour", bins.colour, np.uint16, shape)
    check_labels("bins.colour", bins.colour, _N_COLOURS)
    for texture in bins.textures:
        check_array("bins.textures", texture, np.uint8, shape)
        check_labels("bins.textures", texture, n_bins)
    return n_bins


def colour_histograms(image: NDArray[np.uint8], superpixels: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the HSV histogram of each superpixel.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.

    Returns
    -------
    (n, 432) ndarray of float32
        Each row has the sum 1.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, or the two differ in size.
    """
    n = _count_superpixels(image, superpixels)
    counts = np.zeros((n, _N_COLOURS), np.uint32)
    kernels.count_bins(_colour_bins(np.ascontiguousarray(image)), np.ascontiguousarray(superpixels), counts)
    return _with_unit_sum(counts)


def _colour_bins(image: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Return the bin of the HSV histogram of each pixel."""
    blue, green, red = (image, image, image) if image.ndim == 2 else cv2.split(image)
    bins = np.empty(image.shape[:2], np.uint16)
    kernels.find_colour_bins(blue, green, red, bins)
    return bins


def log_chromaticity(image: NDArray[np.uint8], superpixels: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return the logarithms of blue over green and of red over green of each superpixel's mean colour.

    Shade darkens all three alike, and distance blends the colours of a texture into their mean: neither changes the
    ratios much, as either changes a histogram.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.

    Returns
    -------
    (n, 2) ndarray of float64
        0 for a grey image, and for labels that no pixel has.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, or the two differ in size.
    """
    n = _count_superpixels(image, superpixels)
    return _log_chromaticity(np.ascontiguousarray(image), np.ascontiguousarray(superpixels), n)


def _log_chromaticity(image: NDArray[np.uint8], superpixels: NDArray[np.int32], n: int) -> NDArray[np.float64]:
    """Return the logarithms of the ratios of each of n superpixels."""
    if image.ndim == 2:
        return np.zeros((n, 2))
    sums = np.zeros((n, 4), np.int64)
    kernels.add_colours(image, superpixels, sums)
    blue, green, red = (sums[:, :3] / np.maximum(sums[:, 3:], 1) + _DARK).T
    return np.stack([np.log(blue / green), np.log(red / green)], axis=1)


def texture_histograms(
    image: NDArray[np.uint8], superpixels: NDArray[np.int32], texture: str = "wld"
) -> NDArray[np.float32]:
    """Return the histogram of a texture descriptor in each superpixel.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    texture : str
        One of `TEXTURES`.

    Returns
    -------
    (n, bins) ndarray of float32
        Each row has the sum 1.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, the two differ in size, or there is no such descriptor.
    """
    if not isinstance(texture, str) or texture not in TEXTURES:
        raise ValueError(f"no texture descriptor {texture!r}; choose one of {', '.join(TEXTURES)}")
    n = _count_superpixels(image, superpixels)
    patterns = TEXTURES[texture].describe(to_grey(image))
    counts = np.zeros((len(patterns), n, TEXTURES[texture].n_bins // len(patterns)), np.uint32)
    for pattern, of_pattern in zip(patterns, counts, strict=True):
        kernels.count_bins(pattern, np.ascontiguousarray(superpixels), of_pattern)
    return _joined_textures(counts)


def _joined_textures(counts: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return a histogram of each superpixel from its counts (patterns, n, bins)."""
    parts = [_with_unit_sum(of_pattern) for of_pattern in counts]
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1) / np.float32(len(parts))


def _count_superpixels(image: NDArray[np.uint8], superpixels: NDArray[np.int32]) -> int:
    """Check image and labels, and return the number of superpixels."""
    check_image("image", image)
    check_array("superpixels", superpixels, np.int32, image.shape[:2])
    return check_labels("superpixels", superpixels, superpixels.size) + 1


def _with_unit_sum(counts: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return the rows, each divided by its sum; those without counts stay 0."""
    shares = np.empty(counts.shape, np.float32)
    kernels.divide_by_sums(counts, shares)
    return shares
