"""The files of a recording: which there are, and the messages of each by its index, or without it where it is lost."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath

import yaml
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import ConnectionExtRosbag2, Qos

from lrtrav_ros.io.damaged_bags import RawMessage, Report, intact_messages
from lrtrav_ros.io.zstd_files import decompress_file, first_bytes, is_zstd_file

_MAGIC = {b"#ROSBAG V2.0": "rosbag1", b"\x89MCAP0\r\n": "mcap", b"SQLite format 3\0": "sqlite3"}
_SUFFIXES = {"rosbag1": ".bag", "mcap": ".mcap", "sqlite3": ".db3"}
_COMPRESSED_SUFFIXES = (".zstd", ".zst")


def storage_format(path: Path) -> str | None:
    """Return ``rosbag1``, ``mcap`` or ``sqlite3`` by what a file or its decompressed content begins with, or None."""
    start = first_bytes(path, 16)
    return next((name for magic, name in _MAGIC.items() if start.startswith(magic)), None)


def recording_files(path: Path, report: Report) -> list[Path]:
    """Return the files of a recording that hold messages, in the order in which they were written.

    Parameters
    ----------
    path : Path
        A file, or a folder: then the files that its metadata.yaml lists, or all where there is none.
    report : callable
        Is called with what is missing.
    """
    if path.is_file():
        return [path] if storage_format(path) else []
    found = [file for file in path.iterdir() if file.is_file() and storage_format(file)]
    # Who compresses a file may leave the original, or was interrupted; either way that is the one to read.
    names = {file.name for file in found}
    found = [file for file in found if file.suffix not in _COMPRESSED_SUFFIXES or file.stem not in names]
    if listed := _listed_names(path / "metadata.yaml", report):
        for name in listed:
            if not any(_is_same(file.name, name) for file in found):
                report(f"{path / name}: is missing or damaged, though metadata.yaml lists it")
        found = [file for file in found if any(_is_same(file.name, name) for name in listed)] or found
    return sorted(found, key=_numbered)


def _listed_names(path: Path, report: Report) -> list[str]:
    """Return the names of the files that a recording's metadata list; none where there are no metadata."""
    if not path.exists():
        return []
    try:
        metadata = yaml.safe_load(path.read_text(encoding="utf-8"))
        return [PurePath(name).name for name in metadata["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError) as err:
        report(f"{path}: damaged ({' '.join(str(err).split())}); all files beside it are read")
        return []


def _is_same(name: str, listed: str) -> bool:
    """Return whether a file is the listed one, compressed or decompressed since or not."""
    plain, listed_plain = (
        text.removesuffix(_COMPRESSED_SUFFIXES[0]).removesuffix(_COMPRESSED_SUFFIXES[1]) for text in (name, listed)
    )
    return plain == listed_plain


def _numbered(path: Path) -> list[int | str]:
    """Return a key that sorts name_2 before name_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


class BagFile:
    """A file of a recording that is open for reading.

    Parameters
    ----------
    path : Path
        A file that `storage_format` knows.
    folder : Path
        Where to write what the file holds if it is compressed.
    report : callable
        Is called with what is damaged, now and later.

    Attributes
    ----------
    is_ros1 : bool
        Whether its messages are those of ROS 1.
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

    def __init__(self, path: Path, folder: Path, report: Report) -> None:
        self._report: Report = lambda text: report(f"{path}: {text}")
        self._kind = storage_format(path) or ""
        self._path = self._plain_file(path, folder)
        self.is_ros1 = self._kind == "rosbag1"
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.definitions: dict[str, str] = {}
        self.qos: dict[str, Sequence[Qos]] = {}
        self.start_ns = self.end_ns = 0
        self._reader: rosbag1.Reader | rosbag2.Reader | None = None
        try:
            self._open()
        except PermissionError:
            raise
        except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged files
            self._reader = None
            self._report(f"damaged or not finished ({reason(err)}); read as far as it is intact")
            self._scan()

    def close(self) -> None:
        """Close the file."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def messages(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        """Yield the messages on topics, at a time or later, in order of time (without index: in order of the file)."""
        is_indexed = self._reader is not None
        done: set[str] = set()  # topics of the messages at the last time
        if is_indexed:
            try:
                for raw in self._indexed(topics, start_ns):
                    done = done | {raw.topic} if raw.time_ns == start_ns else {raw.topic}
                    start_ns = raw.time_ns
                    yield raw
                return
            except Exception as err:  # see above; the consumer's own errors do not come here
                self._report(f"damaged ({reason(err)}); read as far as it is intact")
        for raw in intact_messages(self._path, self._kind, self._report if is_indexed else _ignore):
            if raw.topic not in topics:
                continue
            if raw.time_ns > start_ns or (raw.time_ns == start_ns and raw.topic not in done):
                yield raw

    def _plain_file(self, path: Path, folder: Path) -> Path:
        """Return the file itself, or one with what it holds where it is compressed."""
        if not is_zstd_file(path):
            return path
        plain = (folder / path.name.removesuffix(path.suffix)).with_suffix(_SUFFIXES[self._kind])
        if problem := decompress_file(path, plain):
            self._report(f"cut off or damaged ({problem}); read as far as it can be decompressed")
        return plain

    def _open(self) -> None:
        """Open by index, and fill in what it says."""
        reader = rosbag1.Reader(self._path) if self.is_ros1 else rosbag2.Reader(self._path)
        reader.open()
        self._reader = reader
        for connection in reader.connections:
            self.topics[connection.topic] = connection.msgtype
            self.counts[connection.topic] = self.counts.get(connection.topic, 0) + connection.msgcount
            self.definitions[connection.msgtype] = connection.msgdef.data
            if isinstance(connection.ext, ConnectionExtRosbag2):
                self.qos[connection.topic] = connection.ext.offered_qos_profiles
        if any(self.counts.values()):
            self.start_ns, self.end_ns = reader.start_time, reader.end_time - 1

    def _scan(self) -> None:
        """Read the file once without index, to know its topics, counts and times."""
        times: list[int] = []
        for raw in intact_messages(self._path, self._kind, self._report):
            self.topics[raw.topic] = raw.type
            self.counts[raw.topic] = self.counts.get(raw.topic, 0) + 1
            self.definitions[raw.type] = raw.definition
            times = [min([raw.time_ns, *times]), max([raw.time_ns, *times])]
        if times:
            self.start_ns, self.end_ns = times

    def _indexed(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        assert self._reader is not None
        connections = [connection for connection in self._reader.connections if connection.topic in topics]
        if connections:
            for connection, time_ns, data in self._reader.messages(connections, start=start_ns):
                yield RawMessage(connection.topic, connection.msgtype, "", time_ns, data)


def reason(err: Exception) -> str:
    """Return what an error says, or its kind where it says nothing."""
    return str(err) or type(err).__name__


def _ignore(text: str) -> None:
    """Do not report what has been reported."""
