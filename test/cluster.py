"""A Dask cluster for tests: a scheduler and workers as processes of their own on loopback."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

_DEADLINE_S = 300.0


@contextmanager
def running(*arguments: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a Python module; it is ended by its own id."""
    with log.open("wb") as stream:
        process = subprocess.Popen([sys.executable, "-m", *arguments], stdout=stream, stderr=stream)
        try:
            yield process
        finally:
            process.kill()
            process.wait(_DEADLINE_S)


@dataclass(frozen=True)
class Cluster:
    """A scheduler, and a worker that is there as long; nothing starts a worker again."""

    folder: Path
    worker: subprocess.Popen[bytes]

    @property
    def address(self) -> str:
        return json.loads((self.folder / "scheduler.json").read_text())["address"]

    @contextmanager
    def another_worker(self) -> Iterator[subprocess.Popen[bytes]]:
        """Start one more worker, to be killed."""
        log = self.folder / f"worker_{time.monotonic_ns()}.log"
        with _worker(self.folder, log) as process:
            _wait_until_registered(log)
            yield process


@contextmanager
def cluster(folder: Path) -> Iterator[Cluster]:
    """Start a cluster, whose files are in a folder."""
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    file, log = ("--scheduler-file", str(folder / "scheduler.json")), folder / "worker.log"
    with (
        running("distributed.cli.dask_scheduler", *options, *file, log=folder / "scheduler.log"),
        _worker(folder, log) as worker,  # it waits for the scheduler's file
    ):
        _wait_until_registered(log)
        yield Cluster(folder, worker)


def _worker(folder: Path, log: Path):
    """Start a worker of the scheduler whose file is in a folder."""
    file, space = ("--scheduler-file", str(folder / "scheduler.json")), ("--local-directory", str(folder / "work"))
    options = ("--no-nanny", "--nthreads", "1", "--no-dashboard", *file, *space)
    return running("distributed.cli.dask_worker", *options, log=log)


def _wait_until_registered(log: Path) -> None:
    until(lambda: b"Registered to" in log.read_bytes())


def until(holds) -> None:
    """Wait for a condition; fail at the deadline."""
    end = time.monotonic() + _DEADLINE_S
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError("the condition did not come true")
        time.sleep(0.02)
