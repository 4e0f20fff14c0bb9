"""The figures of a run: medians, memory, and the machine that they hold for."""

from __future__ import annotations

import dataclasses
import json
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from joblib import cpu_count

import lrtrav_ros
from lrtrav_ros.benchmark.memory import Memory, measure_memory
from lrtrav_ros.benchmark.rivals import contests, installed, reference
from lrtrav_ros.benchmark.timing import Contender, Runs, take_turns
from lrtrav_ros.benchmark.workload import WHOLE_FRAME, Workload, detections
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Stage, StageTimes
from lrtrav_ros.frame import Frame

if TYPE_CHECKING:
    from lrtrav_ros.nodes.measurement import NodesFigures

STAGES_AFTER_MATCHING = "stages after matching"
"""The name of the sum of their times."""

_LIBRARIES = ("numpy", "scipy", "cv2", "numba")


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeFigures:
    """The time of one thing.

    Attributes
    ----------
    name : str
        Of a stage within a whole frame, the sum of several, or a contender.
    in_frame : bool
        Whether it was timed as a stage of a whole frame, where stages may run beside each other.
    n_threads : int
        Threads that it could use.
    half_resolution : bool
        Whether stereo matching is at half resolution.
    n_runs : int
        Number of runs that the medians are of.
    wall_ms : float
        By the clock, in milliseconds.
    cpu_ms : float or None
        Of all processors together, in milliseconds; None for stages.
    ratio : float
        `wall_ms` divided by that of the reference on one thread in the same run.
    """

    name: str
    in_frame: bool = False
    n_threads: int
    half_resolution: bool
    n_runs: int
    wall_ms: float
    cpu_ms: float | None
    ratio: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkloadFigures:
    """Times and memory for images of one size and one number of superpixels.

    `half_resolution` is that of the settings, of which matching at half resolution is measured in any case; `times`
    begins with the reference's.
    """

    width: int
    height: int
    n_disparities: int
    n_superpixels: int
    half_resolution: bool
    n_frames: int
    memory: Memory
    times: tuple[TimeFigures, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class NodesRun:
    """What was measured of the running nodes, with a number of `threads` that is 0 for all processors."""

    width: int
    height: int
    n_disparities: int
    n_superpixels: int
    threads: int
    seconds: float
    measured: NodesFigures


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """Processor, system, and versions of the libraries by the names that are imported."""

    processor: str
    n_processors: int
    system: str
    python: str
    versions: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """All figures of a run."""

    machine: Machine
    workloads: tuple[WorkloadFigures, ...] = ()
    nodes: tuple[NodesRun, ...] = ()

    def to_json(self) -> bytes:
        """Return the figures as JSON, with fields named as here."""
        text = json.dumps(dataclasses.asdict(self), indent=2)
        return (text.replace(": NaN", ": null") + "\n").encode()  # JSON has no NaN


def measure(workloads: Sequence[Workload], threads: Sequence[int], *, rounds: int) -> tuple[WorkloadFigures, ...]:
    """Measure whole frames and what else there is to compare, of all workloads in turns.

    Parameters
    ----------
    workloads : sequence of Workload
        Frames and settings; all with the same number of frames.
    threads : sequence of int
        Numbers of threads for whole frames.
    rounds : int
        How often each frame is timed.

    Raises
    ------
    ValueError
        If images are too narrow for the reference.
    """
    contenders = [[reference(item), *detections(item, threads), *contests(item)] for item in workloads]
    runs = iter(take_turns([contender for item in contenders for contender in item], rounds=rounds))
    return tuple(
        _figures(workload, list(zip(item, islice(runs, len(item)), strict=True)), max(threads))
        for workload, item in zip(workloads, contenders, strict=True)
    )


def _figures(workload: Workload, timed: Sequence[tuple[Contender, Runs]], n_threads: int) -> WorkloadFigures:
    """Return the figures of a workload, and measure its memory; the reference has to come first."""
    reference_ms = _median(timed[0][1].wall_ms)
    config = workload.config
    largest = dataclasses.replace(workload, config=config.updated({"threads": n_threads}))
    return WorkloadFigures(
        width=workload.width,
        height=workload.height,
        n_disparities=config.stereo.n_disparities,
        n_superpixels=config.superpixels.n_superpixels,
        half_resolution=config.stereo.half_resolution,
        n_frames=len(workload.frames),
        memory=measure_memory(largest),
        times=tuple(row for contender, runs in timed for row in _rows(contender, runs, reference_ms)),
    )


def measure_nodes(frames: Sequence[Frame], config: Config, *, rate_hz: float, seconds: float) -> NodesRun:
    """Measure the nodes, which this starts in a process of their own.

    Parameters
    ----------
    frames : sequence of Frame
        All from one source; they are published again and again.
    config : Config
        The nodes' settings, where they are others than the defaults.
    rate_hz, seconds : float
        How often frames come, and for how long.

    Raises
    ------
    ImportError
        Where there is no ROS.
    RuntimeError
        If the nodes do not start.
    """
    from lrtrav_ros.nodes import measurement

    defaults = Config().values()
    settings = {name: value for name, value in config.values().items() if value != defaults[name]}
    height, width = frames[0].shape
    return NodesRun(
        width=width,
        height=height,
        n_disparities=config.stereo.n_disparities,
        n_superpixels=config.superpixels.n_superpixels,
        threads=config.threads,
        seconds=seconds,
        measured=measurement.measure_nodes(frames, settings, rate_hz=rate_hz, seconds=seconds),
    )


def this_machine() -> Machine:
    """Return what the figures hold for."""
    names = [*_LIBRARIES, *sorted(installed())]
    return Machine(
        processor=_processor(),
        n_processors=cpu_count(),
        system=platform.platform(),
        python=platform.python_version(),
        versions={
            "lrtrav_ros": str(lrtrav_ros.__version__),
            **{name: str(import_module(name).__version__) for name in names},
        },
    )


def numbers_of_threads(workload: WorkloadFigures) -> list[int]:
    """Return the numbers of threads that whole frames were detected with."""
    return sorted({times.n_threads for times in workload.times if times.name == WHOLE_FRAME})


def _rows(contender: Contender, runs: Runs, reference_ms: float) -> Iterator[TimeFigures]:
    """Yield the figures of a contender, and those of its stages where it detects in whole frames."""
    row = TimeFigures(
        name=contender.name,
        n_threads=contender.n_threads,
        half_resolution=contender.half_resolution,
        n_runs=len(runs.wall_ms),
        wall_ms=_median(runs.wall_ms),
        cpu_ms=_median(runs.cpu_ms),
        ratio=round(_median(runs.wall_ms) / reference_ms, 4),
    )
    yield row
    if contender.name == WHOLE_FRAME:
        for name, times_ms in _stages(runs.stages).items():
            wall_ms = _median(times_ms)
            ratio = round(wall_ms / reference_ms, 4)
            yield dataclasses.replace(row, name=name, in_frame=True, wall_ms=wall_ms, cpu_ms=None, ratio=ratio)


def _stages(times: Sequence[StageTimes]) -> dict[str, list[float]]:
    """Return the times of each stage, and of all but the first together."""
    table = np.array([dataclasses.astuple(row) for row in times])
    names = [stage.value for stage in Stage]
    return {
        **dict(zip(names, table.T.tolist(), strict=True)),
        STAGES_AFTER_MATCHING: table[:, 1:].sum(axis=1).tolist(),
    }


def _median(values: Sequence[float]) -> float:
    return round(float(np.median(values)), 3)


def _processor() -> str:
    """Return the processor's name, or its architecture where the system does not tell."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
