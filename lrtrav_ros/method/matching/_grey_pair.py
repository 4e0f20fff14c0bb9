"""The pair of images that every matcher compares: grey, of 8 bits, scaled alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.frame import pair_as_8bit, to_grey
from lrtrav_ros.numerics.checks import check_array


def grey_pair(left: NDArray[np.generic], right: NDArray[np.generic]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return two images as contiguous grey ones of 8 bits.

    Parameters
    ----------
    left, right : (H, W), (H, W, 1) or (H, W, 3) ndarray of uint8 or uint16
        Grey or BGR, of one shape and one type; 16 bits are scaled as `pair_as_8bit` does.

    Raises
    ------
    TypeError, ValueError
        If they are not such a pair.
    """
    for name, image in (("left image", left), ("right image", right)):
        check_array(name, image, (np.uint8, np.uint16), ("H", "W"), ("H", "W", 1), ("H", "W", 3))
    if left.shape != right.shape or left.dtype != right.dtype:
        raise ValueError(
            f"left image is {left.dtype} {left.shape}, right image {right.dtype} {right.shape}; "
            "give images of one size, number of channels and type"
        )
    left_8bit, right_8bit = pair_as_8bit(left, right)
    return _grey(left_8bit), _grey(right_8bit)


def _grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a contiguous grey image (H, W) of one with 1 or 3 channels, or none."""
    return np.ascontiguousarray(to_grey(image[..., 0] if image.shape[2:] == (1,) else image))
