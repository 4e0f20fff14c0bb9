"""The files of a recording: which there are, and the messages of each by its index, or without it where it is lost."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from lrtrav_ros.io.bag_metadata import BagMetadata, read_metadata
from lrtrav_ros.io.bag_records import MAX_TIME_NS, Contents, RawMessage, Report, UnindexedFileError
from lrtrav_ros.io.mcap_files import McapFile, scanned_mcap
from lrtrav_ros.io.ros1_files import Ros1File, scanned_ros1
from lrtrav_ros.io.sqlite_files import SqliteFile, scanned_sqlite
from lrtrav_ros.io.zstd_files import decompress_file, first_bytes, is_zstd_file

_MAGIC = {b"#ROSBAG V2.0": "rosbag1", b"\x89MCAP0\r\n": "mcap", b"SQLite format 3\0": "sqlite3"}
_SUFFIXES = {"rosbag1": ".bag", "mcap": ".mcap", "sqlite3": ".db3"}
_COMPRESSED_SUFFIXES = (".zstd", ".zst")
_SCANS = {"rosbag1": scanned_ros1, "mcap": scanned_mcap, "sqlite3": scanned_sqlite}


def storage_format(path: Path) -> str | None:
    """Return ``rosbag1``, ``mcap`` or ``sqlite3`` by what a file or its decompressed content begins with, or None."""
    start = first_bytes(path, 16)
    return next((name for magic, name in _MAGIC.items() if start.startswith(magic)), None)


def recording_files(path: Path, metadata: BagMetadata, report: Report) -> list[Path]:
    """Return the files of a recording that hold messages, in the order in which they were written.

    Parameters
    ----------
    path : Path
        A file, or a folder: then the files that its metadata list, or all where there are none.
    metadata : BagMetadata
        What its ``metadata.yaml`` says.
    report : callable
        Is called with what is missing.
    """
    if not path.is_dir():
        return [path] if path.is_file() and storage_format(path) else []
    found = [file for file in path.iterdir() if file.is_file() and storage_format(file)]
    # Who compresses a file may leave the original, or was interrupted; either way that is the one to read.
    names = {file.name for file in found}
    found = [file for file in found if file.suffix not in _COMPRESSED_SUFFIXES or file.stem not in names]
    plain, listed = ({_plain_name(name) for name in group} for group in (names, metadata.names))
    for name in metadata.names:
        if _plain_name(name) not in plain:
            report(f"{path / name}: is missing or damaged, though metadata.yaml lists it")
    for file in () if listed else sorted(path.iterdir()):
        if _is_named_as_recording(file.name) and _plain_name(file.name) not in plain:
            report(f"{file}: is no recording, or damaged from its start on")
    found = [file for file in found if _plain_name(file.name) in listed] or found
    return sorted(found, key=_numbered)


def recording_metadata(path: Path, report: Report) -> BagMetadata:
    """Return what the metadata of a recording say: nothing where there are none, or they are damaged."""
    file = path / "metadata.yaml"
    if not path.is_dir() or not file.exists():
        return BagMetadata()
    try:
        return read_metadata(file)
    except ValueError as err:
        report(f"{file}: damaged ({err}); all files beside it are read")
        return BagMetadata()


def _is_named_as_recording(name: str) -> bool:
    """Return whether a recorder gives files such names; those with a dot before them are of file systems."""
    return not name.startswith(".") and _plain_name(name).endswith(tuple(_SUFFIXES.values()))


def _plain_name(name: str) -> str:
    """Return the name of a file before it was compressed."""
    return name.removesuffix(_COMPRESSED_SUFFIXES[0]).removesuffix(_COMPRESSED_SUFFIXES[1])


def _numbered(path: Path) -> list[int | str]:
    """Return a key that sorts name_2 before name_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


