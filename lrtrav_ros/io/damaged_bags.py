"""Recovers intact messages from truncated or damaged bags."""

from __future__ import annotations

import bz2
import io
import sqlite3
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from lrtrav_ros.io.zstd_files import decompressed

Report = Callable[[str], None]


class RawMessage(NamedTuple):
    """A message as it stands in a file: ROS 1 or CDR bytes; `definition` is the text of its type, if it is known."""

    topic: str
    type: str
    definition: str
    time_ns: int
    data: bytes


def intact_messages(path: Path, kind: str, report: Report) -> Iterator[RawMessage]:
    """Yield the messages of a file in file order, without the use of an index.

    Parameters
    ----------
    path : Path
        File that is not compressed as a whole.
    kind : str
        ``rosbag1``, ``mcap`` or ``sqlite3``.
    report : callable
        Is called with what is damaged; the file's name stands before it.
    """
    if kind == "sqlite3":
        yield from _sqlite_messages(path, report)
        return
    with path.open("rb") as file:
        if kind == "mcap":
            file.seek(8)
            yield from _mcap_messages(_guarded(_mcap_records, file, report))
        else:
            file.readline()
            yield from _bag_messages(_guarded(_bag_records, file, report))


Record = tuple[dict[bytes, bytes], bytes]
_Records = Callable[[BinaryIO, Report], Iterator[Record]]


def _guarded(records: _Records, file: BinaryIO, report: Report) -> Iterator[Record]:
    """Yield records up to the first one that is not whole, and report that."""
    try:
        yield from records(file, report)
    except (EOFError, ValueError, struct.error, KeyError):
        report(f"cut off or damaged before byte {file.tell()}")


def _mcap_records(file: BinaryIO, report: Report) -> Iterator[Record]:
    """Yield opcode and content of each record of an MCAP file, those inside of chunks too."""
    while start := file.read(9):
        opcode, size = struct.unpack("<BQ", start)
        content = _read(file, size)
        if opcode == 0x06:
            (name_size,) = struct.unpack_from("<I", content, 28)
            compression = content[32 : 32 + name_size].decode()
            yield from _chunk(_mcap_records, content[40 + name_size :], compression, report)
        elif len(content) == size:
            yield {b"op": start[:1]}, content
        if len(content) < size:
            raise EOFError
        if opcode == 0x02:
            return


def _mcap_messages(records: Iterator[Record]) -> Iterator[RawMessage]:
    """Yield the messages among the records of an MCAP file."""
    schemas: dict[int, tuple[str, str]] = {}
    channels: dict[int, tuple[str, str, str]] = {}
    for header, content in records:
        opcode = header[b"op"][0]
        if opcode == 0x03:
            schemas[struct.unpack_from("<H", content)[0]] = _mcap_schema(content)
        elif opcode == 0x04:
            channel, schema = struct.unpack_from("<HH", content)
            channels[channel] = (_mcap_string(content, 4), *schemas.get(schema, ("", "")))
        elif opcode == 0x05:
            channel, _, time_ns, _ = struct.unpack_from("<HIQQ", content)
            if channel in channels:
                yield RawMessage(*channels[channel], time_ns, content[22:])


def _mcap_schema(content: bytes) -> tuple[str, str]:
    """Return name and text of a type."""
    name = _mcap_string(content, 2)
    encoding_at = 2 + 4 + len(name.encode())
    text_at = encoding_at + 4 + len(_mcap_string(content, encoding_at).encode())
    return name, _mcap_string(content, text_at)


def _mcap_string(content: bytes, offset: int) -> str:
    (size,) = struct.unpack_from("<I", content, offset)
    return content[offset + 4 : offset + 4 + size].decode()


def _bag_records(file: BinaryIO, report: Report) -> Iterator[Record]:
    """Yield header and data of each record of a ROS 1 bag, those inside of chunks too."""
    while start := file.read(4):
        header_size = struct.unpack("<I", start)[0]
        header = _bag_fields(_whole(file, header_size))
        size = struct.unpack("<I", _whole(file, 4))[0]
        data = _read(file, size)
        if header[b"op"] == b"\x05":
            yield from _chunk(_bag_records, data, header[b"compression"].decode(), report)
        elif len(data) == size:
            yield header, data
        if len(data) < size:
            raise EOFError


def _bag_fields(data: bytes) -> dict[bytes, bytes]:
    """Return the fields of a ROS 1 header, each of which is its size and name=value."""
    fields, position = {}, 0
    while position < len(data):
        end = position + 4 + struct.unpack_from("<I", data, position)[0]
        name, _, value = data[position + 4 : end].partition(b"=")
        fields[name] = value
        position = end
    return fields


def _bag_messages(records: Iterator[Record]) -> Iterator[RawMessage]:
    """Yield the messages among the records of a ROS 1 bag."""
    connections: dict[bytes, tuple[str, str, str]] = {}
    for header, data in records:
        if header[b"op"] == b"\x07":
            fields = _bag_fields(data)
            package, _, name = fields[b"type"].decode().rpartition("/")
            definition = fields[b"message_definition"].decode(errors="replace")
            connections[header[b"conn"]] = (header[b"topic"].decode(), f"{package}/msg/{name}", definition)
        elif header[b"op"] == b"\x02" and header[b"conn"] in connections:
            seconds, nanoseconds = struct.unpack("<II", header[b"time"])
            yield RawMessage(*connections[header[b"conn"]], seconds * 10**9 + nanoseconds, data)


def _sqlite_messages(path: Path, report: Report) -> Iterator[RawMessage]:
    """Yield the messages of a database up to the first page that is missing."""
    database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        # SQLite refuses a file that is shorter than its header says, except in this mode, which is meant for repairs.
        database.execute("PRAGMA writable_schema=ON")
        topics = {number: names for number, *names in database.execute("SELECT id, name, type FROM topics")}
        for topic, time_ns, data in database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
            name, kind = topics[topic]
            yield RawMessage(name, kind, "", time_ns, data)
    except (sqlite3.DatabaseError, KeyError) as err:
        report(f"cut off or damaged ({err})")
    finally:
        database.close()


def _chunk(records: _Records, data: bytes, compression: str, report: Report) -> Iterator[Record]:
    """Yield the records of a chunk, or of the part of one that is there."""
    try:
        unpacked = _unpacked(data, compression)
    except Exception as err:
        report(f"a chunk cannot be decompressed ({err})")
        return
    yield from _guarded(records, io.BytesIO(unpacked), lambda _: report("a chunk is cut off or damaged"))


def _unpacked(data: bytes, compression: str) -> bytes:
    """Decompress as much as there is."""
    if compression in ("", "none"):
        return data
    if compression == "bz2":
        return bz2.BZ2Decompressor().decompress(data)
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data))
    if compression == "zstd":
        return decompressed(data)
    raise ValueError(f"compression {compression!r} is not known")


def _whole(file: BinaryIO, size: int) -> bytes:
    """Read `size` bytes; raise EOFError where there are fewer."""
    data = _read(file, size)
    if len(data) < size:
        raise EOFError
    return data


def _read(file: BinaryIO, size: int) -> bytes:
    """Read `size` bytes or what is left: a damaged size may be larger than all memory."""
    position = file.tell()
    rest = file.seek(0, io.SEEK_END) - position
    file.seek(position)
    return file.read(min(size, rest))
