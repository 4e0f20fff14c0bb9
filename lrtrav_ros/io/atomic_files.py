"""Files that appear whole or not at all, and what a run that was killed leaves of others."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from lrtrav_ros.io.folder_lock import locked_folder

_TEMPORARY = re.compile(r"\.[0-9a-f]{16}(\.\d+)?\.tmp")


def write_bytes(path: str | os.PathLike[str], data: bytes, *, durable: bool = False) -> None:
    """Write a file under a temporary name beside it, then give it its name: a finished file is never half replaced.

    Parameters
    ----------
    path : path
        The file; missing folders are made.
    data : bytes
        All that it is to hold.
    durable : bool
        Wait until the disk has it, so that after a power loss it is whole too. That takes some 7 ms.

    Raises
    ------
    OSError
        If it cannot be written, or is a device, pipe or socket; the error names it.
    """
    with _temporary_file(Path(path)) as temporary:
        with temporary.open("wb", buffering=0) as file:
            write_all(file.fileno(), data)
            if durable:
                os.fsync(file.fileno())
        temporary.replace(path)


def check_writable(path: Path) -> None:
    """Raise OSError where `write_bytes` could not write a file, before there is something to write."""
    with _temporary_file(path) as temporary:
        temporary.touch()


@contextmanager
def _temporary_file(path: Path) -> Iterator[Path]:
    """Yield what to name a file until it is finished; it is gone afterwards. Raises OSError where no file can be."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        raise OSError(f"{path}: is a device, pipe or socket, which a file would replace; give the name of a file")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f"{hidden_name(path)}.{os.getpid()}.tmp")
    try:
        with named_errors(path):
            yield temporary
    finally:
        with suppress(OSError):  # it is not there, or the disk is read-only and has none either
            temporary.unlink()


def write_all(file: int, data: bytes) -> None:
    """Write all of the data to an open file; a disk that fills up takes a part, and says so at the next call only."""
    rest = memoryview(data)
    while rest:
        rest = rest[os.write(file, rest) :]


def sync_file(path: Path) -> None:
    """Wait until the disk has a file, before it is given its name."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


@contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Name the file in an OSError of the block: one of writing, such as that of a full disk, names none."""
    try:
        yield
    except OSError as err:
        if err.errno is None or (err.filename is not None and not _is_hidden(Path(err.filename))):
            raise
        raise OSError(err.errno, err.strerror, str(path)) from err


@contextmanager
def scratch_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder beside a path, for what is to become it; it is removed at the end.

    What a run that was killed has left there is removed first.

    Raises
    ------
    BlockingIOError
        If another run writes to the same path.
    """
    folder = path.with_name(f"{hidden_name(path)}.tmp")
    work = folder / "work"
    with ExitStack() as opened:
        with named_errors(path):
            opened.enter_context(locked_folder(folder, removes_empty=True, shown=path))
            opened.callback(shutil.rmtree, work, ignore_errors=True)
            if work.exists():
                shutil.rmtree(work)
            work.mkdir()
        yield work


def remove_leftovers(folder: Path) -> None:
    """Remove what runs that were killed have left in a folder and those in it; its lock must be held."""
    for path in sorted(folder.rglob(".*.tmp")):
        if not is_leftover(path):
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            with suppress(FileNotFoundError):
                path.unlink()


def is_leftover(path: Path) -> bool:
    """Return whether a name is a temporary one of this module's."""
    return _TEMPORARY.fullmatch(path.name) is not None


def _is_hidden(path: Path) -> bool:
    """Return whether a path is, or is in, a temporary one: the user knows the final one only."""
    return any(map(is_leftover, (path, *path.parents)))


def hidden_name(path: Path) -> str:
    """Return what begins the temporary name of a file: of one length, for names may be as long as a disk takes."""
    return f".{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:16]}"
