"""A team of threads that share the work of one stage, or of several at a time.

Kernels run without the GIL, so that threads of one process use several processors. Whoever shares work takes part in
it, and never waits for what no thread has begun: calls may be nested, and several threads may share a team. A forked
child process has teams of the same size, whose threads start anew; what was started before the fork is lost there.
"""

from __future__ import annotations

import itertools
import os
import threading
import weakref
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Generic, ParamSpec, TypeVar

from lrtrav_ros.numerics.checks import check_count
from lrtrav_ros.numerics.forks import renew_in_children

_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")

_BANDS_PER_THREAD = 2  # rows differ in their work


class ThreadTeam:
    """The thread that calls, and `n_threads` - 1 others that start when there is work to share.

    Parameters
    ----------
    n_threads : int
        With 1, the thread that calls does everything.

    Raises
    ------
    TypeError, ValueError
        If `n_threads` is no whole number above 0.
    """

    def __init__(self, n_threads: int = 1) -> None:
        self.n_threads = check_count("n_threads", n_threads)
        self._board = _Board(self.n_threads - 1)
        weakref.finalize(self, self._board.close)

    def start(self, function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> Started[_R]:
        """Let another thread call a function as soon as one is free."""
        return Started(self._board, lambda: function(*args, **kwargs))

    def map(self, function: Callable[[_T], _R], items: Iterable[_T]) -> list[_R]:
        """Return the results of a function for each of several items, in their order."""
        items = list(items)
        if self.n_threads == 1 or len(items) < 2:
            return [function(item) for item in items]
        results: dict[int, _R] = {}
        remaining = iter(range(len(items)))  # one step of the interpreter, so that no index is taken twice

        def take_part() -> None:
            for index in remaining:
                try:
                    results[index] = function(items[index])
                except BaseException:
                    deque(remaining, maxlen=0)  # nobody begins with another item
                    raise

        others = [self.start(take_part) for _ in range(min(self.n_threads, len(items)) - 1)]
        try:
            take_part()
        finally:
            for other in others:
                other.withdraw()
        for error in filter(None, (other.error for other in others)):
            raise error
        return [results[index] for index in range(len(items))]

    def for_bands(self, function: Callable[[int, int], None], n_rows: int, *, least_rows: int = 1) -> None:
        """Call a function with the first row, and the last + 1, of each of the bands that make up `n_rows` rows.

        There is one band where there is one thread. A band has at least `least_rows` rows, so that it is worth the
        some 20 microseconds that sharing takes.
        """
        n_bands = 1 if self.n_threads == 1 else min(_BANDS_PER_THREAD * self.n_threads, n_rows // least_rows)
        n_bands = min(max(n_bands, 1), n_rows)
        edges = [n_rows * band // n_bands for band in range(n_bands + 1)] if n_bands else []
        self.map(lambda band: function(*band), itertools.pairwise(edges))


class Started(Generic[_R]):
    """A call that another thread of a team may make; `ThreadTeam.start` returns it."""

    def __init__(self, board: _Board, function: Callable[[], _R]) -> None:
        self._board = board
        self._function = function
        self._error: BaseException | None = None
        self._is_done = False
        self._process = os.getpid()
        self._value: _R
        board.post(self)

    def result(self) -> _R:
        """Return what the function returns, or raise what it raises.

        Where no thread has begun with it, the call is made here and now; else this thread lends the team a hand while
        it waits. Raises RuntimeError in a process that was forked in between.
        """
        if self._board.take(self):
            self.make()
        while not self.is_over:
            other = self._board.next_or_done(self)
            if other is not None:
                other.make()
        if self.error is not None:
            raise self.error
        return self._value

    def withdraw(self) -> None:
        """Forget the call if no thread has begun with it; else wait for its end."""
        if not self._board.take(self):
            self._board.wait_for(self)

    @property
    def error(self) -> BaseException | None:
        """What the call raised, or that it is lost; None where it raised nothing, or was not made."""
        if self.is_over and not self._is_done:
            return RuntimeError("the call was started before this process was forked; start it anew")
        return self._error

    def __enter__(self) -> Started[_R]:
        return self

    def __exit__(self, *exception: object) -> None:
        """Leave no call behind, whatever happened meanwhile."""
        self.withdraw()

    def make(self) -> None:
        """Make the call; only for who took it from the board."""
        try:
            self._value = self._function()
        except BaseException as err:  # it belongs to the thread that asks for the result
            self._error = err
        self._board.finish(self)

    @property
    def is_done(self) -> bool:
        """Whether the call has been made."""
        return self._is_done

    @property
    def is_over(self) -> bool:
        """Whether the call has been made or, in a forked child, never will be: the thread for it is not there."""
        return self._is_done or self._process != os.getpid()

    def mark_done(self) -> None:
        """Note that the call has been made."""
        self._is_done = True


class _Board:
    """Calls that wait for a thread, and the threads that make them."""

    def __init__(self, n_threads: int) -> None:
        self._n_threads = n_threads
        self._is_closed = False
        self.renew()
        renew_in_children(self)

    def renew(self) -> None:
        """Begin without threads and without calls."""
        self._threads: list[threading.Thread] = []
        self._waiting: deque[Started[Any]] = deque()
        self._changed = threading.Condition()

    def post(self, call: Started[Any]) -> None:
        """Offer a call."""
        with self._changed:
            self._waiting.append(call)
            if len(self._threads) < self._n_threads:
                thread = threading.Thread(target=self._run, name="team", daemon=True)
                self._threads.append(thread)
                thread.start()
            self._changed.notify_all()

    def take(self, call: Started[Any]) -> bool:
        """Take a call off the board, and return whether it was still there."""
        with self._changed:
            if call not in self._waiting:
                return False
            self._waiting.remove(call)
            return True

    def next_or_done(self, call: Started[Any]) -> Started[Any] | None:
        """Wait until there is another call to make, and take it, or return None when `call` has been made."""
        with self._changed:
            self._changed.wait_for(lambda: call.is_over or self._waiting)
            return None if call.is_over else self._waiting.popleft()

    def wait_for(self, call: Started[Any]) -> None:
        """Wait until a call has been made."""
        with self._changed:
            self._changed.wait_for(lambda: call.is_over)

    def finish(self, call: Started[Any]) -> None:
        """Tell those who wait that a call has been made."""
        with self._changed:
            call.mark_done()
            self._changed.notify_all()

    def close(self) -> None:
        """Let the threads end."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._is_closed)
                if self._is_closed:
                    return
                call = self._waiting.popleft()
            call.make()
            del call  # it may hold megabytes while the thread waits


ALONE = ThreadTeam(1)
"""The team of one: the thread that calls."""
