"""The figures of a run as text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from lrtrav_ros.benchmark.figures import (
    STAGES_AFTER_MATCHING,
    Figures,
    Machine,
    NodesRun,
    TimeFigures,
    WorkloadFigures,
    numbers_of_threads,
)
from lrtrav_ros.benchmark.rivals import OPTIONAL, REFERENCE
from lrtrav_ros.benchmark.workload import AFTER_MATCHING, WHOLE_FRAME
from lrtrav_ros.detector import Stage

_STAGES = tuple(stage.value for stage in Stage)
_NAME = 34  # columns of the first field


def table(figures: Figures) -> Iterator[str]:
    """Yield the lines of all tables."""
    yield _machine(figures.machine)
    for workload in figures.workloads:
        yield ""
        yield from _workload(workload)
    missing = [package for name, package in OPTIONAL.items() if name not in figures.machine.versions]
    if figures.workloads:
        yield from (f"{package} is not installed; `pip install {package}` to compare with it" for package in missing)
    if len(figures.workloads) > 1:
        yield from ("", *_growth(figures.workloads))
    if figures.nodes:
        yield from ("", *_nodes(figures.nodes))


def _machine(machine: Machine) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    return f"{machine.processor}, processors: {machine.n_processors}, Python {machine.python}, {versions}"


def _workload(workload: WorkloadFigures) -> Iterator[str]:
    reference = workload.times[0]
    yield f"{_conditions(workload)}, medians of {reference.n_runs} runs"
    yield f"in ms, and as ratios to {REFERENCE} on one thread, {reference.wall_ms:.1f} ms"
    threads = numbers_of_threads(workload)
    yield f"{'':{_NAME}}" + "".join(f"{f'threads: {n}':>18}" for n in threads)
    halves = sorted({times.half_resolution for times in workload.times if times.name == WHOLE_FRAME})
    for name, in_frame, half in _frame_rows(halves):
        found = [_find(workload, name, n_threads=n, half=half, in_frame=in_frame) for n in threads]
        if any(found):
            yield f"{_label(name, half):{_NAME}}" + "".join(map(_time, found))
    rates = [_find(workload, WHOLE_FRAME, n_threads=n, half=halves[0]) for n in threads]
    yield f"{'frames/s':{_NAME}}" + "".join(f"{1e3 / times.wall_ms:10.1f}{'':8}" for times in rates if times)
    if threads != [1]:
        yield "With several threads stages run beside each other: their times add up to more than the whole frame's."
    yield from _alone(workload)
    memory = workload.memory
    yield f"memory: at most {memory.peak_mb:.0f} MB, {memory.start_mb:.0f} MB of it before the first frame"


def _frame_rows(halves: Sequence[bool]) -> Iterator[tuple[str, bool, bool]]:
    """Yield name, whether it is a stage, and whether at half resolution, of all rows that whole frames give."""
    yield from ((name, True, halves[0]) for name in (*_STAGES, STAGES_AFTER_MATCHING))
    yield from ((Stage.MATCHING.value, True, half) for half in halves[1:])
    yield from ((name, False, half) for name in (AFTER_MATCHING, WHOLE_FRAME) for half in halves)


def _alone(workload: WorkloadFigures) -> Iterator[str]:
    """Yield the rows of the contests."""
    yield f"{'alone':{_NAME}}{'threads: 1':>18}"
    for times in workload.times:
        if not times.in_frame and times.name not in (AFTER_MATCHING, WHOLE_FRAME):
            yield f"{_label(times.name, times.half_resolution):{_NAME}}{_time(times)}"


def _growth(workloads: Sequence[WorkloadFigures]) -> Iterator[str]:
    """Yield a row for each workload."""
    threads = numbers_of_threads(workloads[0])
    totals = (AFTER_MATCHING, WHOLE_FRAME)
    stages = "".join(f"{stage:>{len(stage) + 2}}" for stage in _STAGES)
    yield f"{'size':12}{'n':>5}{stages}{totals[0]:>18}{totals[1]:>18}{'StereoSGBM':>12}"
    for workload in sorted(workloads, key=lambda item: (item.width * item.height, item.n_superpixels)):
        half = workload.half_resolution
        of_stages = [_find(workload, stage, n_threads=threads[0], half=half, in_frame=True) for stage in _STAGES]
        of_totals = [[_find(workload, name, n_threads=n, half=half) for n in threads] for name in totals]
        yield (
            f"{f'{workload.width} x {workload.height}':12}{workload.n_superpixels:5}"
            + "".join(f"{_ms(times):>{len(name) + 2}}" for name, times in zip(_STAGES, of_stages, strict=True))
            + "".join(f"{' / '.join(map(_ms, found)):>18}" for found in of_totals)
            + f"{_ms(workload.times[0]):>12}"
        )
    numbers = " / ".join(map(str, threads))
    yield f"in ms, n superpixels; threads: {threads[0]} for stages, {numbers} for the two columns after them"


def _nodes(runs: Sequence[NodesRun]) -> Iterator[str]:
    yield f"running nodes, {runs[0].seconds:g} s each; latency of long_range/mask, CPU in processors, peak of memory"
    yield (
        f"{'size':12}{'threads':>8} {'source':10}{'in Hz':>7}{'out Hz':>8}{'median ms':>11}{'99 % ms':>9}"
        f"{'dropped':>9}{'CPU':>6}{'MB':>6}{'start s':>9}"
    )
    for run in runs:
        found = run.measured
        yield (
            f"{f'{run.width} x {run.height}':12}{run.threads or 'all':>8} {found.source:10}{found.rate_in_hz:7.1f}"
            f"{found.rate_out_hz:8.1f}{_number(found.latency_median_ms):>11}{_number(found.latency_p99_ms):>9}"
            f"{found.dropped_share:9.1%}{found.cpu_share:6.2f}{found.peak_rss_mb:6.0f}{found.start_s:9.1f}"
        )


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"


def _conditions(workload: WorkloadFigures) -> str:
    size = f"{workload.width} x {workload.height}"
    return f"{size}, {workload.n_disparities} disparities, {workload.n_superpixels} superpixels"


def _label(name: str, half: bool) -> str:
    return f"{name}, half resolution" if half else name


def _time(times: TimeFigures | None) -> str:
    return f"{times.wall_ms:10.1f}{times.ratio:8.2f}" if times else f"{'':18}"


def _find(
    workload: WorkloadFigures, name: str, *, n_threads: int = 1, half: bool = False, in_frame: bool = False
) -> TimeFigures | None:
    """Return the figures of what has a name, None where it was not measured."""
    wanted = (name, n_threads, half, in_frame)
    return next((t for t in workload.times if (t.name, t.n_threads, t.half_resolution, t.in_frame) == wanted), None)


def _ms(times: TimeFigures | None) -> str:
    return f"{times.wall_ms:.1f}" if times else "-"
