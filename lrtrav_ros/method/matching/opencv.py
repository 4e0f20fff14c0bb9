"""OpenCV's matchers: semi-global block matching (StereoSGBM) and block matching (StereoBM)."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import StereoConfig
from lrtrav_ros.method.matching._grey_pair import grey_pair
from lrtrav_ros.numerics.checks import check_type
from lrtrav_ros.numerics.forks import renew_in_children

_SCALE = np.float32(16)  # OpenCV's disparities are in sixteenths of a pixel
_SPECKLE_SIZE_PX = 200


class OpenCVMatcher:
    """StereoSGBM along five directions (``matcher`` sgbm) or StereoBM (bm), with the interface of `Matcher`.

    The images are extended to the left by the disparity range: unlike OpenCV alone, which leaves that margin empty,
    every pixel is compared with all disparities that lie in the right image.

    Parameters
    ----------
    stereo : StereoConfig
        `matcher` (``sgbm`` or ``bm``), `n_disparities` (rounded up to a multiple of 16; what exceeds the range is
        dropped), `half_resolution` and `block_size` are used.

    Raises
    ------
    TypeError, ValueError
        If `stereo` is something else, or names another matcher.

    Notes
    -----
    StereoSGBM uses one thread; how many StereoBM uses is OpenCV's own setting, ``cv2.setNumThreads``.
    """

    def __init__(self, stereo: StereoConfig) -> None:
        check_type("stereo", stereo, StereoConfig)
        if stereo.matcher not in _KINDS:
            raise ValueError(f"matcher is {stereo.matcher!r}; OpenCV has {' and '.join(_KINDS)}")
        kind = _KINDS[stereo.matcher]
        self._stereo = stereo
        step = 2 if stereo.half_resolution else 1
        self._range = -(-stereo.n_disparities // (16 * step)) * 16
        self._block_size = max((stereo.block_size or kind.default_block_size) | 1, kind.least_block_size)
        self._create = partial(kind.create, self._range, self._block_size, _SPECKLE_SIZE_PX // step**2)
        self.renew()
        renew_in_children(self)

    def renew(self) -> None:
        """Have a matcher of OpenCV that no thread uses; a forked child needs it."""
        self._matcher = self._create()
        self._in_use = threading.Lock()

    def compute(self, left: NDArray[np.generic], right: NDArray[np.generic]) -> NDArray[np.float32]:
        """Return the disparity of the left image; takes, returns and raises what `Matcher.compute` does.

        With `half_resolution` images of half the size are matched and each disparity stands for 2 x 2 pixels.
        """
        left, right = grey_pair(left, right)
        if not self._stereo.half_resolution:
            return self._within_range(self._match(left, right))
        height, width = left.shape
        disparity = 2 * self._match(_halved(left), _halved(right))
        return self._within_range(disparity.repeat(2, axis=0).repeat(2, axis=1)[:height, :width].copy())

    def _match(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return the disparity of the left of two grey images, below 0 for none."""
        height, width = left.shape
        edge = self._block_size  # room for a whole window at every pixel, however small the image is
        padding = (edge, edge, edge + self._range, edge)
        padded = [cv2.copyMakeBorder(image, *padding, cv2.BORDER_REPLICATE) for image in (left, right)]
        with self._in_use:  # OpenCV's matchers have buffers, which two threads must not write to at a time
            raw = self._matcher.compute(*padded)
        disparity = raw[edge : edge + height, -edge - width : -edge].astype(np.float32) / _SCALE
        disparity[disparity > np.arange(width)] = 0  # found in the extension, not in the right image
        return disparity

    def _within_range(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return `disparity` with 0 for none and for all that exceeds the range."""
        disparity[(disparity < 0) | (disparity > self._stereo.n_disparities - 1)] = 0
        return disparity


class _StereoMatcher(Protocol):
    """OpenCV's matchers."""

    def compute(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.int16]: ...


@dataclass(frozen=True, slots=True)
class _Kind:
    """A kind of matcher: `create` takes the number of disparities, the block's and the smallest segment's size."""

    create: Callable[[int, int, int], _StereoMatcher]
    default_block_size: int
    least_block_size: int


def _create_sgbm(n_disparities: int, block_size: int, speckle_size: int) -> _StereoMatcher:
    """Return StereoSGBM along five directions."""
    area = block_size**2
    return cv2.StereoSGBM_create(
        minDisparity=0,
        numDisparities=n_disparities,
        blockSize=block_size,
        P1=8 * area,
        P2=32 * area,
        disp12MaxDiff=1,
        preFilterCap=63,
        uniquenessRatio=10,
        speckleWindowSize=speckle_size,
        speckleRange=1,
        mode=cv2.STEREO_SGBM_MODE_SGBM,
    )


def _create_bm(n_disparities: int, block_size: int, speckle_size: int) -> _StereoMatcher:
    """Return StereoBM."""
    matcher = cv2.StereoBM_create(numDisparities=n_disparities, blockSize=block_size)
    matcher.setPreFilterCap(31)
    matcher.setTextureThreshold(10)
    matcher.setUniquenessRatio(10)
    matcher.setDisp12MaxDiff(1)
    matcher.setSpeckleWindowSize(speckle_size)
    matcher.setSpeckleRange(1)
    return matcher


_KINDS = {
    "sgbm": _Kind(_create_sgbm, default_block_size=5, least_block_size=1),
    "bm": _Kind(_create_bm, default_block_size=15, least_block_size=5),
}


def _halved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the means of 2 x 2 pixels; both images are treated alike, so disparities are exactly halved."""
    height, width = image.shape
    even = cv2.copyMakeBorder(image, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    return cv2.resize(even, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
