"""Tests of the compilation of kernels: once, and apart from the nodes."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from lrtrav_ros import Config
from lrtrav_ros.nodes import process
from lrtrav_ros.nodes.warm_up import compile_kernels

CODE = """
from lrtrav_ros import Config
from lrtrav_ros.nodes.warm_up import _kernels, compile_kernels
compiled = compile_kernels(Config())
print(compiled, len(_kernels()) > 20)
"""

FRAMES = """
import numpy as np
from lrtrav_ros import Config, Detector, StereoCamera
from lrtrav_ros.config import NODE_DEFAULTS
from lrtrav_ros.nodes.warm_up import _kernels, compile_kernels

def count():
    return sum(len(kernel.signatures) for kernel in _kernels())

config = Config().updated(NODE_DEFAULTS)
compile_kernels(config)
before = count()
detector = Detector(config, StereoCamera(fx=200.0, cx=100.0, cy=40.0, baseline_m=0.2))
left = np.random.default_rng(0).integers(0, 256, (160, 200, 3), np.uint8)
ground = np.repeat(np.maximum(0.2 * (np.arange(160, dtype=np.float32) - 40), 0)[:, None], 200, axis=1)
for _ in range(2):
    found = detector.detect(left, disparity=ground)
    print(found.clusters.shape, found.long_range.confidence.shape)
print(len(detector.long_range.memory) > 0, before > 20, count() - before)
"""


def test_kernels_are_compiled_once_and_then_loaded() -> None:
    compile_kernels(Config())
    again = subprocess.run([sys.executable, "-c", CODE], check=True, capture_output=True, text=True)
    assert again.stdout.strip() == "False True"


def test_frames_with_memory_confidence_and_clusters_compile_nothing_more() -> None:
    done = subprocess.run([sys.executable, "-c", FRAMES], check=True, capture_output=True, text=True)
    assert done.stdout.splitlines() == ["(160, 200) (160, 200)"] * 2 + ["True True 0"]


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
