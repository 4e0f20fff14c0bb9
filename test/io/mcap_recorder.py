"""MCAP files as ROS 2's recorder writes them: chunks of any compression, with checksums."""

import struct
from pathlib import Path
from zlib import crc32

import lz4.frame

from lrtrav_ros.io.zstd_files import zstd

MAGIC = b"\x89MCAP0\r\n"
PACKERS = {"": bytes, "lz4": lz4.frame.compress, "zstd": zstd.compress}


def text(value):
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def write_mcap(
    path, topics, messages, *, compression="", per_chunk=8, crc=True, indexed=True, packed=None, statistics=True
):
    """Write messages, of `topics` (name to type and definition), given as (topic, time, data) in the order of time.

    `packed` takes a chunk's records in place of what `compression` names; without `indexed` there is no summary.
    """
    numbers = {topic: i + 1 for i, topic in enumerate(topics)}
    definitions = b"".join(
        record(3, struct.pack("<H", numbers[topic]) + text(kind) + text("ros2msg") + text(definition))
        + record(4, struct.pack("<HH", numbers[topic], numbers[topic]) + text(topic) + text("cdr") + text(""))
        for topic, (kind, definition) in topics.items()
    )
    data = MAGIC + record(1, text("ros2") + text("test"))
    summary = definitions
    for at in range(0, len(messages), per_chunk):
        part = messages[at : at + per_chunk]
        content, offsets = definitions, {}
        for topic, time_ns, payload in part:
            offsets.setdefault(numbers[topic], []).append((time_ns, len(content)))
            content += record(5, struct.pack("<HIQQ", numbers[topic], 0, time_ns, time_ns) + payload)
        compressed = (packed or PACKERS[compression])(content)
        times = [time_ns for _, time_ns, _ in part]
        start = len(data)
        checksum = crc32(content) if crc else 0
        data += record(
            6,
            struct.pack("<QQQI", min(times), max(times), len(content), checksum)
            + text(compression)
            + struct.pack("<Q", len(compressed))
            + compressed,
        )
        length = len(data) - start
        index_start, places = len(data), b""
        for number, entries in offsets.items():
            places += struct.pack("<HQ", number, len(data))
            listed = b"".join(struct.pack("<QQ", *entry) for entry in entries)
            data += record(7, struct.pack("<HI", number, len(listed)) + listed)
        summary += record(
            8,
            struct.pack("<QQQQI", min(times), max(times), start, length, len(places))
            + places
            + struct.pack("<Q", len(data) - index_start)
            + text(compression)
            + struct.pack("<QQ", len(compressed), len(content)),
        )
    if statistics:
        summary += _statistics(messages, numbers, -(-len(messages) // per_chunk))
    data += record(15, struct.pack("<I", crc32(data) if crc else 0))
    if not indexed:
        Path(path).write_bytes(data + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC)
        return
    summary_start = len(data)
    end = summary + struct.pack("<BQQQ", 2, 20, summary_start, 0)
    Path(path).write_bytes(data + end + struct.pack("<I", crc32(end) if crc else 0) + MAGIC)


def _statistics(messages, numbers, n_chunks):
    counts = b"".join(
        struct.pack("<HQ", number, sum(name == topic for name, *_ in messages)) for topic, number in numbers.items()
    )
    times = [time_ns for _, time_ns, _ in messages]
    fixed = struct.pack("<QHIIIIQQ", len(messages), len(numbers), len(numbers), 0, 0, n_chunks, min(times), max(times))
    return record(11, fixed + struct.pack("<I", len(counts)) + counts)
