"""Compilation of the numba kernels before a node says that it is ready; the result is cached on disk."""

from __future__ import annotations

import sys

import numpy as np
from numba.core.dispatcher import Dispatcher

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector

_PACKAGE = __name__.partition(".")[0]


def compile_kernels(config: Config) -> bool:
    """Run all stages on a small scene; return whether a kernel had to be compiled, and not just loaded."""
    detector = Detector(config, StereoCamera(fx=200.0, cx=80.0, cy=40.0, baseline_m=0.2))
    left = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
    detector.detect(left, np.roll(left, -8, axis=1))
    ground = np.maximum(0.2 * (np.arange(120, dtype=np.float32) - 40), 0)
    detector.detect(left, disparity=np.repeat(ground[:, None], 160, axis=1))
    return any(sum(kernel.stats.cache_misses.values()) for kernel in _kernels())


def _kernels() -> list[Dispatcher]:
    """Return the kernels of this package's modules that are loaded."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(f"{_PACKAGE}.")]
    return [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
