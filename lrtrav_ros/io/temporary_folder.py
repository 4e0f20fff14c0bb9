"""Folders for what is needed while a process runs; those of processes that were killed are removed by the next one."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from contextlib import ExitStack, suppress
from pathlib import Path

from lrtrav_ros.io.folder_lock import LOCK_FILE, locked_folder

_PREFIX = "lrtrav_ros_decompressed_"


class TemporaryFolder:
    """An empty folder in that of ``TMPDIR``, which only this user can read.

    Attributes
    ----------
    path : Path
        The folder; it is gone when `close` is called, and at the latest when nobody refers to this object.
    """

    def __init__(self) -> None:
        remove_abandoned(Path(tempfile.gettempdir()))
        new = Path(tempfile.mkdtemp(prefix=f".{_PREFIX}"))
        with ExitStack() as opened:
            opened.callback(shutil.rmtree, new, ignore_errors=True)
            opened.enter_context(locked_folder(new))
            self.path = new.with_name(new.name[1:])
            new.rename(self.path)  # until it was locked, another process could have taken it for an abandoned one
            opened.callback(shutil.rmtree, self.path, ignore_errors=True)
            self._remove = weakref.finalize(self, opened.pop_all().close)  # a signal may come before anybody closes it

    def close(self) -> None:
        """Remove the folder."""
        self._remove()


def remove_abandoned(folder: Path) -> None:
    """Remove the temporary folders of this user in a folder that no process holds any more."""
    for path in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):  # one that is in use, or that another process removes
            if (path / LOCK_FILE).is_file() and path.lstat().st_uid == os.geteuid():
                with locked_folder(path, removes_empty=True):
                    shutil.rmtree(path)
