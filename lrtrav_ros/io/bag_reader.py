"""Rosbags of any format, ROS 1 or 2, as serialised messages of ROS 2."""

from __future__ import annotations

import heapq
import os
from collections import Counter
from collections.abc import Collection, Generator, Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from lrtrav_ros.io.bag_files import BagFile, reason, recording_files
from lrtrav_ros.io.damaged_bags import RawMessage
from lrtrav_ros.io.zstd_files import decompressed, is_zstd, is_zstd_file


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

    The files of a folder are read together, with or without its metadata.yaml. Files that are compressed as a whole
    (``.zstd``) are decompressed into a temporary folder until the bag is closed; messages that are, one by one. A file
    that was cut off or damaged is read without its index, as far as its messages are intact; `problems` says so.

    Parameters
    ----------
    path : path
        File or folder; format and compression are told from the content.

    Attributes
    ----------
    topics : dict of str to str
        Type of each topic.
    counts : dict of str to int
        Number of messages on each topic.
    definitions : dict of str to str
        Text of each type, where the recording has it.
    qos : dict of str to sequence of rosbags.interfaces.Qos
        With which quality of service each topic was published, where the recording says so.
    typestore : rosbags.typesys.store.Typestore or None
        The types of a ROS 1 recording, as messages are converted; None for ROS 2.
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
        self.problems: list[str] = []
        paths = recording_files(self.path, self.problems.append)
        if not paths:
            raise ValueError(
                "; ".join([*self.problems, f"{self.path}: is no recording; give a .bag, .mcap or .db3 file, "])
                + "compressed or not, or a ROS 2 bag's folder"
            )
        self._is_closed = False
        self._folder = TemporaryDirectory(prefix="lrtrav_ros_") if any(map(is_zstd_file, paths)) else None
        self._files: list[BagFile] = []
        try:
            folder = Path(self._folder.name) if self._folder else self.path
            self._files.extend(BagFile(file, folder, self.problems.append) for file in paths)
        except BaseException:
            self.close()
            raise
        self.topics = {topic: kind for part in self._files for topic, kind in part.topics.items()}
        self.definitions = {kind: text for part in self._files for kind, text in part.definitions.items() if text}
        self.counts: Counter[str] = Counter()
        for part in self._files:
            self.counts.update(part.counts)
        full = [part for part in self._files if any(part.counts.values())]
        self.start_ns = min((part.start_ns for part in full), default=0)
        self.end_ns = max((part.end_ns for part in full), default=0)
        self.qos = {topic: qos for part in self._files for topic, qos in part.qos.items()}
        is_ros1 = any(part.is_ros1 for part in self._files)
        self.typestore = _typestore(self.definitions) if is_ros1 else None

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for file in self._files:
            file.close()
        if self._folder is not None:
            self._folder.cleanup()
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
        wanted = set(self.topics if topics is None else topics)
        parts = [_lazy_messages(file, wanted, start_ns or 0) for file in self._files]
        for _, raw in heapq.merge(*parts, key=itemgetter(0)):
            if raw is not None:
                yield from self._converted(raw)

    def _converted(self, raw: RawMessage) -> Iterator[BagMessage]:
        """Yield the message in CDR, unless it cannot be converted."""
        data: bytes | memoryview = raw.data
        try:
            if self.typestore is not None:
                data = self.typestore.ros1_to_cdr(data, raw.type)
            elif is_zstd(data):  # which metadata need not say
                data = decompressed(data)
        except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged messages
            self.problems.append(f"{self.path}: message on {raw.topic} at {raw.time_ns} ns skipped ({reason(err)})")
            return
        yield BagMessage(raw.topic, raw.type, raw.time_ns, bytes(data))


def _lazy_messages(file: BagFile, topics: set[str], start_ns: int) -> Iterator[tuple[int, RawMessage | None]]:
    """Yield the times and messages of a file after its own start, so that it is not read before its turn."""
    yield file.start_ns, None
    for raw in file.messages(topics, start_ns):
        yield raw.time_ns, raw


def _typestore(definitions: Mapping[str, str]) -> Typestore:
    """Return the types that a ROS 1 bag defines."""
    types = {}
    for kind, definition in definitions.items():
        types.update(get_types_from_msg(definition, kind))
    # rosbags drops the seq of ROS 1 by itself where the header is defined as in ROS 2.
    types.update(get_types_from_msg("builtin_interfaces/Time stamp\nstring frame_id\n", "std_msgs/msg/Header"))
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store
