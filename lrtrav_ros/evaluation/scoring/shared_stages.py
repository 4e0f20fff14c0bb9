"""The stages of one frame, computed once for all the methods that share them."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.io.dataset_folder import Frame
from lrtrav_ros.method.clustering import spectral_clusters
from lrtrav_ros.method.features import colour_histograms, superpixel_distances, texture_histograms
from lrtrav_ros.method.ground import ShortRange
from lrtrav_ros.method.superpixels import preemptive_slic

Value = TypeVar("Value")
Timed: TypeAlias = tuple[Value, float]
"""A stage's result, and the milliseconds that it took when it was computed."""


class FrameStages:
    """What the stages of the method give on a frame; each is computed once for each of its settings.

    Every method here takes the whole configuration, and returns the result with the time in milliseconds.
    """

    def __init__(self, frame: Frame) -> None:
        self.frame = frame
        self._done: dict[Hashable, Timed[Any]] = {}

    def disparity(self, config: Config) -> Timed[NDArray[np.float32]]:
        """Return the disparity, matched, computed from depth or as the frame brings it, however far it goes."""
        return self._once(("disparity", config.stereo, config.elas), lambda: self._match(config))

    def short_range(self, config: Config) -> Timed[ShortRange]:
        """Return ground and obstacles in the range of stereo."""
        disparity, _ = self.disparity(config)
        from_depth = self.frame.depth_m is not None
        detector = Detector(config, self.frame.camera)
        return self._once(
            ("ground", config.ground, config.source, config.stereo, config.elas),
            lambda: detector.short_range(disparity, from_depth=from_depth),
        )

    def superpixels(self, config: Config) -> Timed[NDArray[np.int32]]:
        """Return the label of each pixel."""
        return self._once(config.superpixels, lambda: preemptive_slic(self.frame.left, config.superpixels))

    def histograms(self, config: Config) -> Timed[NDArray[np.float32]]:
        """Return colour and texture histograms of each superpixel, side by side."""
        superpixels, _ = self.superpixels(config)
        left, texture = self.frame.left, config.features.texture
        return self._once(
            ("histograms", config.superpixels, texture),
            lambda: np.hstack([colour_histograms(left, superpixels), texture_histograms(left, superpixels, texture)]),
        )

    def distances(self, config: Config) -> Timed[NDArray[np.float64]]:
        """Return the distance of each superpixel to each."""
        superpixels, _ = self.superpixels(config)
        return self._once(
            ("distances", config.superpixels, config.features),
            lambda: superpixel_distances(self.frame.left, superpixels, config.features),
        )

    def clusters(self, config: Config) -> Timed[NDArray[np.int32]]:
        """Return the cluster of each superpixel."""
        distances, _ = self.distances(config)
        return self._once(
            ("clusters", config.superpixels, config.features, config.clustering),
            lambda: spectral_clusters(distances, config.clustering),
        )

    def _match(self, config: Config) -> NDArray[np.float32]:
        frame = self.frame
        detector = Detector(config.updated({"source.max_depth_m": 0.0}), frame.camera)
        return detector.disparity_of(frame.left, frame.right, disparity=frame.disparity, depth_m=frame.depth_m)

    def _once(self, key: Hashable, compute: Callable[[], Value]) -> Timed[Value]:
        if key not in self._done:
            self._done[key] = timed(compute)
        return self._done[key]


def timed(compute: Callable[[], Value]) -> Timed[Value]:
    """Return what `compute` returns, and the milliseconds that it took."""
    start = time.perf_counter()
    value = compute()
    return value, (time.perf_counter() - start) * 1e3
