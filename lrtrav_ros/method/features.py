"""Colour and texture histograms of superpixels, and distances between them.

References
----------
.. [1] H. Lu et al., "Long Range Traversable Region Detection Based on Superpixels Clustering for Mobile Robots",
       IROS 2015, section III.
.. [2] J. Chen et al., "WLD: A Robust Local Image Descriptor", IEEE PAMI 32(9), 2010.
.. [3] T. Ojala, M. Pietikäinen and T. Mäenpää, "Multiresolution Gray-Scale and Rotation Invariant Texture
       Classification with Local Binary Patterns", IEEE PAMI 24(7), 2002.
.. [4] M. Heikkilä, M. Pietikäinen and C. Schmid, "Description of Interest Regions with Local Binary Patterns", Pattern
       Recognition 42(3), 2009.
.. [5] X. Tan and B. Triggs, "Enhanced Local Texture Feature Sets for Face Recognition Under Difficult Lighting
       Conditions", IEEE TIP 19(6), 2010.
.. [6] Homogeneity: F. Jing et al., Pattern Recognition Letters, 2003.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.frame import to_grey
from lrtrav_ros.method import _features_kernels as kernels
from lrtrav_ros.numerics.blas import one_blas_thread
from lrtrav_ros.numerics.checks import check_array, check_distances, check_image, check_labels
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

HSV_BINS = (kernels.HUES, kernels.SATURATIONS, kernels.VALUES)
"""Bins of the colour histogram along hue, saturation and value."""

MAX_LANDMARKS = 640
"""Superpixels that all are compared with, at most: time and memory grow with n times this, not with n squared."""

_MAX_SHARE = 1 + 1e-3  # of a histogram in one bin: its sum is not exact
_DARK = 4.0  # grey levels: in the dark, the ratios of colours are noise
_SPARSE = 0.8  # share of bins in use, below which it is worth the time to leave the others out
_LEAST_ROWS = 64  # of a matrix of distances, that are worth a thread
_PAIRS_AT_ONCE = 1024
_FLAT = 1e-7  # spread of a histogram, against its mean, that rounding makes
_WEBER_GAIN = 3.0
_TERNARY_THRESHOLD = 5
_CS_LBP_THRESHOLD = 0.01 * 255
_NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1))


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

    @property
    def landmarks(self) -> NDArray[np.intp]:
        """Numbers of those that all are compared with: all, or `MAX_LANDMARKS` that are evenly spread over them."""
        n = len(self)
        return np.arange(n) if n <= MAX_LANDMARKS else np.linspace(0, n - 1, MAX_LANDMARKS).astype(np.intp)

    def chosen(self, which: NDArray[np.intp]) -> Features:
        """Return the features of superpixels given by their numbers, (m,) ndarray of intp."""
        return Features(self.colour[which], self.texture[which], self.chromaticity[which])


def joined(parts: Sequence[Features]) -> Features:
    """Return the features of several images as if they were of one, in their order; ValueError where there are none."""
    return Features(
        np.concatenate([part.colour for part in parts]),
        np.concatenate([part.texture for part in parts]),
        np.concatenate([part.chromaticity for part in parts]),
    )


def superpixel_features(
    image: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    config: FeaturesConfig | None = None,
    *,
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
    team : ThreadTeam, optional
        The threads that share the work; the result does not depend on it.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, or the two differ in size.
    """
    config = config or FeaturesConfig()
    n = _count_superpixels(image, superpixels)
    image, superpixels = np.ascontiguousarray(image), np.ascontiguousarray(superpixels)
    texture = TEXTURES[config.texture]
    with (
        team.start(_log_chromaticity, image, superpixels, n) as chromaticity,
        team.start(lambda: texture.describe(to_grey(image))) as described,
    ):
        bins = _colour_bins(image)
        patterns = described.result()
        colours = np.zeros((n, int(np.prod(HSV_BINS))), np.uint32)
        textures = np.zeros((len(patterns), n, texture.n_bins // len(patterns)), np.uint32)
        kernels.count_both(bins, patterns[0], superpixels, colours, textures[0])
        for pattern, counts in zip(patterns[1:], textures[1:], strict=True):
            kernels.count_bins(pattern, superpixels, counts)
        return Features(_with_unit_sum(colours), _joined_textures(textures), chromaticity.result())


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
        Symmetric, with a zero diagonal.

    Raises
    ------
    TypeError, ValueError
        If the histograms are none.
    """
    config = config or FeaturesConfig()
    return CUES[config.cues](features, config.distance)


def superpixel_distances(
    image: NDArray[np.uint8], superpixels: NDArray[np.int32], config: FeaturesConfig | None = None
) -> NDArray[np.float64]:
    """Return the distance of each superpixel of an image to each: `feature_distances` of `superpixel_features`.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    config : FeaturesConfig, optional
        The cues, the texture descriptor and the distance between histograms.

    Returns
    -------
    (n, n) ndarray of float64
        Symmetric, with a zero diagonal.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, or the two differ in size.
    """
    return feature_distances(superpixel_features(image, superpixels, config), config)


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
        Distances.

    Returns
    -------
    (n, n) ndarray of float64

    Raises
    ------
    TypeError, ValueError
        If one is no matrix of distances, or they differ in size.
    """
    check_distances("colour", colour)
    check_distances("texture", texture)
    n = len(colour)
    check_array("texture", texture, np.float64, (n, n), may_be_empty=True)
    pairs = max(n * (n - 1), 1)
    mean_colour, mean_texture = colour.sum() / pairs, texture.sum() / pairs
    total = mean_colour + mean_texture
    if total == 0:
        return np.zeros_like(colour)
    return (colour * mean_colour + texture * mean_texture) / total


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
    counts = np.zeros((n, int(np.prod(HSV_BINS))), np.uint32)
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
    if texture not in TEXTURES:
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


def weber_descriptor(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return Weber's law descriptor [2]: arctan(sum of 3 (x_i - x_c) / x_c) over the 8 neighbours of each pixel.

    A black centre has the limit for x_c to 0: the largest value where a neighbour is brighter, else the middle.

    Parameters
    ----------
    grey : (H, W) ndarray of uint8
        Grey image.

    Returns
    -------
    (H, W) ndarray of uint8
        The angle, from -pi / 2 .. pi / 2 to 0 .. 255.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array.
    """
    grey = _checked_grey(grey)
    described = np.empty_like(grey)
    kernels.describe_weber(grey, _weber_table(), described)
    return described


@lru_cache(maxsize=1)
def _weber_table() -> NDArray[np.uint8]:
    """Return the descriptor for each centre and each sum of the 3 x 3 window, uint8 (256, 2296)."""
    centre = np.arange(256.0)[:, None]
    difference = np.arange(9 * 255 + 1.0) - 9 * centre
    angle = np.arctan2(_WEBER_GAIN * difference, centre)
    return np.rint((angle / np.pi + 0.5) * 255).clip(0, 255).astype(np.uint8)


def local_binary_pattern(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the local binary pattern [3]: a bit for each neighbour that is at least as bright as the centre.

    Parameters
    ----------
    grey : (H, W) ndarray of uint8
        Grey image.

    Returns
    -------
    (H, W) ndarray of uint8
        8 bits.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array.
    """
    grey = _checked_grey(grey)
    return _pattern([neighbour >= grey for neighbour in _neighbours(grey)])


def centre_symmetric_pattern(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the centre-symmetric local binary pattern [4]: a bit for each pair of opposite neighbours that differ.

    Parameters
    ----------
    grey : (H, W) ndarray of uint8
        Grey image.

    Returns
    -------
    (H, W) ndarray of uint8
        4 bits: 0 .. 15.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array.
    """
    around = [neighbour.astype(np.int16) for neighbour in _neighbours(_checked_grey(grey))]
    return _pattern([around[i] - around[i + 4] > _CS_LBP_THRESHOLD for i in range(4)])


def local_ternary_patterns(grey: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the upper and lower local ternary pattern [5]: neighbours clearly brighter, and clearly darker.

    Parameters
    ----------
    grey : (H, W) ndarray of uint8
        Grey image.

    Returns
    -------
    upper, lower : (H, W) ndarray of uint8
        8 bits each.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array.
    """
    grey = _checked_grey(grey)
    centre = grey.astype(np.int16)
    around = [neighbour.astype(np.int16) - centre for neighbour in _neighbours(grey)]
    return (
        _pattern([difference >= _TERNARY_THRESHOLD for difference in around]),
        _pattern([difference <= -_TERNARY_THRESHOLD for difference in around]),
    )


def local_homogeneity(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the local homogeneity [6]: 1 - normalised standard deviation x normalised gradient.

    Parameters
    ----------
    grey : (H, W) ndarray of uint8
        Grey image.

    Returns
    -------
    (H, W) ndarray of uint8
        0 .. 255; 0 at the strongest edge.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array.
    """
    values = _checked_grey(grey).astype(np.float32)
    mean = cv2.blur(values, (5, 5), borderType=cv2.BORDER_REPLICATE)
    variance = cv2.blur(values * values, (5, 5), borderType=cv2.BORDER_REPLICATE) - mean * mean
    deviation = np.sqrt(np.maximum(variance, 0))
    gradient = cv2.magnitude(cv2.Sobel(values, cv2.CV_32F, 1, 0), cv2.Sobel(values, cv2.CV_32F, 0, 1))
    product = deviation / max(float(deviation.max()), 1e-6) * gradient / max(float(gradient.max()), 1e-6)
    return np.rint((1 - product) * 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class Texture:
    """A texture descriptor.

    Parameters
    ----------
    describe : callable
        Takes a grey image, (H, W) ndarray of uint8, and returns one or more patterns of that size and type.
    n_bins : int
        Bins of the histogram, those of all patterns together.
    """

    describe: Callable[[NDArray[np.uint8]], tuple[NDArray[np.uint8], ...]]
    n_bins: int


TEXTURES = {
    "wld": Texture(lambda grey: (weber_descriptor(grey),), 256),
    "lbp": Texture(lambda grey: (local_binary_pattern(grey),), 256),
    "cs_lbp": Texture(lambda grey: (centre_symmetric_pattern(grey),), 16),
    "ltp": Texture(local_ternary_patterns, 512),
    "homogeneity": Texture(lambda grey: (local_homogeneity(grey),), 256),
}
"""Texture descriptors, by the names that the setting ``features.texture`` has for them."""


def _checked_grey(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Check a grey image (H, W) and return it as a contiguous array."""
    check_array("grey", grey, np.uint8, ("H", "W"))
    return np.ascontiguousarray(grey)


def _neighbours(grey: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the image shifted to each of the 8 neighbours, in the order around the centre."""
    height, width = grey.shape
    padded = cv2.copyMakeBorder(grey, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    return [padded[1 + dv : 1 + dv + height, 1 + du : 1 + du + width] for dv, du in _NEIGHBOURS]


def _pattern(bits: list[NDArray[np.bool_]]) -> NDArray[np.uint8]:
    """Return the images of bits as one of numbers, the first bit the lowest."""
    pattern = np.zeros(bits[0].shape, np.uint8)
    for i, bit in enumerate(bits):
        pattern |= bit.astype(np.uint8) << np.uint8(i)
    return pattern


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
        Symmetric, with a zero diagonal.

    Raises
    ------
    TypeError, ValueError
        If `histograms` is not such an array, or there is no such distance.
    """
    if distance not in DISTANCES:
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
    ratio = np.divide((rows - row) ** 2, total, out=np.zeros_like(rows), where=total > 0)
    return np.asarray(ratio.sum(axis=1) / 2)


def _intersection(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 1 - the sum of the lesser values."""
    return np.asarray(np.maximum(1 - np.minimum(rows, row).sum(axis=1), 0))


def _euclidean(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Euclidean distance."""
    return np.asarray(np.linalg.norm(rows - row, axis=1))


def _earth_mover(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean difference of the cumulated rows."""
    return np.asarray(np.abs(np.cumsum(rows - row, axis=1)).mean(axis=1))


def _row_by_row(
    distance: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]],
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return a function of all rows from one of all rows and one of them, which needs less memory."""

    def distances(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        result = np.stack([distance(rows, row) for row in rows])
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


class Comparison(Protocol):
    """Compares the n superpixels of an image by colour and texture, each weighted as suits the image."""

    landmarks: NDArray[np.intp]
    """`Features.landmarks`, (m,)."""

    def with_landmarks(self, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each landmark, (n, m), 0 to itself."""
        ...

    def with_others(self, others: Features, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each of those of other images, (n, len(others)).

        Raises TypeError or ValueError if their histograms are none, or have not as many bins.
        """
        ...

    def of_pairs(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> NDArray[np.float32]:
        """Return the distances of pairs of superpixels, (p,), given by two arrays of their numbers."""
        ...


def compare(features: Features, config: FeaturesConfig | None = None) -> Comparison:
    """Return what compares superpixels; its distances are those of `feature_distances`, but for rounding.

    With more than `MAX_LANDMARKS` superpixels, the weights of the cues are those of the landmarks.

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
    config = config or FeaturesConfig()
    _check_histograms("colour", features.colour)
    _check_histograms("texture", features.texture, len(features))
    return (_Correlation if config.distance == "correlation" else _RowByRow)(features, config)


def _check_others(others: Features, features: Features) -> None:
    """Check that features of other images can be compared with those of one."""
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
        self.landmarks = features.landmarks
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
        return self._rows.distances_of_pairs(first, second)


class _RowByRow:
    """Compares by any distance but correlation."""

    def __init__(self, features: Features, config: FeaturesConfig) -> None:
        self.landmarks = features.landmarks
        self._features = features
        self._distance = ROW_DISTANCES[config.distance]
        some, pairs = features.chosen(self.landmarks), max(len(self.landmarks) * (len(self.landmarks) - 1), 1)
        means = (float(self._between(cue, cue).sum()) / pairs for cue in (some.colour, some.texture))
        self._weights = _Weights.of(config.cues, *means)

    def with_landmarks(self, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        """Return the distance of each superpixel to each landmark."""
        return self.with_others(self._features.chosen(self.landmarks), team)

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
        result = np.empty((len(rows), len(others)), np.float32)
        for column, other in enumerate(others.astype(np.float64)):
            result[:, column] = self._distance(shares, other)
        return result

    def _weighted(self, colour: NDArray[Any], texture: NDArray[Any]) -> NDArray[np.float32]:
        """Return the weighted sum of distances by colour and texture."""
        return np.asarray(self._weights.colour * colour + self._weights.texture * texture, np.float32)


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
