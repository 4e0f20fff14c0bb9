"""Rosbags of any format, ROS 1 or 2, as serialised messages of ROS 2."""

from __future__ import annotations

import os
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from lrtrav_ros.io.damaged_bags import RawMessage, intact_messages, recording_files, storage_format


@dataclass(frozen=True, slots=True, eq=False)
class BagMessage:
    """A recorded message.

    Attributes
    ----------
    topic, type : str
        Such as ``/left/image_rect`` and ``sensor_msgs/msg/Image``.
    time_ns : int
        When it was received, in nanoseconds.
    data : bytes
        The message in CDR, as ROS 2 sends it.
    """

    topic: str
    type: str
    time_ns: int
    data: bytes


class BagReader:
    """A rosbag that is open for reading: a ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a ROS 2 bag.

    One that was cut off or damaged is read without its index, as far as its messages are intact; `problems` says so.

    Parameters
    ----------
    path : path
        File or folder; the format is told from the content.

    Attributes
    ----------
    topics : dict of str to str
        Type of each topic.
    counts : dict of str to int
        Number of messages on each topic.
    start_ns, end_ns : int
        Times of the first and last message; 0 for a recording without messages.
    problems : list of str
        What of the recording could not be read, as far as it has been read.

    Raises
    ------
    FileNotFoundError
        If there is no such file or folder.
    ValueError
        If it is no recording.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise FileNotFoundError(f"{self.path}: there is no such recording")
        self._files = recording_files(self.path)
        if not self._files and not (self.path / "metadata.yaml").exists():
            raise ValueError(f"{self.path}: is no recording; give a .bag, .mcap or .db3 file or a ROS 2 bag's folder")
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.start_ns = self.end_ns = 0
        self.problems: list[str] = []
        self._definitions: dict[str, str] = {}
        self._reader: rosbag1.Reader | rosbag2.Reader | None = None
        self._is_closed = False
        try:
            self._open()
        except PermissionError:
            raise
        except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged files
            self._reader = None
            self.problems.append(f"{self.path}: damaged or not finished ({_reason(err)}); read as far as it is intact")
            self._scan()
        self._typestore = _typestore(self._definitions)

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        self._is_closed = True

    def messages(
        self, topics: Collection[str] | None = None, *, start_ns: int | None = None
    ) -> Generator[BagMessage, None, None]:
        """Yield the messages in order of time (where the index is lost: in the order of the file).

        Parameters
        ----------
        topics : collection of str, optional
            Only these, thus nothing where it is empty; all by default.
        start_ns : int, optional
            Only messages at this time or later, in nanoseconds.

        Raises
        ------
        ValueError
            If the bag is closed.
        """
        if self._is_closed:
            raise ValueError(f"{self.path}: is closed; open it again to read it")
        start_ns = start_ns or 0
        done: set[str] = set()  # topics of the messages at the last time
        wanted = set(self.topics if topics is None else topics)
        if self._reader is not None:
            try:
                for raw in self._indexed(wanted, start_ns):
                    done = done | {raw.topic} if raw.time_ns == start_ns else {raw.topic}
                    start_ns = raw.time_ns
                    yield from self._converted(raw)
                return
            except Exception as err:  # see above; the consumer's own errors do not come here
                self.problems.append(f"{self.path}: damaged ({_reason(err)}); read as far as it is intact")
        for raw in self._intact(wanted, report=self._reader is not None):
            if raw.time_ns > start_ns or (raw.time_ns == start_ns and raw.topic not in done):
                yield from self._converted(raw)

    def _open(self) -> None:
        """Open by index, and fill in what it says."""
        is_bag1 = self.path.is_file() and storage_format(self.path) == "rosbag1"
        reader = rosbag1.Reader(self.path) if is_bag1 else rosbag2.Reader(self.path)
        reader.open()
        self._reader = reader
        for connection in reader.connections:
            self.topics[connection.topic] = connection.msgtype
            self.counts[connection.topic] = self.counts.get(connection.topic, 0) + connection.msgcount
            if is_bag1:
                self._definitions[connection.msgtype] = _text(connection.msgdef)
        if any(self.counts.values()):
            self.start_ns, self.end_ns = reader.start_time, reader.end_time - 1

    def _scan(self) -> None:
        """Read the recording once without index, to know its topics, counts and times."""
        times: list[int] = []
        for raw in self._intact(None, report=True):
            self.topics[raw.topic] = raw.type
            self.counts[raw.topic] = self.counts.get(raw.topic, 0) + 1
            if raw.definition:
                self._definitions[raw.type] = raw.definition
            times = [min([raw.time_ns, *times]), max([raw.time_ns, *times])]
        if times:
            self.start_ns, self.end_ns = times

    def _indexed(self, topics: set[str], start_ns: int) -> Iterator[RawMessage]:
        assert self._reader is not None
        connections = [connection for connection in self._reader.connections if connection.topic in topics]
        if connections:
            for connection, time_ns, data in self._reader.messages(connections, start=start_ns):
                yield RawMessage(connection.topic, connection.msgtype, "", time_ns, data)

    def _intact(self, topics: set[str] | None, *, report: bool) -> Iterator[RawMessage]:
        for path in self._files:
            reports: list[str] = []
            for raw in intact_messages(path, reports.append):
                if topics is None or raw.topic in topics:
                    yield raw
            if report:
                self.problems.extend(f"{path}: {text}" for text in reports)

    def _converted(self, raw: RawMessage) -> Iterator[BagMessage]:
        """Yield the message in CDR, unless it cannot be converted."""
        data: bytes | memoryview = raw.data
        if self._typestore is not None:
            try:
                data = self._typestore.ros1_to_cdr(data, raw.type)
            except Exception as err:  # see above
                self.problems.append(
                    f"{self.path}: message on {raw.topic} at {raw.time_ns} ns skipped ({_reason(err)})"
                )
                return
        yield BagMessage(raw.topic, raw.type, raw.time_ns, bytes(data))


def _typestore(definitions: dict[str, str]) -> Typestore | None:
    """Return the types that a ROS 1 bag defines; None for a ROS 2 one, of which messages need no conversion."""
    if not definitions:
        return None
    types = {}
    for kind, definition in definitions.items():
        types.update(get_types_from_msg(definition, kind))
    # rosbags drops the seq of ROS 1 by itself where the header is defined as in ROS 2.
    types.update(get_types_from_msg("builtin_interfaces/Time stamp\nstring frame_id\n", "std_msgs/msg/Header"))
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store


def _text(definition: object) -> str:
    """Return the text of a type's definition, which rosbags wraps since version 0.10.2 or so."""
    return str(getattr(definition, "data", definition))


def _reason(err: Exception) -> str:
    return str(err) or type(err).__name__
