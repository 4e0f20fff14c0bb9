"""Argument checks that public functions run before they call a kernel; kernels trust their arguments."""

from __future__ import annotations

import sys
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

_LARGEST = sys.float_info.max
_STRETCH = 1e-5  # of a rotation: what is left of one that was rounded to single precision, or to six digits

Shape: TypeAlias = tuple[int | str, ...]
"""Sizes of an array's axes; a name, such as ``"H"``, stands for any size, the same wherever it occurs."""


def check_array(
    name: str,
    array: NDArray[Any],
    dtypes: type[np.generic] | tuple[type[np.generic], ...],
    *shapes: Shape,
    may_be_empty: bool = False,
) -> None:
    """Check type and shape of an array; its layout in memory does not matter, and it may be read-only.

    Parameters
    ----------
    name : str
        The array's name in the error.
    array : ndarray
        What was given.
    dtypes : type of NumPy scalar, or several
        The types that its elements may have.
    *shapes : tuple of int and str
        The shapes that it may have, such as ``("H", "W", 3)``.
    may_be_empty : bool
        Whether it may have no elements.

    Raises
    ------
    TypeError
        If it is not a NumPy array, or a masked array or matrix, with which NumPy computes otherwise.
    ValueError
        If it has another type or shape.

    Examples
    --------
    >>> check_array("occupancy", np.zeros((4, 6), np.uint16), np.uint8, ("H", "W"))
    Traceback (most recent call last):
    ValueError: occupancy is uint16 (4, 6); give uint8 (H, W), not empty
    """
    dtypes = dtypes if isinstance(dtypes, tuple) else (dtypes,)
    is_array = isinstance(array, np.ndarray) and not isinstance(array, (np.ma.MaskedArray, np.matrix))
    fits = is_array and array.dtype in dtypes and any(_has_shape(array, shape) for shape in shapes)
    if fits and (array.size or may_be_empty):
        return
    types, sizes = " or ".join(str(np.dtype(dtype)) for dtype in dtypes), " or ".join(map(_shape_text, shapes))
    wanted = f"{types} {sizes}" + ("" if may_be_empty else ", not empty")
    if not is_array:
        raise TypeError(f"{name} is of type {type(array).__name__}; give a NumPy array of {wanted}")
    raise ValueError(f"{name} is {array.dtype} {_shape_text(array.shape)}; give {wanted}")


def check_image(name: str, image: NDArray[Any]) -> None:
    """Check an 8-bit image, grey (H, W) or BGR (H, W, 3); raises what `check_array` does."""
    check_array(name, image, np.uint8, ("H", "W"), ("H", "W", 3))


def check_labels(name: str, labels: NDArray[np.number[Any]], n_labels: int) -> int:
    """Check that labels, an array that is not empty, are numbers from 0 to `n_labels` - 1, and return the highest.

    Raises
    ------
    ValueError
        If one is not.
    """
    low, high = int(labels.min()), int(labels.max())
    if low < 0 or high >= n_labels:
        raise ValueError(f"{name} holds {low if low < 0 else high}; give labels from 0 to {n_labels - 1}")
    return high


def check_distances(name: str, distances: NDArray[np.float64], *, highest: float = np.finfo(np.float64).max) -> None:
    """Check a matrix of the distances between n things, float64 (n, n), from 0 to `highest`; n may be 0.

    Raises
    ------
    TypeError
        If it is not a NumPy array.
    ValueError
        If it is no such matrix.
    """
    check_array(name, distances, np.float64, ("n", "n"), may_be_empty=True)
    low, high = (float(distances.min()), float(distances.max())) if distances.size else (0.0, 0.0)
    if not (low >= 0 and high <= highest):
        raise ValueError(
            f"{name} holds values from {low:g} to {high:g}; give finite distances from 0 up to {highest:g}"
        )


def check_finite(name: str, array: NDArray[np.floating[Any]]) -> None:
    """Check that no element is infinite or NaN; raises ValueError if one is."""
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds values that are not finite; give finite numbers")


