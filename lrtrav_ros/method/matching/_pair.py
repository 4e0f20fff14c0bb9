"""The check and the conversion of a pair of images, the same for every matcher."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray


def grey_pair(left: NDArray[np.generic], right: NDArray[np.generic]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return both images as contiguous grey ones of 8 bit; raises ValueError where they are not a pair."""
    left, right = np.asarray(left), np.asarray(right)
    for side, image in (("left", left), ("right", right)):
        _check(side, image)
    if left.shape != right.shape or left.dtype != right.dtype:
        raise ValueError(
            f"left image is {left.shape} {left.dtype}, right image {right.shape} {right.dtype}; "
            "give images of one size, number of channels and dtype"
        )
    # One scale for both: 10 or 12 bit in words of 16 would lose most of their values by a fixed shift of 8.
    bits = max(int(left.max()), int(right.max())).bit_length() if left.dtype == np.uint16 else 8
    return _grey(left, max(bits - 8, 0)), _grey(right, max(bits - 8, 0))


def _check(side: str, image: NDArray[Any]) -> None:
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3)):
        raise ValueError(f"{side} image has shape {image.shape}; give (H, W), (H, W, 1) or (H, W, 3)")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{side} image has dtype {image.dtype}; convert it to uint8 or uint16")
    if image.size == 0:
        raise ValueError(f"{side} image has shape {image.shape}, no pixel; give one that is not empty")


def _grey(image: NDArray[Any], shift: int) -> NDArray[np.uint8]:
    if image.ndim == 3:
        image = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2GRAY) if image.shape[2] == 3 else image[..., 0]
    return np.ascontiguousarray(image >> shift if shift else image, dtype=np.uint8)
