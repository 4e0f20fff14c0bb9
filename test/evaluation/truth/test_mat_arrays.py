"""The process that reads `.mat` files: damaged ones are errors that name the file, and it ends with its parent."""

import io
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from damaged_files import refusal, truncated, variants
from scipy.io import savemat

from lrtrav_ros.commands import run
from lrtrav_ros.evaluation.truth import mat_arrays, mat_child
from lrtrav_ros.evaluation.truth.mat_arrays import read_arrays

SOURCE = Path(mat_child.__file__).read_text(encoding="utf-8")
READING = "loadmat(io.BytesIO(data)).items()"
ARRAYS = {"image": np.arange(60, dtype=np.uint8).reshape(4, 5, 3), "labels": np.eye(4, 5)}


def mat_bytes(content, *, compressed=False):
    file = io.BytesIO()
    savemat(file, content, do_compression=compressed)
    return file.getvalue()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "frame.mat"


@pytest.fixture
def script(tmp_path, monkeypatch):
    """Return a function that has files read by another script."""

    def replace(text):
        (tmp_path / "script.py").write_text(text)
        monkeypatch.setattr(mat_arrays, "_SCRIPT", str(tmp_path / "script.py"))
        mat_arrays._CHILD.end()

    yield replace
    mat_arrays._CHILD.end()


def same(found, wanted):
    return found.keys() == wanted.keys() and all(np.array_equal(found[name], wanted[name]) for name in wanted)


def alive(process):
    """Return whether a process is there, and is not only waited for."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:  # it may go while it is looked at
        return False


def wait_until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_arrays_come_as_scipy_reads_them(path):
    struct = {"a": 1.5, "text": "left", "deeper": {"b": np.array([[1, 2]], np.int16)}}
    cells = np.empty((1, 2), object)
    cells[:] = "x"
    content = {**ARRAYS, "struct": struct, "cells": cells, "empty": np.zeros((0, 3)), "complex": np.array([[1j]])}
    path.write_bytes(mat_bytes(content, compressed=True))
    found = read_arrays(path)
    assert list(found) == [
        *("image", "labels", "struct.a", "struct.text", "struct.deeper.b", "cells", "empty", "complex"),
    ]
    for name, array in ARRAYS.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert np.array_equal(found[name], array)
        assert found[name].flags.writeable
    assert found["struct.text"].tolist() == ["left"]
    assert found["struct.deeper.b"].tolist() == [[1, 2]]
    assert (found["cells"].shape, found["cells"].dtype, found["empty"].shape) == ((1, 2), np.dtype(object), (0, 3))
    assert found["complex"][0, 0] == 1j


@pytest.mark.parametrize("compressed", [False, True])
def test_damaged_files_are_refused_by_name_and_the_next_one_is_read(path, compressed):
    whole = mat_bytes(ARRAYS, compressed=compressed)
    for damaged in variants(whole, n_flips=30, step=64):
        path.write_bytes(damaged)
        assert re.match(f"{path}: |$", refusal(read_arrays, path))
    path.write_bytes(whole)
    assert same(read_arrays(path), ARRAYS)


def test_every_file_that_is_cut_off_is_refused(path):
    for cut in truncated(mat_bytes(ARRAYS, compressed=True), step=16):
        path.write_bytes(cut)
        with pytest.raises(ValueError, match=r"frame\.mat: cannot be read as a MATLAB file"):
            read_arrays(path)


def test_a_crash_of_the_reader_is_an_error(path, script, capsys):
    """SciPy 1.11 to 1.16 at least die of these."""
    whole = mat_bytes({"a": {"b": np.arange(6.0).reshape(2, 3), "c": "text"}, "z": np.eye(2) * 1j})
    for offset in (209, 236, 240):
        damaged = bytearray(whole)
        damaged[offset] ^= 8 if offset == 209 else 1
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"frame\.mat: cannot be read as a MATLAB file \("):
            read_arrays(path)
    assert run("evaluate", ["--inspect", str(path)]) == 1
    assert f"{path}: cannot be read as a MATLAB file (" in capsys.readouterr().err
    script(SOURCE.replace(READING, "os.kill(os.getpid(), signal.SIGSEGV) or {}.items()"))
    with pytest.raises(ValueError, match=r"frame\.mat: .*\(SciPy's reader ended by SIGSEGV\)"):
        read_arrays(path)


def test_a_file_that_takes_too_long_is_refused(path, script, monkeypatch):
    monkeypatch.setattr(mat_arrays, "SECONDS", 0.05)
    script(SOURCE.replace(READING, "max(iter(int, 1))"))
    path.write_bytes(mat_bytes(ARRAYS))
    with pytest.raises(ValueError, match=r"frame\.mat: takes more than 0.05 s to read as a MATLAB file"):
        read_arrays(path)


def test_a_file_that_takes_too_much_memory_is_refused(path):
    damaged = bytearray(mat_bytes({"a": np.zeros((2, 2), np.uint8)}))
    at = damaged.index((2).to_bytes(4, "little") * 2)
    damaged[at : at + 8] = (1 << 16).to_bytes(4, "little") * 2
    path.write_bytes(damaged)
    with pytest.raises(ValueError, match=r"frame\.mat: cannot be read as a MATLAB file"):
        read_arrays(path)


def test_threads_and_forks_have_files_read_side_by_side(path):
    path.write_bytes(mat_bytes(ARRAYS))
    with ThreadPoolExecutor(4) as threads:
        assert all(same(found, ARRAYS) for found in threads.map(read_arrays, [path] * 20))
    before = mat_arrays._CHILD._process.pid
    reader, writer = os.pipe()
    fork = os.fork()
    if fork == 0:
        os.write(writer, b"same" if same(read_arrays(path), ARRAYS) else b"other")
        mat_arrays._CHILD.end()
        os._exit(0)
    assert same(read_arrays(path), ARRAYS)
    assert os.waitpid(fork, 0)[1] == 0
    assert os.read(reader, 5) == b"same"
    assert mat_arrays._CHILD._process.pid == before


def test_daemonic_processes_read_files(path):
    path.write_bytes(mat_bytes(ARRAYS))
    with multiprocessing.get_context("spawn").Pool(1) as pool:  # as Dask's workers are
        assert same(pool.apply(read_arrays, (path,)), ARRAYS)


def test_the_process_ends_with_a_parent_that_is_killed(path):
    path.write_bytes(mat_bytes(ARRAYS))
    code = (
        "import sys; from pathlib import Path; from lrtrav_ros.evaluation.truth import mat_arrays\n"
        "mat_arrays.read_arrays(Path(sys.argv[1])); print(mat_arrays._CHILD._process.pid, flush=True); input()"
    )
    parent = subprocess.Popen([sys.executable, "-c", code, str(path)], stdin=-1, stdout=-1)
    child = int(parent.stdout.readline())
    assert alive(child)
    parent.kill()
    parent.communicate()
    wait_until(lambda: not alive(child))


def test_a_process_that_was_killed_is_started_anew(path):
    path.write_bytes(mat_bytes(ARRAYS))
    read_arrays(path)
    child = mat_arrays._CHILD._process.pid
    os.kill(child, signal.SIGKILL)
    with pytest.raises(ValueError, match=r"frame\.mat: .* ended with status -9"):
        read_arrays(path)
    assert same(read_arrays(path), ARRAYS)
    assert not alive(child)
