"""The whole method, stage after stage: stereo pair -> short range -> long range."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.io.encodings import Image, as_8bit, valid_disparity
from lrtrav_ros.method.clustering import spectral_clusters
from lrtrav_ros.method.extension import extend
from lrtrav_ros.method.features import superpixel_distances
from lrtrav_ros.method.ground import ShortRange, detect_ground, traversable_mask
from lrtrav_ros.method.matching import create_matcher
from lrtrav_ros.method.superpixels import preemptive_slic


@dataclass(frozen=True, slots=True)
class StageTimes:
    """Time that each stage took, in milliseconds; 0 for one that did not run."""

    matching_ms: float = 0.0
    ground_ms: float = 0.0
    superpixels_ms: float = 0.0
    features_ms: float = 0.0
    clustering_ms: float = 0.0
    extension_ms: float = 0.0


@dataclass(frozen=True, slots=True)
class LongRange:
    """The traversable region to the horizon, in an image of (H, W) pixels.

    Attributes
    ----------
    occupancy
        uint8 (H, W): 0 free, 100 occupied, 255 unknown.
    superpixels
        int32 (H, W), labels 0 .. n - 1.
    superpixel_clusters
        int32 (n,), the cluster of each superpixel.
    """

    occupancy: NDArray[np.uint8]
    superpixels: NDArray[np.int32]
    superpixel_clusters: NDArray[np.int32]

    @property
    def mask(self) -> NDArray[np.uint8]:
        """Traversable pixels, uint8 (H, W): 255 traversable, 0 not."""
        return traversable_mask(self.occupancy)

    @property
    def clusters(self) -> NDArray[np.int32]:
        """The cluster of each pixel, int32 (H, W)."""
        return self.superpixel_clusters[self.superpixels]


@dataclass(frozen=True, slots=True)
class Detection:
    """All that the method finds in one frame; `disparity` is float32 (H, W) in pixels, 0 for none."""

    left: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    short_range: ShortRange
    long_range: LongRange
    times: StageTimes


class Detector:
    """Detects the traversable region, frame by frame; it keeps no state between frames.

    Parameters
    ----------
    config
        Settings of all stages.
    camera
        Calibration of the rectified pair.

    Examples
    --------
    >>> detector = Detector(Config.preset("robust"), StereoCamera(fx=721.5, cx=609.6, cy=172.9, baseline_m=0.53))
    >>> result = detector.detect(left_bgr, right_bgr)  # doctest: +SKIP
    >>> result.long_range.mask.dtype  # doctest: +SKIP
    dtype('uint8')
    """

    def __init__(self, config: Config, camera: StereoCamera) -> None:
        self.config = config
        self.camera = camera
        self._matcher = create_matcher(config)

    def detect(
        self,
        left: Image,
        right: Image | None = None,
        *,
        disparity: NDArray[np.float32] | None = None,
        depth_m: NDArray[np.float32] | None = None,
    ) -> Detection:
        """Detect short and long range in one frame.

        Parameters
        ----------
        left
            BGR (H, W, 3) or grey (H, W), uint8 or uint16.
        right, disparity, depth_m
            One of them: the right image, the disparity in pixels, or the depth in metres; the last two float32 (H, W),
            with 0 for none. What is not finite or negative counts as none.

        Raises
        ------
        ValueError
            If not exactly one of the three is given, or an image does not fit.
        """
        start = time.perf_counter()
        disparity = self.disparity_of(left, right, disparity=disparity, depth_m=depth_m)
        matched = time.perf_counter()
        short_range = self.short_range(disparity, from_depth=depth_m is not None)
        ground_ms = _milliseconds_since(matched)
        long_range, times = self._timed_long_range(left, short_range.occupancy)
        times = dataclasses.replace(times, matching_ms=(matched - start) * 1e3, ground_ms=ground_ms)
        return Detection(as_8bit(left), disparity, short_range, long_range, times)

    def disparity_of(
        self,
        left: Image,
        right: Image | None = None,
        *,
        disparity: NDArray[np.float32] | None = None,
        depth_m: NDArray[np.float32] | None = None,
    ) -> NDArray[np.float32]:
        """Return a frame's disparity, float32 (H, W) in pixels, 0 for none; takes and raises what `detect` does."""
        if [right is None, disparity is None, depth_m is None].count(False) != 1:
            raise ValueError("give exactly one of right, disparity and depth_m")
        if right is not None:
            return self.match(left, right)
        if depth_m is not None:
            return self.disparity_of_depth(depth_m)
        return valid_disparity(cast("NDArray[np.float32]", disparity), 0.0)

    def match(self, left: Image, right: Image) -> NDArray[np.float32]:
        """Return the disparity of the left image, float32 (H, W) in pixels, 0 for none."""
        return self._matcher.compute(left, right)

    def disparity_of_depth(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return a depth image, cut at ``source.max_depth_m``, as disparity of the camera."""
        return self._within_reach(self.camera.disparity(depth_m))

    def short_range(self, disparity: NDArray[np.float32], *, from_depth: bool = False) -> ShortRange:
        """Return ground and obstacles up to ``source.max_depth_m``; `from_depth` says that it was depth."""
        config = self.config.ground
        if from_depth:
            config = dataclasses.replace(config, noise_px=config.depth_noise_px)
        return detect_ground(self._within_reach(disparity), self.camera, config=config)

    def _within_reach(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the disparity without what is farther than ``source.max_depth_m``."""
        limit = self.config.source.max_depth_m
        if not limit:
            return disparity
        return np.where(disparity >= self.camera.fx * self.camera.baseline_m / limit, disparity, np.float32(0))

    def long_range(self, left: Image, occupancy: NDArray[np.uint8]) -> LongRange:
        """Return the traversable region to the horizon, from the left image and the short range's occupancy."""
        return self._timed_long_range(left, occupancy)[0]

    def _timed_long_range(self, left: Image, occupancy: NDArray[np.uint8]) -> tuple[LongRange, StageTimes]:
        left = as_8bit(left)
        config = self.config
        if left.shape[:2] != occupancy.shape:
            raise ValueError(f"left image is {left.shape[:2]}, occupancy {occupancy.shape}; give images of one size")
        start = time.perf_counter()
        superpixels = preemptive_slic(left, config.superpixels)
        segmented = time.perf_counter()
        distances = superpixel_distances(left, superpixels, config.features)
        compared = time.perf_counter()
        clusters = spectral_clusters(distances, config.clustering)
        clustered = time.perf_counter()
        extended = extend(occupancy, superpixels, clusters, config.extension)
        times = StageTimes(
            superpixels_ms=(segmented - start) * 1e3,
            features_ms=(compared - segmented) * 1e3,
            clustering_ms=(clustered - compared) * 1e3,
            extension_ms=_milliseconds_since(clustered),
        )
        return LongRange(extended, superpixels, clusters), times


def _milliseconds_since(start: float) -> float:
    return (time.perf_counter() - start) * 1e3
