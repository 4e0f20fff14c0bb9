"""An MCAP file that holds what was found in the frames of a bag beside all that the bag holds."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from types import TracebackType

from rosbags import rosbag2
from rosbags.interfaces import Connection

from lrtrav_ros.io.atomic_files import named_errors, scratch_folder, sync_file
from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_reader import BagMessage, BagReader
from lrtrav_ros.io.message_definitions import MessageDefinition, own_definition, recorded_definition
from lrtrav_ros.io.output_messages import FrameOutputs, OutputLayout, output_topics
from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.io.topics import LEFT_RAW, namespace_of


class OutputBag:
    """Copies a bag to an MCAP file, with the outputs of its frames at the times of their left images.

    It is written into a hidden folder beside `path`, and only gets its own name when `finish` is called.

    Parameters
    ----------
    path : Path
        The file to write; what is there is replaced.
    bag : StereoBag
        The bag that the frames come from. It is opened once more, to be copied.

    Attributes
    ----------
    layout : OutputLayout
        For `output_messages.frame_outputs`.
    problems : list of str
        What could not be copied, one line each.
    """

    def __init__(self, path: Path, bag: StereoBag) -> None:
        self._path = path
        self._left_topic = bag.left_topic
        self.layout = OutputLayout(
            namespace=namespace_of(self._left_topic),
            frame_id=_frame_id(bag.reader, self._left_topic),
            with_left=LEFT_RAW in bag.inputs,
            inputs=frozenset(map(_absolute, bag.inputs.values())),
        )
        self.problems: list[str] = []
        self._output_topics = output_topics(self.layout, source=bag.source)
        self._connections: dict[tuple[str, str], Connection] = {}
        self._left_times_ns: dict[int, int] = {}
        with ExitStack() as opened:
            self._reader = opened.enter_context(BagReader(bag.reader.path))
            self._inputs = opened.enter_context(closing(self._reader.messages()))
            # A bag is a folder, of which one file is wanted.
            self._folder = opened.enter_context(scratch_folder(path)) / "bag"
            self._writer = rosbag2.Writer(self._folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
            self._writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
            with named_errors(path):
                self._writer.open()
            self._opened = opened.pop_all()

    def __enter__(self) -> OutputBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close; what is not finished is removed."""
        with self._opened:
            if self._writer.storage is not None:
                with suppress(OSError):  # a full disk does not take the rest of what is removed either
                    self._writer.abort()

    def write(self, outputs: FrameOutputs) -> None:
        """Write the outputs of a frame, after all that was recorded up to its left image."""
        with named_errors(self._path):
            time_ns = self._copy_up_to(outputs.stamp_ns)
            for message in outputs.messages:
                connection = self._connection(message.topic, message.type, own_definition)
                self._writer.write(connection, time_ns, message.data)

    def finish(self) -> None:
        """Copy the rest of the bag, and give the file its name."""
        with named_errors(self._path):
            for message in self._inputs:
                self._copy(message)
            self._writer.close()
            written = self._folder / f"{self._folder.name}.mcap"
            sync_file(written)
            written.replace(self._path)

    def _copy_up_to(self, stamp_ns: int) -> int:
        """Copy messages up to the left image with a stamp; return the time at which it was received."""
        if stamp_ns not in self._left_times_ns:
            for message in self._inputs:
                self._copy(message)
                if stamp_ns in self._left_times_ns:
                    break
        return self._left_times_ns.get(stamp_ns, stamp_ns)

    def _copy(self, message: BagMessage) -> None:
        """Copy a message, unless it is in the place of an output."""
        if message.topic == self._left_topic:
            self._note_left(message)
        topic = _absolute(message.topic)
        if topic in self._output_topics:
            self._report(f"{topic} is replaced by what was found now")
            return
        try:
            connection = self._connection(topic, message.type, self._recorded_definition)
        except ValueError as err:
            self._report(f"{topic} is left out: {err}")
            return
        self._writer.write(connection, message.time_ns, message.data)

    def _note_left(self, message: BagMessage) -> None:
        """Note when a left image was received; of two with one stamp, the first."""
        with suppress(ValueError):  # it is no frame's
            stamp_ns = SerializedMessage(message.data, message.type).stamp_ns
            self._left_times_ns.setdefault(stamp_ns, message.time_ns)

    def _report(self, problem: str) -> None:
        """Note a problem, once."""
        text = f"{self._path}: {problem}"
        if text not in self.problems:
            self.problems.append(text)

    def _recorded_definition(self, kind: str) -> MessageDefinition:
        return recorded_definition(self._reader, kind)

    def _connection(self, topic: str, kind: str, define: Callable[[str], MessageDefinition]) -> Connection:
        """Return what to write a topic's messages of a type to, which is made with the first one."""
        if (topic, kind) not in self._connections:
            definition = define(kind)
            self._connections[topic, kind] = self._writer.add_connection(
                topic,
                kind,
                msgdef=definition.text,
                rihs01=definition.digest,
                offered_qos_profiles=self._reader.qos.get(topic, ()),
            )
        return self._connections[topic, kind]


def _absolute(topic: str) -> str:
    """Return a topic's full name; ROS 1 records relative names too."""
    return f"/{topic.strip('/')}"


def _frame_id(reader: BagReader, topic: str) -> str:
    """Return the coordinate frame of the first image on a topic that can be read."""
    with closing(reader.messages([topic])) as messages:
        for message in messages:
            with suppress(ValueError):
                return str(SerializedMessage(message.data, message.type).decode().header.frame_id)
    return ""
