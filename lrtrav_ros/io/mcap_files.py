"""MCAP files: by their index, chunk by chunk, or without it where it is lost. Checksums are checked."""

from __future__ import annotations

import heapq
import io
import os
import struct
from collections.abc import Iterator, Sequence
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO, NamedTuple
from zlib import crc32

from rosbags.interfaces import Qos

from lrtrav_ros.io.bag_records import (
    MAX_RECORD_BYTES,
    MAX_UNPACKED_BYTES,
    Contents,
    RawMessage,
    Report,
    UnindexedFileError,
    file_size,
    qos_profiles,
    unpacked,
    whole,
)

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_CHUNK_INDEX, _STATISTICS, _SUMMARY_OFFSET, _DATA_END = 8, 11, 14, 15
_FOOTER_BYTES = 9 + 20
_MAX_HELD_BYTES = 1 << 30  # of messages whose chunks overlap in time, which are in memory together
_ERRORS = (EOFError, ValueError, struct.error)  # of records that are damaged


class _ChunkIndex(NamedTuple):
    start_ns: int
    end_ns: int
    offset: int
    size: int
    channels: frozenset[int]  # empty where it is not said


class _Channels:
    """The channels of a file, as its records tell them."""

    def __init__(self) -> None:
        self._schemas: dict[int, tuple[str, str]] = {}
        self.known: dict[int, tuple[str, str, str]] = {}
        self.metadata: dict[int, bytes] = {}

    def add(self, opcode: int, content: bytes | memoryview) -> None:
        """Take a record; all but schemas and channels are left aside."""
        fields = _Fields(content)
        if opcode == _SCHEMA:
            (number,) = fields.numbers("<H")
            name, _, text = fields.text(), fields.text(), fields.text()
            self._schemas[number] = (name, text)
        elif opcode == _CHANNEL:
            channel, schema = fields.numbers("<HH")
            topic, _ = fields.text(), fields.text()
            self.known[channel] = (topic, *self._schemas.get(schema, ("", "")))
            self.metadata[channel] = fields.data()

    def message(self, content: bytes | memoryview) -> RawMessage | None:
        """Return the message of a record, or None where its channel is not known."""
        channel, _, time_ns, _ = struct.unpack_from("<HIQQ", content)
        return RawMessage(*self.known[channel], time_ns, bytes(content[22:])) if channel in self.known else None


