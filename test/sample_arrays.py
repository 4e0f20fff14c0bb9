"""Small arrays that functions are given: images, labels, and what stages find in them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.method import ground

Array = NDArray[Any]

CAMERA = StereoCamera(fx=20.0, cx=9.5, cy=2.0, baseline_m=0.3)
LINE = ground.GroundLine(slope=0.5, intercept=-1.0)


class NearGround(NamedTuple):
    """What the grid takes of the short range."""

    occupancy: Array
    disparity: Array
    line: ground.GroundLine | None


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def grey(height: int, width: int) -> Array:
    return rng().integers(0, 256, (height, width), np.uint8)


def bgr(height: int, width: int) -> Array:
    return rng().integers(0, 256, (height, width, 3), np.uint8)


def labels(height: int, width: int) -> Array:
    """Return 0 .. n - 1, two columns each, in a (height, width) image."""
    return np.repeat(np.arange(width, dtype=np.int32)[None] // 2, height, axis=0)


def n_labels(width: int) -> int:
    return (width + 1) // 2


def clusters(width: int) -> Array:
    return (np.arange(n_labels(width)) % 2).astype(np.int32)


def occupancy(height: int, width: int) -> Array:
    return rng().choice(np.array([0, 100, 255], np.uint8), (height, width))


def disparity(height: int, width: int) -> Array:
    """Return the disparity of the ground line's plane, with some noise."""
    noise = rng().uniform(-0.3, 0.3, (height, width))
    return np.maximum(0.5 * np.arange(height)[:, None] - 1 + noise, 0).astype(np.float32)
