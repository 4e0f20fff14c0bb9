"""A detector that runs for hours compiles nothing, allocates little and keeps nothing, on any number of threads."""

from __future__ import annotations

import dataclasses
import gc
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import recorded
from numba.core.runtime import _nrt_python, rtsys
from recorded import HEIGHT, WIDTH

from lrtrav_ros import Config, Detector
from lrtrav_ros.config import NODE_DEFAULTS
from lrtrav_ros.detector import Detection
from lrtrav_ros.frame import Frame

SETTINGS = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60}
BYTES_PER_PIXEL = 100  # a frame and all that it takes to detect in it; 57 at the time of writing
KEPT_BYTES = 40_000  # in 20 frames, less than a mask and a half; the interpreter's own lists grow a little

COMPILES_NOTHING = """
import dataclasses, sys
import numpy as np
sys.path.insert(0, {test!r})
import recorded
from lrtrav_ros import Config, Detector
from lrtrav_ros.nodes.warm_up import _kernels, compile_kernels

# Rendering compiles kernels of its own, and so does what makes the frames.
frames = [frame for source in ("stereo", "disparity", "depth") for frame in recorded.frames(source, n=2)]
frames += recorded.frames(grey=True, n=2)

def as_in_a_message(image):
    "Return an image as it lies in a message: read-only, with rows that are longer than the image is wide."
    if image is None or image.dtype != np.uint8:
        return image
    padded = np.pad(image, [(0, 0), (0, 16)] + [(0, 0)] * (image.ndim - 2))
    padded.flags.writeable = False
    return padded[:, : image.shape[1]]

frames += [
    dataclasses.replace(frame, left=as_in_a_message(frame.left), right=as_in_a_message(frame.right))
    for frame in recorded.frames(n=1) + recorded.frames(grey=True, n=1)
]

def compiled():
    return {{f"{{kernel.py_func.__module__}}.{{kernel.py_func.__name__}}": len(kernel.signatures)
            for kernel in _kernels()}}

config = Config.preset({preset!r}).updated({settings!r})
compile_kernels(config)
before = compiled()
detector = Detector(config)
for frame in frames:
    found = detector.detect_frame(frame)
    found.clusters, found.long_range.mask, found.short_range.mask
after = compiled()
print(len(before) > 20, len(detector.long_range.memory) > 0)
print("compiled later:", sorted(name for name in after if after[name] != before.get(name)))
"""


@pytest.mark.parametrize(
    ("preset", "settings"),
    [
        ("robust", NODE_DEFAULTS),
        ("robust", {**NODE_DEFAULTS, "stereo.half_resolution": True, "threads": 2}),
        ("robust", {**NODE_DEFAULTS, "source.max_depth_m": 10.0, "threads": 1}),
        ("paper", {**NODE_DEFAULTS, "stereo.matcher": "sgbm"}),
    ],
)
def test_a_node_that_is_warmed_up_compiles_nothing_more(preset: str, settings: dict[str, object]) -> None:
    code = COMPILES_NOTHING.format(test=str(Path(__file__).parent), preset=preset, settings=dict(settings))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    remembers = preset == "robust"
    assert done.stdout.splitlines() == [f"True {remembers}", "compiled later: []"]


def drive(source: str = "stereo", *, grey: bool = False) -> Iterator[Frame]:
    """Yield frames without end, as of a camera that goes to and fro at 10 Hz."""
    frames = recorded.frames(source, grey=grey)
    order = [*range(len(frames)), *range(len(frames) - 2, 0, -1)]
    index = 0
    while True:
        yield dataclasses.replace(frames[order[index % len(order)]], stamp_ns=10**18 + index * 10**8)
        index += 1


@pytest.fixture
def traced() -> Iterator[None]:
    """Count what NumPy and numba's kernels allocate."""
    counted = _nrt_python.memsys_stats_enabled()
    _nrt_python.memsys_enable_stats()
    tracemalloc.start()
    yield
    tracemalloc.stop()
    if not counted:
        _nrt_python.memsys_disable_stats()


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("source", ["stereo", "disparity"])
@pytest.mark.parametrize("settings", [{}, NODE_DEFAULTS, {"stereo.half_resolution": True}, {"stereo.matcher": "sgbm"}])
@pytest.mark.usefixtures("traced")
def test_a_frame_takes_little_memory_and_leaves_none_behind(
    settings: dict[str, object], source: str, n_threads: int
) -> None:
    detector = Detector(Config().updated({**SETTINGS, **settings, "threads": n_threads}))
    frames = drive(source)
    for frame in islice(frames, 8):  # until the memory is full
        detector.detect_frame(frame)
    gc.collect()
    before, kernels_before = tracemalloc.get_traced_memory()[0], rtsys.get_allocation_stats()
    tracemalloc.reset_peak()
    for frame in islice(frames, 20):
        detector.detect_frame(frame)
    gc.collect()
    after, peak = tracemalloc.get_traced_memory()
    kernels = rtsys.get_allocation_stats()
    assert peak - before < BYTES_PER_PIXEL * HEIGHT * WIDTH
    assert after - before < KEPT_BYTES
    assert kernels.alloc - kernels.free == kernels_before.alloc - kernels_before.free


def all_of(found: Detection) -> dict[str, np.ndarray | object]:
    """Return all that was found in a frame."""
    long_range, short_range = found.long_range, found.short_range
    return {
        "disparity": found.disparity,
        "short range": short_range.occupancy,
        "short-range mask": short_range.mask,
        "obstacle disparity": short_range.obstacle_disparity,
        "u-disparity": short_range.u_disparity,
        "v-disparity": short_range.v_disparity,
        "line": short_range.line,
        "superpixels": found.superpixels,
        "clusters": found.clusters,
        "long range": long_range.occupancy,
        "long-range mask": long_range.mask,
        "confidence": long_range.confidence,
    }


@pytest.mark.parametrize(
    ("source", "preset", "settings"),
    [
        ("stereo", "robust", {}),
        ("stereo", "robust", NODE_DEFAULTS),
        ("stereo", "robust", {"stereo.half_resolution": True}),
        ("stereo", "robust", {"stereo.matcher": "sgbm"}),
        ("stereo", "robust", {"superpixels.n_superpixels": 500}),
        ("stereo", "paper", {}),
        ("disparity", "robust", NODE_DEFAULTS),
        ("depth", "robust", {"source.max_depth_m": 10.0}),
    ],
)
@pytest.mark.parametrize("grey", [False, True])
def test_results_do_not_depend_on_the_number_of_threads(
    source: str, preset: str, settings: dict[str, object], grey: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("joblib.cpu_count", lambda *_, **__: 5)
    config = Config.preset(preset).updated({**SETTINGS, **settings})
    detectors = [Detector(config.updated({"threads": n_threads})) for n_threads in (1, 2, 3, 5)]
    for frame in islice(drive(source, grey=grey), 5):
        expected, *others = (all_of(detector.detect_frame(frame)) for detector in detectors)
        assert expected["disparity"].any()
        assert expected["long-range mask"].any()
        for found in others:
            differing = [name for name, value in found.items() if not np.array_equal(value, expected[name])]
            assert differing == []
