"""The one way in which this package declares compiled functions.

Kernels stand in a private module ``_X_kernels.py`` beside the public module ``X.py``, which alone calls them: it checks
and explains their arguments. Kernels trust what they are given. Those that call each other stand in one file, for
numba's cache on disk notices changes of no other file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from lrtrav_ros.numerics.kernel_cache import kernel_cache

_Function = TypeVar("_Function", bound=Callable[..., object])

# Sums in any order, and values that are all finite: what the compiler needs to vectorise a sum.
_REORDERED = {"reassoc", "contract", "nsz", "nnan", "ninf"}


def kernel(function: _Function) -> _Function:
    """Compile a function at its first call; it runs without the GIL, is cached on disk and divides as NumPy does."""
    return _cached(numba.njit(nogil=True, error_model="numpy")(function))


def summing_kernel(function: _Function) -> _Function:
    """Compile a function as `kernel` does, with sums in whatever order is fastest; its numbers have to be finite."""
    return _cached(numba.njit(nogil=True, error_model="numpy", fastmath=_REORDERED)(function))


def inlined_kernel(function: _Function) -> _Function:
    """Compile a function into each kernel that calls it, which saves the calls; it is for the kernels of its file."""
    return numba.njit(nogil=True, error_model="numpy", inline="always")(function)


def _cached(dispatcher: Any) -> Any:
    """Return a function that numba compiles, with a cache on disk; what ``NUMBA_DISABLE_JIT`` leaves is as it was."""
    if hasattr(dispatcher, "py_func"):
        dispatcher._cache = kernel_cache(dispatcher.py_func)  # numba's own, `cache=True`, loads whatever is there
    return dispatcher
