"""Linear algebra that is reproducible bit for bit on the same processor, whatever the number of cores.

BLAS splits sums over its threads, so that the last bits depend on their number: one more core, or a limit that a
cluster sets for its workers, could then move a superpixel into another cluster.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

from threadpoolctl import ThreadpoolController

from lrtrav_ros.numerics.forks import renew_in_children


class _Turn:
    """Whose turn it is to set the limit, which is one of the whole process."""

    def __init__(self) -> None:
        self.renew()
        renew_in_children(self)

    def renew(self) -> None:
        """Let it be nobody's turn: who has it may be a thread that a forked child does not have."""
        self.lock = threading.RLock()


_TURN = _Turn()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread, in a ``with`` block or as a decorator; other threads that want to do so wait."""
    with _TURN.lock, _controller().limit(limits=1, user_api="blas"):
        yield


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    """Return the BLAS libraries of this process; cached, because finding them takes a few milliseconds."""
    return ThreadpoolController()
