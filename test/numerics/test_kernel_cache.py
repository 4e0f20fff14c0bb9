"""A kernel is loaded from its cache only where that is whole and its own; else it is compiled anew."""

from __future__ import annotations

import importlib.util
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import pytest
from numba.core.caching import IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

SOURCE = """
from lrtrav_ros.numerics.kernels import kernel

@kernel
def plus_seven(x):
    return x + 7
"""


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module with a kernel, and a folder beside it for its cache."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "seven.py"
    path.write_text(SOURCE, encoding="utf-8")
    return path


def start(source: Path) -> Dispatcher:
    """Return the kernel as a process that starts finds it."""
    spec = importlib.util.spec_from_file_location(source.stem, source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    kernel: Dispatcher = module.plus_seven
    return kernel


def is_compiled(kernel: Dispatcher) -> bool:
    """Return whether a kernel that was called was compiled, and not loaded."""
    return bool(kernel.stats.cache_misses)


def cache_file(source: Path, suffix: str) -> Path:
    """Return the one file of this suffix in the cache."""
    (path,) = (source.parent / "cache").rglob(f"*.{suffix}")
    return path


def cut(data: bytes, n_bytes: int) -> bytes:
    return data[:n_bytes]


def flipped(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 16]) + data[place + 1 :]


DAMAGES = {
    "empty": lambda data: b"",
    "half": lambda data: data[: len(data) // 2],
    "zeros": lambda data: bytes(len(data)),
    "zeros at its end": lambda data: data[:-40] + bytes(40),
    "a flipped bit at its begin": lambda data: flipped(data, 3),
    "a flipped bit in its middle": lambda data: flipped(data, len(data) // 2),
}


def test_a_whole_cache_is_loaded(source: Path) -> None:
    first, second = start(source), start(source)
    assert (first(1), is_compiled(first)) == (8, True)
    assert (second(1), is_compiled(second)) == (8, False)


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_damaged_cache_is_replaced(source: Path, suffix: str, damage: str) -> None:
    start(source)(1)
    path = cache_file(source, suffix)
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    damaged, after = start(source), start(source)
    assert (damaged(1), is_compiled(damaged)) == (8, True)
    assert (after(1), is_compiled(after)) == (8, False)


def test_code_of_another_source_is_not_taken(source: Path) -> None:
    """A power loss between the two files leaves a new index beside old code."""
    start(source)(1)
    path = cache_file(source, "nbc")
    old = path.read_bytes()
    source.write_text(SOURCE.replace("+ 7", "+ 70"), encoding="utf-8")
    start(source)(1)
    path.write_bytes(old)
    kernel = start(source)
    assert (kernel(1), is_compiled(kernel)) == (71, True)


def test_code_for_other_types_is_not_taken(source: Path) -> None:
    """Two processes that compile for different types at the same time may give both the same file."""
    start(source)(1)
    path = cache_file(source, "nbc")
    of_int = path.read_bytes()
    cache_file(source, "nbi").unlink()
    start(source)(1.5)
    assert path == cache_file(source, "nbc")
    path.write_bytes(of_int)
    kernel = start(source)
    assert (kernel(1.5), is_compiled(kernel)) == (8.5, True)


def test_a_cache_that_cannot_be_written_is_done_without(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(IndexDataCacheFile, "_open_for_write", full)
    kernel = start(source)
    assert (kernel(1), is_compiled(kernel)) == (8, True)


def test_a_cache_that_cannot_be_read_is_done_without(source: Path) -> None:
    start(source)(1)
    path = cache_file(source, "nbi")
    path.unlink()
    path.mkdir()
    kernel = start(source)
    assert (kernel(1), is_compiled(kernel)) == (8, True)


def test_without_a_place_for_a_cache_kernels_are_compiled(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", os.devnull)  # no folder can be made in it
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    (source.parent / "__pycache__").write_bytes(b"")
    kernel = start(source)
    assert (kernel(1), is_compiled(kernel)) == (8, True)
    assert kernel.stats.cache_path is None


def test_several_may_compile_at_a_time(source: Path) -> None:
    values = [1, 1.5, True, 2j] * 3
    with ThreadPoolExecutor(len(values)) as pool:
        assert list(pool.map(lambda value: start(source)(value), values)) == [value + 7 for value in values]
    assert [start(source)(value) for value in values] == [value + 7 for value in values]
