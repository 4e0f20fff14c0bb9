"""Recordings in several files, compressed ones, and ones without metadata."""

import tempfile

import pytest
import yaml
from recorder import START_NS, Recorder, assert_same, make_frames, storage_file
from rosbags import rosbag2

from lrtrav_ros.io import zstd_files
from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.io.bag_writer import write_stereo_bag
from lrtrav_ros.io.zstd_files import zstd

KINDS = {"mcap": ".mcap", "sqlite3": ".db3"}
MODES = [
    ("mcap", "NONE"),
    ("mcap", "STORAGE"),
    ("mcap", "MESSAGE"),
    ("mcap", "FILE"),
    ("sqlite3", "NONE"),
    ("sqlite3", "MESSAGE"),
    ("sqlite3", "FILE"),
]


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """The folder that temporary files are made in."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def compressed_bag(path, frames, kind, mode):
    """Write a ROS 2 bag as a recorder does; `STORAGE` compresses the chunks of an MCAP file."""
    with pytest.MonkeyPatch.context() as patch:
        original = rosbag2.Writer.__init__

        def initialize(self, *args, **options):
            original(self, *args, **options)
            self.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat.ZSTD)

        patch.setattr(rosbag2.Writer, "__init__", initialize)
        write_stereo_bag(path, frames, format=kind)
    return path


def split_bag(path, parts, kind, mode):
    """Write each part (by its number) as a bag, and join them to one of several files, as a recorder does."""
    path.mkdir()
    merged = None
    for i, frames in parts.items():
        part = compressed_bag(path.with_name(f"part{i}"), frames, kind, mode)
        suffix = ".zstd" if mode == "FILE" else ""
        name = f"{path.name}_{i}{KINDS[kind]}{suffix}"
        storage_file(part).rename(path / name)
        metadata = yaml.safe_load((part / "metadata.yaml").read_text())
        info = metadata["rosbag2_bagfile_information"]
        info["relative_file_paths"] = [name]
        info["files"][0]["path"] = name
        if merged is None:
            merged = info
            continue
        start, end = (
            pick(
                bag["starting_time"]["nanoseconds_since_epoch"] + (bag["duration"]["nanoseconds"] if pick is max else 0)
                for bag in (merged, info)
            )
            for pick in (min, max)
        )
        merged["starting_time"]["nanoseconds_since_epoch"] = start
        merged["duration"]["nanoseconds"] = end - start
        merged["message_count"] += info["message_count"]
        merged["relative_file_paths"] += [name]
        merged["files"] += info["files"]
        for topic, other in zip(merged["topics_with_message_count"], info["topics_with_message_count"], strict=True):
            topic["message_count"] += other["message_count"]
    (path / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": merged}))
    return path


def assert_holds(path, frames, temporary):
    """Assert that a bag is read whole, with nothing to complain of and nothing left behind."""
    with StereoBag(path) as bag:
        assert len(bag) == len(frames)
        for frame, written in zip(bag.frames(), frames, strict=True):
            assert_same(frame, written)
        assert bag.problems == []
        assert (bag.reader.start_ns, bag.reader.end_ns) == (frames[0].stamp_ns, frames[-1].stamp_ns)
        assert sum(bag.reader.counts.values()) == 4 * len(frames)
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("has_metadata", [True, False])
@pytest.mark.parametrize(("kind", "mode"), MODES)
def test_a_compressed_recording_is_read(kind, mode, has_metadata, tmp_path, temporary):
    frames = make_frames(3)
    path = compressed_bag(tmp_path / "bag", frames, kind, mode)
    if not has_metadata:
        (path / "metadata.yaml").unlink()
    assert_holds(path, frames, temporary)


@pytest.mark.parametrize("has_metadata", [True, False])
@pytest.mark.parametrize(("kind", "mode"), MODES)
def test_a_split_recording_is_read_in_order_of_time(kind, mode, has_metadata, tmp_path, temporary):
    frames = make_frames(5)
    path = split_bag(tmp_path / "bag", {2: frames[:2], 9: frames[2:4], 10: frames[4:]}, kind, mode)
    if not has_metadata:
        (path / "metadata.yaml").unlink()
    assert_holds(path, frames, temporary)
    suffix = ".zstd" if mode == "FILE" else ""
    assert_holds(path / f"bag_9{KINDS[kind]}{suffix}", frames[2:4], temporary)


def test_files_side_by_side_are_read_in_order_of_time(tmp_path, temporary):
    frames = make_frames(6)
    path = split_bag(tmp_path / "bag", {0: frames[::2], 1: frames[1::2]}, "mcap", "NONE")
    assert_holds(path, frames, temporary)
    with BagReader(path) as reader:
        times = [message.time_ns for message in reader.messages(start_ns=frames[3].stamp_ns)]
    assert times == [frame.stamp_ns for frame in frames[3:] for _ in range(4)]


def test_a_missing_file_costs_its_own_messages_only(tmp_path):
    frames = make_frames(3)
    path = split_bag(tmp_path / "bag", {i: [frame] for i, frame in enumerate(frames)}, "sqlite3", "FILE")
    (path / "bag_1.db3.zstd").unlink()
    with StereoBag(path) as bag:
        assert [frame.name for frame in bag.frames()] == [frames[0].name, frames[2].name]
        assert bag.problems == [f"{path}/bag_1.db3.zstd: is missing or damaged, though metadata.yaml lists it"]


@pytest.mark.parametrize("data", [b"", bytes(5000)])
def test_a_file_that_begins_with_nothing_is_missed_without_metadata(data, tmp_path):
    frames = make_frames(3)
    path = split_bag(tmp_path / "bag", {i: [frame] for i, frame in enumerate(frames)}, "mcap", "NONE")
    (path / "metadata.yaml").unlink()
    (path / "._bag_0.mcap").write_bytes(b"of macOS")
    (path / "bag_1.mcap").write_bytes(data)
    with StereoBag(path) as bag:
        assert [frame.name for frame in bag.frames()] == [frames[0].name, frames[2].name]
        assert bag.problems == [f"{path}/bag_1.mcap: is no recording, or damaged from its start on"]


def test_a_file_that_is_there_compressed_and_not_is_read_once(tmp_path, temporary):
    frames = make_frames(3)
    path = compressed_bag(tmp_path / "bag", frames, "mcap", "NONE")
    file = storage_file(path)
    file.with_name(f"{file.name}.zstd").write_bytes(zstd.compress(file.read_bytes())[:5000])
    (path / "metadata.yaml").unlink()
    assert_holds(path, frames, temporary)


def test_files_that_metadata_do_not_list_are_left_out(tmp_path, temporary):
    frames = make_frames(4)
    path = compressed_bag(tmp_path / "bag", frames[:2], "mcap", "NONE")
    other = compressed_bag(tmp_path / "other", frames[2:], "mcap", "NONE")
    storage_file(other).rename(path / "other.mcap")
    assert_holds(path, frames[:2], temporary)


@pytest.mark.parametrize("text", ["{", "a: b", "- 1", "\x00"])
def test_damaged_metadata_are_done_without(text, tmp_path):
    frames = make_frames(2)
    path = compressed_bag(tmp_path / "bag", frames, "sqlite3", "MESSAGE")
    (path / "metadata.yaml").write_text(text)
    with StereoBag(path) as bag:
        assert [frame.name for frame in bag.frames()] == [frame.name for frame in frames]
        (problem,) = bag.problems
    assert problem.startswith(f"{path}/metadata.yaml: damaged (")


def test_a_recording_of_which_all_files_are_missing_is_refused(tmp_path):
    path = compressed_bag(tmp_path / "bag", make_frames(1), "mcap", "NONE")
    storage_file(path).unlink()
    with pytest.raises(ValueError, match=r"bag.mcap: is missing or damaged.*; .*: is no recording"):
        BagReader(path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_compressed_file_that_is_cut_off_yields_what_is_left(kind, tmp_path, temporary):
    frames = make_frames(40)
    path = compressed_bag(tmp_path / "bag", frames, kind, "FILE")
    file = storage_file(path)
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 7 // 10])
    with StereoBag(path) as bag:
        result = list(bag.frames())
        assert "cut off or damaged (Compressed file ended" in bag.problems[0]
        assert "damaged or not finished" in bag.problems[1]
    assert 15 <= len(result) <= 28  # a block, which is whole or lost, holds 128 KiB: 10 to 17 frames
    for frame, written in zip(result, frames, strict=False):
        assert_same(frame, written)
    assert list(temporary.iterdir()) == []


def test_a_compressed_message_that_is_damaged_is_skipped(tmp_path):
    frames = make_frames(3)
    path = compressed_bag(tmp_path / "bag", frames, "mcap", "MESSAGE")
    file = storage_file(path)
    data = bytearray(file.read_bytes())
    with BagReader(path) as reader:
        messages = list(reader.messages(["/left/image_rect"]))
    packed = zstd.compress(messages[1].data)
    at = data.index(packed)
    data[at + 4 : at + 12] = b"\xff" * 8
    file.write_bytes(data)
    with BagReader(path) as reader:
        assert [message.time_ns for message in reader.messages(["/left/image_rect"])] == [
            frames[0].stamp_ns,
            frames[2].stamp_ns,
        ]
        (problem,) = reader.problems
    assert f"message on /left/image_rect at {frames[1].stamp_ns} ns skipped" in problem


def test_a_full_disk_says_what_to_do(tmp_path, monkeypatch):
    path = compressed_bag(tmp_path / "bag", make_frames(1), "mcap", "FILE")

    def write(file, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(zstd_files.os, "write", write)
    with pytest.raises(OSError, match=r"bag.mcap.zstd: decompressing it into .*; set TMPDIR to a folder with more"):
        BagReader(path)


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_compressed_recordings_of_ros1_are_read(compression, tmp_path):
    recorder = Recorder(tmp_path / "bag.bag", "rosbag1", compression)
    recorder.infos()
    recorder.close()
    with BagReader(recorder.path) as reader:
        assert [(message.topic, message.time_ns) for message in reader.messages()] == [
            ("/left/camera_info", START_NS),
            ("/right/camera_info", START_NS),
        ]
        assert reader.problems == []


@pytest.mark.parametrize("names", [("drive_1.0.zst", "drive_1.1.zst"), ("a.mcap.zst", "a.mcap.zstd"), ("x" * 251,) * 2])
def test_compressed_files_of_any_names_are_told_apart(names, tmp_path, temporary):
    frames = make_frames(4)
    path = tmp_path / "bag"
    path.mkdir()
    for i, name in enumerate(dict.fromkeys(names)):
        part = storage_file(compressed_bag(tmp_path / f"part{i}", frames[2 * i : 2 * i + 2], "mcap", "NONE"))
        (path / f"{name.removesuffix('.zst')}.zst").write_bytes(zstd.compress(part.read_bytes()))
    assert_holds(path, frames[: 2 * len(set(names))], temporary)
