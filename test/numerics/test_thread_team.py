"""Threads that share work: all of it is done once and in order, whoever does it, and errors reach who asked."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable

import pytest

from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

TEAMS = (1, 2, 3, 5)
DEADLINE_S = 60.0


def wait_until(condition: Callable[[], bool]) -> bool:
    """Whether a condition holds before the deadline."""
    end = time.monotonic() + DEADLINE_S
    while not condition() and time.monotonic() < end:
        threading.Event().wait(0.001)
    return condition()


def team_threads() -> set[threading.Thread]:
    """Return the threads of teams that run."""
    return {thread for thread in threading.enumerate() if thread.name == "team"}


def meet(barrier: threading.Barrier) -> int:
    """Wait until as many threads as the barrier wants are here at once; return this one's number."""
    barrier.wait(DEADLINE_S)
    return threading.get_ident()


@pytest.mark.parametrize("n_threads", TEAMS)
@pytest.mark.parametrize("n_items", [0, 1, 2, 7, 100])
def test_map_returns_results_in_order(n_threads: int, n_items: int) -> None:
    seen: list[int] = []

    def square(item: int) -> int:
        seen.append(item)
        return item * item

    assert ThreadTeam(n_threads).map(square, iter(range(n_items))) == [item * item for item in range(n_items)]
    assert sorted(seen) == list(range(n_items))


@pytest.mark.parametrize("n_threads", [2, 3, 5])
def test_as_many_threads_as_the_team_has_work_at_once(n_threads: int) -> None:
    barrier = threading.Barrier(n_threads)
    threads = ThreadTeam(n_threads).map(lambda _: meet(barrier), range(n_threads))
    assert len(set(threads)) == n_threads
    assert threading.get_ident() in threads


def test_a_team_of_one_works_in_the_thread_that_calls_and_starts_none() -> None:
    before = set(threading.enumerate())
    for team in (ALONE, ThreadTeam(1)):
        assert team.n_threads == 1
        assert team.map(lambda _: threading.get_ident(), range(4)) == [threading.get_ident()] * 4
        rows: list[tuple[int, int, int]] = []
        team.for_bands(lambda first, last, rows=rows: rows.append((first, last, threading.get_ident())), 9)
        assert rows == [(0, 9, threading.get_ident())]
        started = team.start(threading.get_ident)
        assert started.result() == threading.get_ident()
    assert set(threading.enumerate()) == before


@pytest.mark.parametrize("n_threads", TEAMS)
def test_no_thread_is_started_before_there_is_work_to_share(n_threads: int) -> None:
    before = set(threading.enumerate())
    team = ThreadTeam(n_threads)
    assert team.map(str, [1]) == ["1"]
    team.for_bands(lambda first, last: None, 1)
    assert set(threading.enumerate()) == before


@pytest.mark.parametrize("n_threads", [2, 3])
def test_threads_end_when_the_team_is_gone(n_threads: int) -> None:
    before = team_threads()
    team = ThreadTeam(n_threads)
    barrier = threading.Barrier(n_threads)
    team.map(lambda _: meet(barrier), range(n_threads))
    threads = team_threads() - before
    assert len(threads) == n_threads - 1
    assert all(thread.daemon for thread in threads)
    del team
    gc.collect()
    assert wait_until(lambda: not any(thread.is_alive() for thread in threads))


@pytest.mark.parametrize("n_threads", TEAMS)
@pytest.mark.parametrize("n_rows", [0, 1, 2, 13, 480])
@pytest.mark.parametrize("least_rows", [1, 5, 1000])
def test_bands_cover_each_row_once(n_threads: int, n_rows: int, least_rows: int) -> None:
    bands: list[tuple[int, int]] = []
    ThreadTeam(n_threads).for_bands(lambda first, last: bands.append((first, last)), n_rows, least_rows=least_rows)
    rows = [row for first, last in sorted(bands) for row in range(first, last)]
    assert rows == list(range(n_rows))
    assert all(last > first for first, last in bands)
    if n_threads == 1 or n_rows < 2 * least_rows:
        assert len(bands) == min(n_rows, 1)
    else:
        assert len(bands) > 1
        assert min(last - first for first, last in bands) >= least_rows


@pytest.mark.parametrize("n_threads", TEAMS)
@pytest.mark.parametrize("wrong", [0, 3, 6])
def test_map_raises_what_a_call_raises(n_threads: int, wrong: int) -> None:
    def refuse(item: int) -> int:
        if item == wrong:
            raise ValueError(f"item is {item}")
        return item

    with pytest.raises(ValueError, match=f"item is {wrong}"):
        ThreadTeam(n_threads).map(refuse, range(7))


@pytest.mark.parametrize("here", [False, True])
def test_map_raises_from_whichever_thread(here: bool) -> None:
    barrier, caller = threading.Barrier(2), threading.get_ident()

    def refuse(item: int) -> None:
        meet(barrier)
        if (threading.get_ident() == caller) == here:
            raise KeyError(item)

    with pytest.raises(KeyError):
        ThreadTeam(2).map(refuse, range(2))


