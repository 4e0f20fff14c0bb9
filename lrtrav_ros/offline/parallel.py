"""Tasks in processes of this machine or on a Dask cluster; both through joblib."""

from __future__ import annotations

import os
import pickle
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import Any, Generic, TypeVar

import cv2
from joblib import Parallel, cpu_count, delayed, parallel_config
from threadpoolctl import threadpool_limits

_Task = TypeVar("_Task")
_Result = TypeVar("_Result")

_CONNECT_S = 10.0
_WATCH_S = 1.0
_AHEAD = 16  # tasks for each process whose results may wait to be taken: those of an output bag have 10 MB each


@dataclass(frozen=True, slots=True)
class TaskFailure:
    """Stands in place of the result of a task that raised ValueError or OSError; `message` is what it said."""

    message: str


def run_tasks(
    function: Callable[[_Task], _Result], tasks: Iterable[_Task], *, jobs: int = 1, cluster: str | None = None
) -> Iterator[_Result | TaskFailure]:
    """Call `function` with each task and yield the results, in the order of the tasks.

    The results do not depend on `jobs` and `cluster`. Tasks are taken from `tasks` as they are needed, one at a time
    but perhaps in another thread. Only a few are under way at any time, and not many results wait until they are asked
    for. Each task runs on one thread of BLAS and OpenMP, and where several run at a time, of OpenCV.

    Parameters
    ----------
    function : callable
        A function of a module, so that other processes can import it.
    tasks : iterable
        Picklable tasks; an exception raised by the iterable is raised after the results of the tasks before it.
    jobs : int
        Number of processes; 1 for this one, 0 for as many as there are processors.
    cluster : str, optional
        Address of a Dask scheduler, such as ``tcp://host:8786``, whose workers are used in place of own processes. A
        task whose worker dies is given to another one.

    Raises
    ------
    ValueError
        If `jobs` is negative, or Dask is not installed.
    OSError
        If the scheduler cannot be reached, or has no worker.
    RuntimeError
        If a process was killed, or on a cluster several were at the same task.
    """
    if jobs < 0:
        raise ValueError(f"jobs is {jobs}; give a number of processes, or 0 for as many as there are processors")
    if cluster is not None:
        return _on_cluster(function, tasks, cluster)
    jobs = jobs or cpu_count()
    return _in_processes(function, tasks, jobs) if jobs > 1 else _here(function, tasks)


def _here(function: Callable[[_Task], _Result], tasks: Iterable[_Task]) -> Iterator[_Result | TaskFailure]:
    for task in tasks:
        with threadpool_limits(1):
            outcome = _outcome(function, task)
        yield outcome


def _in_processes(
    function: Callable[[_Task], _Result], tasks: Iterable[_Task], jobs: int
) -> Iterator[_Result | TaskFailure]:
    with parallel_config(backend="loky", inner_max_num_threads=1):
        parallel = _parallel(jobs)
    try:
        yield from _results(parallel, function, tasks, n_workers=lambda: jobs, parent=os.getpid())
    except BrokenExecutor as err:
        raise RuntimeError("a process was killed, perhaps for lack of memory; give fewer jobs") from err


def _on_cluster(
    function: Callable[[_Task], _Result], tasks: Iterable[_Task], address: str
) -> Iterator[_Result | TaskFailure]:
    try:
        from distributed import Client, KilledWorker
    except ImportError as err:
        raise ValueError("a cluster needs Dask: install lrtrav_ros[cluster]") from err
    with Client(address, timeout=_CONNECT_S, set_as_default=False) as client:
        with parallel_config(backend="dask", client=client, wait_for_workers_timeout=_CONNECT_S):
            parallel = _parallel(-1)
        try:
            yield from _results(parallel, function, tasks, n_workers=lambda: sum(client.ncores().values()))
        except KilledWorker as err:
            raise RuntimeError(f"several workers of {address} died at the same task; look at their logs") from err


def _parallel(jobs: int) -> Parallel:
    """Return joblib's executor for tasks that take long: one at a time to each worker, and arrays never mapped."""
    return Parallel(jobs, return_as="generator", batch_size=1, pre_dispatch="2 * n_jobs", max_nbytes=None)


def _results(
    parallel: Parallel,
    function: Callable[[_Task], _Result],
    tasks: Iterable[_Task],
    *,
    n_workers: Callable[[], int],
    parent: int | None = None,
) -> Iterator[_Result | TaskFailure]:
    """Yield the results; processes that are children of `parent` end with it.

    joblib goes on with tasks however many results wait, so it is given only so many at a time.
    """
    rest = iter(tasks)
    while True:
        most = _AHEAD * max(n_workers(), 1)
        given = _Given(islice(rest, most))
        yield from _results_of_some(parallel, function, given, parent)
        if given.n < most:
            return


def _results_of_some(
    parallel: Parallel, function: Callable[[_Task], _Result], given: _Given[_Task], parent: int | None
) -> Iterator[_Result | TaskFailure]:
    results = parallel(delayed(_run)(function, task, parent) for task in given)
    try:
        for result in results:  # noqa: UP028 - `yield from` would close them outside of the block below
            yield result
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the tasks under way at an early end
            results.close()
    if given.error is not None:
        raise given.error


class _Given(Generic[_Task]):
    """The tasks as bytes, so that Dask does not scatter large ones over workers, where they are lost with one.

    joblib takes them in threads of its own, which cannot raise what goes wrong: it is kept in `error`. How many were
    taken is `n`.
    """

    def __init__(self, tasks: Iterable[_Task]) -> None:
        self._tasks = tasks
        self.error: Exception | None = None
        self.n = 0

    def __iter__(self) -> Iterator[bytes]:
        try:
            for task in self._tasks:
                self.n += 1
                yield pickle.dumps(task, pickle.HIGHEST_PROTOCOL)
        except Exception as err:
            self.error = err


def _run(function: Callable[[Any], _Result], task: bytes, parent: int | None) -> _Result | TaskFailure:
    """Run a task in a worker process."""
    _use_one_thread()
    if parent is not None:
        _end_with(parent)
    return _outcome(function, pickle.loads(task))


@lru_cache(maxsize=1)
def _use_one_thread() -> None:
    """Limit this process, once: its tasks run beside those of others."""
    cv2.setNumThreads(1)
    threadpool_limits(1)


@lru_cache(maxsize=1)
def _end_with(parent: int) -> None:
    """Watch, from the first task on, whether the parent is still there: one that is killed cannot end its children."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_WATCH_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _outcome(function: Callable[[_Task], _Result], task: _Task) -> _Result | TaskFailure:
    try:
        return function(task)
    except (ValueError, OSError) as err:
        return TaskFailure(str(err))
