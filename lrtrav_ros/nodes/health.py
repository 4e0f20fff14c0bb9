"""Rules that make levels and texts of what came of messages and frames within the last seconds."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise

from lrtrav_ros.nodes.counts import Counts
from lrtrav_ros.nodes.input_topic import Failure

LEAST = 10
"""Messages or frames of which a share tells something."""

UNPAIRED_SHARE = 0.1
"""Share of the messages without partner above which that is a fault; fewer get lost on any network."""

DROPPED_SHARE = 0.5
"""Share of the frames above which dropping them is told of; a frame that waits makes room for a newer one by design."""


class Level(IntEnum):
    """As in ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True, slots=True)
class Health:
    """How well a node or one of its topics works, and what is wrong with it, in lines."""

    level: Level
    lines: tuple[str, ...]


class Window:
    """What counts grew by within the last seconds.

    Parameters
    ----------
    length_s : float
        Seconds that are looked back, and up to the time between two `add` more.
    clock : callable
        Returns the time in seconds; it should not jump.
    """

    def __init__(self, length_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.length_s = length_s
        self._clock = clock
        self.forget()

    def forget(self) -> None:
        """Begin anew, with all counts at 0."""
        self._history: deque[tuple[float, Mapping[str, Counts]]] = deque([(self._clock(), {})])

    def add(self, counts: Mapping[str, Counts]) -> None:
        """Take the counts of this moment, by name."""
        self._history.append((self.now_s, counts))
        while self._history[1][0] <= self.now_s - self.length_s:
            self._history.popleft()

    def recent(self, name: str) -> Counts:
        """Return what the counts of a name grew by; they may have begun anew meanwhile."""
        moments = [counts.get(name, Counts()) for _, counts in self._history]
        return sum((now.since(before) for before, now in pairwise(moments)), start=Counts())

    def rate_hz(self, name: str) -> float:
        """Return how many of a name were received per second."""
        return self.recent(name).received / max(self._history[-1][0] - self._history[0][0], 1e-6)

    @property
    def is_full(self) -> bool:
        """Whether it looks back as far as it can."""
        return self._history[-1][0] - self._history[0][0] >= self.length_s

    @property
    def now_s(self) -> float:
        """The time on its clock."""
        return self._clock()

    def ago(self, failure: Failure | None) -> str:
        """Return when and why something failed."""
        return "" if failure is None else f"; last, {self.now_s - failure.at_s:.0f} s ago: {failure.reason}"

    def __str__(self) -> str:
        return f"the last {self.length_s:g} s"


def topic_health(
    topic: str, recent: Counts, window: Window, *, last_refusal: Failure | None, needs_partner: bool, publishers: str
) -> Health:
    """Return how it is with the messages of a topic.

    Parameters
    ----------
    topic : str
        Its full name.
    recent : Counts
        Of its messages in the window.
    window : Window
        What is looked at.
    last_refusal : Failure or None
        The last one ever.
    needs_partner : bool
        Whether it is a fault that messages find no partner.
    publishers : str
        What is wrong with those who publish it; empty where nothing is.
    """
    lines = [publishers]
    if recent.refused:
        why = window.ago(last_refusal)
        lines.append(f"{recent.refused} of {recent.received} messages on {topic} refused in {window}{why}")
    if needs_partner and recent.received >= LEAST and recent.unpaired > UNPAIRED_SHARE * recent.received:
        lines.append(f"{recent.unpaired} of {recent.received} messages on {topic} without partner in {window}")
    return _health(lines, is_useless=0 < recent.received <= recent.refused)


def silent_health(recent: Counts, window: Window) -> Health | None:
    """Return how it is with an image topic on which nothing comes; None where something does."""
    if recent.received or not window.is_full:
        return None
    return Health(Level.ERROR, (f"no message in {window}",))


def frames_health(
    recent: Counts, window: Window, *, last_failure: Failure | None, problem: str, topics: Sequence[Health]
) -> Health:
    """Return how it is with the frames of a node.

    Parameters
    ----------
    recent : Counts
        Of its frames in the window.
    window : Window
        What is looked at.
    last_failure : Failure or None
        The last one ever of a frame whose messages were not to blame.
    problem : str
        What else is wrong; empty where nothing is.
    topics : sequence of Health
        Those of the topics that it subscribes to.
    """
    lines = [problem, *(line for topic in topics for line in topic.lines)]
    if recent.failed:
        lines.append(f"{recent.failed} of {recent.received} frames failed in {window}{window.ago(last_failure)}")
    if recent.processed and recent.received >= LEAST and recent.dropped > DROPPED_SHARE * recent.received:
        dropped = f"{recent.dropped} of {recent.received} frames dropped in {window}"
        lines.append(f"{dropped}: they come faster than they are processed")
    is_useless = window.is_full and not recent.processed
    if is_useless and recent.lost:
        lines.append(f"none of {recent.received} frames processed in {window}")
    return _health(lines, is_useless=is_useless)


def _health(lines: Sequence[str], *, is_useless: bool) -> Health:
    """Return that all is well where there are no lines, else that something is wrong, or everything."""
    said = tuple(line for line in lines if line)
    if not said:
        return Health(Level.OK, ())
    return Health(Level.ERROR if is_useless else Level.WARN, said)