class McapFile:
    """An MCAP file that is read by its index.

    Parameters
    ----------
    path : Path
        The file.
    report : callable
        Is called with what is damaged, when it is come upon.

    Attributes
    ----------
    contents : Contents
        What its summary says that it holds.

    Raises
    ------
    UnindexedFileError
        If it has no index.
    ValueError, EOFError, struct.error
        If it is damaged or not finished.
    """

    def __init__(self, path: Path, report: Report) -> None:
        self._report = report
        self._channels = _Channels()
        self._chunks: list[_ChunkIndex] = []
        self._n_held = 0
        self.contents = Contents()
        self._file = path.open("rb")
        try:
            self._read_summary()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        """Yield the messages on topics, at a time or later, in order of time; chunks that are damaged are reported.

        Raises ValueError where too many chunks overlap in time to be put in order.
        """
        wanted = {number for number, (topic, *_) in self._channels.known.items() if topic in topics}
        parts = [
            self._timed(chunk, wanted, start_ns)
            for chunk in self._chunks
            if chunk.end_ns >= start_ns and (not chunk.channels or chunk.channels & wanted)
        ]
        for _, _, raw in heapq.merge(*parts, key=itemgetter(0, 1)):
            if raw is not None:
                yield raw

    def _read_summary(self) -> None:
        """Read where the chunks are and what is in them."""
        _check_start(self._file)
        footer = self._file.seek(-_FOOTER_BYTES - len(_MAGIC), os.SEEK_END)
        opcode, size, start, _, checksum = struct.unpack("<BQQQI", whole(self._file, _FOOTER_BYTES))
        if self._file.read() != _MAGIC or (opcode, size) != (_FOOTER, 20):
            raise ValueError("its end is missing")
        if start == 0:
            raise UnindexedFileError("it has no summary")
        if not 0 < footer - start <= MAX_UNPACKED_BYTES:
            raise ValueError("its summary is not where it should be")
        self._file.seek(start)
        summary = whole(self._file, footer + _FOOTER_BYTES - start)
        if checksum and crc32(summary[:-4]) != checksum:
            raise ValueError("its summary does not match its checksum")
        statistics = None
        for opcode, content in _records(io.BytesIO(summary[:-_FOOTER_BYTES])):
            self._channels.add(opcode, content)
            if opcode == _CHUNK_INDEX:
                self._chunks.append(_chunk_index(content))
            elif opcode == _STATISTICS:
                statistics = content
        if statistics is None or not self._channels.known:
            raise UnindexedFileError("its summary has no counts")
        self._fill_contents(_Fields(statistics))
        self._chunks.sort(key=lambda chunk: chunk.offset)

    def _fill_contents(self, statistics: _Fields) -> None:
        """Take what the summary says; raises where it contradicts itself."""
        n_messages, _, _, _, _, n_chunks, start_ns, end_ns = statistics.numbers("<QHIIIIQQ")
        if n_messages and not n_chunks:
            raise UnindexedFileError("it has no chunks")
        if n_chunks != len(self._chunks):
            raise ValueError(f"its index lists {len(self._chunks)} of {n_chunks} chunks")
        counts = dict(struct.iter_unpack("<HQ", statistics.data()))
        if sum(counts.values()) != n_messages or not counts.keys() <= self._channels.known.keys():
            raise ValueError("its counts contradict each other")
        for number, (topic, kind, definition) in self._channels.known.items():
            self.contents.add(topic, kind, counts.get(number, 0))
            self.contents.definitions[kind] = definition
            try:
                self.contents.qos[topic] = _qos(self._channels.metadata[number])
            except _ERRORS as err:
                self._report(f"{topic}: {err}")
        if n_messages:
            self.contents.start_ns, self.contents.end_ns = start_ns, end_ns

    def _timed(
        self, chunk: _ChunkIndex, channels: set[int], start_ns: int
    ) -> Iterator[tuple[int, int, RawMessage | None]]:
        """Yield time, place and message; first those of the chunk, so that it is not read before its turn."""
        yield chunk.start_ns, -1, None
        found = []
        try:
            self._file.seek(chunk.offset)
            opcode, size = struct.unpack("<BQ", whole(self._file, 9))
            if opcode != _CHUNK or size + 9 != chunk.size:
                raise ValueError("it is not where the index says")
            for opcode, content in _chunk_records(whole(self._file, size)):
                if opcode == _MESSAGE and struct.unpack_from("<H", content)[0] in channels:
                    raw = self._channels.message(content)
                    if raw is not None and raw.time_ns >= start_ns:
                        found.append(raw)
        except _ERRORS as err:
            self._report(_damaged_chunk(chunk.offset, chunk.size, err))
        n_bytes = sum(len(raw.data) for raw in found)
        self._n_held += n_bytes
        try:
            if self._n_held > _MAX_HELD_BYTES:
                raise ValueError(f"more than {_MAX_HELD_BYTES} bytes of its chunks overlap in time; they stay unsorted")
            for raw in sorted(found, key=lambda raw: raw.time_ns):
                yield raw.time_ns, chunk.offset, raw
        finally:
            self._n_held -= n_bytes


class _Fields:
    """The fields of a record, one after another."""

    def __init__(self, content: bytes | memoryview) -> None:
        self._content = content
        self._at = 0

    def numbers(self, layout: str) -> tuple[int, ...]:
        values = struct.unpack_from(layout, self._content, self._at)
        self._at += struct.calcsize(layout)
        return values

    def data(self) -> bytes:
        (size,) = self.numbers("<I")
        return self.rest(size)

    def text(self) -> str:
        return self.data().decode()

    def rest(self, size: int) -> bytes:
        if size > len(self._content) - self._at:
            raise EOFError("a field is longer than its record")
        self._at += size
        return bytes(self._content[self._at - size : self._at])

    @property
    def is_at_end(self) -> bool:
        return self._at >= len(self._content)


def _check_start(file: BinaryIO) -> None:
    """Raise ValueError where the file is none that ROS 2 wrote."""
    if file.read(len(_MAGIC)) != _MAGIC:
        raise ValueError("it is no MCAP file")
    opcode, size = struct.unpack("<BQ", whole(file, 9))
    if opcode != _HEADER:
        raise ValueError("it does not begin with a header")
    profile = _Fields(whole(file, size)).text()
    if profile != "ros2":
        raise ValueError(f"its profile is {profile!r}, not 'ros2'")


def _chunk_index(content: bytes) -> _ChunkIndex:
    fields = _Fields(content)
    start_ns, end_ns, offset, size = fields.numbers("<QQQQ")
    channels = frozenset(number for number, _ in struct.iter_unpack("<HQ", fields.data()))
    return _ChunkIndex(start_ns, end_ns, offset, size, channels)


