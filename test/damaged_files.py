"""Damaged variants of a file, as power loss or a bad disk leaves them: cut off, zeros, swapped parts, bits flipped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

KILOBYTE = 1024


def truncated(data: bytes, *, step: int = KILOBYTE) -> Iterator[bytes]:
    """Yield the file cut off at every `step` bytes, the empty one first."""
    for length in range(0, len(data), step):
        yield data[:length]


def flipped(data: bytes, seed: int, n: int = 1) -> bytes:
    """Return the file with `n` different bits flipped, chosen by `seed`."""
    damaged = np.frombuffer(data, np.uint8).copy()
    bits = np.random.default_rng(seed).choice(8 * len(data), n, replace=False)
    np.bitwise_xor.at(damaged, bits // 8, (1 << bits % 8).astype(np.uint8))
    return damaged.tobytes()


def zero_tailed(data: bytes, *, step: int = KILOBYTE) -> Iterator[bytes]:
    """Yield the file with zeros from every `step` bytes on to its end, as a journal leaves what was not yet written."""
    for length in range(0, len(data), step):
        yield data[:length].ljust(len(data), b"\0")


def holed(data: bytes, *, step: int = KILOBYTE) -> Iterator[bytes]:
    """Yield the file with zeros in place of each part of `step` bytes, as unreadable sectors are copied."""
    for start in range(0, len(data), step):
        end = min(start + step, len(data))
        yield data[:start] + bytes(end - start) + data[end:]


def swapped(data: bytes, seed: int, *, size: int = 512) -> bytes:
    """Return the file with two of its sectors in each other's place, chosen by `seed`."""
    sectors = [data[start : start + size] for start in range(0, len(data), size)]
    a, b = np.random.default_rng(seed).integers(0, len(sectors), 2)
    sectors[a], sectors[b] = sectors[b], sectors[a]
    return b"".join(sectors)


def variants(data: bytes, *, n_flips: int, step: int = KILOBYTE) -> Iterator[bytes]:
    """Yield the file in all these ways, with one, two, four … bits flipped in turn; none is the file itself."""
    yield from truncated(data, step=step)
    yield from (damaged for damaged in zero_tailed(data, step=step) if damaged != data)
    for seed in range(n_flips):
        yield flipped(data, seed, 2 ** (seed % 5))


def refusal(read: Callable[[Path], object], path: Path) -> str:
    """Return what the ValueError says with which a file is refused; nothing where it is read."""
    try:
        read(path)
    except ValueError as err:
        return str(err)
    return ""
