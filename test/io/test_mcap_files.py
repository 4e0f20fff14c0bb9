"""MCAP files with checksums, as ROS 2's recorder writes them."""

import bz2
import random
import struct

import lz4.frame
import pytest
from mcap_recorder import MAGIC, record, text, write_mcap

from lrtrav_ros.io import bag_records, mcap_files
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.io.zstd_files import zstd

TOPICS = {"/a": ("std_msgs/msg/String", "string data\n"), "/b": ("std_msgs/msg/Empty", "")}
MESSAGES = [("/a" if i % 3 else "/b", 100 + i, bytes([0, i] * 50)) for i in range(20)]


def contents(path, *topics, start_ns=None):
    """Return messages and problems."""
    with BagReader(path) as reader:
        return [
            (message.topic, message.time_ns, message.data)
            for message in reader.messages(topics or None, start_ns=start_ns)
        ], reader.problems


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
@pytest.mark.parametrize("options", [{}, {"indexed": False}, {"crc": False}, {"statistics": False}])
def test_whole_files_are_read(compression, options, tmp_path):
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, MESSAGES, compression=compression, per_chunk=6, **options)
    assert contents(path) == (MESSAGES, [])
    assert contents(path, "/b", start_ns=110) == ([m for m in MESSAGES if m[0] == "/b" and m[1] >= 110], [])
    with BagReader(path) as reader:
        assert (reader.start_ns, reader.end_ns, dict(reader.counts)) == (100, 119, {"/a": 13, "/b": 7})
        assert reader.definitions["std_msgs/msg/String"] == "string data\n"


def test_messages_of_chunks_that_overlap_come_in_order_of_time(tmp_path):
    path = tmp_path / "bag.mcap"
    mixed = [*MESSAGES[::2], *MESSAGES[1::2]]
    write_mcap(path, TOPICS, mixed, per_chunk=5)
    assert contents(path) == (MESSAGES, [])


def test_chunks_that_overlap_too_much_are_read_in_the_order_of_the_file(tmp_path, monkeypatch):
    path = tmp_path / "bag.mcap"
    mixed = [*MESSAGES[::2], *MESSAGES[1::2]]
    write_mcap(path, TOPICS, mixed, per_chunk=5)
    monkeypatch.setattr(mcap_files, "_MAX_HELD_BYTES", 1000)  # of ten messages
    assert contents(path) == (MESSAGES, [])
    monkeypatch.setattr(mcap_files, "_MAX_HELD_BYTES", 999)
    messages, problems = contents(path)
    assert messages == mixed
    assert problems == [
        f"{path}: damaged (more than 999 bytes of its chunks overlap in time; they stay unsorted); read as far as it "
        "is intact"
    ]
    write_mcap(path, TOPICS, MESSAGES, per_chunk=5)
    assert contents(path) == (MESSAGES, [])


@pytest.mark.parametrize("indexed", [True, False])
def test_a_chunk_that_does_not_match_its_checksum_is_left_out(indexed, tmp_path):
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, MESSAGES, per_chunk=5, indexed=indexed)
    data = path.read_bytes()
    path.write_bytes(data.replace(MESSAGES[7][2], MESSAGES[6][2]))
    messages, problems = contents(path)
    assert messages == [*MESSAGES[:5], *MESSAGES[10:]]
    assert "bag.mcap: the chunk of " in problems[0]
    assert "does not match its checksum" in problems[0]
    if indexed:
        assert problems[1:] == [
            f"{path}: 3 of the 13 messages on /a that are listed cannot be read",
            f"{path}: 2 of the 7 messages on /b that are listed cannot be read",
        ]


def test_a_summary_that_does_not_match_its_checksum_is_not_believed(tmp_path):
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, MESSAGES)
    data = bytearray(path.read_bytes())
    data[data.rindex(b"/a") + 1] = ord("c")
    path.write_bytes(data)
    messages, problems = contents(path)
    assert messages == MESSAGES
    assert problems == [
        f"{path}: damaged or not finished (its summary does not match its checksum); read as far as it is intact"
    ]


def test_messages_that_only_the_statistics_know_are_missed(tmp_path):
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, MESSAGES, crc=False)
    data = path.read_bytes()
    counted = struct.pack("<HQHQ", 1, 13, 2, 7)
    total = struct.pack("<QHII", 20, 2, 2, 0)
    data = data.replace(counted, struct.pack("<HQHQ", 1, 15, 2, 7)).replace(total, struct.pack("<QHII", 22, 2, 2, 0))
    path.write_bytes(data)
    assert contents(path) == (MESSAGES, [f"{path}: 2 of the 15 messages on /a that are listed cannot be read"])


def bomb(n_mebibytes):
    compressor = zstd.ZstdCompressor()
    zeros = bytes(1 << 20)
    return b"".join([*(compressor.compress(zeros) for _ in range(n_mebibytes)), compressor.flush()])


