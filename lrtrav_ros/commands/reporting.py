"""What commands print: what is done stays done where nobody reads that any more, or the disk it goes to is full."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TextIO


def print_result(*lines: str) -> None:
    """Print lines that are all that a command is for; raises OSError where they cannot be printed."""
    _print(lines, sys.stdout)


def report(*lines: str) -> None:
    """Print lines about results that are written; where they cannot be printed, that is told, and no failure."""
    try:
        _print(lines, sys.stdout)
    except OSError as err:
        warn(f"standard output: {err.strerror}; the results are written")


def warn(*lines: str) -> None:
    """Print lines on standard error, as far as that is possible."""
    with suppress(OSError):
        _print(lines, sys.stderr)


def _print(lines: tuple[str, ...], stream: TextIO | None) -> None:
    """Print lines at once; where that fails, what is left of them goes nowhere. A closed stream is None."""
    if stream is None:
        return
    try:
        for line in lines:
            print(line, file=stream)
        stream.flush()
    except OSError:
        _discard(stream)
        raise


def _discard(stream: TextIO) -> None:
    """Let a stream go nowhere: Python would print what is left when it ends, fail again, and exit with 120."""
    with suppress(OSError):  # it is no file of the system's
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
