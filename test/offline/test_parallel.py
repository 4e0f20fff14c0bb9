"""Tests of parallel tasks: same results in order, errors as values, nothing lost; lazily, and on a cluster."""

from __future__ import annotations

import bz2
import math
import operator
import os
import subprocess
import sys
import time
from pathlib import Path

import cluster as clusters
import numpy as np
import pytest

from lrtrav_ros.offline import parallel
from lrtrav_ros.offline.parallel import TaskFailure, run_tasks


@pytest.mark.parametrize("jobs", [1, 2, 3, 0])
def test_results_come_in_the_order_of_the_tasks(jobs):
    assert list(run_tasks(math.sqrt, range(20), jobs=jobs)) == [math.sqrt(i) for i in range(20)]


def test_order_does_not_depend_on_how_long_tasks_take():
    seconds = [0.3, 0.0, 0.1, 0.0]
    # eval: what a test module defines can't be imported by other processes
    assert list(run_tasks(eval, [f"__import__('time').sleep({s}) or {s}" for s in seconds], jobs=2)) == seconds


@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_of_tasks_are_values(jobs):
    results = list(run_tasks(math.sqrt, [4, -1, 9], jobs=jobs))
    assert results[0] == 2
    assert isinstance(results[1], TaskFailure)
    assert results[1].message
    assert results[2] == 3
    missing = list(run_tasks(os.stat, ["/none/of/this", "/"], jobs=jobs))
    assert "/none/of/this" in missing[0].message
    assert missing[1].st_ino == Path("/").stat().st_ino


@pytest.mark.parametrize("jobs", [1, 2])
def test_other_errors_of_tasks_are_raised(jobs):
    with pytest.raises(TypeError):
        list(run_tasks(math.sqrt, [4, "four"], jobs=jobs))


@pytest.mark.parametrize("jobs", [1, 2])
def test_error_of_the_tasks_themselves_comes_after_the_results(jobs):
    def tasks():
        yield from (1, 4, 9)
        raise ValueError("the bag ends here")

    results = []
    with pytest.raises(ValueError, match="the bag ends here"):
        results.extend(run_tasks(math.sqrt, tasks(), jobs=jobs))
    assert results == [1, 2, 3]


@pytest.mark.parametrize("jobs", [1, 2])
def test_no_tasks_give_no_results(jobs):
    assert list(run_tasks(math.sqrt, [], jobs=jobs)) == []


@pytest.mark.parametrize("jobs", [1, 2])
def test_tasks_are_taken_as_they_are_needed(jobs):
    taken = []

    def tasks():
        for i in range(10**9):
            taken.append(i)
            yield 0.01

    results = run_tasks(time.sleep, tasks(), jobs=jobs)
    assert [next(results) for _ in range(3)] == [None] * 3
    results.close()
    # However late this process takes the results, which the others may be ahead of.
    assert 3 <= len(taken) <= jobs * parallel._AHEAD


def test_results_that_are_taken_slowly_do_not_pile_up():
    taken = []
    results = run_tasks(math.sqrt, (taken.append(i) or i for i in range(10**6)), jobs=2)
    blob = np.random.default_rng(0).bytes(100_000)
    for i in range(80):
        assert next(results) == math.sqrt(i)
        bz2.compress(blob)  # some work on each result, slower than the tasks
        assert len(taken) <= i + 2 * parallel._AHEAD + 1
    results.close()


def test_arrays_of_tasks_can_be_written_to_and_are_not_shared():
    image = np.zeros((1000, 1700), np.uint8)
    filled = list(run_tasks(operator.methodcaller("fill", 7), [image, image], jobs=2))
    assert filled == [None, None]  # read-only memory would raise ValueError
    assert not image.any()


def test_processes_use_one_thread_each():
    assert list(run_tasks(eval, ["__import__('cv2').getNumThreads()"], jobs=2)) == [1]
    for jobs in (1, 2):
        code = "__import__('numpy') and __import__('threadpoolctl').threadpool_info()"
        pools = next(run_tasks(eval, [code], jobs=jobs))
        assert {pool["num_threads"] for pool in pools} == {1}


def test_killed_process_is_an_error_that_says_so():
    with pytest.raises(RuntimeError, match="a process was killed, perhaps for lack of memory; give fewer jobs"):
        list(run_tasks(os._exit, [1], jobs=2))
    assert list(run_tasks(math.sqrt, [4, 9], jobs=2)) == [2, 3]


def test_processes_end_with_a_parent_that_is_killed():
    code = """
from lrtrav_ros.offline.parallel import run_tasks
for process_id in run_tasks(eval, ["__import__('time').sleep(0.1) or __import__('os').getpid()"] * 1000, jobs=2):
    print(process_id, flush=True)
"""
    children = set()
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        while len(children) < 2:
            children.add(int(parent.stdout.readline()))
        parent.kill()
    clusters.until(lambda: not any(Path(f"/proc/{child}").exists() for child in children))


def test_negative_jobs_are_refused():
    with pytest.raises(ValueError, match="jobs is -1"):
        run_tasks(math.sqrt, [], jobs=-1)


def test_cluster_without_dask_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match=r"install lrtrav_ros\[cluster\]"):
        list(run_tasks(math.sqrt, [1], cluster="tcp://127.0.0.1:1"))


def test_scheduler_that_is_not_there_is_an_error(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(parallel, "_CONNECT_S", 0.3)
    with pytest.raises(OSError, match=r"127\.0\.0\.1:1"):
        list(run_tasks(math.sqrt, [1], cluster="tcp://127.0.0.1:1"))


def test_cluster_gives_the_same_and_loses_nothing_with_a_worker(dask_cluster):
    address = dask_cluster.address
    with dask_cluster.another_worker() as worker:
        assert list(run_tasks(math.sqrt, [4, -1, 9], cluster=address)) == list(run_tasks(math.sqrt, [4, -1, 9]))

        blobs = [np.random.default_rng(i).bytes(500_000) for i in range(16)]
        compressed = run_tasks(bz2.compress, blobs, cluster=address)
        results = [next(compressed)]
        worker.kill()
        results.extend(compressed)
        assert results == [bz2.compress(blob) for blob in blobs]
        assert worker.wait(10) != 0
        assert dask_cluster.worker.poll() is None
