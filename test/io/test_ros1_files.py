"""Bags of ROS 1 whose index or records are damaged."""

import bz2
import struct

import pytest
from recorder import START_NS, Recorder
from rosbags import rosbag1

from lrtrav_ros.io import ros1_files
from lrtrav_ros.io.bag_reader import BagReader


@pytest.fixture
def path(tmp_path):
    """A bag of four chunks with two messages each."""
    recorder = Recorder(tmp_path / "bag.bag", "rosbag1")
    recorder.bag.chunk_threshold = 700
    for i in range(4):
        recorder.infos(START_NS + i)
    recorder.close()
    return recorder.path


def times(path):
    """Return the times of the messages, and the problems."""
    with BagReader(path) as reader:
        return [message.time_ns - START_NS for message in reader.messages()], reader.problems


def header(**fields):
    parts = [name.encode() + b"=" + value for name, value in fields.items()]
    data = b"".join(struct.pack("<I", len(part)) + part for part in parts)
    return struct.pack("<I", len(data)) + data


@pytest.mark.parametrize("n_chunks", [0, 3])
def test_chunks_that_the_index_does_not_list_are_read(n_chunks, path):
    data = path.read_bytes()
    assert times(path) == ([0, 0, 1, 1, 2, 2, 3, 3], [])
    start = data.index(b"chunk_count=")
    path.write_bytes(data[: start + 12] + struct.pack("<I", n_chunks) + data[start + 16 :])
    found, problems = times(path)
    assert found == [0, 0, 1, 1, 2, 2, 3, 3]
    if n_chunks:
        assert "its index lists 3 chunks, but there are 5" in problems[0]


def test_counts_that_contradict_each_other_are_told(path):
    data = path.read_bytes()
    listed = data.index(struct.pack("<II", 0, 1), data.rindex(b"chunk_pos"))
    path.write_bytes(data[:listed] + struct.pack("<II", 5, 1) + data[listed + 8 :])
    found, problems = times(path)
    assert found == [0, 0, 1, 1, 2, 2, 3, 3]
    assert "counts contradict each other" in problems[0]


@pytest.mark.parametrize("name", [b"message_definition=", b"type=", b"topic=", b"conn=", b"op=\2"])
def test_a_record_without_a_field_is_told(name, path):
    data = path.read_bytes()
    path.write_bytes(data.replace(name, b"x" + name[1:]))
    found, problems = times(path)
    assert len(found) < 8
    assert "damaged" in problems[0]


def test_a_chunk_may_not_hold_more_than_it_says(tmp_path):
    path = tmp_path / "bag.bag"
    packed = bz2.compress(bytes(30_000_000))
    counts = {"conn_count": struct.pack("<I", 0), "chunk_count": struct.pack("<I", 0)}
    path.write_bytes(
        b"#ROSBAG V2.0\n"
        + header(op=b"\3", index_pos=bytes(8), **counts)
        + bytes(4)
        + header(op=b"\5", compression=b"bz2", size=struct.pack("<I", 1000))
        + struct.pack("<I", len(packed))
        + packed
    )
    found, problems = times(path)
    assert found == []
    assert "holds more than 1000 bytes when decompressed" in " ".join(problems)


def test_a_record_is_bounded_where_its_size_is_damaged(path, monkeypatch):
    monkeypatch.setattr(ros1_files, "MAX_RECORD_BYTES", 50_000)
    whole = path.read_bytes()
    (index,) = struct.unpack_from("<Q", whole, whole.index(b"index_pos=") + 10)
    start = whole[:index] + header(op=b"\x09") + struct.pack("<I", (1 << 32) - 1)
    path.write_bytes(start + bytes(200_000))
    found, problems = times(path)
    assert len(found) == 8
    assert problems[-1] == f"{path}: cut off or damaged before byte {len(start) + 50_000}"


@pytest.mark.parametrize("definition", ["uint8[" + "9" * 5000 + "] a\n", "\0", "uint8 a\n" * 10_000, "own/Own a\n"])
def test_a_type_that_cannot_be_understood_costs_its_own_messages_only(definition, tmp_path):
    path = tmp_path / "bag.bag"
    with rosbag1.Writer(path) as bag:
        own = bag.add_connection("/own", "own/msg/Own", msgdef=definition, md5sum="0" * 32)
        other = bag.add_connection("/other", "std_msgs/msg/String", msgdef="string data\n", md5sum="0" * 32)
        for i in range(3):
            bag.write(own, i, b"\0")
            bag.write(other, i, b"\1\0\0\0a")
    with BagReader(path) as reader:
        assert [message.topic for message in reader.messages()] == ["/other"] * 3
        assert any("own/msg/Own" in problem or "/own" in problem for problem in reader.problems)
        assert reader.problems[-1].endswith("(and 2 more like it)")
