"""A frame: what the camera saw at one instant, whatever format it comes in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.numerics.checks import check_array, check_image, check_stamp, check_type

Image: TypeAlias = NDArray[Any]
"""A grey (H, W) or BGR (H, W, 3) image of uint8 or uint16."""

SOURCES = ("stereo", "disparity", "depth")
"""Sources of disparity, in the order of preference."""

_IMAGE_TYPES = (np.uint8, np.uint16)
_MAX_DISPARITY_PX = 2.0**15
"""No real disparity is this large, whatever the baseline."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """The left image, the camera, and one of right image, disparity and depth; valid by construction.

    Parameters
    ----------
    camera : StereoCamera
        Calibration; where it tells the images' size, they must have it.
    left : (H, W) or (H, W, 3) ndarray of uint8 or uint16, optional
        Left image, grey or BGR. Only a frame that is made for short range alone, from disparity or depth, has none.
    right : ndarray, optional
        Right image, rectified like the left one, of its shape and type.
    disparity : (H, W) ndarray of float32, optional
        Disparity in pixels. Invalid values (negative, not finite, absurdly large) become 0, which means none.
    depth_m : (H, W) ndarray of float32, optional
        Depth in metres; 0 for none, and what is negative or not finite becomes 0.
    unseen : (H, W) ndarray of bool, optional
        The pixels of the left image that the camera does not show, as at the borders of rectified images; all of them
        are unknown.
    name : str
        The file's name without suffix, or the left image's header stamp in nanoseconds.
    stamp_ns : int, optional
        Time of the left image in nanoseconds, where it is known.

    Raises
    ------
    TypeError
        If an image is not a NumPy array, or the camera or the time are of another type.
    ValueError
        If not exactly one of `right`, `disparity` and `depth_m` is given, or an array has another type or size; the
        message names the value and what is expected.
    """

    camera: StereoCamera
    left: Image | None = None
    right: Image | None = None
    disparity: NDArray[np.float32] | None = None
    depth_m: NDArray[np.float32] | None = None
    unseen: NDArray[np.bool_] | None = None
    name: str = ""
    stamp_ns: int | None = None

    def __post_init__(self) -> None:
        n_sources = [self.right is None, self.disparity is None, self.depth_m is None].count(False)
        if n_sources != 1:
            raise ValueError(f"a frame has {n_sources} of them; give exactly one of right image, disparity and depth")
        check_type("camera", self.camera, StereoCamera)
        if self.stamp_ns is not None:
            object.__setattr__(self, "stamp_ns", check_stamp(self.stamp_ns))
        if self.left is not None:
            check_array("left image", self.left, _IMAGE_TYPES, ("H", "W"), ("H", "W", 3))
            self.camera.check_size(self.left.shape)
        if self.right is not None:
            self._check_right(self.right)
        if self.disparity is not None:
            object.__setattr__(self, "disparity", valid_disparity(self.disparity))
            self._check_size("disparity", self.disparity)
        if self.depth_m is not None:
            object.__setattr__(self, "depth_m", valid_depth(self.depth_m))
            self._check_size("depth", self.depth_m)
        if self.unseen is not None:
            check_array("unseen", self.unseen, np.bool_, self.shape)

    @property
    def image(self) -> NDArray[np.uint8]:
        """The left image with 8 bits per channel; see `as_8bit`. Raises ValueError for a frame without one."""
        if self.left is None:
            raise ValueError("the frame has no left image; the long range needs it")
        return as_8bit(self.left)

    @property
    def source(self) -> str:
        """The source of disparity; one of `SOURCES`."""
        return "stereo" if self.right is not None else "disparity" if self.disparity is not None else "depth"

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        images = (self.left, self.disparity, self.depth_m)
        height, width = next(image.shape[:2] for image in images if image is not None)
        return height, width

    def _check_right(self, right: Image) -> None:
        if self.left is None:
            raise ValueError("a right image needs a left one; give both")
        check_array("right image", right, _IMAGE_TYPES, ("H", "W"), ("H", "W", 3))
        self._check_size("right image", right)
        if right.shape != self.left.shape or right.dtype != self.left.dtype:
            raise ValueError(
                f"left image is {self.left.shape} {self.left.dtype}, right image {right.shape} {right.dtype}; "
                "give images with the same number of channels and the same type"
            )

    def _check_size(self, name: str, image: NDArray[Any]) -> None:
        """Raise ValueError where an image is not of the left one's size, or of that the camera is calibrated for."""
        if self.left is None:
            self.camera.check_size(image.shape)
        elif image.shape[:2] != self.left.shape[:2]:
            size, wanted = (f"{shape[1]} x {shape[0]}" for shape in (image.shape, self.left.shape))
            raise ValueError(f"the {name} is {size} pixels, but the left image is {wanted}; give images of one size")


