"""Compilation of the numba kernels before a node says that it is ready; the result is cached on disk."""

from __future__ import annotations

import sys
from functools import cache

import numpy as np
from numba.core.dispatcher import Dispatcher

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, MapsConfig, SourceConfig
from lrtrav_ros.detector import Detection, Detector
from lrtrav_ros.io.rvl import decode_rvl
from lrtrav_ros.mapping.grid import ground_grid
from lrtrav_ros.mapping.points import free_points, obstacle_points
from lrtrav_ros.mapping.segmentation import segmentation_points
from lrtrav_ros.pose import Pose
from lrtrav_ros.registration import DepthRegistration

_PACKAGE = __name__.partition(".")[0]
_CAMERA = StereoCamera(fx=200.0, cx=80.0, cy=40.0, baseline_m=0.2)


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
        detector = Detector(settings, _CAMERA)
        left.flags.writeable = writeable
        for found in (detector.detect(left, np.roll(left, -8, axis=1)), detector.detect(left, disparity=disparity)):
            found.long_range.find_clusters()  # which nobody does until they are asked for
            _make_maps(found, config.maps)
    _compile_depth(config.source)
    return any(sum(kernel.stats.cache_misses.values()) for kernel in _kernels())


def _make_maps(found: Detection, config: MapsConfig) -> None:
    """Make the maps of a frame, which nobody does until they are asked for."""
    disparity, occupancy, line = found.disparity, found.short_range.occupancy, found.short_range.line
    obstacle_points(disparity, occupancy, line, _CAMERA, config)
    free_points(occupancy, line, _CAMERA, config)
    segmentation_points(found.long_range.occupancy, disparity, line, _CAMERA, config)
    ground_grid(found.long_range.occupancy, found.short_range, _CAMERA, config).in_frame(0.0, 0.0, 1.0)


def _compile_depth(config: SourceConfig) -> None:
    """Run what depth images take that are compressed, or that are to be registered."""
    if config.source != "depth":
        return
    if config.compressed:
        decode_rvl(bytes.fromhex("00000010"), height=1, width=1)  # a zero
    if not config.depth_registered:
        camera = StereoCamera(fx=20.0, cx=8.0, cy=6.0, baseline_m=0.1, width=16, height=12)
        DepthRegistration(camera, camera, Pose.parsed("0 0 0 0 0 0")).registered(np.ones((12, 16), np.float32))


def _kernels() -> list[Dispatcher]:
    """Return the kernels of this package's modules that are loaded."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(f"{_PACKAGE}.")]
    return [value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)]
