"""A Dask cluster for tests: a scheduler and workers as processes of their own on loopback."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

_DEADLINE_S = 20.0


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


@contextmanager
def cluster(folder: Path, *, n_workers: int = 2) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Yield the address of a scheduler and the processes of its workers, which nothing starts again."""
    file = folder / "scheduler.json"
    with ExitStack() as stack:
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
        scheduler = stack.enter_context(
            running("distributed.cli.dask_scheduler", *options, log=folder / "scheduler.log")
        )
        until(lambda: file.exists() or scheduler.poll() is not None)
        address = json.loads(file.read_text())["address"]
        options = (
            address,
            "--no-nanny",
            "--nthreads",
            "1",
            "--no-dashboard",
            "--local-directory",
            str(folder / "work"),
        )
        workers = [
            stack.enter_context(running("distributed.cli.dask_worker", *options, log=folder / f"worker_{i}.log"))
            for i in range(n_workers)
        ]
        for i in range(n_workers):
            log = folder / f"worker_{i}.log"
            until(lambda log=log: b"Registered to" in log.read_bytes())
        yield address, workers


def until(holds) -> None:
    """Wait for a condition; fail at the deadline."""
    end = time.monotonic() + _DEADLINE_S
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError("the condition did not come true")
        time.sleep(0.02)