def test_a_chunk_may_not_hold_more_than_it_says(tmp_path):
    path = tmp_path / "bag.mcap"
    packed = bomb(64)
    write_mcap(path, TOPICS, MESSAGES, compression="zstd", per_chunk=20, packed=lambda _: packed)
    messages, problems = contents(path)
    assert messages == []
    assert "when decompressed" in problems[0]


def test_a_record_is_bounded_where_its_size_is_damaged(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap_files, "MAX_RECORD_BYTES", 2000)
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, MESSAGES, per_chunk=5)
    start = path.read_bytes().index(struct.pack("<BQ", 15, 4))
    path.write_bytes(path.read_bytes()[:start] + struct.pack("<BQ", 9, 1 << 40) + bytes(5000))
    messages, problems = contents(path)
    assert messages == MESSAGES
    assert problems[-1] == f"{path}: cut off or damaged before byte {start + 9 + 2000}"


def test_what_a_chunk_says_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(mcap_files, "MAX_UNPACKED_BYTES", 1000)
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, MESSAGES, compression="zstd", per_chunk=20)
    messages, problems = contents(path)
    assert messages == []
    assert "bytes when decompressed, more than 1000" in " ".join(problems)


def test_a_message_is_bounded_and_must_be_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("lrtrav_ros.io.bag_reader.MAX_UNPACKED_BYTES", 1 << 20)
    payloads = [zstd.compress(b"\0\1\0\0"), bomb(2), zstd.compress(bytes(500))[:-2]]
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, [("/a", 5 + i, payload) for i, payload in enumerate(payloads)])
    messages, problems = contents(path)
    assert messages == [("/a", 5, b"\0\1\0\0")]
    assert problems == [
        f"{path}: message on /a at 6 ns skipped (it holds more than 1048576 bytes when decompressed)",
        f"{path}: message on /a at 7 ns skipped (it is cut off)",
    ]


@pytest.mark.parametrize(
    "record_",
    [
        b"\3" + b"\xff" * 8 + b"abc",
        record(6, struct.pack("<QQQI", 1, 2, 0, 0) + text("lz5") + struct.pack("<Q", 0)),
        record(5, b"\1\0"),
        record(5, struct.pack("<HIQQ", 9, 0, 0, 0)),
        record(3, b"\1\0\xff\0\0\0"),
        record(4, b"\1\0\1\0" + b"\2\0\0\0\xff\xfe"),
        record(6, b"ab"),
        bytes(5000),
    ],
)
def test_a_record_that_is_none_costs_no_other(record_, tmp_path):
    path = tmp_path / "bag.mcap"
    write_mcap(path, TOPICS, MESSAGES, indexed=False)
    path.write_bytes(path.read_bytes()[: -len(MAGIC) - 29 - 13] + record_)
    messages, problems = contents(path)
    assert messages == MESSAGES
    assert len(problems) >= 2


def test_chunks_in_chunks_are_refused(tmp_path):
    inner = b""
    for _ in range(2000):
        inner = record(6, struct.pack("<QQQI", 1, 2, len(inner), 0) + text("") + struct.pack("<Q", len(inner)) + inner)
    path = tmp_path / "bag.mcap"
    path.write_bytes(MAGIC + record(1, text("ros2") + text("")) + inner)
    messages, problems = contents(path)
    assert messages == []
    assert "it holds another chunk" in " ".join(problems)


@pytest.mark.parametrize("compression", ["bz2", "lz4", "zstd"])
def test_damaged_compression_is_an_error_of_one_kind(compression):
    with pytest.raises(ValueError, match="cannot be decompressed"):
        bag_records.unpacked(b"\xff" * 100, compression)


PACKERS = {"bz2": bz2.compress, "lz4": lz4.frame.compress, "zstd": zstd.compress}


@pytest.mark.parametrize("compression", PACKERS)
def test_frames_one_after_another_are_unpacked(compression):
    parts = [b"", b"abc", random.Random(0).randbytes(100_000), bytes(1_000_000), b"d"]
    packed = b"".join(map(PACKERS[compression], parts))
    data = b"".join(parts)
    assert bag_records.unpacked(packed, compression, max_bytes=len(data)) == data
    assert data.startswith(bag_records.unpacked(packed[:-5], compression))
    with pytest.raises(ValueError, match=f"more than {len(data) - 1} bytes when decompressed"):
        bag_records.unpacked(packed, compression, max_bytes=len(data) - 1)


@pytest.mark.parametrize("compression", PACKERS)
def test_frames_are_bounded(compression):
    frame = PACKERS[compression](b"a")
    assert bag_records.unpacked(frame * 64, compression) == b"a" * 64
    with pytest.raises(ValueError, match="consists of more than 64 frames"):
        bag_records.unpacked(frame * 100_000, compression)
