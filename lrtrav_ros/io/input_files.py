"""Reading whole files of others: regular ones alone, and of no more than a stated size."""

from __future__ import annotations

import os
import stat
from pathlib import Path

IMAGE_BYTES = 1 << 30
"""Most bytes of a file that holds arrays: an image, or a ``.mat``."""

TEXT_BYTES = 1 << 20
"""Most bytes of a file that holds text: a calibration or parameters."""


def read_bytes(path: str | os.PathLike[str], *, max_bytes: int = IMAGE_BYTES) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path : path
        The file, or a link to one. Pipes and devices, which may have no end, are never opened.
    max_bytes : int
        Most bytes that it may have.

    Raises
    ------
    OSError
        If there is no such file, or it cannot be read.
    ValueError
        If it is no regular file, or a larger one.
    """
    status = Path(path).stat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f"{path}: is no regular file but {_kind(status.st_mode)}; give a file")
    if status.st_size > max_bytes:
        raise ValueError(f"{path}: has {status.st_size} bytes; give a file of at most {max_bytes}")
    with Path(path).open("rb") as file:
        return file.read(max_bytes)


def read_text(path: str | os.PathLike[str], *, max_bytes: int = TEXT_BYTES) -> str:
    """Return the text of a file in UTF-8, as `read_bytes` does.

    Raises
    ------
    OSError, ValueError
        As `read_bytes` does, or if it is not UTF-8.
    """
    try:
        return read_bytes(path, max_bytes=max_bytes).decode("utf-8")
    except UnicodeDecodeError as err:
        raise ValueError(f"{path}: is no text in UTF-8 ({err.reason} at byte {err.start}); save it as UTF-8") from err


def _kind(mode: int) -> str:
    """Return what a path is that is no regular file."""
    kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
    return kinds.get(stat.S_IFMT(mode), "a device")
