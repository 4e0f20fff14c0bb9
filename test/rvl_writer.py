"""An encoder of RVL for the tests: slow, and written apart from the decoder."""

import itertools

import numpy as np


def rvl_of(image):
    """Return the RVL data of a (height, width) image of uint16."""
    nibbles, previous = [], 0
    pixels = [int(value) for value in image.reshape(-1)]
    runs = [(is_zero, list(run)) for is_zero, run in itertools.groupby(pixels, key=lambda value: value == 0)]
    if not runs[0][0]:
        nibbles += _number(0)
    for is_zero, run in runs:
        nibbles += _number(len(run))
        for value in () if is_zero else run:
            difference, previous = value - previous, value
            nibbles += _number(2 * difference if difference >= 0 else -2 * difference - 1)
    if runs[-1][0]:
        nibbles += _number(0)
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{nibble:x}" for nibble in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    return np.array(words, "<u4").tobytes()


def _number(value):
    """Return the nibbles of a number that is not negative."""
    parts = []
    while True:
        value, part = value >> 3, value & 7
        parts.append(part | (8 if value else 0))
        if not value:
            return parts