class _IndexedFile(Protocol):
    """A file of a recording that is read by its index."""

    contents: Contents

    def messages(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        """Yield the messages on topics, at a time or later, in order of time."""

    def close(self) -> None:
        """Close the file."""


class BagFile:
    """A file of a recording that is open for reading.

    Parameters
    ----------
    path : Path
        A file that `storage_format` knows.
    stem : Path
        Where to write what the file holds if it is compressed, without suffix; no other file's.
    report : callable
        Is called with what is damaged, now and later.

    Attributes
    ----------
    is_ros1 : bool
        Whether its messages are those of ROS 1.
    contents : Contents
        What it holds.
    """

    def __init__(self, path: Path, stem: Path, report: Report) -> None:
        self._report: Report = lambda text: report(f"{path}: {text}")
        self._kind = storage_format(path) or ""
        self._path = self._plain_file(path, stem)
        self.is_ros1 = self._kind == "rosbag1"
        self._indexed: _IndexedFile | None = None
        try:
            self._indexed = self._open()
            self.contents = self._indexed.contents
        except PermissionError:
            raise
        except UnindexedFileError:
            self.contents = self._scanned_contents()
        except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged files
            self._report(f"damaged or not finished ({reason(err)}); read as far as it is intact")
            self.contents = self._scanned_contents()

    def close(self) -> None:
        """Close the file."""
        if self._indexed is not None:
            self._indexed.close()
            self._indexed = None

    def messages(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        """Yield the messages on topics, at a time or later, in order of time (without index: in order of the file).

        What is damaged is reported, and afterwards how many messages are missing that the index lists.
        """
        counts = dict.fromkeys(sorted(topics & self.contents.topics.keys()), 0)
        for raw in self._readable(topics, start_ns):
            if not 0 <= raw.time_ns < MAX_TIME_NS:
                self._report(f"a message on {raw.topic} is skipped: ROS 2 cannot tell its time, {raw.time_ns} ns")
                continue
            counts[raw.topic] = counts.get(raw.topic, 0) + 1
            yield raw
        if start_ns > self.contents.start_ns:
            return
        for topic, count in counts.items():
            listed = self.contents.counts[topic]
            if count < listed:
                self._report(f"{listed - count} of the {listed} messages on {topic} that are listed cannot be read")

    def _readable(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        """Yield what can be read: by the index as far as that goes, and then without it."""
        done: set[str] = set()  # topics of the messages at the last time
        if self._indexed is not None:
            try:
                for raw in self._indexed.messages(topics, start_ns):
                    done = done | {raw.topic} if raw.time_ns == start_ns else {raw.topic}
                    start_ns = raw.time_ns
                    yield raw
                return
            except Exception as err:  # see above; the consumer's own errors do not come here
                self._report(f"damaged ({reason(err)}); read as far as it is intact")
        for raw in _SCANS[self._kind](self._path, self._report):
            if raw.topic not in topics:
                continue
            if raw.time_ns > start_ns or (raw.time_ns == start_ns and raw.topic not in done):
                yield raw

    def _plain_file(self, path: Path, stem: Path) -> Path:
        """Return the file itself, or one with what it holds where it is compressed."""
        if not is_zstd_file(path):
            return path
        plain = stem.with_suffix(_SUFFIXES[self._kind])
        if problem := decompress_file(path, plain):
            self._report(f"cut off or damaged ({problem}); read as far as it can be decompressed")
        return plain

    def _open(self) -> _IndexedFile:
        """Open by index."""
        if self._kind == "mcap":
            return McapFile(self._path, self._report)
        return Ros1File(self._path) if self.is_ros1 else SqliteFile(self._path, self._report)

    def _scanned_contents(self) -> Contents:
        """Read the file once without index, to know its topics, counts and times."""
        contents = Contents()
        times: list[int] = []
        for raw in _SCANS[self._kind](self._path, self._report):
            contents.add(raw.topic, raw.type, 1)
            contents.definitions[raw.type] = raw.definition
            if 0 <= raw.time_ns < MAX_TIME_NS:
                times = [min([raw.time_ns, *times]), max([raw.time_ns, *times])]
        if times:
            contents.start_ns, contents.end_ns = times
        return contents


def reason(err: Exception) -> str:
    """Return in one line what an error says, or its kind where it says nothing."""
    return " ".join(str(err).split())[:300] or type(err).__name__
