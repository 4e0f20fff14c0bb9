"""Data and files that are compressed with Zstandard, by the package that comes with rosbags."""

from __future__ import annotations

import errno
import os
import shutil
import sys
from pathlib import Path

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZstdError = zstd.ZstdError
zstd_decompressor = zstd.ZstdDecompressor

_MAGIC = b"\x28\xb5\x2f\xfd"
_BLOCK_BYTES = 1 << 20
_CHECKED_BYTES = 64 << 20  # after which the disk is looked at
_RESERVED_BYTES = 1 << 30  # what is left to others
_REMEDY = "; set TMPDIR to a folder with more space"


def is_zstd(data: bytes | memoryview) -> bool:
    """Return whether data begins as Zstandard's does, which no message in CDR can: its first byte is 0."""
    return bytes(data[: len(_MAGIC)]) == _MAGIC


def is_zstd_file(path: Path) -> bool:
    """Return whether a file is compressed as a whole."""
    with path.open("rb") as file:
        return is_zstd(file.read(len(_MAGIC)))


def decompressed(data: bytes | memoryview, *, max_bytes: int) -> bytes:
    """Decompress one frame.

    Raises
    ------
    ValueError
        If the data is damaged or cut off, or holds more than `max_bytes`.
    """
    decompressor = zstd.ZstdDecompressor()
    try:
        content = decompressor.decompress(data, max_bytes)
    except zstd.ZstdError as err:
        raise ValueError(str(err)) from err
    if not decompressor.eof:
        what = f"holds more than {max_bytes} bytes when decompressed" if len(content) == max_bytes else "is cut off"
        raise ValueError(f"it {what}")
    return content


def first_bytes(path: Path, n: int) -> bytes:
    """Return the first `n` bytes of a file, or of what it holds where it is compressed; fewer where it is damaged."""
    if not is_zstd_file(path):
        with path.open("rb") as file:
            return file.read(n)
    try:
        with zstd.ZstdFile(path) as content:
            return content.read1(n)
    except (EOFError, zstd.ZstdError):
        return b""


def decompress_file(path: Path, target: Path) -> str:
    """Write what a compressed file holds to another one, block by block.

    Returns
    -------
    str
        Where the file is cut off or damaged, why; empty otherwise. What comes before is written.

    Raises
    ------
    OSError
        If the target cannot be written, or would fill the disk.
    """
    reserve = min(_RESERVED_BYTES, shutil.disk_usage(target.parent).total // 20)
    n_written = 0
    with target.open("wb") as output, zstd.ZstdFile(path) as content:
        while True:
            try:
                block = content.read1(_BLOCK_BYTES)  # `read` would lose what comes before the end
            except (EOFError, zstd.ZstdError) as err:
                return str(err)
            if not block:
                return ""
            if n_written % _CHECKED_BYTES < len(block) and shutil.disk_usage(target.parent).free < reserve:
                raise OSError(
                    errno.ENOSPC,
                    f"{path}: decompressing it into {target.parent}: {n_written} bytes are written, and less than "
                    f"{reserve} would be left on the disk{_REMEDY}",
                )
            n_written += len(block)
            _write(output.fileno(), block, f"{path}: decompressing it into {target.parent}")


def _write(file: int, data: bytes, action: str) -> None:
    """Write all of the data; raises OSError that says what for, and what to do where the disk is full."""
    rest = memoryview(data)
    while rest:
        try:
            rest = rest[os.write(file, rest) :]
        except OSError as err:
            remedy = _REMEDY if err.errno in (errno.ENOSPC, errno.EDQUOT) else ""
            raise OSError(err.errno, f"{action}: {err.strerror}{remedy}") from err
