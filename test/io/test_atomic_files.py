"""Tests of files that appear whole or not at all, on disks that are full or closed, and under the longest names."""

from __future__ import annotations

import errno
import os
import resource
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lrtrav_ros.io.atomic_files import check_writable, is_leftover, remove_leftovers, scratch_folder, write_bytes


@contextmanager
def largest_file(n_bytes: int) -> Iterator[None]:
    """Have writing fail beyond a size, as it does where the disk is full."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("durable", [False, True])
def test_file_is_replaced(tmp_path: Path, durable: bool) -> None:
    path = tmp_path / "new" / "file.csv"
    for data in (b"first", b"", b"second"):
        write_bytes(path, data, durable=durable)
        assert path.read_bytes() == data
    assert list(path.parent.iterdir()) == [path]


def test_failed_write_names_the_file_and_leaves_the_finished_one(tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    write_bytes(path, b"finished")
    with largest_file(1000), pytest.raises(OSError, match=r"file\.csv") as raised:
        write_bytes(path, bytes(5000))
    assert (raised.value.errno, raised.value.filename) == (errno.EFBIG, str(path))
    assert path.read_bytes() == b"finished"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["a" * 251 + ".png", "ä" * 125 + ".png"])
def test_name_may_be_as_long_as_the_disk_takes(tmp_path: Path, name: str) -> None:
    write_bytes(tmp_path / name, b"whole")
    assert (tmp_path / name).read_bytes() == b"whole"
    with scratch_folder(tmp_path / name) as folder:
        assert folder.is_dir()


def test_place_that_cannot_be_written_to_is_found_before(tmp_path: Path) -> None:
    path = tmp_path / "figures.json"
    check_writable(path)
    assert list(tmp_path.iterdir()) == []
    path.mkdir()
    with pytest.raises(IsADirectoryError, match=r"figures\.json"):
        check_writable(path)
    with pytest.raises(OSError, match=r"/proc/figures\.json"):
        check_writable(Path("/proc/figures.json"))


@pytest.mark.parametrize("act", [check_writable, lambda path: write_bytes(path, b"figures")])
def test_device_pipe_or_socket_is_never_replaced(tmp_path: Path, act: Callable[[Path], None]) -> None:
    pipe, link, listening = tmp_path / "pipe", tmp_path / "null", tmp_path / "socket"
    os.mkfifo(pipe)
    link.symlink_to("/dev/null")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(listening))
        kinds = {path: path.lstat().st_mode for path in (pipe, link, listening)}
        for path in kinds:
            with pytest.raises(OSError, match=rf"{path}: is a device, pipe or socket, .*; give the name of a file"):
                act(path)
    assert {path: path.lstat().st_mode for path in tmp_path.iterdir()} == kinds


def test_leftovers_alone_are_removed(tmp_path: Path) -> None:
    kept = [".notes.tmp", "0123456789abcdef.1.tmp", ".0123456789abcdef.1.tmp.gz"]
    for name in [*kept, ".0123456789abcdef.17.tmp"]:
        (tmp_path / "sub" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "sub" / name).write_bytes(b"half")
    (tmp_path / ".fedcba9876543210.tmp" / "work").mkdir(parents=True)
    remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*") if path.is_file()) == sorted(kept)
    assert [path.name for path in tmp_path.iterdir()] == ["sub"]


def test_scratch_folder_is_of_one_run_and_taken_over_from_a_killed_one(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    with scratch_folder(path) as folder:
        (folder / "half").touch()
        assert is_leftover(folder.parent)
        with pytest.raises(BlockingIOError, match=r"out\.mcap: another run writes to it"):
            scratch_folder(path).__enter__()
        assert (folder / "half").exists()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError, match=r"'/proc/out\.mcap'"):
        scratch_folder(Path("/proc/out.mcap")).__enter__()
    folder.mkdir(parents=True)
    (folder / "half").touch()
    with scratch_folder(path) as again:
        assert again == folder
        assert list(folder.iterdir()) == []
    assert list(tmp_path.iterdir()) == []