def test_map_waits_for_calls_that_run_before_it_raises() -> None:
    barrier, caller = threading.Barrier(2), threading.get_ident()
    go, finished = threading.Event(), threading.Event()

    def work(_: int) -> None:
        meet(barrier)
        if threading.get_ident() == caller:
            go.set()
            raise ValueError("here")
        assert go.wait(DEADLINE_S)
        for _ in range(1000):
            sum(range(100))
        finished.set()

    with pytest.raises(ValueError, match="here"):
        ThreadTeam(2).map(work, range(2))
    assert finished.is_set()


@pytest.mark.parametrize("n_threads", TEAMS)
def test_a_team_works_on_after_an_error(n_threads: int) -> None:
    team = ThreadTeam(n_threads)
    for _ in range(20):
        with pytest.raises(ZeroDivisionError):
            team.map(lambda item: 1 // item, range(8))
        assert team.map(abs, range(-8, 0)) == list(range(8, 0, -1))


@pytest.mark.parametrize("n_threads", TEAMS)
def test_calls_may_be_nested(n_threads: int) -> None:
    team = ThreadTeam(n_threads)

    def row(v: int) -> list[int]:
        return team.map(lambda u: team.start(lambda: 10 * v + u).result(), range(5))

    for _ in range(20):
        assert team.map(row, range(6)) == [[10 * v + u for u in range(5)] for v in range(6)]


@pytest.mark.parametrize("n_threads", TEAMS)
def test_several_threads_may_share_a_team(n_threads: int) -> None:
    team = ThreadTeam(n_threads)
    found: dict[int, list[list[int]]] = {number: [] for number in range(4)}

    def use(number: int) -> None:
        for _ in range(20):
            with team.start(sum, [number]) as other:
                found[number].append([*team.map(lambda item: item * number, range(9)), other.result()])

    threads = [threading.Thread(target=use, args=(number,), daemon=True) for number in found]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(DEADLINE_S)
    assert found == {number: [[*(item * number for item in range(9)), number]] * 20 for number in found}


def test_a_started_call_runs_in_another_thread_meanwhile() -> None:
    team, barrier = ThreadTeam(2), threading.Barrier(2)
    started = team.start(meet, barrier)
    assert meet(barrier) == threading.get_ident()
    assert started.result() != threading.get_ident()
    assert started.result() == started.result()


def test_arguments_are_handed_on() -> None:
    for n_threads in TEAMS:
        assert ThreadTeam(n_threads).start(sorted, [2, 3, 1], reverse=True).result() == [3, 2, 1]


def test_result_makes_the_call_here_where_all_threads_are_busy() -> None:
    team, begun, end = ThreadTeam(2), threading.Event(), threading.Event()

    def occupy() -> bool:
        begun.set()
        return end.wait(DEADLINE_S)

    busy = team.start(occupy)
    assert begun.wait(DEADLINE_S)
    assert team.start(threading.get_ident).result() == threading.get_ident()
    end.set()
    assert busy.result()


def test_who_waits_for_a_result_lends_a_hand() -> None:
    team, begun, others_done = ThreadTeam(2), threading.Event(), threading.Event()

    def wait_for_the_other() -> bool:
        begun.set()
        return others_done.wait(DEADLINE_S)

    first = team.start(wait_for_the_other)
    assert begun.wait(DEADLINE_S)
    team.start(others_done.set)  # there is no thread for it but the one that asks for the first
    assert first.result()


@pytest.mark.parametrize("n_threads", TEAMS)
def test_result_raises_what_the_call_raises_each_time(n_threads: int) -> None:
    started = ThreadTeam(n_threads).start(int, "one")
    for _ in range(2):
        with pytest.raises(ValueError, match="invalid literal"):
            started.result()


def test_a_call_that_is_withdrawn_in_time_is_never_made() -> None:
    team, made = ThreadTeam(1), threading.Event()
    started = team.start(made.set)
    started.withdraw()
    assert not started.is_done
    assert not made.is_set()
    assert started.error is None


def test_withdraw_waits_for_a_call_that_has_begun() -> None:
    team, begun, withdrawing = ThreadTeam(2), threading.Event(), threading.Event()

    def work() -> int:
        begun.set()
        assert withdrawing.wait(DEADLINE_S)
        return sum(range(100_000))

    started = team.start(work)
    assert begun.wait(DEADLINE_S)
    withdrawing.set()
    started.withdraw()
    assert started.is_done
    assert started.result() == 4_999_950_000


@pytest.mark.parametrize("n_threads", TEAMS)
def test_a_with_block_leaves_no_call_behind(n_threads: int) -> None:
    team, calls = ThreadTeam(n_threads), []
    for _ in range(20):
        with pytest.raises(RuntimeError, match="in between"), team.start(calls.append, 1) as started:
            raise RuntimeError("in between")
        n_made = len(calls)
        assert started.is_done in (False, True)
        team.map(str, range(4))
        assert len(calls) == n_made
        calls.clear()


def test_an_error_that_nobody_asks_for_hurts_nobody() -> None:
    team = ThreadTeam(2)
    barrier = threading.Barrier(2)

    def fail() -> None:
        meet(barrier)
        raise ValueError("unheard")

    with team.start(fail) as started:
        meet(barrier)
    assert str(started.error) == "unheard"
    assert team.map(str, range(3)) == ["0", "1", "2"]


@pytest.mark.parametrize("n_threads", [0, -1])
def test_a_team_without_threads_is_refused(n_threads: int) -> None:
    with pytest.raises(ValueError, match=f"n_threads is {n_threads}; give 1 to "):
        ThreadTeam(n_threads)
