"""The calibration of one camera, from its CameraInfo topic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lrtrav_ros.io.serialized_message import SerializedMessage
from lrtrav_ros.nodes.input_topic import InputTopic, Report


class Calibration:
    """The last CameraInfo of a topic that frames can be made with; what is none is refused, and the one before stays.

    Parameters
    ----------
    name : str
        Relative name of the topic.
    report : callable
        Takes the text of each refusal.
    check : callable
        Takes a CameraInfo, and raises ValueError where no frame can be made with it.

    Attributes
    ----------
    topic : InputTopic
        Counts the messages.
    info : sensor_msgs/CameraInfo or None
        None before the first.
    """

    def __init__(self, name: str, report: Report, check: Callable[[Any], None]) -> None:
        self.topic = InputTopic(name, report)
        self.info: Any | None = None
        self._check = check
        self._content = b""

    def forget(self) -> None:
        """Forget the CameraInfo, and set the counts to 0."""
        self.info, self._content = None, b""
        self.topic.forget()

    def take(self, message: SerializedMessage) -> bool:
        """Count a message, and return whether frames can be made with it."""
        self.topic.queue.count(message.stamp_ns)
        content = message.without_stamp  # drivers send the same one with every image
        if content != self._content:
            try:
                info = message.decode()
                self._check(info)
            except ValueError as err:
                self.topic.refuse(err)
                return False
            self.info, self._content = info, content
        return True
