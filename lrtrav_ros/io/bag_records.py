"""What the files of all bag formats have in common: raw messages, what a file holds, and limits on what is read."""

from __future__ import annotations

import bz2
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO, NamedTuple

from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import parse_qos

from lrtrav_ros.io.bag_metadata import check_depth
from lrtrav_ros.io.zstd_files import ZstdError, zstd_decompressor

Report = Callable[[str], None]

MAX_UNPACKED_BYTES = 256 << 20
"""What a chunk or message may hold when decompressed. Recorders make chunks of 1 to 4 MiB, or of one message."""

MAX_RECORD_BYTES = 1 << 30
"""What of a record is read where no index tells its size: damaged sizes may be those of all that follows."""

MAX_TIME_NS = 2**31 * 10**9
"""End of the times that ROS 2 can tell."""

_MAX_QOS_CHARACTERS = 1 << 16
_MAX_FRAMES = 64  # of compressed data, after each of which all that follows is copied; recorders write one
_SMALL_BYTES = 1 << 16  # which may be reserved before it is known whether they are there


class RawMessage(NamedTuple):
    """A message as it stands in a file: ROS 1 or CDR bytes; `definition` is the text of its type, if it is known."""

    topic: str
    type: str
    definition: str
    time_ns: int
    data: bytes


@dataclass(slots=True)
class Contents:
    """What a file holds.

    Attributes
    ----------
    topics : dict of str to str
        Type of each topic.
    counts : dict of str to int
        Number of messages on each topic.
    definitions : dict of str to str
        Text of each type, where the file has it.
    qos : dict of str to sequence of rosbags.interfaces.Qos
        With which quality of service each topic was published, where the file says so.
    start_ns, end_ns : int
        Times of the first and last message; 0 in a file without messages.
    """

    topics: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    qos: dict[str, Sequence[Qos]] = field(default_factory=dict)
    start_ns: int = 0
    end_ns: int = 0

    def add(self, topic: str, kind: str, count: int) -> None:
        """Add messages of a topic."""
        self.topics.setdefault(topic, kind)
        self.counts[topic] = self.counts.get(topic, 0) + count


class UnindexedFileError(ValueError):
    """A file has no index; there need not be anything wrong with it."""


def unpacked(data: bytes | memoryview, compression: str, *, max_bytes: int = MAX_UNPACKED_BYTES) -> bytes | memoryview:
    """Decompress what is there: all, or the beginning where the data is cut off.

    Parameters
    ----------
    data : bytes
        As compressed.
    compression : str
        ``none`` or empty, ``bz2``, ``lz4`` or ``zstd``.
    max_bytes : int
        How much there may be.

    Raises
    ------
    ValueError
        If the data is damaged or there is more, it is of too many frames, or the compression is not known.
    """
    if compression in ("", "none"):
        return data
    parts: list[bytes] = []
    room = max_bytes + 1
    try:
        while data and room > 0:
            if len(parts) == _MAX_FRAMES:
                raise ValueError(f"consists of more than {_MAX_FRAMES} frames")
            decompressor = _decompressor(compression)
            parts.append(decompressor.decompress(data, room))
            room -= len(parts[-1])
            data = decompressor.unused_data or b""
    except (OSError, EOFError, RuntimeError, ZstdError) as err:  # of bz2, lz4 and zstd
        raise ValueError(f"cannot be decompressed: {err}") from err
    if room <= 0:
        raise ValueError(f"holds more than {max_bytes} bytes when decompressed")
    return b"".join(parts)


def _decompressor(compression: str) -> Any:
    if compression == "bz2":
        return bz2.BZ2Decompressor()
    if compression == "zstd":
        return zstd_decompressor()
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        return lz4.frame.LZ4FrameDecompressor()
    raise ValueError(f"its compression {compression!r} is not known")


def whole(file: BinaryIO, size: int) -> bytes:
    """Read `size` bytes; raise EOFError where there are fewer."""
    # Headers are small and come by the thousand: to look for the end of the file would read its buffer anew for each.
    n_there = size if size <= _SMALL_BYTES else file_size(file) - file.tell()
    data = file.read(max(0, min(size, n_there)))
    if len(data) < size:
        raise EOFError(f"{size - len(data)} bytes are missing")
    return data


def file_size(file: BinaryIO) -> int:
    """Return how many bytes there are: the size of a damaged record may be larger than all memory."""
    position = file.tell()
    end = file.seek(0, os.SEEK_END)
    file.seek(position)
    return end


def qos_profiles(profiles: object) -> Sequence[Qos]:
    """Return the qualities of service that a bag's text or list tells; raises ValueError where it cannot be read."""
    if isinstance(profiles, str) and (len(profiles) > _MAX_QOS_CHARACTERS or "&" in profiles):
        raise ValueError("its quality of service is too long")
    try:
        if isinstance(profiles, str):
            check_depth(profiles)
        return parse_qos(profiles)  # type: ignore[arg-type]
    except Exception as err:  # rosbags and YAML raise anything from KeyError to RecursionError on damaged text
        raise ValueError(f"its quality of service cannot be read ({type(err).__name__})") from err