def as_8bit(image: Image) -> NDArray[np.uint8]:
    """Return a grey or colour image with 8 bits per channel, scaled by its own brightest pixel; see `pair_as_8bit`.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8 or uint16

    Returns
    -------
    ndarray of uint8
        Of the same shape; `image` itself where it has 8 bits.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array.
    """
    return _shifted(image, _excess_bits(image))


def pair_as_8bit(left: Image, right: Image) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return two images with 8 bits per channel, scaled alike.

    A camera of 10 or 12 bits fills only a part of its 16: the significant bits of the brightest pixel of both are kept,
    so that the result is the image divided by a power of two, 1 .. 256. No pixel is scaled up, and none is clipped.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) ndarray of uint8 or uint16

    Returns
    -------
    left, right : ndarray of uint8
        Of the same shapes.

    Raises
    ------
    TypeError, ValueError
        If an image is not such an array.
    """
    excess = max(_excess_bits(left), _excess_bits(right))
    return _shifted(left, excess), _shifted(right, excess)


def _excess_bits(image: Image) -> int:
    """Return how many bits the brightest pixel has beyond 8."""
    check_array("image", image, _IMAGE_TYPES, ("H", "W"), ("H", "W", "C"), may_be_empty=True)
    return 0 if image.dtype == np.uint8 or not image.size else max(int(image.max()).bit_length() - 8, 0)


def _shifted(image: Image, bits: int) -> NDArray[np.uint8]:
    return (image >> bits if bits else image).astype(np.uint8, copy=False)


def to_grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the luminance of an image.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR.

    Returns
    -------
    (H, W) ndarray of uint8
        A grey image itself.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array.
    """
    check_image("image", image)
    return image if image.ndim == 2 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2GRAY)


def valid_disparity(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return disparity in pixels with invalid values replaced by 0, which means none.

    Negative, infinite, absurdly large (2^15 pixels and more) and NaN values are none.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32

    Returns
    -------
    (H, W) ndarray of float32
        `disparity` itself where all of it is valid.

    Raises
    ------
    ValueError
        If it is not such an array.
    """
    check_array("disparity", disparity, np.float32, ("H", "W"))
    return _positive(disparity, _MAX_DISPARITY_PX)


def valid_depth(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return depth in metres with 0, which means none, in place of what is negative or not finite.

    Parameters
    ----------
    depth_m : (H, W) ndarray of float32

    Raises
    ------
    ValueError
        If it is not such an array.
    """
    check_array("depth", depth_m, np.float32, ("H", "W"))
    return _positive(depth_m, np.inf)


def _positive(values: NDArray[np.float32], limit: float) -> NDArray[np.float32]:
    """Return `values`, 0 where they are not from 0 to below `limit`; without a copy where all are."""
    bits, bound = values.view(np.uint32), np.float32(limit).view(np.uint32)
    if bits.max() < bound:  # as bits, NaN and what is negative are greater than any such number
        return values
    return np.where((values > 0) & (values < limit), values, np.float32(0))
