"""Stages that methods share: run once for all that call them alike, and never for one that calls them otherwise."""

import dataclasses

import numpy as np
import pytest
from recorded import frames

from lrtrav_ros import detector as detector_module
from lrtrav_ros.detector import Stage
from lrtrav_ros.evaluation.scoring import methods as methods_module
from lrtrav_ros.evaluation.scoring.frame_evaluation import detect_all, make_setup
from lrtrav_ros.evaluation.scoring.methods import METHODS, choose_methods, detect_short_range
from lrtrav_ros.evaluation.scoring.shared_stages import SharedStages
from lrtrav_ros.method.matching.elas import Elas

VALUES = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60, "superpixels.max_iterations": 5}
FRAME = frames(n=1)[0]


def of_16_bits(frame):
    """The same frame as a camera of 12 bits in words of 16 would give it."""
    left, right = (image.astype(np.uint16) << 4 for image in (frame.left, frame.right))
    return dataclasses.replace(frame, left=left, right=right)


@pytest.fixture
def calls(monkeypatch):
    """The names of the stages that are run, in the order of their calls."""
    calls = []

    def count(name, *owners):
        real = getattr(owners[0], name)

        def counted(*args, **kwargs):
            calls.append(name)
            return real(*args, **kwargs)

        for owner in owners:
            monkeypatch.setattr(owner, name, counted)

    count("compute", Elas)
    count("preemptive_slic", detector_module, methods_module)
    for name in ("detect_ground", "pixel_bins", "superpixel_features", "feature_distances", "spectral_clusters"):
        count(name, detector_module)
    count("classify_superpixels", methods_module)
    return calls


@pytest.mark.parametrize("limit_m", [0.0, 12.0])
@pytest.mark.parametrize("frame", [FRAME, of_16_bits(FRAME)], ids=["8 bit", "16 bit"])
def test_all_methods_share_what_they_have_in_common(calls, frame, limit_m):
    setup = make_setup(list(METHODS.values()), {**VALUES, "source.max_depth_m": limit_m}, n_seeds=3)
    stages = SharedStages()
    detect_short_range(frame, setup.geometry, stages.runner())
    assert len(list(detect_all(frame, setup, stages))) == len(METHODS) == 8
    assert {name: calls.count(name) for name in calls} == {
        "compute": 1,
        "detect_ground": 3 if limit_m else 2,  # of either preset, and to measure distances on all of the disparity
        "preemptive_slic": 1,
        "pixel_bins": 3,  # with three configurations
        "superpixel_features": 3,
        "feature_distances": 3,  # by both cues and each
        "spectral_clusters": 6,  # of the paper by these, with three seeds; propagation does without
        "classify_superpixels": 1,
    }


def test_frames_share_nothing(calls):
    (setup,) = [make_setup(choose_methods(["uv_disparity"]), VALUES, n_seeds=1)]
    for frame in frames(n=2):
        list(detect_all(frame, setup, SharedStages()))
    assert calls.count("compute") == 2


def test_shared_stage_counts_for_each_method_with_its_time():
    stages = SharedStages()
    setup = make_setup(choose_methods(["uv_disparity", "proposed", "robust"]), VALUES, n_seeds=1)
    short, proposed, robust = (detections[0].times for _, detections in detect_all(FRAME, setup, stages))
    assert short.matching_ms == proposed.matching_ms == robust.matching_ms > 0
    assert short.ground_ms == proposed.ground_ms > 0
    assert robust.ground_ms > 0
    assert proposed.superpixels_ms == robust.superpixels_ms > 0
    assert (short.superpixels_ms, short.extension_ms) == (0.0, 0.0)


def total(values, weights=None, *, scale=1):
    return int((values if weights is None else values * weights).sum()) * scale


def test_calls_are_told_apart_by_stage_arguments_and_keywords():
    run, other = (stages := SharedStages()).runner(), stages.runner()
    values = np.arange(6, dtype=np.int32).reshape(2, 3)
    assert run(Stage.GROUND, total, values) == 15
    assert run(Stage.GROUND, total, values, values) == 55
    assert run(Stage.GROUND, total, values, values.astype(np.uint8)) == 55
    assert other(Stage.GROUND, total, values + 1) == 21
    assert other(Stage.GROUND, total, values, scale=2) == 30
    assert other(Stage.GROUND, total, values.T) == 15
    assert other(Stage.FEATURES, total, values, None) == 15
    assert run(Stage.GROUND, len, values) == 2


def test_equal_arguments_are_the_same_call_though_they_are_other_objects():
    stages, results = SharedStages(), []
    for _ in range(2):
        values = np.arange(6, dtype=np.float32).reshape(2, 3)
        results.append(stages.runner()(Stage.MATCHING, np.add, values, np.float32(1)))
    assert results[0] is results[1]
