"""numba's cache of compiled kernels on disk, made safe from power losses, full disks and processes side by side.

What is damaged is compiled and written anew; what can be neither read nor written is done without. A digest finds
accidents, not intent: whoever may write to the cache may run code here.
"""

from __future__ import annotations

import contextlib
import hashlib
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba.core.caching import Cache, FunctionCache, IndexDataCacheFile, NullCache

_N_DIGEST = hashlib.sha256().digest_size


def kernel_cache(function: Any) -> Cache | NullCache:
    """Return the cache of a function that is to be compiled; one that is always empty where no folder can be had."""
    try:
        return _KernelCache(function)
    except RuntimeError:  # numba's, where it finds no folder that it may write to
        return NullCache()


class _CacheFiles(IndexDataCacheFile):
    """The files of one function, each with a digest at its end; those with code say what it is the code of."""

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (self._source_stamp, key, data))

    def load(self, key: Any) -> Any:
        # The index may be newer than the code: the power went between the two, or another process took its name.
        stamp, of, data = super().load(key) or (None, None, None)
        return data if (stamp, of) == (self._source_stamp, key) else None

    def _dump(self, obj: Any) -> bytes:
        data: bytes = super()._dump(obj)
        return data + hashlib.sha256(data).digest()  # which `pickle` does not read

    def _load_index(self) -> Any:
        version = pickle.dumps(self._version, protocol=-1)  # before all that `_dump` returned
        return super()._load_index() if _is_whole(Path(self._index_path), after=version) else {}

    def _load_data(self, name: str) -> Any:
        return super()._load_data(name) if _is_whole(Path(self._data_path(name))) else None


class _KernelCache(FunctionCache):
    """numba's cache with checked files, for which no error of the disk is one of the kernel."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        impl = self._impl
        self._cache_file = _CacheFiles(self._cache_path, impl.filename_base, impl.locator.get_source_stamp())

    @contextlib.contextmanager
    def _guard_against_spurious_io_errors(self) -> Iterator[None]:
        with contextlib.suppress(OSError):
            yield


def _is_whole(path: Path, after: bytes = b"") -> bool:
    """Return whether a file begins with some bytes, and the rest ends with its digest; nothing else is unpickled."""
    try:
        data = path.read_bytes()
    except OSError:
        return False
    return data.startswith(after) and hashlib.sha256(data[len(after) : -_N_DIGEST]).digest() == data[-_N_DIGEST:]
