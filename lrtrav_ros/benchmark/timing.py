"""Times of calls that take turns, so that a busy machine slows all of them alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import cv2
from threadpoolctl import ThreadpoolController
from tqdm import tqdm

from lrtrav_ros.detector import Detection, StageTimes

_WARM_UP = 2  # frames, in which kernels are compiled and memory is fetched
_ENOUGH_MS = 5000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Contender:
    """Something that is timed.

    Parameters
    ----------
    name : str
        What is timed.
    calls : sequence of callable
        One for each frame.
    n_threads : int
        The most threads that OpenCV and BLAS may use in a call; that of the package are the call's own matter.
    half_resolution : bool
        Whether stereo matching is at half resolution.
    """

    name: str
    calls: Sequence[Callable[[], object]]
    n_threads: int = 1
    half_resolution: bool = False


@dataclass(frozen=True, slots=True)
class Runs:
    """Times of all runs of a contender in milliseconds.

    Attributes
    ----------
    wall_ms : list of float
        By the clock.
    cpu_ms : list of float
        Of all processors together.
    stages : list of StageTimes
        Times of the stages, where the call detects.
    """

    wall_ms: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)
    stages: list[StageTimes] = field(default_factory=list)


def take_turns(contenders: Sequence[Contender], *, rounds: int) -> list[Runs]:
    """Time all contenders on each frame in turns, `rounds` times; who is slow is spared the last of them.

    Parameters
    ----------
    contenders : sequence of Contender
        All with the same number of calls.
    rounds : int
        How often each call is timed.

    Returns
    -------
    list of Runs
        Of each contender, with a run for each round and frame until it has had 5 seconds in all.
    """
    libraries = ThreadpoolController()
    for contender in contenders:
        with _threads(libraries, contender.n_threads):
            for call in contender.calls[:_WARM_UP]:
                call()
    runs = [Runs() for _ in contenders]
    for _ in tqdm(range(rounds), unit="round", disable=None):
        for frame in range(len(contenders[0].calls)):
            for contender, found in zip(contenders, runs, strict=True):
                if sum(found.wall_ms) < _ENOUGH_MS:
                    with _threads(libraries, contender.n_threads):
                        _time(contender.calls[frame], found)
    return runs


def _time(call: Callable[[], object], runs: Runs) -> None:
    """Add the times of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = call()
    runs.wall_ms.append((time.perf_counter() - wall) * 1e3)
    runs.cpu_ms.append((time.process_time() - cpu) * 1e3)
    if isinstance(result, Detection):
        runs.stages.append(result.times)


@contextmanager
def _threads(libraries: ThreadpoolController, n_threads: int) -> Iterator[None]:
    """Hold OpenCV and all that threadpoolctl knows to a number of threads."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(n_threads)
    try:
        with libraries.limit(limits=n_threads):
            yield
    finally:
        cv2.setNumThreads(before)