def _qos(metadata: bytes) -> Sequence[Qos]:
    """Return the quality of service out of a channel's metadata."""
    fields = _Fields(metadata)
    while not fields.is_at_end:
        if fields.text() == "offered_qos_profiles":
            return qos_profiles(fields.text())
        fields.text()
    return ()


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield opcode and content of each record."""
    end = file_size(file)
    while start := file.read(9):
        opcode, size = struct.unpack("<BQ", start)
        if opcode == 0 or size > end - file.tell():
            raise EOFError("a record is not whole")
        yield opcode, file.read(size)


def _inner_records(content: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield opcode and content of each record of a chunk, which are not copied."""
    at = 0
    while at < len(content):
        opcode, size = struct.unpack_from("<BQ", content, at)
        at += 9 + size
        if opcode == 0 or at > len(content):
            raise EOFError("a record is not whole")
        yield opcode, content[at - size : at]


def _chunk_records(chunk: bytes, *, is_cut: bool = False) -> Iterator[tuple[int, memoryview]]:
    """Yield the records of a chunk; raises ValueError before the first one where they do not match their checksum.

    Of a chunk that is cut off at the end of the file those are yielded that are there, which no checksum tells of; then
    it raises EOFError.
    """
    fields = _Fields(chunk)
    _, _, size, checksum = fields.numbers("<QQQI")
    compression = fields.text()
    (packed_size,) = fields.numbers("<Q")
    packed = memoryview(chunk)[40 + len(compression.encode()) :][:packed_size]
    is_whole = len(packed) == packed_size
    if not is_whole and not is_cut:
        raise ValueError(f"it has {len(packed)} of {packed_size} bytes")
    if size > MAX_UNPACKED_BYTES and compression:
        raise ValueError(f"it holds {size} bytes when decompressed, more than {MAX_UNPACKED_BYTES}")
    content = unpacked(packed, compression, max_bytes=size)
    if is_whole and len(content) != size:
        raise ValueError(f"it holds {len(content)} bytes when decompressed, not {size}")
    if is_whole and checksum and crc32(content) != checksum:
        raise ValueError("it does not match its checksum")
    for opcode, record in _inner_records(memoryview(content)):
        if opcode == _CHUNK:
            raise ValueError("it holds another chunk")
        yield opcode, record
    if not is_whole:
        raise EOFError("it is cut off")


def _damaged_chunk(offset: int, size: int, err: Exception) -> str:
    return f"the chunk of {size} bytes at byte {offset} is damaged ({err}); it is left out but for what is known whole"


def scanned_mcap(path: Path, report: Report) -> Iterator[RawMessage]:
    """Yield the messages of a file in the order of the file, without its index; what is damaged is reported."""
    channels = _Channels()
    n_lost = 0
    with path.open("rb") as file:
        file.seek(len(_MAGIC))
        for opcode, content in _scanned_records(file, report):
            if opcode not in (_SCHEMA, _CHANNEL, _MESSAGE):
                continue
            try:
                channels.add(opcode, content)
                raw = channels.message(content) if opcode == _MESSAGE else None
            except _ERRORS as err:
                report(f"a record is damaged ({err})")
                continue
            n_lost += opcode == _MESSAGE and raw is None
            if raw is not None:
                yield raw
    if n_lost:
        report(f"{n_lost} messages are of no topic that is known")


def _scanned_records(file: BinaryIO, report: Report) -> Iterator[tuple[int, bytes | memoryview]]:
    """Yield the records up to the first one that is not whole, those inside of chunks too."""
    checksum = crc32(_MAGIC)
    end = file_size(file)
    while start := file.read(9):
        at = file.tell() - len(start)
        opcode, size = struct.unpack("<BQ", start.ljust(9, b"\0"))
        content = file.read(min(size, end - file.tell(), MAX_RECORD_BYTES))
        if opcode == _DATA_END and len(content) >= 4:
            (expected,) = struct.unpack_from("<I", content)
            if expected and expected != checksum:
                report("its data does not match its checksum; messages may be altered")
        checksum = crc32(content, crc32(start, checksum))
        if opcode == _CHUNK:
            try:
                yield from _chunk_records(content, is_cut=len(content) < size)
            except _ERRORS as err:
                report(_damaged_chunk(at, len(start) + len(content), err))
        elif len(content) == size:
            yield opcode, content
        if opcode == 0 or len(content) < size or len(start) < 9:
            report(f"cut off or damaged before byte {at + len(start) + len(content)}")
            return
        if opcode == _FOOTER:
            return
    report("its end is missing")
