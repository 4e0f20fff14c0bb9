"""What came of the messages of one topic that a node subscribes to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from lrtrav_ros.io.pairing import TopicQueue
from lrtrav_ros.io.serialized_message import SerializedMessage

Report = Callable[[str], None]

_MAX_REASON = 500  # characters: a reason quotes fields of the message, which may be megabytes


def shortened(reason: str) -> str:
    """Return the beginning of a long reason, which goes to the log and once a second to ``/diagnostics``."""
    return reason if len(reason) <= _MAX_REASON else f"{reason[:_MAX_REASON]}… ({len(reason)} characters)"


class Failure(NamedTuple):
    """Why something failed, and when on the clock of `time.monotonic` [s]."""

    at_s: float
    reason: str


@dataclass(frozen=True, slots=True)
class Failures:
    """How often something failed, and the last time that it did; None where it never has."""

    n: int = 0
    last: Failure | None = None

    def plus(self, reason: str) -> Failures:
        """Return these and one that happens now."""
        return Failures(self.n + 1, Failure(time.monotonic(), shortened(reason)))


class InputTopic:
    """A topic that a node subscribes to, and the counts of its messages.

    Parameters
    ----------
    name : str
        Relative name, without a transport, such as ``left/image_rect``.
    report : callable
        Takes the text of each refusal.
    capacity : int, optional
        Of its queue; see `TopicQueue`.
    part : str
        Which part of a frame its messages are, ``left`` or ``partner``; empty where frames are not counted by them.
    needs_partner : bool
        Whether it is a fault that a message finds no partner.

    Attributes
    ----------
    queue : TopicQueue
        The messages that wait for a partner; `forget` makes a new one. Its topic is the full name.
    refusals : Failures
        Messages that were refused when they came.
    """

    def __init__(
        self, name: str, report: Report, *, capacity: int | None = None, part: str = "", needs_partner: bool = True
    ) -> None:
        self.name = name
        self.part = part
        self.needs_partner = needs_partner
        self._report = report
        self._capacity = capacity
        self._lock = threading.Lock()
        self._set_queue("")

    def _set_queue(self, topic: str) -> None:
        # Late images are not wanted: a pair of theirs would take the place of a newer frame.
        self.queue: TopicQueue[SerializedMessage] = TopicQueue(topic, is_ordered=True)
        if self._capacity is not None:
            self.queue.capacity = self._capacity
        self.refusals = Failures()

    @property
    def topic(self) -> str:
        """Its full name."""
        return self.queue.topic

    @topic.setter
    def topic(self, topic: str) -> None:
        self.queue.topic = topic

    def has_come(self) -> bool:
        """Return whether any message has come."""
        return self.queue.received > 0

    def forget(self) -> None:
        """Set the counts to 0, and drop what waits."""
        self._set_queue(self.topic)

    def refuse_damaged(self, err: Exception) -> None:
        """Count and report a message that came without a legible stamp."""
        self.queue.count_damaged()
        self.refuse(err)

    def refuse(self, err: Exception) -> None:
        """Count and report a message that was counted as received."""
        with self._lock:  # the worker refuses as well as the thread that spins
            self.refusals = self.refusals.plus(str(err))
        self._report(f"{self.topic}: {shortened(str(err))}")
