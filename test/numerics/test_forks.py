"""Child processes that are forked while other threads hold what the child does not get back from them."""

from __future__ import annotations

import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest

from lrtrav_ros.config import StereoConfig
from lrtrav_ros.detector import LongRange
from lrtrav_ros.method.matching.opencv import OpenCVMatcher
from lrtrav_ros.numerics.blas import one_blas_thread
from lrtrav_ros.numerics.thread_team import ThreadTeam

DEADLINE_S = 20


def ends_well(function: Callable[[], object]) -> bool:
    """Return whether a forked child finds that a function returns what is true, in time."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # from Python 3.12 on, of forks beside threads
        process = os.fork()
    if process == 0:
        status = 1
        try:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(DEADLINE_S)
            status = 0 if function() else 2
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0


class Gate:
    """Where a thread stops until it is let through."""

    def __init__(self) -> None:
        self.reached, self.opened = threading.Event(), threading.Event()

    def wait(self) -> bool:
        self.reached.set()
        return self.opened.wait(DEADLINE_S)


@contextmanager
def another_thread(function: Callable[[Gate], object]) -> Iterator[Future[object]]:
    """Have another thread at the gate meanwhile."""
    gate = Gate()
    with ThreadPoolExecutor(1) as executor:
        future = executor.submit(function, gate)
        assert gate.reached.wait(DEADLINE_S)
        try:
            yield future
        finally:
            gate.opened.set()
    future.result()


def test_blas_is_free_in_a_child_whoever_held_it() -> None:
    def hold(gate: Gate) -> bool:
        with one_blas_thread():
            return gate.wait()

    @one_blas_thread()
    def use() -> bool:
        return True

    with another_thread(hold):
        assert ends_well(use)


def test_blas_is_free_in_a_child_of_the_thread_that_holds_it() -> None:
    @one_blas_thread()
    def use() -> bool:
        return True

    with one_blas_thread():
        assert ends_well(lambda: ThreadPoolExecutor(1).submit(use).result(DEADLINE_S))


def has_threads(team: ThreadTeam) -> bool:
    """Return whether all of a team take part."""
    barrier = threading.Barrier(team.n_threads)
    return team.map(lambda item: barrier.wait(DEADLINE_S) >= 0 and item, range(1, 9)[: team.n_threads]) == [
        *range(1, 1 + team.n_threads)
    ]


@pytest.mark.parametrize("n_threads", [2, 3])
def test_a_team_has_threads_of_its_own_in_a_child(n_threads: int) -> None:
    team = ThreadTeam(n_threads)
    for _ in range(2):
        assert has_threads(team)
        assert ends_well(lambda: has_threads(team))


def test_a_team_works_in_a_child_whoever_was_at_its_board() -> None:
    team = ThreadTeam(2)

    def hold(gate: Gate) -> bool:
        with team._board._changed:
            return gate.wait()

    with another_thread(hold):
        assert ends_well(lambda: has_threads(team))
    assert has_threads(team)


def test_what_was_started_before_the_fork_is_lost_in_the_child() -> None:
    team, gate, made = ThreadTeam(2), Gate(), threading.Event()

    def is_lost() -> bool:
        for started in (begun, waiting):
            started.withdraw()
            with pytest.raises(RuntimeError, match="started before this process was forked; start it anew"):
                started.result()
        return done.result() == 3 and has_threads(team) and not made.is_set()

    done = team.start(sum, [1, 2])
    done.result()
    begun = team.start(gate.wait)
    assert gate.reached.wait(DEADLINE_S)
    waiting = team.start(made.set)
    assert ends_well(is_lost)
    gate.opened.set()
    assert begun.result()
    waiting.result()
    assert made.is_set()


def test_map_does_not_wait_in_a_child_that_one_of_its_calls_becomes() -> None:
    team, barrier, gate = ThreadTeam(2), threading.Barrier(2), Gate()
    caller, parent = threading.get_ident(), os.getpid()

    def fork(_: int) -> bool:
        barrier.wait(DEADLINE_S)
        if threading.get_ident() != caller:
            return gate.wait()
        assert gate.reached.wait(DEADLINE_S)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            children.append(os.fork())
        if os.getpid() == parent:
            gate.opened.set()
        else:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(DEADLINE_S)
        return True

    children: list[int] = []
    status = 1
    try:
        found = team.map(fork, range(2))
    except RuntimeError:
        status = 0
    finally:
        if os.getpid() != parent:
            os._exit(status)
    assert found == [True, True]
    assert os.waitstatus_to_exitcode(os.waitpid(children[0], 0)[1]) == 0


def test_a_matcher_of_opencv_is_free_in_a_child_whoever_used_it() -> None:
    matcher = OpenCVMatcher(StereoConfig(matcher="bm", n_disparities=16))
    left = np.random.default_rng(0).integers(0, 256, (40, 60), np.uint8)
    right = np.roll(left, -4, axis=1)
    expected = matcher.compute(left, right)

    class Slow:
        def __init__(self, gate: Gate) -> None:
            self.gate = gate

        def compute(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
            self.gate.wait()
            return np.zeros(left.shape, np.int16)

    def use(gate: Gate) -> object:
        matcher._matcher = Slow(gate)
        return matcher.compute(left, right)

    with another_thread(use):
        assert ends_well(lambda: np.array_equal(matcher.compute(left, right), expected))


def test_clusters_are_found_in_a_child_whoever_was_at_it() -> None:
    labels = np.zeros((4, 6), np.int32)

    def found(find: Callable[[], object]) -> LongRange:
        return LongRange(np.zeros((4, 6), np.uint8), labels, lambda: find() and np.array([7], np.int32))

    with another_thread(lambda gate: found(gate.wait).superpixel_clusters):
        assert ends_well(lambda: (found(lambda: True).clusters == 7).all())
