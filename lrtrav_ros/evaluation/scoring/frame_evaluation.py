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
from lrtrav_ros.evaluation.scoring.methods import Method, MethodResult
from lrtrav_ros.evaluation.scoring.score_records import FrameRecord, FrameTimes, MethodRecord, MethodTimes
from lrtrav_ros.evaluation.scoring.scores import count_bands, mean_scores, score, spread_of_scores
from lrtrav_ros.evaluation.scoring.shared_stages import FrameStages
from lrtrav_ros.evaluation.truth.labelled_sets import FrameSource, LabelledFrame
from lrtrav_ros.evaluation.truth.labels import apply_unknown_rule
from lrtrav_ros.io.encodings import encode_file
from lrtrav_ros.method.ground import NO_GROUND


@dataclass(frozen=True, slots=True)
class MethodRun:
    """A method with its configurations, one for each seed."""

    method: Method
    configs: tuple[Config, ...]


@dataclass(frozen=True, slots=True)
class Setup:
    """What is done with every frame.

    Attributes
    ----------
    geometry
        The configuration by which distances on the ground are measured, the same for all methods: the preset
        ``robust`` on all of the disparity.
    save_masks
        Whether masks are kept.
    """

    runs: tuple[MethodRun, ...]
    geometry: Config
    save_masks: bool = False


def make_setup(
    methods: Sequence[Method], values: Mapping[str, object], *, n_seeds: int, save_masks: bool = False
) -> Setup:
    """Return the setup for methods whose presets are changed by `values`; a frame is computed on one thread.

    The seeds are ``clustering.seed`` and those that follow it.

    Raises
    ------
    ValueError
        If a name in `values` is unknown or a value does not fit, or there are no seeds.
    """
    if n_seeds < 1:
        raise ValueError(f"the number of seeds is {n_seeds}; give at least 1")
    runs = []
    for method in methods:
        config = dataclasses.replace(method.configuration(values), threads=1)
        runs.append(MethodRun(method, tuple(_seeded(config, n_seeds if method.is_random else 1))))
    geometry = Config.preset("robust").updated({**values, "source.max_depth_m": 0.0, "threads": 1})
    return Setup(tuple(runs), geometry, save_masks)


def _seeded(config: Config, n_seeds: int) -> Iterator[Config]:
    """Yield the configuration with its seed and those that follow."""
    first = config.clustering.seed
    for seed in range(first, first + n_seeds):
        yield dataclasses.replace(config, clustering=dataclasses.replace(config.clustering, seed=seed))


@dataclass(frozen=True, slots=True)
class FrameTask:
    """A frame to evaluate; `inputs` goes into its record."""

    set: str
    source: FrameSource
    unknown_rule: str
    inputs: str
    setup: Setup


@dataclass(frozen=True, slots=True)
class MaskFile:
    """A method's mask as PNG; with several seeds, that of the first."""

    method: str
    data: bytes


@dataclass(frozen=True, slots=True)
class FrameOutcome:
    """What is kept of a frame."""

    record: FrameRecord
    times: FrameTimes
    masks: tuple[MaskFile, ...] = ()


def evaluate_frame(task: FrameTask) -> FrameOutcome:
    """Read a frame and run all methods on it; a frame that cannot be used gives a record that says why."""
    name = task.source.name
    try:
        with _one_opencv_thread():
            return _evaluated(task, task.source.read())
    except (OSError, ValueError, cv2.error) as err:
        record = FrameRecord(task.set, name, (), error=" ".join(str(err).split()), inputs=task.inputs)
        return FrameOutcome(record, FrameTimes(task.set, name, ()))


def find_all(stages: FrameStages, setup: Setup) -> Iterator[tuple[MethodRun, list[MethodResult]]]:
    """Yield what each method finds in a frame, a result for each of its configurations."""
    for run in setup.runs:
        yield run, [run.method.find(stages, config) for config in run.configs]


def _evaluated(task: FrameTask, labelled: LabelledFrame) -> FrameOutcome:
    stages = FrameStages(labelled.frame)
    line = stages.short_range(task.setup.geometry)[0].line
    truth = apply_unknown_rule(labelled.truth, task.unknown_rule)
    distances = None if line is None else GroundDistances(line, labelled.frame.camera, truth.shape)
    records, times, masks = [], [], []
    for run, results in find_all(stages, task.setup):
        records.append(_record(run.method.name, results, truth, distances))
        times.append(MethodTimes(run.method.name, results[0].times))
        if task.setup.save_masks:
            masks.append(MaskFile(run.method.name, encode_file("mask.png", results[0].mask)))
    name = task.source.name
    record = FrameRecord(task.set, name, tuple(records), inputs=task.inputs)
    return FrameOutcome(record, FrameTimes(task.set, name, tuple(times)), tuple(masks))


def _record(
    method: str, results: Sequence[MethodResult], truth: NDArray[np.uint8], distances: GroundDistances | None
) -> MethodRecord:
    """Return the scores of a method's results, which differ by seed."""
    scores = [score(result.mask, truth) for result in results]
    record = MethodRecord(
        method,
        mean_scores(scores),
        spread_of_scores(scores) if len(scores) > 1 else None,
        problem=NO_GROUND if results[0].short_range.line is None else "",
        seeds=tuple(scores),
    )
    if distances is None:
        return record
    bands = [count_bands(result.mask, truth, distances.distance_m) for result in results]
    reach = float(np.mean([distances.reach_m(result.mask, truth) for result in results]))
    seen = distances.reach_m(results[0].short_range.mask, truth)
    summed = tuple(functools.reduce(operator.add, counts) for counts in zip(*bands, strict=True))
    return dataclasses.replace(record, bands=summed, reach_m=reach, gain_m=reach - seen)


@contextmanager
def _one_opencv_thread() -> Iterator[None]:
    """Let OpenCV use one thread, as all the rest does: times then do not depend on what else is done."""
    n_threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(n_threads)
