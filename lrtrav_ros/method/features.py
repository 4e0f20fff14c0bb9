"""Colour and texture histograms of superpixels, and distances between them.

Lu et al., IROS 2015, section III. Weber's law descriptor: Chen et al., PAMI 2010; LBP: Ojala et al., PAMI 2002;
centre-symmetric LBP: Heikkilä et al., Pattern Recognition 2009; local ternary patterns: Tan and Triggs, TIP 2010;
homogeneity: Jing et al., Pattern Recognition Letters 2003.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.numerics.blas import one_blas_thread

HSV_BINS = (9, 8, 6)
TEXTURE_BINS = {"wld": 256, "lbp": 256, "cs_lbp": 16, "ltp": 512, "homogeneity": 256}

_WEBER_GAIN = 3.0
_TERNARY_THRESHOLD = 5
_CS_LBP_THRESHOLD = 0.01 * 255
_NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1))


def superpixel_distances(
    image: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    config: FeaturesConfig = FeaturesConfig(),  # noqa: B008 - frozen
) -> NDArray[np.float64]:
    """Return the distance of each superpixel to each, float64 (n, n), symmetric with a zero diagonal.

    Parameters
    ----------
    image
        BGR uint8 (H, W, 3) or grey uint8 (H, W). The colour histogram of a grey image tells brightness alone.
    superpixels
        Labels 0 .. n - 1, int32 (H, W).
    """
    colour = texture = None
    if config.cues != "texture":
        colour = histogram_distances(colour_histograms(image, superpixels), config.distance)
    if config.cues != "colour":
        texture = histogram_distances(texture_histograms(image, superpixels, config.texture), config.distance)
    if colour is None or texture is None:
        distances = texture if colour is None else colour
        if distances is None:
            raise ValueError(f"features.cues is {config.cues!r}; choose one of both, colour, texture")
        return distances
    return weighted_sum(colour, texture)


def weighted_sum(colour: NDArray[np.float64], texture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of two distance matrices, each weighted by its mean: the cue that tells more counts more."""
    n = len(colour)
    pairs = max(n * (n - 1), 1)
    mean_colour, mean_texture = colour.sum() / pairs, texture.sum() / pairs
    total = mean_colour + mean_texture
    if total == 0:
        return np.zeros_like(colour)
    return (colour * mean_colour + texture * mean_texture) / total


