"""Compilation of the numba kernels before a node says that it is ready; the result is cached on disk."""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
from numba.core.dispatcher import Dispatcher

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector

_PACKAGE = __name__.partition(".")[0]


@cache
def compile_kernels(config: Config) -> bool:
    """Run all stages on a small scene; return whether a kernel had to be compiled, and not just loaded.

    With one configuration it does so once a process.
    """
    left = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
    ground = np.maximum(0.2 * (np.arange(120, dtype=np.float32) - 40), 0)
    disparity = np.repeat(ground[:, None], 160, axis=1)
    disparity[90:100, 40:120] = 0.9 * ground[80]  # a ditch
    # Few superpixels are compared all with all, many are not; for read-only images, as of some messages, numba compiles
    # again.
    for settings, writeable in ((config, True), (config.updated({"superpixels.n_superpixels": 20}), False)):
        detector = Detector(settings, StereoCamera(fx=200.0, cx=80.0, cy=40.0, baseline_m=0.2))
        left.flags.writeable = writeable
        for found in (detector.detect(left, np.roll(left, -8, axis=1)), detector.detect(left, disparity=disparity)):
            found.long_range.find_clusters()  # which nobody does until they are asked for
    return any(sum(kernel.stats.cache_misses.values()) for kernel in _kernels())


def _kernels() -> list[Dispatcher]:
    """Return the kernels of this package's modules that are loaded."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(f"{_PACKAGE}.")]
    return [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
