"""Reads ``.mat`` files for `mat_arrays`, as a process that only this file is run in.

Damaged files crash SciPy's reader, so each is read by a fork of this process. It is given the bytes of a file with
their number before them, and answers with a line and the arrays' bytes. The line is a Python literal: a text that says
what is wrong, or a list of (name, type, shape) whose bytes follow, in Fortran's order of axes; objects have none. It
ends with its input, thus with the process that started it.
"""

from __future__ import annotations

import io
import os
import resource
import signal
import struct
import sys
import warnings
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

MEMORY_BYTES = 2 << 30
"""Address space for reading a file, where the system limits it."""

ARRAY_BYTES = 1 << 29
"""Most bytes of the arrays of a file."""

LENGTH = struct.Struct("<Q")
"""The number of bytes before a file's."""


def answer(data: bytes, seconds: float) -> list[bytes]:
    """Return the parts of the answer to the bytes of a file; ends the process where reading takes longer."""
    try:
        signal.setitimer(signal.ITIMER_PROF, seconds)
        return _encoded(read(data))
    except NotImplementedError:
        return [_line("is a file of MATLAB 7.3; save it with the option -v7")]
    except Exception as err:  # damaged files lead SciPy into errors of any kind, UnboundLocalError for one
        return [_line(f"cannot be read as a MATLAB file ({' '.join(str(err).split()) or type(err).__name__})")]
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def read(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file by name, those in a struct as ``STRUCT.FIELD``; raises whatever SciPy does."""
    arrays = {
        name: array
        for key, value in loadmat(io.BytesIO(data)).items()
        if not key.startswith("__")
        for name, array in _flattened(key, np.asarray(value))
    }
    if not any(array.size for array in arrays.values()):  # older versions of SciPy read zeros as an empty file
        raise ValueError("it holds no arrays")
    n_bytes = sum(array.nbytes for array in arrays.values())
    if n_bytes > ARRAY_BYTES:
        raise ValueError(f"its arrays have {n_bytes} bytes, more than {ARRAY_BYTES}")
    return arrays


def _flattened(name: str, value: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield an array, or those of a struct, with names."""
    if value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            yield from _flattened(f"{name}.{field}", np.asarray(value.flat[0][field]))
    else:
        yield name, value


def _encoded(arrays: Mapping[str, NDArray[Any]]) -> list[bytes]:
    """Return the line of the arrays, and the bytes of each."""
    found = [
        (name, array.dtype.descr if array.dtype.names else array.dtype.str, array.shape)
        for name, array in arrays.items()
    ]
    return [_line(found), *(array.tobytes(order="F") for array in arrays.values() if not array.dtype.hasobject)]


def _line(value: object) -> bytes:
    return f"{value!a}\n".encode()


def _answer_of_fork(data: bytes, output: BinaryIO, seconds: float) -> int:
    """Let a fork answer, and return its status."""
    process = os.fork()
    if process == 0:
        status = 1
        try:
            output.writelines(answer(data, seconds))
            output.flush()
            status = 0
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def _reason(status: int, seconds: float) -> str:
    """Return why a fork ended without an answer."""
    if status == -signal.SIGPROF:
        return f"takes more than {seconds:g} s to read as a MATLAB file"
    how = f"by {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
    return f"cannot be read as a MATLAB file (SciPy's reader ended {how})"


def main(seconds: float) -> None:
    """Answer until the input ends."""
    limit = min(size for size in (MEMORY_BYTES, *resource.getrlimit(resource.RLIMIT_AS)) if size >= 0)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    source, output = sys.stdin.buffer, sys.stdout.buffer
    while len(head := source.read(LENGTH.size)) == LENGTH.size:
        status = _answer_of_fork(source.read(*LENGTH.unpack(head)), output, seconds)
        if status:
            output.write(_line(_reason(status, seconds)))
            output.flush()


if __name__ == "__main__":
    main(float(sys.argv[1]))
