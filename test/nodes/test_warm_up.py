"""Tests of the compilation of kernels: once, and apart from the nodes."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from lrtrav_ros.nodes import process

CODE = """
from lrtrav_ros import Config
from lrtrav_ros.nodes.warm_up import _kernels, compile_kernels
compiled = compile_kernels(Config())
print(compiled, len(_kernels()) > 20)
"""


def test_kernels_are_compiled_once_and_then_loaded() -> None:
    subprocess.run([sys.executable, "-c", CODE], check=True)
    again = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert again.stdout.strip() == "False True"


@pytest.mark.parametrize(("compiled", "starts"), [(True, 1), (False, 0)])
def test_a_process_that_compiled_starts_anew_once(monkeypatch: pytest.MonkeyPatch, compiled: bool, starts: int) -> None:
    started: list[list[str]] = []
    monkeypatch.setenv("LRTRAV_KERNELS_COMPILED", "")
    monkeypatch.delenv("LRTRAV_KERNELS_COMPILED")
    monkeypatch.setattr(process, "compile_kernels", lambda config: compiled)
    monkeypatch.setattr(os, "execv", lambda program, arguments: started.append(arguments))
    process._compile_apart()
    process._compile_apart()
    assert started == [sys.orig_argv] * starts
