"""What has to be made anew in a forked child process, which has one thread: that which forked.

A lock that another thread held is never released there, and threads that waited for work are gone.
"""

from __future__ import annotations

import os
import weakref
from typing import Protocol


class _Renewable(Protocol):
    """What has locks or threads."""

    def renew(self) -> None:
        """Have locks that are free and no threads, as at the beginning."""
        ...  # pragma: no cover


_RENEWABLE: weakref.WeakSet[_Renewable] = weakref.WeakSet()


def renew_in_children(renewable: _Renewable) -> None:
    """Have `renew` called in each child process that this one forks from now on, as long as the object lives."""
    _RENEWABLE.add(renewable)


def _renew() -> None:
    for renewable in list(_RENEWABLE):
        renewable.renew()


os.register_at_fork(after_in_child=_renew)