def colour_histograms(image: NDArray[np.uint8], superpixels: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the HSV histogram of each superpixel, float32 (n, 432), each with sum 1."""
    hue, saturation, value = _hsv_bins()
    n_bins = int(np.prod(HSV_BINS))
    if image.ndim == 2:
        return _histograms(value[image], superpixels, n_bins)
    counts = np.zeros((int(superpixels.max()) + 1, n_bins), np.float32)
    _count_colours(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), superpixels, hue, saturation, value, counts)
    return _with_unit_sum(counts)


def texture_histograms(
    image: NDArray[np.uint8], superpixels: NDArray[np.int32], texture: str = "wld"
) -> NDArray[np.float32]:
    """Return the histogram of a texture descriptor in each superpixel, float32 (n, bins), each with sum 1.

    Raises
    ------
    ValueError
        If there is no such descriptor.
    """
    if texture not in TEXTURE_BINS:
        raise ValueError(f"no texture descriptor {texture!r}; choose one of {', '.join(TEXTURE_BINS)}")
    gray = to_gray(image)
    n_bins = TEXTURE_BINS[texture]
    if texture == "ltp":
        upper, lower = local_ternary_patterns(gray)
        halves = [_histograms(pattern.astype(np.uint16), superpixels, n_bins // 2) for pattern in (upper, lower)]
        return np.concatenate(halves, axis=1) / np.float32(2)
    return _histograms(_descriptor(gray, texture).astype(np.uint16), superpixels, n_bins)


def _descriptor(gray: NDArray[np.uint8], texture: str) -> NDArray[np.uint8]:
    if texture == "wld":
        return weber_descriptor(gray)
    if texture == "lbp":
        return local_binary_pattern(gray)
    if texture == "cs_lbp":
        return centre_symmetric_pattern(gray)
    return local_homogeneity(gray)


def to_gray(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the luminance (H, W) of a BGR or grey image."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def weber_descriptor(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return Weber's law descriptor, uint8 (H, W): arctan(sum of 3 (x_i - x_c) / x_c) over 8 neighbours, to 0 .. 255.

    A black centre has the limit for x_c to 0: the largest value where a neighbour is brighter, else the middle.
    """
    sums = cv2.boxFilter(gray, cv2.CV_16U, (3, 3), normalize=False, borderType=cv2.BORDER_REPLICATE)
    described = np.empty_like(gray)
    _look_up(gray, sums, _weber_table(), described)
    return described


@lru_cache(maxsize=1)
def _weber_table() -> NDArray[np.uint8]:
    """Return the descriptor for each centre and each sum of the 3 x 3 window, uint8 (256, 2296)."""
    centre = np.arange(256.0)[:, None]
    difference = np.arange(9 * 255 + 1.0) - 9 * centre
    angle = np.arctan2(_WEBER_GAIN * difference, centre)
    return np.rint((angle / np.pi + 0.5) * 255).clip(0, 255).astype(np.uint8)


def local_binary_pattern(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the 8-bit LBP: one bit for each neighbour that is at least as bright as the centre."""
    return _pattern([neighbour >= gray for neighbour in _neighbours(gray)])


def centre_symmetric_pattern(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the 4-bit centre-symmetric LBP: one bit for each pair of opposite neighbours that differ clearly."""
    around = [neighbour.astype(np.int16) for neighbour in _neighbours(gray)]
    return _pattern([around[i] - around[i + 4] > _CS_LBP_THRESHOLD for i in range(4)])


def local_ternary_patterns(gray: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the upper and lower pattern: neighbours clearly brighter, and clearly darker, than the centre."""
    centre = gray.astype(np.int16)
    around = [neighbour.astype(np.int16) - centre for neighbour in _neighbours(gray)]
    return (
        _pattern([difference >= _TERNARY_THRESHOLD for difference in around]),
        _pattern([difference <= -_TERNARY_THRESHOLD for difference in around]),
    )


def local_homogeneity(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return 1 - normalised standard deviation x normalised gradient of each pixel, scaled to 0 .. 255."""
    values = gray.astype(np.float32)
    mean = cv2.blur(values, (5, 5), borderType=cv2.BORDER_REPLICATE)
    variance = cv2.blur(values * values, (5, 5), borderType=cv2.BORDER_REPLICATE) - mean * mean
    deviation = np.sqrt(np.maximum(variance, 0))
    gradient = cv2.magnitude(cv2.Sobel(values, cv2.CV_32F, 1, 0), cv2.Sobel(values, cv2.CV_32F, 0, 1))
    product = deviation / max(float(deviation.max()), 1e-6) * gradient / max(float(gradient.max()), 1e-6)
    return np.rint((1 - product) * 255).astype(np.uint8)


def _neighbours(gray: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return the image shifted to each of the 8 neighbours, in the order around the centre."""
    height, width = gray.shape
    padded = cv2.copyMakeBorder(gray, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    return [padded[1 + dv : 1 + dv + height, 1 + du : 1 + du + width] for dv, du in _NEIGHBOURS]


def _pattern(bits: list[NDArray[np.bool_]]) -> NDArray[np.uint8]:
    pattern = np.zeros(bits[0].shape, np.uint8)
    for i, bit in enumerate(bits):
        pattern |= bit.astype(np.uint8) << np.uint8(i)
    return pattern


@one_blas_thread()
def histogram_distances(histograms: NDArray[np.float32], distance: str = "correlation") -> NDArray[np.float64]:
    """Return the distance of each histogram to each, float64 (n, n), symmetric, zero on the diagonal.

    Parameters
    ----------
    histograms
        One a row, (n, bins), each with sum 1.
    distance
        ``correlation``: 1 - (corr + 1) / 2 with Pearson's correlation, in 0 .. 1; ``chi_square``: half the sum of
        (a - b)^2 / (a + b); ``intersection``: 1 - sum of min(a, b); ``bhattacharyya``: sqrt(1 - sum of sqrt(a b));
        ``euclidean``; ``earth_mover``: along the bins in their order, as a share of their number.

    Raises
    ------
    ValueError
        If there is no such distance.
    """
    rows = histograms.astype(np.float64)
    if distance == "correlation":
        result = _correlation_distances(rows)
    elif distance == "bhattacharyya":
        result = np.sqrt(np.maximum(1 - np.sqrt(rows) @ np.sqrt(rows).T, 0))
    elif distance in _ROW_DISTANCES:
        result = np.stack([_ROW_DISTANCES[distance](rows, row) for row in rows])
    else:
        known = ", ".join(["correlation", "bhattacharyya", *_ROW_DISTANCES])
        raise ValueError(f"no histogram distance {distance!r}; choose one of {known}")
    np.fill_diagonal(result, 0)
    return (result + result.T) / 2


def _correlation_distances(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    centred = rows - rows.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(centred, axis=1, keepdims=True)
    unit = centred / np.where(norm > 0, norm, 1)
    return (1 - np.clip(unit @ unit.T, -1, 1)) / 2


def _chi_square(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    total = rows + row
    ratio = np.divide((rows - row) ** 2, total, out=np.zeros_like(rows), where=total > 0)
    return np.asarray(ratio.sum(axis=1) / 2)


def _intersection(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.maximum(1 - np.minimum(rows, row).sum(axis=1), 0))


def _euclidean(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(rows - row, axis=1))


def _earth_mover(rows: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.abs(np.cumsum(rows - row, axis=1)).mean(axis=1))


_ROW_DISTANCES = {
    "chi_square": _chi_square,
    "intersection": _intersection,
    "euclidean": _euclidean,
    "earth_mover": _earth_mover,
}


@lru_cache(maxsize=1)
def _hsv_bins() -> tuple[NDArray[np.uint16], NDArray[np.uint16], NDArray[np.uint16]]:
    """Return for each byte of OpenCV's H (0 .. 179), S and V its part of the joint bin's number."""
    byte = np.arange(256)
    hues, saturations, values = HSV_BINS
    hue = np.minimum(byte * hues // 180, hues - 1) * saturations * values
    return (
        hue.astype(np.uint16),
        (byte * saturations // 256 * values).astype(np.uint16),
        (byte * values // 256).astype(np.uint16),
    )


def _histograms(bins: NDArray[np.uint16], superpixels: NDArray[np.int32], n_bins: int) -> NDArray[np.float32]:
    """Return the normalised histogram of `bins` (H, W) for each superpixel."""
    counts = np.zeros((int(superpixels.max()) + 1, n_bins), np.float32)
    _count(bins, superpixels, counts)
    return _with_unit_sum(counts)


def _with_unit_sum(counts: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(counts / np.maximum(counts.sum(axis=1, keepdims=True), 1), np.float32)


@numba.njit(cache=True, nogil=True)
def _count_colours(hsv, superpixels, hue, saturation, value, counts):  # type: ignore[no-untyped-def]
    """Add each pixel to its joint bin, the sum of what its three bytes look up, of its superpixel's histogram."""
    for v in range(hsv.shape[0]):
        for u in range(hsv.shape[1]):
            colour_bin = hue[hsv[v, u, 0]] + saturation[hsv[v, u, 1]] + value[hsv[v, u, 2]]
            counts[superpixels[v, u], colour_bin] += 1


@numba.njit(cache=True, nogil=True)
def _count(bins, superpixels, counts):  # type: ignore[no-untyped-def]
    """Add each pixel to its bin of its superpixel's histogram."""
    for v in range(bins.shape[0]):
        for u in range(bins.shape[1]):
            counts[superpixels[v, u], bins[v, u]] += 1


@numba.njit(cache=True, nogil=True)
def _look_up(gray, sums, table, described):  # type: ignore[no-untyped-def]
    """Write the table's entry for each centre and window sum."""
    for v in range(gray.shape[0]):
        for u in range(gray.shape[1]):
            described[v, u] = table[gray[v, u], sums[v, u]]
