"""One run at a time for each output folder."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOCK_FILE = ".lock"
"""The file in a folder that is locked. The kernel unlocks it when its process ends, however it ends."""

# NFS without its lock daemon, FUSE and cluster file systems: a run there is not locked, rather than not possible.
_WITHOUT_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)


@contextmanager
def locked_folder(path: Path, *, removes_empty: bool = False, shown: Path | None = None) -> Iterator[None]:
    """Hold the lock of a folder in a ``with`` block; a folder made for that is removed where it stays empty.

    Parameters
    ----------
    path : Path
        The folder; missing ones are made.
    removes_empty : bool
        Remove it where it is empty at the end, even if it was there before.
    shown : Path, optional
        What to name to the user in its place.

    Raises
    ------
    BlockingIOError
        If another run holds it.
    OSError
        If the folder cannot be made or written to.
    """
    goes = removes_empty or not path.exists()
    folder, file = _acquired(path, shown or path)
    try:
        yield
    finally:
        with suppress(OSError):
            os.unlink(LOCK_FILE, dir_fd=folder)  # it may have another path by now
        os.close(file)
        os.close(folder)
        if goes:
            with suppress(OSError):
                path.rmdir()


def _acquired(path: Path, shown: Path) -> tuple[int, int]:
    """Return the open folder and its open, locked file."""
    while True:
        path.mkdir(parents=True, exist_ok=True)
        try:
            folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
        except FileNotFoundError:
            continue  # its last run has removed it just now
        file = -1
        try:
            file = _opened(path, folder)
            if file >= 0 and _is_locked(shown, file):
                return folder, file
        except BaseException:
            _close(folder, file)
            raise
        _close(folder, file)


def _opened(path: Path, folder: int) -> int:
    """Return the open lock file of an open folder; -1 where the folder was removed meanwhile."""
    try:
        return os.open(LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666, dir_fd=folder)
    except FileNotFoundError:
        return -1
    except OSError as err:
        raise OSError(err.errno, err.strerror, str(path / LOCK_FILE)) from err


def _is_locked(path: Path, file: int) -> bool:
    """Lock an open file; return False where the run before has removed it meanwhile. Raises where a run holds it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as err:
        raise BlockingIOError(f"{path}: another run writes to it; let that end, or choose another folder") from err
    except OSError as err:
        if err.errno not in _WITHOUT_LOCKS:
            raise OSError(err.errno, err.strerror, str(path / LOCK_FILE)) from err
    return os.fstat(file).st_nlink > 0


def _close(*files: int) -> None:
    for file in files:
        if file >= 0:
            os.close(file)
