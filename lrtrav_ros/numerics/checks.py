"""Argument checks that public functions run before they call a kernel; kernels trust their arguments."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

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
        If it is not a NumPy array.
    ValueError
        If it has another type or shape.

    Examples
    --------
    >>> check_array("occupancy", np.zeros((4, 6), np.uint16), np.uint8, ("H", "W"))
    Traceback (most recent call last):
    ValueError: occupancy is uint16 (4, 6); give uint8 (H, W), not empty
    """
    dtypes = dtypes if isinstance(dtypes, tuple) else (dtypes,)
    is_array = isinstance(array, np.ndarray)
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


def check_distances(name: str, distances: NDArray[np.float64]) -> None:
    """Check a matrix of the distances between n things, float64 (n, n), finite and not negative; n may be 0.

    Raises
    ------
    TypeError
        If it is not a NumPy array.
    ValueError
        If it is no such matrix.
    """
    check_array(name, distances, np.float64, ("n", "n"), may_be_empty=True)
    low, high = (float(distances.min()), float(distances.max())) if distances.size else (0.0, 0.0)
    if not (low >= 0 and high < np.inf):
        raise ValueError(f"{name} holds values from {low:g} to {high:g}; give finite distances from 0 up")


def check_finite(name: str, array: NDArray[np.floating[Any]]) -> None:
    """Check that no element is infinite or NaN; raises ValueError if one is."""
    if not np.isfinite(array).all():
        raise ValueError(f"{name} holds values that are not finite; give finite numbers")


def check_rotation(name: str, matrix: NDArray[np.float64]) -> None:
    """Check that a matrix turns vectors and does nothing else.

    Raises
    ------
    TypeError, ValueError
        If it is no (3, 3) array of finite float64, not orthonormal, or mirrors.
    """
    check_array(name, matrix, np.float64, (3, 3))
    check_finite(name, matrix)
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6) or np.linalg.det(matrix) < 0:
        raise ValueError(f"{name} is {matrix.tolist()}; give an orthonormal matrix of determinant 1")


def check_count(name: str, count: int) -> None:
    """Check a number of things, at least 1.

    Raises
    ------
    TypeError
        If it is not a whole number.
    ValueError
        If it is below 1.
    """
    if isinstance(count, bool) or not isinstance(count, (int, np.integer)):
        raise TypeError(f"{name} is {count!r}; give a whole number")
    if count < 1:
        raise ValueError(f"{name} is {count}; give at least 1")


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
