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

_LOCK = threading.RLock()  # the limit is one of the whole process


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread, in a ``with`` block or as a decorator; other threads that want to do so wait."""
    with _LOCK, _controller().limit(limits=1, user_api="blas"):
        yield


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    """Return the BLAS libraries of this process; cached, because finding them takes a few milliseconds."""
    return ThreadpoolController()
