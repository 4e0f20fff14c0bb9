"""Tests of temporary folders: gone when closed, and when the process was killed, by the next one."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lrtrav_ros.io.temporary_folder import TemporaryFolder

_HOLD = """
import sys
from lrtrav_ros.io.temporary_folder import TemporaryFolder
folder = TemporaryFolder()
(folder.path / "bag.mcap").touch()
print(folder.path, flush=True)
sys.stdin.readline()
"""


def test_folder_of_a_process_that_was_killed_is_removed_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    (tmp_path / "lrtrav_ros_decompressed_mine").mkdir()
    command = [sys.executable, "-c", _HOLD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        held = Path(process.stdout.readline().strip())
        first = TemporaryFolder()
        assert (held / "bag.mcap").exists()
        process.send_signal(signal.SIGKILL)
        process.wait()
    second = TemporaryFolder()
    assert not held.exists()
    assert first.path.is_dir()
    assert first.path.stat().st_mode & 0o777 == 0o700
    for folder in (first, second):
        folder.close()
    assert [path.name for path in tmp_path.iterdir()] == ["lrtrav_ros_decompressed_mine"]


def test_folder_goes_with_the_object(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    closed, dropped = TemporaryFolder(), TemporaryFolder()
    (closed.path / "bag.mcap").touch()
    (dropped.path / "bag.mcap").touch()
    for _ in range(2):
        closed.close()
    assert list(tmp_path.iterdir()) == [dropped.path]
    del dropped
    assert not list(tmp_path.iterdir())
