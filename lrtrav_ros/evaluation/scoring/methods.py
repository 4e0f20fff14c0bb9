"""The methods that are compared: those of Table I of the paper, the robust preset, and near-to-far learning.

The five of Table I have the short range, superpixels and features of the preset ``paper``; ``robust`` and near-to-far
learning those of the preset ``robust``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import Config, Value
from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.scoring.near_to_far import classify_superpixels
from lrtrav_ros.evaluation.scoring.shared_stages import FrameStages, timed
from lrtrav_ros.method.extension import extend
from lrtrav_ros.method.ground import (
    GROUND,
    OBSTACLE,
    UNKNOWN,
    ShortRange,
    traversable_mask,
)


@dataclass(frozen=True, slots=True)
class MethodResult:
    """What a method finds in a frame of (H, W) pixels.

    Attributes
    ----------
    occupancy
        uint8 (H, W): 0 traversable, 100 not, 255 unknown.
    short_range
        What the method starts from.
    superpixels
        int32 (H, W); None for a method without superpixels.
    clusters
        The cluster of each pixel, or the verdict of the classifier (1 ground, 0 not), int32 (H, W); None for a method
        without superpixels.
    times
        In milliseconds. The training of a classifier and its verdict count as clustering.
    """

    occupancy: NDArray[np.uint8]
    short_range: ShortRange
    superpixels: NDArray[np.int32] | None
    clusters: NDArray[np.int32] | None
    times: StageTimes

    @property
    def mask(self) -> NDArray[np.uint8]:
        """Traversable pixels, uint8 (H, W): 255 traversable, 0 not."""
        return traversable_mask(self.occupancy)


@dataclass(frozen=True, slots=True)
class Method:
    """A way to find the traversable region: its preset, what it changes there, and how it goes on from short range.

    Attributes
    ----------
    is_random
        Its result depends on chance so much that it is run with several seeds.
    needs_sklearn
        It needs scikit-learn, which is an extra.
    """

    name: str
    description: str
    preset: str
    find: Callable[[FrameStages, Config], MethodResult]
    settings: tuple[tuple[str, Value], ...] = ()
    is_random: bool = False
    needs_sklearn: bool = False

    def configuration(self, values: Mapping[str, object]) -> Config:
        """Return the preset, changed first by `values` and then by what makes this method.

        Raises
        ------
        ValueError
            If a name in `values` is unknown or a value does not fit.
        """
        return Config.preset(self.preset).updated(values).updated(dict(self.settings))

    def with_setting(self, parameter: str, value: Value) -> Method:
        """Return this method with one more parameter set, named ``METHOD-VALUE``."""
        return dataclasses.replace(
            self,
            name=f"{self.name}-{value}",
            description=f"{self.description}, {parameter} = {value}",
            settings=(*self.settings, (parameter, value)),
        )


def find_short_range(stages: FrameStages, config: Config) -> MethodResult:
    """Return the short range and nothing beyond."""
    short_range, times = _timed_short_range(stages, config)
    return MethodResult(short_range.occupancy, short_range, None, None, times)


def find_by_clusters(stages: FrameStages, config: Config) -> MethodResult:
    """Extend the short range over clusters of superpixels, as `Detector` does."""
    short_range, times = _timed_short_range(stages, config)
    superpixels, superpixels_ms = stages.superpixels(config)
    _, features_ms = stages.distances(config)
    clusters, clustering_ms = stages.clusters(config)
    occupancy, extension_ms = timed(lambda: extend(short_range.occupancy, superpixels, clusters, config.extension))
    times = dataclasses.replace(
        times,
        superpixels_ms=superpixels_ms,
        features_ms=features_ms,
        clustering_ms=clustering_ms,
        extension_ms=extension_ms,
    )
    return MethodResult(occupancy, short_range, superpixels, clusters[superpixels], times)


def find_by_learning(stages: FrameStages, config: Config) -> MethodResult:
    """Classify every superpixel by what short range says of some."""
    short_range, times = _timed_short_range(stages, config)
    superpixels, superpixels_ms = stages.superpixels(config)
    histograms, features_ms = stages.histograms(config)
    is_ground, learning_ms = timed(lambda: classify_superpixels(histograms, superpixels, short_range.occupancy))
    verdict = is_ground[superpixels]
    times = dataclasses.replace(
        times, superpixels_ms=superpixels_ms, features_ms=features_ms, clustering_ms=learning_ms
    )
    occupancy = np.where(verdict, np.uint8(GROUND), np.uint8(OBSTACLE))
    return MethodResult(occupancy, short_range, superpixels, verdict.astype(np.int32), times)


def find_by_learning_the_unknown(stages: FrameStages, config: Config) -> MethodResult:
    """Classify superpixels, and keep what short range says of each pixel that it judges."""
    learned = find_by_learning(stages, config)
    seen = learned.short_range.occupancy
    return dataclasses.replace(learned, occupancy=np.where(seen == UNKNOWN, learned.occupancy, seen))


METHODS = {
    method.name: method
    for method in (
        Method("uv_disparity", "short range alone, by u-v-disparity", "paper", find_short_range),
        Method("proposed", "the paper's method", "paper", find_by_clusters),
        Method("colour_only", "the paper's, by colour", "paper", find_by_clusters, (("features.cues", "colour"),)),
        Method("texture_only", "the paper's, by texture", "paper", find_by_clusters, (("features.cues", "texture"),)),
        Method(
            "random_centres",
            "the paper's, with random initial centres",
            "paper",
            find_by_clusters,
            (("clustering.centres", "random"),),
            is_random=True,
        ),
        Method("robust", "clusters judged by evidence", "robust", find_by_clusters),
        Method(
            "near_to_far",
            "superpixels classified by learning from short range",
            "robust",
            find_by_learning,
            needs_sklearn=True,
        ),
        Method(
            "near_to_far_fused",
            "near_to_far where short range says nothing, short range elsewhere",
            "robust",
            find_by_learning_the_unknown,
            needs_sklearn=True,
        ),
    )
}

DEFAULT_METHODS = tuple(name for name in METHODS if name != "near_to_far_fused")


def choose_methods(names: Iterable[str]) -> list[Method]:
    """Return the methods of these names.

    Raises
    ------
    ValueError
        If there is no such method, one is named twice, or scikit-learn is not installed for one that needs it.
    """
    chosen: dict[str, Method] = {}
    for name in names:
        if name not in METHODS:
            raise ValueError(f"no method {name!r}; choose out of {', '.join(METHODS)}")
        if name in chosen:
            raise ValueError(f"method {name!r} is named twice; name it once")
        if METHODS[name].needs_sklearn and find_spec("sklearn") is None:
            raise ValueError(f"{name} needs scikit-learn: install lrtrav_ros[evaluation], or leave it out of --methods")
        chosen[name] = METHODS[name]
    return list(chosen.values())


def _timed_short_range(stages: FrameStages, config: Config) -> tuple[ShortRange, StageTimes]:
    _, matching_ms = stages.disparity(config)
    short_range, ground_ms = stages.short_range(config)
    return short_range, StageTimes(matching_ms=matching_ms, ground_ms=ground_ms)
