"""A worker thread with a mailbox of one slot: the newest frame always wins."""

from __future__ import annotations

import statistics
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError
from typing import Generic, TypeVar

_Item = TypeVar("_Item")

_RATE_WINDOW_S = 5.0


class Worker(Generic[_Item]):
    """Runs `process` on one frame after the other in a thread of its own, from `start` on, and keeps count.

    Parameters
    ----------
    process : callable
        Processes one frame; raises `CancelledError` where it has to give it up, and that counts as dropped.
    failed : callable
        Called with the exception that a frame raised, whatever it is; the worker continues with the next frame.

    Attributes
    ----------
    processed, dropped, failed : int
        Number of frames that were processed, that a newer one replaced or that were given up, and that raised an
        exception.
    damaged : int
        Number of messages that were refused, of whatever topic: no frame can be made of them.
    error : str
        Why the last frame failed; empty where it did not.
    """

    def __init__(self, process: Callable[[_Item], None], *, failed: Callable[[Exception], None]) -> None:
        self.processed = 0
        self.dropped = 0
        self.failed = 0
        self.damaged = 0
        self.error = ""
        self._process = process
        self._report = failed
        self._durations_s: deque[float] = deque(maxlen=100)
        self._finished_s: deque[float] = deque(maxlen=1000)
        self._slot: list[_Item] = []
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)

    def start(self) -> None:
        """Begin with the frames."""
        self._thread.start()

    def put(self, frame: _Item) -> None:
        """Leave a frame for the worker; one that still waits is replaced and counted as dropped."""
        with self._changed:
            self.dropped += len(self._slot)
            self._slot[:] = [frame]
            self._changed.notify()

    def refuse(self, err: Exception) -> None:
        """Count and report a message that is too damaged for a frame to be put."""
        self.damaged += 1
        self._explain(err)

    def forget(self) -> None:
        """Set all counts to 0, and drop the frame that waits."""
        with self._changed:
            self._slot.clear()
            self.processed = self.dropped = self.failed = self.damaged = 0
            self.error = ""
            self._durations_s.clear()
            self._finished_s.clear()

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
            return None if self._closed else self._slot.pop()

    def _run(self) -> None:
        while (frame := self._take()) is not None:
            start = time.monotonic()
            try:
                self._process(frame)
            except CancelledError:
                with self._changed:
                    self.dropped += 1
            except Exception as err:  # the worker outlives every frame
                with self._changed:
                    self.failed += 1
                self._explain(err)
            else:
                self._count(time.monotonic() - start)
            del frame  # it may hold megabytes while the worker waits

    def _count(self, duration_s: float) -> None:
        """Count a frame that was processed."""
        with self._changed:
            self._durations_s.append(duration_s)
            self._finished_s.append(time.monotonic())
            self.error = ""
            self.processed += 1

    def _explain(self, err: Exception) -> None:
        self.error = str(err) or type(err).__name__
        self._report(err)
