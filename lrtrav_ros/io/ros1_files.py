"""Bags of ROS 1: by their index, or without it where it is lost. The format has no checksums of its own."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import BinaryIO

from rosbags import rosbag1

from lrtrav_ros.io.bag_records import (
    MAX_RECORD_BYTES,
    MAX_UNPACKED_BYTES,
    Contents,
    RawMessage,
    Report,
    UnindexedFileError,
    file_size,
    unpacked,
    whole,
)

_MESSAGE, _CHUNK, _CONNECTION = b"\x02", b"\x05", b"\x07"
_ERRORS = (EOFError, ValueError, struct.error, KeyError)  # of records that are damaged

_Record = tuple[dict[bytes, bytes], bytes]


class Ros1File:
    """A bag of ROS 1 that is read by its index.

    Parameters
    ----------
    path : Path
        The file.

    Attributes
    ----------
    contents : Contents
        What its index says that it holds.

    Raises
    ------
    UnindexedFileError
        If the index lists nothing.
    Exception
        If it is damaged or not finished: anything that rosbags raises, from AssertionError to struct.error.
    """

    def __init__(self, path: Path) -> None:
        self.contents = Contents()
        self._reader = rosbag1.Reader(path)
        self._reader.open()
        try:
            if not self._reader.chunk_infos:
                raise UnindexedFileError("its index lists no chunks")
            sizes = _chunk_sizes(path)
            self._check_index(sizes)
            self._bound_chunks(sizes)
            self._fill_contents()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def messages(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        """Yield the messages on topics, at a time or later, in order of time; raises anything where it is damaged."""
        connections = [connection for connection in self._reader.connections if connection.topic in topics]
        if not connections:
            return
        for connection, time_ns, data in self._reader.messages(connections, start=start_ns):
            if connection.topic not in topics:
                raise ValueError("its index lists a message of another topic")
            yield RawMessage(connection.topic, connection.msgtype, "", time_ns, data)

    def _check_index(self, sizes: dict[int, int]) -> None:
        """Raise ValueError where the index does not list what the file holds."""
        chunks = self._reader.chunk_infos
        if sorted(chunk.pos for chunk in chunks) != sorted(sizes):
            raise ValueError(f"its index lists {len(chunks)} chunks, but there are {len(sizes)}, or elsewhere")
        listed: dict[int, int] = {}
        for chunk in chunks:
            for number, count in chunk.connection_counts.items():
                listed[number] = listed.get(number, 0) + count
        counts = {connection.id: connection.msgcount for connection in self._reader.connections}
        if listed != {number: count for number, count in counts.items() if count}:
            raise ValueError("its counts contradict each other")

    def _bound_chunks(self, sizes: dict[int, int]) -> None:
        """Limit what is decompressed."""
        names = {decompress: name for name, decompress in rosbag1.reader.decompressors.items()}
        for position, chunk in self._reader.chunks.items():
            name = names[chunk.decompressor]
            bounded = partial(_unpacked_chunk, compression=name, size=sizes[position])
            self._reader.chunks[position] = chunk._replace(decompressor=bounded)

    def _fill_contents(self) -> None:
        contents = self.contents
        for connection in self._reader.connections:
            contents.add(connection.topic, connection.msgtype, connection.msgcount)
            contents.definitions[connection.msgtype] = connection.msgdef.data
        if any(contents.counts.values()):
            contents.start_ns, contents.end_ns = self._reader.start_time, self._reader.end_time - 1


def _chunk_sizes(path: Path) -> dict[int, int]:
    """Return what each chunk holds, in bytes, by its position; raises EOFError where the file ends too early."""
    sizes = {}
    with path.open("rb") as file:
        end = file_size(file)
        file.readline(32)
        while start := file.read(4):
            position = file.tell() - len(start)
            header = _fields(whole(file, struct.unpack("<I", start)[0]))
            (size,) = struct.unpack("<I", whole(file, 4))
            if header[b"op"] == _CHUNK:
                sizes[position] = struct.unpack("<I", header[b"size"])[0]
            if file.seek(size, io.SEEK_CUR) > end:
                raise EOFError("it is cut off")
    return sizes


def _unpacked_chunk(data: bytes, *, compression: str, size: int) -> bytes:
    """Decompress a chunk, which holds no more than its header says."""
    return bytes(unpacked(data, compression, max_bytes=min(size, MAX_UNPACKED_BYTES)))


def scanned_ros1(path: Path, report: Report) -> Iterator[RawMessage]:
    """Yield the messages of a file in the order of the file, without its index; what is damaged is reported."""
    connections: dict[bytes, tuple[str, str, str]] = {}
    n_lost = 0
    with path.open("rb") as file:
        file.readline(32)
        for header, data in _scanned_records(file, report):
            try:
                raw = _taken(header, data, connections)
            except _ERRORS as err:
                report(f"a record is damaged ({_reason(err)})")
                continue
            n_lost += header.get(b"op") == _MESSAGE and raw is None
            if raw is not None:
                yield raw
    if n_lost:
        report(f"{n_lost} messages are of no topic that is known")


def _taken(
    header: dict[bytes, bytes], data: bytes, connections: dict[bytes, tuple[str, str, str]]
) -> RawMessage | None:
    """Take a record: note a connection, or return a message of one that is known."""
    if header[b"op"] == _CONNECTION:
        fields = _fields(data)
        package, _, name = fields[b"type"].decode().rpartition("/")
        definition = fields[b"message_definition"].decode(errors="replace")
        connections[header[b"conn"]] = (header[b"topic"].decode(), f"{package}/msg/{name}", definition)
    elif header[b"op"] == _MESSAGE and header[b"conn"] in connections:
        seconds, nanoseconds = struct.unpack("<II", header[b"time"])
        return RawMessage(*connections[header[b"conn"]], seconds * 10**9 + nanoseconds, data)
    return None


def _scanned_records(file: BinaryIO, report: Report) -> Iterator[_Record]:
    """Yield the records up to the first one that is not whole, those inside of chunks too."""
    try:
        for header, data, size in _records(file):
            if header[b"op"] == _CHUNK:
                yield from _chunk_records(header, data, report)
            elif len(data) == size:
                yield header, data
            if len(data) < size:
                raise EOFError
    except _ERRORS:
        report(f"cut off or damaged before byte {file.tell()}")


def _chunk_records(header: dict[bytes, bytes], data: bytes, report: Report) -> Iterator[_Record]:
    """Yield the records of a chunk, or of the part of one that is there."""
    try:
        (limit,) = struct.unpack("<I", header[b"size"])
        content = _unpacked_chunk(data, compression=header[b"compression"].decode(), size=limit)
        for inner, part, size in _records(io.BytesIO(content)):
            if len(part) < size or inner[b"op"] == _CHUNK:
                raise EOFError("it is cut off")
            yield inner, part
    except _ERRORS as err:
        report(f"a chunk of {len(data)} bytes is damaged ({_reason(err)}); what of it is whole is read")


def _records(file: BinaryIO) -> Iterator[tuple[dict[bytes, bytes], bytes, int]]:
    """Yield header, data and size of each record; there is less data where the file ends before."""
    end = file_size(file)
    while start := file.read(4):
        header = _fields(whole(file, struct.unpack("<I", start)[0]))
        (size,) = struct.unpack("<I", whole(file, 4))
        yield header, file.read(min(size, end - file.tell(), MAX_RECORD_BYTES)), size


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Return the fields of a header, each of which is its size and name=value."""
    fields, position = {}, 0
    while position < len(data):
        end = position + 4 + struct.unpack_from("<I", data, position)[0]
        name, separator, value = data[position + 4 : end].partition(b"=")
        if not separator or end > len(data):
            raise ValueError("a header is damaged")
        fields[name] = value
        position = end
    return fields


def _reason(err: Exception) -> str:
    return f"no {err.args[0]!r}" if isinstance(err, KeyError) else str(err)
