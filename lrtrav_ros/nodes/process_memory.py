"""Memory of a process that runs nodes: images find their place again, and of the rest only what is needed stays."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import re
from pathlib import Path

# Of malloc.h: what is returned to the system when it is freed, from what size on a block is mapped by itself (32 MB is
# the greatest), and the number of heaps.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
_MALLOC_OPTIONS = ((_M_TRIM_THRESHOLD, 128 * 2**20), (_M_MMAP_THRESHOLD, 32 * 2**20), (_M_ARENA_MAX, 1))

_MADV_DONTNEED = 4  # mman.h
# Only code: nobody writes to it, so that it can be read again from its file.
_COMPILER_CODE = re.compile(r"^([0-9a-f]+)-([0-9a-f]+) r-xp .*/libllvmlite\.so$", re.MULTILINE)


def keep_freed_images() -> None:
    """Let the C library (glibc) use the memory of freed images again; to be called before there are threads.

    By itself it maps each image anew, and the system fills it with zeros page by page: that makes a copy of an image
    ten times as expensive. One heap for all threads wastes less memory than one for each.
    """
    with contextlib.suppress(OSError, AttributeError):
        for option, value in _MALLOC_OPTIONS:
            ctypes.CDLL(None).mallopt(option, value)


def settle() -> None:
    """Give up what only the start needed: freed memory, and the code of the compiler, which is read again if need be.

    What is there now stays: the garbage collector, which would take the time of a frame for it, leaves it alone.
    """
    gc.collect()
    gc.freeze()
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.malloc_trim(0)
        for first, last in _COMPILER_CODE.findall(Path("/proc/self/maps").read_text()):
            size = int(last, 16) - int(first, 16)
            library.madvise(ctypes.c_void_p(int(first, 16)), ctypes.c_size_t(size), _MADV_DONTNEED)
