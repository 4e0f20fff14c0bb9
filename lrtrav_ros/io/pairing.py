"""Pairing of the messages of two topics by their header stamps."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import Generic, TypeVar

First = TypeVar("First")
Second = TypeVar("Second")
Item = TypeVar("Item")


@dataclass(slots=True)
class Side(Generic[Item]):
    """One of the two topics: the messages that wait for a partner, oldest first, and what is known of the topic."""

    topic: str
    capacity: int
    received: int = 0
    unpaired: int = 0
    last_stamp_ns: int | None = None
    waiting: deque[tuple[int, Item]] = field(default_factory=deque)

    def add(self, stamp_ns: int, item: Item) -> None:
        """Let a message wait; where time jumps back (a looped bag), those from before the jump go."""
        if self.last_stamp_ns is not None and stamp_ns < self.last_stamp_ns:
            self.unpaired += len(self.waiting)
            self.waiting.clear()
        self.received += 1
        self.last_stamp_ns = stamp_ns
        self.waiting.append((stamp_ns, item))
        if len(self.waiting) > self.capacity:
            self.waiting.popleft()
            self.unpaired += 1

    def nearest(self, stamp_ns: int) -> int | None:
        """Return the stamp [ns] nearest to `stamp_ns` among the messages that wait, None where none does."""
        return min((stamp for stamp, _ in self.waiting), key=lambda stamp: abs(stamp - stamp_ns), default=None)

    def take(self, stamp_ns: int) -> Item:
        """Return the message of this stamp, and drop it and those before it; they are too late to pair."""
        while True:
            stamp, item = self.waiting.popleft()
            if stamp == stamp_ns:
                return item
            self.unpaired += 1

    def __str__(self) -> str:
        stamp = "none yet" if self.last_stamp_ns is None else f"last stamp {self.last_stamp_ns / 1e9:.6f}"
        return f"{self.topic}: {self.received} received, {stamp}"


class Pairing(Generic[First, Second]):
    """Pairs messages of two topics whose stamps differ by no more than a tolerance; both queues are bounded.

    Parameters
    ----------
    first, second
        Names of the topics, and how many messages of each may wait for a partner.
    """

    def __init__(self, first: tuple[str, int], second: tuple[str, int]) -> None:
        self.first: Side[First] = Side(*first)
        self.second: Side[Second] = Side(*second)
        self._progress_s = time.monotonic()
        self._lonely = 0
        self._difference_ns: int | None = None

    def add_first(self, stamp_ns: int, item: First, *, tolerance_ns: int) -> tuple[First, Second] | None:
        """Take a message of the first topic; return the pair that it completes, if any."""
        self.first.add(stamp_ns, item)
        partner = self._partner(self.second, stamp_ns, tolerance_ns)
        return None if partner is None else (self.first.take(stamp_ns), self.second.take(partner))

    def add_second(self, stamp_ns: int, item: Second, *, tolerance_ns: int) -> tuple[First, Second] | None:
        """Take a message of the second topic; return the pair that it completes, if any."""
        self.second.add(stamp_ns, item)
        partner = self._partner(self.first, stamp_ns, tolerance_ns)
        return None if partner is None else (self.first.take(partner), self.second.take(stamp_ns))

    def _partner(self, other: Side[Item], stamp_ns: int, tolerance_ns: int) -> int | None:
        """Return the stamp of the message to pair with, and note how near the two topics came."""
        nearest = other.nearest(stamp_ns)
        self._lonely += 1
        if nearest is None:
            return None
        difference = abs(nearest - stamp_ns)
        if difference <= tolerance_ns:
            self._progress_s, self._lonely, self._difference_ns = time.monotonic(), 0, None
            return nearest
        self._difference_ns = min(difference, self._difference_ns or difference)
        return None

    @property
    def idle_s(self) -> float:
        """Seconds since the last pair, or since the start."""
        return time.monotonic() - self._progress_s

    def reason(self, *, tolerance_ns: int) -> str:
        """Return why there is no pair: both topics, how many messages came, their last stamps, the least difference."""
        missing = "pairs" if self._lonely else "messages"
        text = f"no {missing} for {self.idle_s:.0f} s; {self.first}; {self.second}"
        if self._difference_ns is not None:
            text += f"; stamps differ by at least {self._difference_ns / 1e9:g} s, allowed are {tolerance_ns / 1e9:g} s"
        return text
