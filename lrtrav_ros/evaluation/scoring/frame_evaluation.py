"""All methods on one frame: what they find, its scores, and the time that it took."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import Config
from lrtrav_ros.evaluation.scoring.ground_distances import GroundDistances
from lrtrav_ros.evaluation.scoring.methods import Method, MethodDetection, detect_short_range
from lrtrav_ros.evaluation.scoring.obstacles import StandingObstacles
from lrtrav_ros.evaluation.scoring.reliability import ConfidenceBin, count_confidence
from lrtrav_ros.evaluation.scoring.score_records import FrameRecord, FrameTimes, MethodRecord, MethodTimes
from lrtrav_ros.evaluation.scoring.scores import count, count_bands, mean_scores, spread_of_scores, sum_each
from lrtrav_ros.evaluation.scoring.shared_stages import SharedStages
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame, LabelledItem
from lrtrav_ros.evaluation.truth.labels import apply_unknown_rule
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.image_files import encode_file
from lrtrav_ros.method.ground import NO_GROUND, GroundLine


@dataclass(frozen=True, slots=True)
class SeededMethod:
    """A method with its configurations, one for each seed."""

    method: Method
    configs: tuple[Config, ...]


@dataclass(frozen=True, slots=True)
class Setup:
    """Work to be done on every frame.

    Attributes
    ----------
    methods : tuple of SeededMethod
        The methods that are compared.
    geometry : Config
        The configuration by which distances on the ground are measured, the same for all methods: the preset
        ``robust`` on all of the disparity.
    save_masks : bool
        Whether masks are kept.
    """

    methods: tuple[SeededMethod, ...]
    geometry: Config
    save_masks: bool = False


def make_setup(
    methods: Sequence[Method], values: Mapping[str, object], *, n_seeds: int, save_masks: bool = False
) -> Setup:
    """Return the setup for some methods; each computes a frame on one thread.

    Parameters
    ----------
    methods : sequence of Method
        The methods that are compared.
    values : mapping of str to value
        Parameters by full name that are changed in all of their presets.
    n_seeds : int
        Seeds of the methods that depend on chance: ``clustering.seed`` and those that follow it.
    save_masks : bool
        Whether masks are kept.

    Raises
    ------
    ValueError
        If a name in `values` is unknown or a value does not fit, a memory is asked for, or there are no seeds.
    """
    if n_seeds < 1:
        raise ValueError(f"the number of seeds is {n_seeds}; give at least 1")
    seeded = []
    for method in methods:
        config = dataclasses.replace(method.configuration(values), threads=1)
        seeded.append(SeededMethod(method, tuple(_with_seeds(config, n_seeds if method.is_random else 1))))
    geometry = Config.preset("robust").updated({**values, "source.max_depth_m": 0.0, "threads": 1})
    for name, value in geometry.memories.items():
        raise ValueError(
            f"{name} is {value}, but frames are evaluated one by one, each without those before it; set it to 0"
        )
    return Setup(tuple(seeded), geometry, save_masks)


def _with_seeds(config: Config, n_seeds: int) -> Iterator[Config]:
    """Yield the configuration with its seed and those that follow."""
    first = config.clustering.seed
    for seed in range(first, first + n_seeds):
        yield dataclasses.replace(config, clustering=dataclasses.replace(config.clustering, seed=seed))


@dataclass(frozen=True, slots=True)
class FrameTask:
    """A frame to evaluate.

    Attributes
    ----------
    set : str
        Name of its set.
    item : LabelledItem
        The frame, to be read.
    unknown_rule : str
        What unknown pixels count as; one of `labels.UNKNOWN_RULES`.
    files_digest : str
        Digest of the files that it is read from, kept in its record.
    setup : Setup
        The methods.
    """

    set: str
    item: LabelledItem
    unknown_rule: str
    files_digest: str
    setup: Setup


@dataclass(frozen=True, slots=True)
class MaskFile:
    """A method's mask as PNG; with several seeds, that of the first."""

    method: str
    data: bytes


@dataclass(frozen=True, slots=True)
class FrameOutcome:
    """Scores, times and masks of a frame."""

    record: FrameRecord
    times: FrameTimes
    masks: tuple[MaskFile, ...] = ()