def check_range(name: str, array: NDArray[np.floating[Any]], low: float, high: float) -> None:
    """Check that all elements, if there are any, are in a range; raises ValueError if one is not, or is NaN."""
    if array.size and not (array.min() >= low and array.max() <= high):
        values = f"{array.min():g} to {array.max():g}"
        raise ValueError(f"{name} holds values from {values}; give {low:g} to {high:g}")


def check_rotation(name: str, matrix: NDArray[np.float64]) -> None:
    """Check that a matrix turns vectors and does nothing else.

    Raises
    ------
    TypeError, ValueError
        If it is no (3, 3) array of finite float64, not orthonormal, or mirrors.
    """
    check_array(name, matrix, np.float64, (3, 3))
    check_finite(name, matrix)
    if not is_rotation(matrix):
        raise ValueError(f"{name} is {matrix.tolist()}; give an orthonormal matrix of determinant 1")


def is_rotation(matrix: NDArray[np.float64]) -> bool:
    """Return whether a matrix (3, 3) of finite numbers is a rotation, to 1e-5; then the transposed one is one too."""
    if np.abs(matrix).max() > 2:  # products of the numbers may be infinite
        return False
    stretch = np.linalg.svd(matrix, compute_uv=False)
    return bool(np.abs(stretch - 1).max() <= _STRETCH and np.linalg.det(matrix) > 0)


def check_count(name: str, count: int, *, least: int = 1, most: int = 2**31 - 1) -> int:
    """Check a number of things, and return it as Python's own: NumPy's overflow.

    Raises
    ------
    TypeError
        If it is not a whole number.
    ValueError
        If it is out of range; what is made for each of the things has to fit into memory.
    """
    if isinstance(count, (bool, np.timedelta64)) or not isinstance(count, (int, np.integer)):
        raise TypeError(f"{name} is {count!r}; give a whole number")
    count = int(count)
    if not least <= count <= most:
        raise ValueError(f"{name} is {count}; give {least} to {most}")
    return count


def check_stamp(stamp_ns: int) -> int:
    """Check a time in nanoseconds, a whole number of 64 bits, as `check_count` does, and return it."""
    return check_count("stamp_ns", stamp_ns, least=-(2**63), most=2**63 - 1)


def check_number(name: str, number: float, *, above: float | None = None, most: float = _LARGEST) -> float:
    """Check a finite number, such as a length, and return it as Python's own: NumPy's may be of any precision.

    Parameters
    ----------
    name : str
        Its name in the error.
    number : float
        What was given; whole numbers will do.
    above : float, optional
        What it has to be greater than.
    most : float
        What it may be at most, above or below 0.

    Raises
    ------
    TypeError
        If it is no number.
    ValueError
        If it is NaN or out of range.
    """
    if isinstance(number, (bool, np.timedelta64)) or not isinstance(number, (int, float, np.integer, np.floating)):
        raise TypeError(f"{name} is {number!r}; give a number")
    if isinstance(number, np.generic):
        number = float(number)  # single precision would overflow when it is compared
    if not (abs(number) <= most and (above is None or number > above)):
        bounds = ("" if above is None else f" above {above:g}") + ("" if most == _LARGEST else f", at most {most:g}")
        raise ValueError(f"{name} is {number}; give a finite number{bounds}")
    return float(number)


def check_type(name: str, value: object, kind: type, *, may_be_none: bool = False) -> None:
    """Check that a value is of a class, or None where it may be; raises TypeError if it is not."""
    if not isinstance(value, kind) and not (may_be_none and value is None):
        none = " or None" if may_be_none else ""
        raise TypeError(f"{name} is of type {type(value).__name__}; give {kind.__name__}{none}")


def _has_shape(array: NDArray[Any], shape: Shape) -> bool:
    """Return whether an array has a shape, in which names stand for any size."""
    sizes: dict[str, int] = {}
    return array.ndim == len(shape) and all(
        size == (sizes.setdefault(wanted, size) if isinstance(wanted, str) else wanted)
        for size, wanted in zip(array.shape, shape, strict=True)
    )


def _shape_text(shape: Shape) -> str:
    """Return a shape as it is written, with a comma where it has one axis."""
    return f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
