"""The arrays of a ``.mat`` file, read by another process: one that crashes SciPy's reader is an error, and no more."""

from __future__ import annotations

import ast
import atexit
import io
import math
import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.evaluation.truth import mat_child
from lrtrav_ros.io.input_files import read_bytes

SECONDS = 10.0
"""What reading a file may take, of a processor."""

_SCRIPT = mat_child.__file__


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Read the arrays of a file.

    A file that takes more than `SECONDS`, or more memory than `mat_child.MEMORY_BYTES`, is refused. The other process
    stays for the next files, and ends with this one.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    dict of str to ndarray
        Arrays by name; those in a struct as ``STRUCT.FIELD``. What is no number or text is None.

    Raises
    ------
    OSError, ValueError
        If it cannot be read; the message names it.
    """
    data = read_bytes(path)
    try:
        return _CHILD.arrays(data)
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


class _Child:
    """The process that reads, started with the first file."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def arrays(self, data: bytes) -> dict[str, NDArray[Any]]:
        """Return the arrays of a file; raises ValueError."""
        with self._lock:
            self._process = self._process or _started()
            try:
                found = _answer(self._process, data)
            except BaseException:
                self.end()  # it is gone, or has more to say than was read
                raise
        if isinstance(found, str):
            raise ValueError(found)
        return found

    def end(self) -> None:
        """End the process, if there is one."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()

    def leave(self) -> None:
        """Leave the process to the one that this one was forked from."""
        self._lock = threading.Lock()
        if self._process is not None:
            self._process.returncode = 0  # no child of this one, so that there is nothing to wait for
            self._process = None


_CHILD = _Child()
atexit.register(_CHILD.end)
os.register_at_fork(after_in_child=_CHILD.leave)


def _started() -> subprocess.Popen[bytes]:
    """Return a new process that finds modules where this one does, and ends with its standard input."""
    return subprocess.Popen(
        [sys.executable, _SCRIPT, str(SECONDS)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,  # where the allocator tells of damaged memory
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"},
        start_new_session=True,  # Ctrl-C is for this process
    )


def _answer(process: subprocess.Popen[bytes], data: bytes) -> dict[str, NDArray[Any]] | str:
    """Return the arrays that the process finds in a file, or what is wrong with it."""
    source, output = cast(IO[bytes], process.stdin), cast(io.BufferedReader, process.stdout)
    with suppress(BrokenPipeError):  # then there is no answer
        source.write(mat_child.LENGTH.pack(len(data)))
        source.write(data)
        source.flush()
    line = output.readline()
    if not line:
        raise ValueError(f"cannot be read: the process that reads MATLAB files ended with status {process.wait()}")
    found = ast.literal_eval(line.decode("ascii"))
    if isinstance(found, str):
        return found
    return {name: _array(output, np.dtype(kind), shape) for name, kind, shape in found}


def _array(source: io.BufferedReader, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Return the next array."""
    if dtype.hasobject:
        return np.empty(shape, dtype)
    buffer = bytearray(dtype.itemsize * math.prod(shape))
    if source.readinto(buffer) < len(buffer):
        raise ValueError("cannot be read: the process that reads MATLAB files was ended")
    return np.ndarray(shape, dtype, buffer, order="F")
