"""Texture descriptors: what surrounds each pixel of a grey image, as a number of 8 bits.

References
----------
.. [1] J. Chen et al., "WLD: A Robust Local Image Descriptor", IEEE PAMI 32(9), 2010.
.. [2] T. Ojala, M. Pietikäinen and T. Mäenpää, "Multiresolution Gray-Scale and Rotation Invariant Texture
       Classification with Local Binary Patterns", IEEE PAMI 24(7), 2002.
.. [3] M. Heikkilä, M. Pietikäinen and C. Schmid, "Description of Interest Regions with Local Binary Patterns", Pattern
       Recognition 42(3), 2009.
.. [4] X. Tan and B. Triggs, "Enhanced Local Texture Feature Sets for Face Recognition Under Difficult Lighting
       Conditions", IEEE TIP 19(6), 2010.
.. [5] Homogeneity: F. Jing et al., Pattern Recognition Letters, 2003.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method import _textures_kernels as kernels
from lrtrav_ros.numerics.checks import check_array

_WEBER_GAIN = 3.0
_TERNARY_THRESHOLD = 5
_CS_LBP_THRESHOLD = 0.01 * 255
_NEIGHBOURS = ((-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1))


def weber_descriptor(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return Weber's law descriptor [1]: arctan(sum of 3 (x_i - x_c) / x_c) over the 8 neighbours of each pixel.

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
    """Return the local binary pattern [2]: a bit for each neighbour that is at least as bright as the centre.

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
    """Return the centre-symmetric local binary pattern [3]: a bit for each pair of opposite neighbours that differ.

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
    """Return the upper and lower local ternary pattern [4]: neighbours clearly brighter, and clearly darker.

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
    """Return the local homogeneity [5]: 1 - normalised standard deviation x normalised gradient.

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
