"""Tests of the compilation of kernels: once, and apart from the nodes."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from lrtrav_ros.nodes import process as detector

CODE = """
from lrtrav_ros import Config
from lrtrav_ros.nodes.warm_up import compile_kernels
print(compile_kernels(Config()))
"""


def test_kernels_are_compiled_once_and_then_loaded() -> None:
    subprocess.run([sys.executable, "-c", CODE], check=True)
    again = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert again.stdout.strip() == "False"


@pytest.mark.parametrize(("compiled", "starts"), [(True, 1), (False, 0)])
def test_a_process_that_compiled_starts_anew_once(monkeypatch: pytest.MonkeyPatch, compiled: bool, starts: int) -> None:
    started: list[list[str]] = []
    monkeypatch.setenv("LRTRAV_KERNELS_COMPILED", "")
    monkeypatch.delenv("LRTRAV_KERNELS_COMPILED")
    monkeypatch.setattr(detector, "compile_kernels", lambda config: compiled)
    monkeypatch.setattr(os, "execv", lambda program, arguments: started.append(arguments))
    detector._compile_apart()
    detector._compile_apart()
    assert started == [sys.orig_argv] * starts
