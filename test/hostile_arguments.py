"""What public functions are given in place of arguments that they can have."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

NO_ARRAYS = (None, 3, "text", [[1, 2], [3, 4]], b"12", {"a": 1}, object())
STRANGE_TYPES = ("O", "M8[s]", "m8[s]", "U1", "S1", "c8", "c16", "g", "e", ">u2", ">i4", ">f4", ">f8", "i4,f4", "V3")
TYPES = ("?", *"bBhHiIlLfd", *STRANGE_TYPES)
KINDS_OF_NUMBERS = (*(np.dtype(name).type for name in ("b", "B", "h", "H", "q", "Q", "e", "f", "d", "g")),)
NEVER_ARRAYS = (
    *(value for value in NO_ARRAYS if value != 3),
    *map(np.dtype, ("O", "M8[s]", "U1", "c8", "i4,f4", "V3")),
)
SHAPES = ((), (0,), (1,), (7,), (0, 0), (0, 20), (12, 0), (1, 1), (1, 9), (9, 1), (5, 3), (13, 20), (12, 21), (12, 20),
          (12, 20, 0), (12, 20, 1), (12, 20, 2), (12, 20, 3), (12, 20, 4), (1, 1, 3), (2, 12, 20, 3))  # fmt: skip
NUMBERS = (
    *(None, True, "3", b"3", [1], object(), 1j, 0, 1, -1, 2, 3, 255, 2**15, 2**31 - 1, 2**31, -(2**31), 2**62, 2**64),
    *(10**400, 0.5, -0.5, 1e-300, 1e300, -1e300, float("nan"), float("inf"), -float("inf"), np.float32(2), np.int64(2)),
    *(np.array(2), np.array([1, 2]), np.nan, np.int8(1), np.int16(-3), np.uint64(2**64 - 1)),
    *(np.float16(0.5), np.longdouble("1e4000"), np.bool_(True), np.timedelta64(5, "s")),
)
WORDS = (None, 3, "", "no such word", b"rgb8", ["mono8"], "mono16", "32FC1", "nv12", "wld", object())


class Matrix(np.ndarray):
    """An array of a class of its own."""


def in_place_of(value: Any) -> Iterator[Any]:
    """Yield values in place of a good one."""
    if isinstance(value, np.ndarray):
        yield from _arrays(value)
        yield from in_layouts(value)
    elif isinstance(value, (bool, int, float)):
        yield from NUMBERS
    elif isinstance(value, str):
        yield from WORDS
    elif dataclasses.is_dataclass(value) or hasattr(value, "_fields"):
        yield from (None, {}, "text", 3, object(), type(value), [value], np.zeros((12, 20), np.uint8))
        yield from _records(value)
    else:
        yield from (None, {}, "text", 3, object(), np.zeros((12, 20), np.uint8))


def _arrays(array: NDArray[Any]) -> Iterator[Any]:
    """Yield what is no array, or one of another type, shape or content."""
    yield from NO_ARRAYS
    for name in TYPES:
        yield np.zeros(array.shape, name)
    for shape in SHAPES:
        yield np.zeros(shape, array.dtype)
    yield from contents(array)


def in_layouts(array: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield an array, or one that shares its memory with itself, in layouts that no kernel is compiled anew for."""
    yield np.flip(np.ascontiguousarray(np.flip(array)))
    yield np.asfortranarray(array)
    yield array.view(Matrix)
    yield np.ma.masked_array(array, mask=np.zeros(array.shape, bool))
    if array.ndim:
        yield np.repeat(array, 2, axis=-1)[..., ::2]
    if array.ndim > 1:
        yield np.lib.stride_tricks.as_strided(array, array.shape, (*array.strides[1:2], *array.strides[1:]))


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array that cannot be written to."""
    return np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape)


def contents(array: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield arrays of the same type with numbers that are out of range, or in one place only."""
    if array.dtype.kind == "f":
        extremes: tuple[Any, ...] = (np.nan, np.inf, -np.inf, -1, 0, 1, 1e-38, 1e38, 2.0**15, 2.0**31, -1e38)
    elif array.dtype.kind in "iu":
        limits = np.iinfo(array.dtype)
        extremes = tuple({int(limits.min), max(-1, int(limits.min)), 0, 1, 7, array.size % 127, int(limits.max)})
    else:
        extremes = (False, True)
    for value in extremes:
        yield np.full(array.shape, value, array.dtype)
        if array.size:
            once = array.copy()
            once.reshape(-1)[array.size // 2] = value
            yield once


def _records(record: Any) -> Iterator[Any]:
    """Yield records of the same kind with a field that does not fit, as far as the kind lets itself be made of it."""
    names = record._fields if hasattr(record, "_fields") else [item.name for item in dataclasses.fields(record)]
    for name in names:
        field = getattr(record, name)
        for value in _arrays(field) if isinstance(field, np.ndarray) else in_place_of(field):
            if isinstance(field, np.ndarray) or not callable(value):
                try:
                    changed = (
                        record._replace(**{name: value})
                        if hasattr(record, "_fields")
                        else dataclasses.replace(record, **{name: value})
                    )
                except Exception:
                    continue  # it cannot be made: the call that makes it is attacked itself
                yield changed
