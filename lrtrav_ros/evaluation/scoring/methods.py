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
from lrtrav_ros.detector import Detector, LongRange, ShortRangeDetector, Stage, StageRunner, StageTimes
from lrtrav_ros.evaluation.scoring.near_to_far import classify_superpixels
from lrtrav_ros.frame import Frame
from lrtrav_ros.method.features import colour_histograms, texture_histograms
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN, ShortRange, traversable_mask
from lrtrav_ros.method.matching import Matcher, create_matcher
from lrtrav_ros.method.superpixels import preemptive_slic
from lrtrav_ros.numerics.thread_team import ALONE


@dataclass(frozen=True, slots=True, eq=False)
class MethodDetection:
    """All that a method finds in a frame.

    Attributes
    ----------
    short_range : ShortRange
        What the method starts from.
    long_range : LongRange or None
        What it makes of it; of a classifier, the clusters are its verdicts, 1 ground and 0 not. None for a method that
        ends with the short range.
    times : StageTimes
        Time of each stage; one that methods share counts for each of them. The training of a classifier and its verdict
        count as clustering.
    """

    short_range: ShortRange
    long_range: LongRange | None
    times: StageTimes

    @property
    def occupancy(self) -> NDArray[np.uint8]:
        """The method's result, uint8 (H, W): 0 traversable, 100 not, 255 unknown."""
        return self.short_range.occupancy if self.long_range is None else self.long_range.occupancy

    @property
    def mask(self) -> NDArray[np.uint8]:
        """Traversable pixels, uint8 (H, W): 255 traversable, 0 not."""
        return traversable_mask(self.occupancy)


@dataclass(frozen=True, slots=True)
class Method:
    """A way to find the traversable region.

    Parameters
    ----------
    name, description : str
        As shown in the tables and the report.
    preset : str
        The configuration that it starts from; one of `config.PRESETS`.
    find : callable
        Runs the method on a frame, each stage by the runner that it is given.
    settings : tuple of (str, value)
        Parameters that make this method out of the preset, whatever else is set.
    is_random : bool
        Its result depends on chance so much that it is run with several seeds.
    needs_sklearn : bool
        It needs scikit-learn, which is an extra.
    """

    name: str
    description: str
    preset: str
    find: Callable[[Frame, Config, StageRunner], MethodDetection]
    settings: tuple[tuple[str, Value], ...] = ()
    is_random: bool = False
    needs_sklearn: bool = False

    def configuration(self, values: Mapping[str, object]) -> Config:
        """Return the preset, changed first by parameters of the user and then by what makes this method.

        Parameters
        ----------
        values : mapping of str to value
            Parameters by full name.

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


def find_short_range(frame: Frame, config: Config, run: StageRunner) -> MethodDetection:
    """Find the short range and nothing beyond."""
    return MethodDetection(detect_short_range(frame, config, run), None, run.times)


def find_by_superpixels(frame: Frame, config: Config, run: StageRunner) -> MethodDetection:
    """Extend the short range over superpixels, as `Detector` does."""
    detector = Detector(config, matcher=_shared_matcher(config, run))
    detection = detector.detect_frame(frame, run)
    return MethodDetection(detection.short_range, detection.long_range, detection.times)


def find_by_learning(frame: Frame, config: Config, run: StageRunner) -> MethodDetection:
    """Classify every superpixel by what short range says of some."""
    short_range, learned = _learn(frame, config, run)
    return MethodDetection(short_range, learned, run.times)


def find_by_learning_the_unknown(frame: Frame, config: Config, run: StageRunner) -> MethodDetection:
    """Classify superpixels, and keep what short range says of each pixel that it judges."""
    short_range, learned = _learn(frame, config, run)
    seen = short_range.occupancy
    fused = dataclasses.replace(learned, occupancy=np.where(seen == UNKNOWN, learned.occupancy, seen))
    return MethodDetection(short_range, fused, run.times)


def detect_short_range(frame: Frame, config: Config, run: StageRunner) -> ShortRange:
    """Return the short range of a frame.

    Parameters
    ----------
    frame : Frame
        The frame.
    config : Config
        As `ShortRangeDetector` takes it.
    run : StageRunner
        Runs the stages; those of one frame that share stages share the matcher as well.
    """
    return ShortRangeDetector(config, matcher=_shared_matcher(config, run)).detect(frame, run)


def _shared_matcher(config: Config, run: StageRunner) -> Matcher:
    """Return the matcher of a configuration: the same one for the same settings, for only so its results are shared."""
    return run(Stage.MATCHING, create_matcher, config.stereo, config.elas)


def _learn(frame: Frame, config: Config, run: StageRunner) -> tuple[ShortRange, LongRange]:
    """Return the short range, and what a classifier makes of it."""
    short_range, image = detect_short_range(frame, config, run), frame.image
    superpixels = run(Stage.SUPERPIXELS, preemptive_slic, image, config.superpixels, team=ALONE)
    histograms = run(Stage.FEATURES, _histograms, image, superpixels, config.features.texture)
    is_ground = run(Stage.CLUSTERING, classify_superpixels, histograms, superpixels, short_range.occupancy)
    occupancy = np.where(is_ground, np.uint8(GROUND), np.uint8(OBSTACLE))[superpixels]
    return short_range, LongRange(occupancy, superpixels, lambda: is_ground.astype(np.int32))


def _histograms(image: NDArray[np.uint8], superpixels: NDArray[np.int32], texture: str) -> NDArray[np.float32]:
    """Return colour and texture histograms of each superpixel, side by side."""
    return np.hstack([colour_histograms(image, superpixels), texture_histograms(image, superpixels, texture)])


METHODS = {
    method.name: method
    for method in (
        Method("uv_disparity", "short range alone, by u-v-disparity", "paper", find_short_range),
        Method("proposed", "the paper's method", "paper", find_by_superpixels),
        Method("colour_only", "the paper's, by colour", "paper", find_by_superpixels, (("features.cues", "colour"),)),
        Method(
            "texture_only", "the paper's, by texture", "paper", find_by_superpixels, (("features.cues", "texture"),)
        ),
        Method(
            "random_centres",
            "the paper's, with random initial centres",
            "paper",
            find_by_superpixels,
            (("clustering.centres", "random"),),
            is_random=True,
        ),
        Method("robust", "votes of superpixels that look alike", "robust", find_by_superpixels),
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

DEFAULT_METHODS = tuple(METHODS)


def choose_methods(names: Iterable[str]) -> list[Method]:
    """Return the methods of these names.

    Parameters
    ----------
    names : iterable of str
        Out of `METHODS`, each once.

    Raises
    ------
    ValueError
        If there is no such method, none is named or one twice, or scikit-learn is not installed for one that needs it.
    """
    chosen: dict[str, Method] = {}
    for name in names:
        if name not in METHODS:
            raise ValueError(f"no method {name!r}; choose one of {', '.join(METHODS)}")
        if name in chosen:
            raise ValueError(f"method {name!r} is named twice; name it once")
        if METHODS[name].needs_sklearn and find_spec("sklearn") is None:
            raise ValueError(f"{name} needs scikit-learn: install lrtrav_ros[evaluation], or leave it out of --methods")
        chosen[name] = METHODS[name]
    if not chosen:
        raise ValueError(f"no method is named; choose one of {', '.join(METHODS)}")
    return list(chosen.values())
