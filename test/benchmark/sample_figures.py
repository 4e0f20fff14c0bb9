"""Figures that nobody measured, for tables and charts."""

from __future__ import annotations

from lrtrav_ros.benchmark.figures import STAGES_AFTER_MATCHING, Figures, Machine, TimeFigures, WorkloadFigures
from lrtrav_ros.benchmark.memory import Memory
from lrtrav_ros.benchmark.rivals import REFERENCE
from lrtrav_ros.benchmark.workload import AFTER_MATCHING, WHOLE_FRAME
from lrtrav_ros.detector import Stage

MACHINE = Machine(
    processor="Abacus", n_processors=2, system="Linux", python="3.11.7", versions={"numpy": "2.0", "sklearn": "1.5"}
)


def row(name, wall_ms, *, reference_ms, n_threads=1, half=False, in_frame=False):
    return TimeFigures(
        name=name,
        in_frame=in_frame,
        n_threads=n_threads,
        half_resolution=half,
        n_runs=6,
        wall_ms=wall_ms,
        cpu_ms=None if in_frame else wall_ms,
        ratio=wall_ms / reference_ms,
    )


def workload(width=640, height=480, n_superpixels=500, *, threads=(1, 2)):
    """Return figures in proportion to the pixels: StereoSGBM takes 40 ms at 640 x 480, a stage 1, 2, 3 ... ms."""
    share = width * height / (640 * 480)
    times = [row(REFERENCE, 40 * share, reference_ms=40 * share)]
    for n in threads:
        for half in (False, True):
            given = {"reference_ms": 40 * share, "n_threads": n, "half": half}
            times.append(row(WHOLE_FRAME, (24 - 4 * half) / n * share, **given))
            times += [row(s.value, (i + 1) * share, in_frame=True, **given) for i, s in enumerate(Stage)]
            times.append(row(STAGES_AFTER_MATCHING, 20 * share, in_frame=True, **given))
            times.append(row(AFTER_MATCHING, 18 / n * share, **given))
    alone = {"matching, elas": 10, "OpenCV StereoBM": 8, "superpixels": 4, "clustering": 2}
    times += [row(name, value * share, reference_ms=40 * share) for name, value in alone.items()]
    return WorkloadFigures(
        width=width,
        height=height,
        n_disparities=64,
        n_superpixels=n_superpixels,
        half_resolution=False,
        n_frames=3,
        memory=Memory(100.0, 150.0),
        times=tuple(times),
    )


def figures(*workloads):
    return Figures(machine=MACHINE, workloads=workloads)