def evaluate_frame(task: FrameTask) -> FrameOutcome:
    """Read a frame and run all methods on it; a frame that cannot be used gives a record that says why."""
    name = task.item.name
    try:
        with _one_opencv_thread():
            return _evaluate(task, task.item.read())
    except (OSError, ValueError, cv2.error) as err:
        record = FrameRecord(task.set, name, (), error=" ".join(str(err).split()), files_digest=task.files_digest)
        return FrameOutcome(record, FrameTimes(task.set, name, ()))


def detect_all(
    frame: Frame, setup: Setup, stages: SharedStages
) -> Iterator[tuple[SeededMethod, list[MethodDetection]]]:
    """Yield all that each method finds in a frame.

    Parameters
    ----------
    frame : Frame
        The frame.
    setup : Setup
        The methods.
    stages : SharedStages
        Those of this frame.

    Yields
    ------
    tuple of SeededMethod and list of MethodDetection
        A method, and a detection for each of its configurations.
    """
    for seeded in setup.methods:
        yield seeded, [seeded.method.find(frame, config, stages.runner()) for config in seeded.configs]


def _evaluate(task: FrameTask, labelled: LabelledFrame) -> FrameOutcome:
    frame, name, stages = labelled.frame, task.item.name, SharedStages()
    line = detect_short_range(frame, task.setup.geometry, stages.runner()).line
    truth = _FrameTruth(labelled, task.unknown_rule, line)
    records, times, masks = [], [], []
    for seeded, detections in detect_all(frame, task.setup, stages):
        method = seeded.method.name
        records.append(_record(method, detections, truth))
        times.append(MethodTimes(method, detections[0].times))
        if task.setup.save_masks:
            masks.append(MaskFile(method, encode_file("mask.png", detections[0].mask)))
    record = FrameRecord(task.set, name, tuple(records), files_digest=task.files_digest)
    return FrameOutcome(record, FrameTimes(task.set, name, tuple(times)), tuple(masks))


class _FrameTruth:
    """What the masks of a frame are compared with: the truth as its pixels count, its obstacles, and distances."""

    def __init__(self, labelled: LabelledFrame, unknown_rule: str, line: GroundLine | None) -> None:
        self.labels = apply_unknown_rule(labelled.truth, unknown_rule)
        self.distances = None if line is None else GroundDistances(line, labelled.frame.camera, self.labels.shape)
        self.obstacles = StandingObstacles(  # of what the truth knows, whatever unknown pixels count as
            labelled.truth,
            distance_m=None if self.distances is None else self.distances.distance_m,
            height_m=labelled.height_m,
        )


def _record(method: str, detections: Sequence[MethodDetection], truth: _FrameTruth) -> MethodRecord:
    """Return the scores of a method's detections, which differ by seed."""
    masks = [detection.mask for detection in detections]
    counts = [count(mask, truth.labels) for mask in masks]
    scores = [item.scores for item in counts]
    record = MethodRecord(
        method,
        mean_scores(scores),
        functools.reduce(operator.add, counts),
        truth.obstacles.scores(masks),
        spread_of_scores(scores) if len(scores) > 1 else None,
        reliability=_reliability(detections, truth.labels),
        problem=NO_GROUND if detections[0].short_range.line is None else "",
        seeds=tuple(scores),
    )
    return record if truth.distances is None else _with_distances(record, detections, truth.labels, truth.distances)


def _reliability(detections: Sequence[MethodDetection], truth: NDArray[np.uint8]) -> tuple[ConfidenceBin, ...]:
    """Return how often detections are right by their confidence; nothing for those without."""
    return sum_each(
        count_confidence(detection.long_range.confidence, detection.mask, truth)
        for detection in detections
        if detection.long_range is not None and detection.long_range.confidence is not None
    )


def _with_distances(
    record: MethodRecord,
    detections: Sequence[MethodDetection],
    truth: NDArray[np.uint8],
    distances: GroundDistances,
) -> MethodRecord:
    """Return a record with its scores by distance, and how far ahead the masks reach."""
    masks = [detection.mask for detection in detections]
    bands = [count_bands(mask, truth, distances.distance_m) for mask in masks]
    reach_m = float(np.mean([distances.reach_m(mask, truth) for mask in masks]))
    seen_m = distances.reach_m(detections[0].short_range.mask, truth)
    return dataclasses.replace(record, bands=sum_each(bands), reach_m=reach_m, gain_m=reach_m - seen_m)


@contextmanager
def _one_opencv_thread() -> Iterator[None]:
    """Let OpenCV use one thread, as all the rest does: times then do not depend on what else is done."""
    n_threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(n_threads)
