"""Rosbags of any format, ROS 1 or 2, as serialised messages of ROS 2."""

from __future__ import annotations

import errno
import heapq
import os
import resource
from collections import Counter
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass
from functools import lru_cache
from operator import itemgetter
from pathlib import Path
from types import TracebackType

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from lrtrav_ros.io.bag_files import BagFile, reason, recording_files, recording_metadata
from lrtrav_ros.io.bag_metadata import BagMetadata
from lrtrav_ros.io.bag_records import MAX_UNPACKED_BYTES, RawMessage
from lrtrav_ros.io.problems import Problems
from lrtrav_ros.io.temporary_folder import TemporaryFolder
from lrtrav_ros.io.zstd_files import decompressed, is_zstd, is_zstd_file

_OTHER_FILES = 64  # that a process may need to open beside those of a recording

MAX_DEFINITION_CHARACTERS = 1 << 16
"""What the text of a type may take, which an image's does a sixteenth of: rosbags is slow at reading it."""


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
    that was cut off or damaged is read without its index, as far as its messages are intact; `problems` says so. What
    checksums an MCAP file has are checked: a chunk that does not match its own is left out. The other formats have
    none, so that an altered message is not always noticed.

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
        What of the recording is damaged or could not be read, as far as it has been read: all there is where empty.
        Problems that are alike are told once, with their number.

    Raises
    ------
    FileNotFoundError
        If there is no such file or folder.
    ValueError
        If it is no recording.
    OSError
        If a file cannot be read, or it has more files than a process may open.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise FileNotFoundError(f"{self.path}: there is no such recording")
        self._problems = Problems()
        metadata = recording_metadata(self.path, self._problems.add)
        paths = self._paths(metadata)
        _allow_open_files(self.path, len(paths))
        self._is_closed = False
        self._folder = TemporaryFolder() if any(map(is_zstd_file, paths)) else None
        self._files: list[BagFile] = []
        try:
            folder = self._folder.path if self._folder else self.path
            self._files.extend(BagFile(file, folder / str(i), self._problems.add) for i, file in enumerate(paths))
            self._fill_contents(metadata)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def problems(self) -> list[str]:
        """What is damaged or could not be read up to now, one line each."""
        return self._problems.lines()

    def report_unreadable(self, message: BagMessage | RawMessage, problem: str) -> None:
        """Note that a message is not what its type says, which counts as damage."""
        self._problems.add(
            f"{self.path}: message on {message.topic} at {message.time_ns} ns skipped ({problem})",
            kind=f"{message.topic}: {problem}",
            case=message.time_ns,
        )

    def close(self) -> None:
        """Close the files."""
        for file in self._files:
            file.close()
        if self._folder is not None:
            self._folder.close()
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

    def _paths(self, metadata: BagMetadata) -> list[Path]:
        """Return the files of the recording; raises ValueError where there are none."""
        paths = recording_files(self.path, metadata, self._problems.add)
        if not paths:
            remedy = (
                f"{self.path}: is no recording; give a .bag, .mcap or .db3 file, compressed or not, or a ROS 2 bag's"
            )
            raise ValueError("; ".join([*self.problems, f"{remedy} folder"]))
        return paths

    def _fill_contents(self, metadata: BagMetadata) -> None:
        """Join what the files hold, and compare it with what the metadata list."""
        parts = [file.contents for file in self._files]
        self.topics = {topic: kind for part in reversed(parts) for topic, kind in part.topics.items()}
        self.definitions = {kind: text for part in parts for kind, text in part.definitions.items() if text}
        self.counts: Counter[str] = Counter()
        for part in parts:
            self.counts.update(part.counts)
        full = [part for part in parts if any(part.counts.values())]
        self.start_ns = min((part.start_ns for part in full), default=0)
        self.end_ns = max((part.end_ns for part in full), default=0)
        self.qos = {topic: qos for part in parts for topic, qos in part.qos.items()}
        if not self._problems:
            self._compare_counts(metadata)
        is_ros1 = any(part.is_ros1 for part in self._files)
        self.typestore = self._ros1_types() if is_ros1 else None

    def _report(self, problem: str) -> None:
        self._problems.add(f"{self.path}: {problem}")

    def _ros1_types(self) -> Typestore:
        """Return the types that are defined, and report those that cannot be understood."""
        store, problems = _typestore(tuple(self.definitions.items()))
        for problem in problems:
            self._report(problem)
        return store

    def _compare_counts(self, metadata: BagMetadata) -> None:
        """Report messages that the metadata list, but no file."""
        for topic, listed in metadata.counts:
            count = self.counts[topic]
            if count < listed:
                missing = f"{listed - count} of the {listed} messages on {topic}"
                self._report(f"{missing} that metadata.yaml lists are missing")

    def _converted(self, raw: RawMessage) -> Iterator[BagMessage]:
        """Yield the message in CDR, unless it cannot be converted."""
        data: bytes | memoryview = raw.data
        try:
            if raw.type != self.topics[raw.topic]:
                raise ValueError(f"its type is {raw.type}, not {self.topics[raw.topic]} as before")
            if self.typestore is not None:
                data = self.typestore.ros1_to_cdr(data, raw.type)
            elif is_zstd(data):  # which metadata need not say
                data = decompressed(data, max_bytes=MAX_UNPACKED_BYTES)
        except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged messages
            self.report_unreadable(raw, reason(err))
            return
        yield BagMessage(raw.topic, raw.type, raw.time_ns, bytes(data))


def _allow_open_files(path: Path, n: int) -> None:
    """Raise this process's limit on open files where a recording needs that; raises OSError where it may not."""
    limit, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if limit == resource.RLIM_INFINITY or n < limit // 4:
        return
    needed = len(list(Path("/dev/fd").iterdir())) + n + _OTHER_FILES
    if needed <= limit:
        return
    if most != resource.RLIM_INFINITY and needed > most:
        remedy = f"allow {needed}, as with `ulimit -Hn`, or give the files in parts"
        raise OSError(errno.EMFILE, f"it has {n} files, and this process may open {most}; {remedy}", str(path))
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, most))


def _lazy_messages(file: BagFile, topics: set[str], start_ns: int) -> Iterator[tuple[int, RawMessage | None]]:
    """Yield the times and messages of a file after its own start, so that it is not read before its turn."""
    yield file.contents.start_ns, None
    for raw in file.messages(topics, start_ns):
        yield raw.time_ns, raw


@lru_cache(maxsize=8)  # rosbags takes 0.2 s for them, and the bags of a drive have the same
def _typestore(definitions: tuple[tuple[str, str], ...]) -> tuple[Typestore, tuple[str, ...]]:
    """Return the types that a ROS 1 bag defines, and a line for each that cannot be understood."""
    store = get_typestore(Stores.EMPTY)
    # rosbags drops the seq of ROS 1 by itself where the header is defined as in ROS 2.
    store.register(get_types_from_msg("builtin_interfaces/Time stamp\nstring frame_id\n", "std_msgs/msg/Header"))
    problems = []
    for kind, definition in definitions:
        try:
            if len(definition) > MAX_DEFINITION_CHARACTERS:
                raise ValueError(f"takes more than {MAX_DEFINITION_CHARACTERS} characters")
            types = get_types_from_msg(definition, kind)
            store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
        except Exception as err:  # rosbags raises anything from KeyError to RecursionError on damaged texts
            problems.append(f"the definition of {kind} cannot be read ({reason(err)})")
    return store, tuple(problems)
