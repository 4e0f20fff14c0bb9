"""Contenders take turns, each with its own number of threads, and all is as before when they are done."""

from __future__ import annotations

import time

import cv2
import pytest
from threadpoolctl import threadpool_info

from lrtrav_ros.benchmark import timing
from lrtrav_ros.benchmark.timing import Contender, take_turns


def contender(name, log, *, n_frames=3, **options):
    return Contender(
        name=name, calls=[lambda frame=frame: log.append((name, frame)) for frame in range(n_frames)], **options
    )


def test_contenders_take_turns_frame_by_frame():
    log = []
    runs = take_turns([contender("a", log), contender("b", log)], rounds=2)
    warm_up = [(name, frame) for name in "ab" for frame in range(2)]
    assert log == warm_up + [(name, frame) for frame in range(3) for name in "ab"] * 2
    assert [len(item.wall_ms) for item in runs] == [len(item.cpu_ms) for item in runs] == [6, 6]
    assert min(min(item.wall_ms) for item in runs) > 0


def test_each_call_has_its_number_of_threads():
    before, found = cv2.getNumThreads(), []

    def look():
        libraries = [item["num_threads"] for item in threadpool_info()]
        found.append((cv2.getNumThreads(), max(libraries)))

    numbers = [1, 2, 1]
    take_turns([Contender(name=str(n), calls=[look], n_threads=n) for n in numbers], rounds=1)
    assert [opencv for opencv, _ in found] == numbers * 2
    assert all(libraries <= opencv for opencv, libraries in found)
    assert cv2.getNumThreads() == before


def test_threads_are_given_back_after_an_error():
    before = cv2.getNumThreads()

    def fail():
        raise ValueError("no frame")

    with pytest.raises(ValueError, match="no frame"):
        take_turns([Contender(name="a", calls=[fail], n_threads=before + 1)], rounds=1)
    assert cv2.getNumThreads() == before


def test_both_clocks_are_read():
    def work():
        end = time.process_time() + 0.01
        while time.process_time() < end:
            pass

    (runs,) = take_turns([Contender(name="a", calls=[work])], rounds=2)
    assert min(runs.wall_ms) > 0
    assert min(runs.cpu_ms) >= 10
    assert runs.stages == []


def test_who_is_slow_is_spared_the_last_rounds(monkeypatch):
    monkeypatch.setattr(timing, "_ENOUGH_MS", 0.0)
    log = []
    (runs,) = take_turns([contender("a", log)], rounds=5)
    assert len(log) == 2
    assert runs.wall_ms == []
