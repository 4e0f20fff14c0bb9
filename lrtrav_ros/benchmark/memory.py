"""Memory of a process that does nothing but detect."""

from __future__ import annotations

import multiprocessing
import resource
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from lrtrav_ros.benchmark.workload import Workload
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.frame import Frame


@dataclass(frozen=True, slots=True)
class Memory:
    """Memory in megabytes.

    Attributes
    ----------
    start_mb : float
        Once the package is loaded.
    peak_mb : float
        The most that was held while frames were detected.
    """

    start_mb: float
    peak_mb: float


def measure_memory(workload: Workload) -> Memory:
    """Return the memory of a new process that detects in the frames of a workload."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_detect, workload.frames, workload.config).result()


def _detect(frames: tuple[Frame, ...], config: Config) -> Memory:
    """Return this process's memory."""
    start_mb = _peak_mb()
    detector = Detector(config)
    for frame in frames:
        detector.detect_frame(frame)
    return Memory(start_mb, _peak_mb())


def _peak_mb() -> float:
    """Return the most that this process held up to now."""
    status = Path("/proc/self/status")
    if status.exists():  # the other figure counts what the process that started this one held
        line = next(line for line in status.read_text(encoding="ascii").splitlines() if line.startswith("VmHWM:"))
        return round(int(line.split()[1]) / 1024, 1)
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)
