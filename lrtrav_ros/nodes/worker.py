"""A worker thread with a mailbox of one slot: the newest frame always wins."""

from __future__ import annotations

import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, TypeVar

from lrtrav_ros.nodes.input_topic import Failures

_Item = TypeVar("_Item")

_RATE_WINDOW_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerCounts:
    """What came of frames up to a moment; those that were put are the sum of the others.

    Attributes
    ----------
    put : int
        Frames that were left for the worker.
    processed, dropped, failed : int
        Frames that were processed, that a newer one replaced or that were given up, and that raised an exception.
    waiting : int
        The frame that waits, and the one at hand.
    failures : mapping of str to Failures
        Those that failed, by the part of the frame that is to blame; by an empty name where none is.
    """

    put: int = 0
    processed: int = 0
    dropped: int = 0
    failed: int = 0
    waiting: int = 0
    failures: Mapping[str, Failures] = field(default_factory=dict)

    def failed_by(self, part: str) -> Failures:
        """Return the frames that failed by a part of them."""
        return self.failures.get(part, Failures())


class Worker(Generic[_Item]):
    """Runs `process` on one frame after the other in a thread of its own, from `start` on, and keeps count.

    Parameters
    ----------
    process : callable
        Processes one frame; raises `CancelledError` where it has to give it up, and that counts as dropped.
    failed : callable
        Called with the exception that a frame raised, whatever it is; the worker continues with the next frame.
    """

    def __init__(self, process: Callable[[_Item], None], *, failed: Callable[[Exception], None]) -> None:
        self._set_counts()
        self._process = process
        self._report = failed
        self._durations_s: deque[float] = deque(maxlen=100)
        self._finished_s: deque[float] = deque(maxlen=1000)
        self._slot: list[_Item] = []
        self._is_busy = self._is_forgotten = False  # with a frame at hand, which is from before the counts began
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)

    def start(self) -> None:
        """Begin with the frames."""
        self._thread.start()

    def put(self, frame: _Item) -> None:
        """Leave a frame for the worker; one that still waits is replaced and counted as dropped."""
        with self._changed:
            self._put += 1
            self._dropped += len(self._slot)
            self._slot[:] = [frame]
            self._changed.notify()

    def forget(self) -> None:
        """Set all counts to 0, and drop the frame that waits; the one at hand is not counted when it ends."""
        with self._changed:
            self._slot.clear()
            self._is_forgotten = self._is_busy
            self._set_counts()
            self._durations_s.clear()
            self._finished_s.clear()

    def counts(self) -> WorkerCounts:
        """Return the counts of one moment."""
        with self._changed:
            return WorkerCounts(
                put=self._put,
                processed=self._processed,
                dropped=self._dropped,
                failed=sum(failures.n for failures in self._failures.values()),
                waiting=len(self._slot) + (self._is_busy and not self._is_forgotten),
                failures=dict(self._failures),
            )

    def _set_counts(self) -> None:
        self._put = self._processed = self._dropped = 0
        self._failures: dict[str, Failures] = {}

    def close(self) -> None:
        """End the thread after the frame at hand; may be called twice."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    @property
    def rate_hz(self) -> float:
        """Frames processed per second, over the last five seconds; 0 for less than two."""
        since = time.monotonic() - _RATE_WINDOW_S
        recent = [finished for finished in tuple(self._finished_s) if finished >= since]
        return (len(recent) - 1) / max(recent[-1] - recent[0], 1e-6) if len(recent) > 1 else 0.0

    @property
    def last_ms(self) -> float:
        """Milliseconds that the last frame took; 0 before the first."""
        return 1e3 * self._durations_s[-1] if self._durations_s else 0.0

    @property
    def median_ms(self) -> float:
        """Median of the milliseconds that the last hundred frames took; 0 before the first."""
        return 1e3 * statistics.median(tuple(self._durations_s)) if self._durations_s else 0.0

    def _take(self) -> _Item | None:
        """Wait for a frame and return it, or None when the worker is to end."""
        with self._changed:
            self._changed.wait_for(lambda: self._slot or self._closed)
            self._is_busy = not self._closed
            return None if self._closed else self._slot.pop()

    def _run(self) -> None:
        while (frame := self._take()) is not None:
            start = time.monotonic()
            try:
                self._process(frame)
            except CancelledError:
                self._end(self._count_dropped)
            except Exception as err:  # the worker outlives every frame
                self._end(partial(self._count_failed, err))
                self._report(err)
            else:
                self._end(partial(self._count_processed, start))
            del frame  # it may hold megabytes while the worker waits

    def _end(self, count: Callable[[], None]) -> None:
        """End with the frame at hand, and count it, unless all before has been forgotten."""
        with self._changed:
            if not self._is_forgotten:
                count()
            self._is_busy = self._is_forgotten = False

    def _count_dropped(self) -> None:
        self._dropped += 1

    def _count_failed(self, err: Exception) -> None:
        part = getattr(err, "part", "")
        self._failures[part] = self._failures.get(part, Failures()).plus(str(err) or type(err).__name__)

    def _count_processed(self, start_s: float) -> None:
        self._durations_s.append(time.monotonic() - start_s)
        self._finished_s.append(time.monotonic())
        self._processed += 1
