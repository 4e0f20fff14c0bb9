"""Pairing of the messages of two topics by their header stamps, the same for bags and nodes."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Generic, TypeVar

CAPACITY = 16
"""Largest number of messages of one topic that wait for a partner: half a second at 30 Hz."""

_First = TypeVar("_First")
_Second = TypeVar("_Second")
_Item = TypeVar("_Item")


@dataclass(slots=True)
class TopicQueue(Generic[_Item]):
    """The messages of one topic that wait for a partner, and the counts of the topic.

    A message waits until its partner comes or newer arrivals push it out: one that is late, or a jump back in time as
    of a looped bag, changes nothing for the others.

    Attributes
    ----------
    topic : str
        Name of the topic.
    capacity : int
        Largest number of messages that wait; one that this many have come after waits no longer.
    received, damaged : int
        Messages that came, and those of them that were too damaged to have a stamp.
    unpaired : int
        Messages that were given up without a partner.
    last_stamp_ns : int, optional
        Stamp of the last message; None before the first.
    is_ordered : bool
        A pair makes the messages useless that came before it and have earlier stamps: the partners come in the order
        of their stamps, or a late one is no longer wanted.
    waiting : dict of int to message
        By stamp in nanoseconds, in order of arrival.
    """

    topic: str
    capacity: int = CAPACITY
    received: int = 0
    damaged: int = 0
    unpaired: int = 0
    last_stamp_ns: int | None = None
    is_ordered: bool = False
    waiting: dict[int, _Item] = field(default_factory=dict)
    _arrivals: dict[int, int] = field(default_factory=dict)

    def count(self, stamp_ns: int) -> None:
        """Count a message that came."""
        self.received += 1
        self.last_stamp_ns = stamp_ns
        oldest = next(iter(self.waiting), None)
        if oldest is not None and self.received - self._arrivals[oldest] > self.capacity:
            self._push_out(oldest)

    def count_damaged(self) -> None:
        """Count a message that came without a legible stamp."""
        self.received += 1
        self.damaged += 1

    def add(self, stamp_ns: int, item: _Item) -> None:
        """Let a message wait; it takes the place of an earlier one with its stamp."""
        if stamp_ns in self.waiting:
            self._push_out(stamp_ns)
        self.waiting[stamp_ns] = item
        self._arrivals[stamp_ns] = self.received
        if len(self.waiting) > self.capacity:
            self._push_out(next(iter(self.waiting)))

    def take(self, stamp_ns: int) -> _Item:
        """Return the message of this stamp, which is paired now."""
        self.mark_paired(stamp_ns)
        del self._arrivals[stamp_ns]
        return self.waiting.pop(stamp_ns)

    def mark_paired(self, stamp_ns: int) -> None:
        """Where the topic is ordered, give up the older messages that arrived before that of this stamp."""
        if self.is_ordered:
            for earlier_ns in list(takewhile(lambda stamp: stamp != stamp_ns, self.waiting)):
                if earlier_ns < stamp_ns:
                    self._push_out(earlier_ns)

    def _push_out(self, stamp_ns: int) -> None:
        """Give up waiting for a message's partner."""
        del self.waiting[stamp_ns], self._arrivals[stamp_ns]
        self.unpaired += 1

    def nearest(self, stamp_ns: int) -> int | None:
        """Return the stamp [ns] nearest to `stamp_ns` among the messages that wait; None where none does."""
        return min(self.waiting, key=lambda stamp: abs(stamp - stamp_ns), default=None)

    def __str__(self) -> str:
        stamp = "none yet" if self.last_stamp_ns is None else f"last stamp {self.last_stamp_ns / 1e9:.6f}"
        damaged = f", {self.damaged} of them damaged" if self.damaged else ""
        return f"{self.topic}: {self.received} received{damaged}, {stamp}"


class StampPairing(Generic[_First, _Second]):
    """Pairs messages of two topics whose stamps differ by no more than a tolerance; both queues are bounded.

    A message is paired at once with the one nearest to it in time among those of the other topic that wait, so that
    the same sequence of messages gives the same pairs wherever it comes from.

    Parameters
    ----------
    first, second : TopicQueue
        The two topics.

    Attributes
    ----------
    n_pairs : int
        Pairs up to now.
    """

    def __init__(self, first: TopicQueue[_First], second: TopicQueue[_Second]) -> None:
        self.first = first
        self.second = second
        self.n_pairs = 0
        self._progress_s = time.monotonic()
        self._n_since_pair = 0
        self._difference_ns: int | None = None

    def add_first(self, stamp_ns: int, item: _First, *, tolerance_ns: int) -> tuple[_First, _Second] | None:
        """Take a message of the first topic; return the pair that it completes, if any."""
        self.first.count(stamp_ns)
        partner_ns = self._partner(self.second, stamp_ns, tolerance_ns)
        if partner_ns is None:
            self.first.add(stamp_ns, item)
            return None
        self.first.mark_paired(stamp_ns)
        return item, self.second.take(partner_ns)

    def add_second(self, stamp_ns: int, item: _Second, *, tolerance_ns: int) -> tuple[_First, _Second] | None:
        """Take a message of the second topic; return the pair that it completes, if any."""
        self.second.count(stamp_ns)
        partner_ns = self._partner(self.first, stamp_ns, tolerance_ns)
        if partner_ns is None:
            self.second.add(stamp_ns, item)
            return None
        self.second.mark_paired(stamp_ns)
        return self.first.take(partner_ns), item

    def _partner(self, other: TopicQueue[_Item], stamp_ns: int, tolerance_ns: int) -> int | None:
        """Return the stamp of the message to pair with, and note how near the two topics came."""
        nearest_ns = other.nearest(stamp_ns)
        self._n_since_pair += 1
        if nearest_ns is None:
            return None
        difference_ns = abs(nearest_ns - stamp_ns)
        if difference_ns <= tolerance_ns:
            self.n_pairs += 1
            self._progress_s, self._n_since_pair, self._difference_ns = time.monotonic(), 0, None
            return nearest_ns
        self._difference_ns = min(difference_ns, self._difference_ns or difference_ns)
        return None

    @property
    def idle_s(self) -> float:
        """Seconds since the last pair, or since the start."""
        return time.monotonic() - self._progress_s

    def silence(self, *, tolerance_ns: int) -> str:
        """Return why there is no pair now: both topics, their counts and last stamps, and the least difference."""
        missing = "pairs" if self._n_since_pair else "messages"
        text = f"no {missing} for {self.idle_s:.0f} s; {self.first}; {self.second}"
        return f"{text}{self._least_difference(tolerance_ns)}"

    def losses(self, *, tolerance_ns: int) -> str:
        """Return how many messages found no partner up to now; empty where all did."""
        queues = (self.first, self.second)
        if all(queue.received == self.n_pairs for queue in queues):
            return ""
        texts = [
            f"{queue.topic}: {queue.received - self.n_pairs} of {queue.received} without partner"
            + (f", last stamp {queue.last_stamp_ns} ns" if queue.received else "")
            for queue in queues
        ]
        return f"{'; '.join(texts)} (stamps may differ by {tolerance_ns / 1e9:g} s)"

    def _least_difference(self, tolerance_ns: int) -> str:
        if self._difference_ns is None:
            return ""
        return f"; stamps differ by at least {self._difference_ns / 1e9:g} s, allowed are {tolerance_ns / 1e9:g} s"
