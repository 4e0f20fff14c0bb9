"""Calibration of a rectified stereo pair, and what follows from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoCamera:
    """A rectified stereo camera; both images have the same rows and the same focal length.

    Parameters
    ----------
    fx
        Focal length along rows, in pixels.
    cx, cy
        Principal point of the left image, in pixels.
    baseline_m
        Distance of the two cameras, in metres.
    fy
        Focal length along columns, in pixels; `fx` where it is not given.

    Raises
    ------
    ValueError
        If a value is not finite, or a focal length or the baseline is not positive.
    """

    fx: float
    cx: float
    cy: float
    baseline_m: float
    fy: float = None  # type: ignore[assignment]  # never None once made

    def __post_init__(self) -> None:
        if self.fy is None:
            object.__setattr__(self, "fy", self.fx)
        for name in ("fx", "fy", "cx", "cy", "baseline_m"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise ValueError(f"{name} is {value!r}; give a finite number")
            if name in ("fx", "fy", "baseline_m") and value <= 0:
                raise ValueError(f"{name} is {value!r}; give a positive number")

    def depth_m(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the depth of each pixel in metres; 0 where `disparity` (pixels) is 0, which means none."""
        return self._inverted(disparity)

    def disparity(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the disparity of each pixel; 0, which means none, where `depth_m` is not positive or not finite."""
        return self._inverted(depth_m)

    def _inverted(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        valid = np.isfinite(values) & (values > 0)
        result = np.zeros(values.shape, np.float32)
        np.divide(np.float32(self.fx * self.baseline_m), values, out=result, where=valid)
        return result
