"""Compiled decoder of RVL; see `rvl`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import kernel

_MAX_BITS = 30  # longer numbers are neither a length of a run nor a difference


@kernel
def _next_number(words: NDArray[np.uint32], nibble: int) -> tuple[int, int]:
    """Return the number that begins at a nibble, and the nibble after it; -1 where there is none."""
    number = 0
    for shift in range(0, _MAX_BITS, 3):
        if nibble >= 8 * words.size:
            return -1, nibble
        bits = (int(words[nibble >> 3]) >> (28 - 4 * (nibble & 7))) & 15
        nibble += 1
        number |= (bits & 7) << shift
        if bits < 8:
            return number, nibble
    return -1, nibble


@kernel
def decode_runs(words: NDArray[np.uint32], depth: NDArray[np.uint16]) -> int:
    """Fill `depth`, which is 0, and return how many pixels were decoded: fewer than it has where data are damaged."""
    i, nibble, previous = 0, 0, 0
    while i < depth.size:
        n_zeros, nibble = _next_number(words, nibble)
        n_others, nibble = _next_number(words, nibble)
        if n_zeros < 0 or n_others < 0 or n_zeros + n_others > depth.size - i or n_zeros + n_others == 0:
            return i
        i += n_zeros
        for _ in range(n_others):
            number, nibble = _next_number(words, nibble)
            previous += (number >> 1) ^ -(number & 1)
            if number < 0 or previous < 0 or previous > 65535:
                return i
            depth[i] = previous
            i += 1
    return i
