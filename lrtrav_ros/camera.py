"""Calibration of a rectified stereo pair, and what follows from it."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.numerics.checks import check_array

_LARGEST = sys.float_info.max
_LEAST = 1e-6  # of a focal length in pixels and of a baseline in metres: quotients of them stay finite

_MAX_PX = 1e5
"""No lens has so long a focal length, and no principal point is so far off: what depends on them stays small."""

_MAX_SIZES = 100
"""Longest focal length and farthest principal point, in sizes of the image. A 1000 mm lens has 28 widths of its sensor,
of which images may show a part. As the least share of the size, a focal length is that of 179 degrees, which no plane
shows."""

_MAX_BASELINE_M = 1000.0
"""No vehicle is as wide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoCamera:
    """A rectified stereo camera; both images have the same rows and the same focal length.

    Parameters
    ----------
    fx : float
        Focal length along rows, in pixels.
    cx, cy : float
        Principal point of the left image, in pixels.
    baseline_m : float
        Distance between the two cameras, in metres.
    fy : float, optional
        Focal length along columns, in pixels; `fx` where it is not given.
    width, height : int, optional
        Size in pixels of the images that this calibration is for. Give both, and images of another size are refused;
        without them, images of any size are accepted.

    Raises
    ------
    ValueError
        If a value is not finite, a value or the size is absurdly large, a focal length, the baseline or a size is not
        positive, a focal length or the principal point cannot be one of images of this size, or only one size is given.
    """

    fx: float
    cx: float
    cy: float
    baseline_m: float
    fy: float = None  # type: ignore[assignment]  # never None once made
    width: int | None = None
    height: int | None = None

    def __post_init__(self) -> None:
        if self.fy is None:
            object.__setattr__(self, "fy", self.fx)
        for name in ("fx", "fy", "cx", "cy", "baseline_m"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _LARGEST:
                raise ValueError(f"{name} is {value!r}; give a finite number")
            if name in ("fx", "fy", "baseline_m") and value < _LEAST:
                raise ValueError(f"{name} is {value!r}; give a positive number, at least {_LEAST:g}")
            if name != "baseline_m" and abs(value) > _MAX_PX:
                raise ValueError(f"{name} is {value!r}; give pixels, at most {_MAX_PX:g} of them")
            object.__setattr__(self, name, float(value))
        if self.baseline_m > _MAX_BASELINE_M:
            raise ValueError(f"baseline_m is {self.baseline_m!r}; give metres, at most {_MAX_BASELINE_M:g} of them")
        if (self.width is None) != (self.height is None):
            raise ValueError(f"width is {self.width!r}, height {self.height!r}; give both or none")
        for name in ("width", "height"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value <= 0):
                raise ValueError(f"{name} is {value!r}; give a whole number of pixels")
        if self.width is not None and self.height is not None:
            if self.width * self.height > MAX_PIXELS:
                raise ValueError(f"images are {self.width} x {self.height}; give a size of at most {MAX_PIXELS} pixels")
            self._check_proportions(self.width, self.height)

    def _check_proportions(self, width: int, height: int) -> None:
        """Raise ValueError where focal lengths or principal point cannot be those of images of a size."""
        size = max(width, height)
        for name in ("fx", "fy", "cx", "cy"):
            value = abs(getattr(self, name))
            if value > _MAX_SIZES * size or (name in ("fx", "fy") and value * _MAX_SIZES < min(width, height)):
                raise ValueError(
                    f"{name} is {getattr(self, name)!r} pixels for images of {width} x {height}, which no camera has; "
                    "calibrate for this size"
                )

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """fx, fy, cx, cy and fx times the baseline, (5,) float64."""
        return np.array([self.fx, self.fy, self.cx, self.cy, self.fx * self.baseline_m])

    def check_size(self, shape: tuple[int, ...]) -> None:
        """Raise ValueError where the calibration cannot be for an image of this shape, (height, width, ...)."""
        if self.width is None or self.height is None:
            self._check_proportions(shape[1], shape[0])
            return
        if shape[:2] == (self.height, self.width):
            return
        raise ValueError(
            f"the calibration is for {self.width} x {self.height} pixels, but the image is {shape[1]} x {shape[0]}; "
            "calibrate for this size"
        )

    def depth_m(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the depth of each pixel.

        Parameters
        ----------
        disparity : (H, W) ndarray of float32
            In pixels; 0 for none.

        Returns
        -------
        (H, W) ndarray of float32
            In metres; 0 where there is no disparity.

        Raises
        ------
        TypeError, ValueError
            If `disparity` is not such an array.
        """
        return self._inverted("disparity", disparity)

    def disparity(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the disparity of each pixel.

        Parameters
        ----------
        depth_m : (H, W) ndarray of float32
            In metres; what is not positive or not finite is none.

        Returns
        -------
        (H, W) ndarray of float32
            In pixels; 0 where there is no depth.

        Raises
        ------
        TypeError, ValueError
            If `depth_m` is not such an array.
        """
        return self._inverted("depth", depth_m)

    def _inverted(self, name: str, values: NDArray[np.float32]) -> NDArray[np.float32]:
        check_array(name, values, np.float32, ("H", "W"))
        valid = np.isfinite(values) & (values > 0)
        result = np.zeros(values.shape, np.float32)
        with np.errstate(over="ignore"):  # what overflows is infinite, and counts as none
            np.divide(np.float32(self.fx * self.baseline_m), values, out=result, where=valid)
        return result
