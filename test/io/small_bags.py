"""Small bags of each format and compression, to be damaged."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mcap_recorder import write_mcap
from recorder import Recorder, record_pairs, storage_file

from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.io.zstd_files import zstd

N_MESSAGES = 8


@dataclass(frozen=True)
class SmallBag:
    """A bag of `N_MESSAGES`, and the file of it that is to be damaged."""

    path: Path
    file: Path
    has_checksums: bool = False


def _recorded(folder, kind, compression=None, *, mode="STORAGE", damaged=""):
    """Record a bag; of a folder all is read where one of its files is named."""
    recorder = Recorder(folder / ("a.bag" if kind == "rosbag1" else "a"), kind, compression, mode=mode)
    record_pairs(recorder, 3)
    recorder.close()
    if damaged:
        return SmallBag(recorder.path, recorder.path / damaged)
    return SmallBag(storage_file(recorder.path), storage_file(recorder.path))


def _content(folder):
    """Return topics and messages as `write_mcap` takes them."""
    with BagReader(_recorded(folder, "sqlite3").path) as reader:
        messages = [(message.topic, message.time_ns, message.data) for message in reader.messages()]
        return {topic: (kind, reader.definitions[kind]) for topic, kind in reader.topics.items()}, messages


def _mcap(folder, compression="", *, pack=bytes):
    topics, messages = _content(folder)
    messages = [(topic, time_ns, pack(data)) for topic, time_ns, data in messages]
    write_mcap(folder / "a.mcap", topics, messages, compression=compression, per_chunk=3)
    return SmallBag(folder / "a.mcap", folder / "a.mcap", has_checksums=True)


def _packed_mcap(folder):
    path = folder / "a.mcap.zstd"
    path.write_bytes(zstd.compress(_mcap(folder, "zstd").path.read_bytes()))
    return SmallBag(path, path, has_checksums=True)


def _split_mcap(folder):
    topics, messages = _content(folder)
    path = folder / "split"
    path.mkdir()
    for i, part in enumerate((messages[:5], messages[5:])):
        write_mcap(path / f"split_{i}.mcap", topics, part, per_chunk=3)
    return SmallBag(path, path / "split_0.mcap", has_checksums=True)


# Each is given a folder to write into.
SMALL_BAGS = {
    "bag": partial(_recorded, kind="rosbag1"),
    "bag, bz2": partial(_recorded, kind="rosbag1", compression="BZ2"),
    "bag, lz4": partial(_recorded, kind="rosbag1", compression="LZ4"),
    "db3": partial(_recorded, kind="sqlite3"),
    "db3, messages zstd": partial(_recorded, kind="sqlite3", compression="ZSTD", mode="MESSAGE"),
    "db3 in a folder": partial(_recorded, kind="sqlite3", damaged="a.db3"),
    "metadata.yaml": partial(_recorded, kind="sqlite3", damaged="metadata.yaml"),
    "mcap": _mcap,
    "mcap, lz4": partial(_mcap, compression="lz4"),
    "mcap, zstd": partial(_mcap, compression="zstd"),
    "mcap, messages zstd": partial(_mcap, pack=zstd.compress),
    "mcap, file zstd": _packed_mcap,
    "mcap, split": _split_mcap,
    "mcap without checksums": partial(_recorded, kind="mcap", compression="ZSTD"),
}
