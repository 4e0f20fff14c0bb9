"""Tests of the lock of a folder: one run at a time, whatever ends it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lrtrav_ros.io.folder_lock import LOCK_FILE, locked_folder

_RACE = """
import sys
from pathlib import Path
from lrtrav_ros.io.folder_lock import locked_folder
sys.stdin.readline()
try:
    with locked_folder(Path(sys.argv[1])):
        print("locked", flush=True)
        sys.stdin.readline()
except BlockingIOError:
    print("refused", flush=True)
"""


@contextmanager
def another_process(path: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a process that locks a folder when it is given a line, and unlocks it at the next."""
    command = [sys.executable, "-c", _RACE, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process


def go(*processes: subprocess.Popen[str]) -> None:
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()


def answer(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_second_run_is_refused_until_the_first_has_ended(tmp_path: Path) -> None:
    with locked_folder(tmp_path):
        with pytest.raises(BlockingIOError, match=f"{tmp_path}: another run writes to it; let that end, or choose"):
            locked_folder(tmp_path).__enter__()
        assert [path.name for path in tmp_path.iterdir()] == [LOCK_FILE]
    assert list(tmp_path.iterdir()) == []
    with locked_folder(tmp_path):
        pass


def test_of_runs_that_begin_at_once_one_works(tmp_path: Path) -> None:
    path = tmp_path / "out"
    with another_process(path) as first, another_process(path) as second:
        go(first, second)
        answers = {answer(process): process for process in (first, second)}
        assert answers.keys() == {"locked", "refused"}
        assert (path / LOCK_FILE).exists()
        go(answers["locked"])
    # It was there before for the one that works, where the other had made it.
    assert not path.exists() or list(path.iterdir()) == []


def test_nothing_stays_locked_when_a_run_is_killed(tmp_path: Path) -> None:
    with another_process(tmp_path) as process:
        go(process)
        assert answer(process) == "locked"
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert (tmp_path / LOCK_FILE).exists()
    with locked_folder(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_folder_that_was_made_is_removed_where_it_stays_empty(tmp_path: Path) -> None:
    with locked_folder(tmp_path / "empty"):
        pass
    with locked_folder(tmp_path / "full"):
        (tmp_path / "full" / "file").touch()
    (tmp_path / "mine").mkdir()
    with locked_folder(tmp_path / "mine"):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == ["full", "mine"]


def test_folder_may_be_renamed_meanwhile(tmp_path: Path) -> None:
    with locked_folder(tmp_path / "new"):
        (tmp_path / "new").rename(tmp_path / "out")
        with pytest.raises(BlockingIOError):
            locked_folder(tmp_path / "out").__enter__()
    assert list((tmp_path / "out").iterdir()) == []


def test_link_in_the_place_of_the_lock_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match=LOCK_FILE):
        locked_folder(tmp_path).__enter__()
    assert not (tmp_path / "elsewhere").exists()
