"""The methods that are compared."""

import dataclasses

import numpy as np
import pytest
from recorded import CAMERA, frames, rendered

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.evaluation.scoring import methods as methods_module
from lrtrav_ros.evaluation.scoring.frame_evaluation import detect_all, make_setup
from lrtrav_ros.evaluation.scoring.methods import DEFAULT_METHODS, choose_methods
from lrtrav_ros.evaluation.scoring.scores import score
from lrtrav_ros.evaluation.scoring.shared_stages import SharedStages

VALUES = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60, "threads": 1}
FRAME, TRUTH = frames()[0], rendered()[0].truth


def detect(name, values=VALUES, frame=FRAME):
    """Return what a method finds in a frame, with one seed."""
    setup = make_setup(choose_methods([name]), values, n_seeds=1)
    ((_, (detection,)),) = detect_all(frame, setup, SharedStages())
    return detection


@pytest.mark.parametrize(
    ("name", "preset", "settings"),
    [
        ("proposed", "paper", {}),
        ("robust", "robust", {}),
        ("colour_only", "paper", {"features.cues": "colour"}),
        ("texture_only", "paper", {"features.cues": "texture"}),
        ("random_centres", "paper", {"clustering.centres": "random"}),
    ],
)
def test_methods_find_what_the_detector_does(name, preset, settings):
    detector = Detector(Config.preset(preset).updated({**VALUES, **settings}), CAMERA)
    expected = detector.detect(FRAME.left, FRAME.right)
    detection = detect(name)
    assert np.array_equal(detection.mask, expected.long_range.mask)
    assert np.array_equal(detection.long_range.clusters, expected.clusters)
    assert np.array_equal(detection.long_range.superpixels, expected.superpixels)
    idle = {"clustering_ms"} if preset == "robust" else set()  # propagation does without clusters
    assert {stage for stage, time_ms in dataclasses.asdict(detection.times).items() if time_ms == 0} == idle


def test_uv_disparity_is_the_short_range_of_the_paper():
    expected = Detector(Config.preset("paper").updated(VALUES), CAMERA).detect(FRAME.left, FRAME.right)
    detection = detect("uv_disparity")
    assert np.array_equal(detection.mask, expected.short_range.mask)
    assert detection.long_range is None


@pytest.mark.parametrize("source", ["stereo", "disparity", "depth"])
def test_methods_take_all_sources_up_to_their_limit(source):
    (frame,) = frames(source, n=1)
    values = {**VALUES, "source.max_depth_m": 12.0}
    detector = Detector(Config().updated(values), CAMERA)
    expected = detector.detect(frame.left, frame.right, disparity=frame.disparity, depth_m=frame.depth_m)
    detection = detect("robust", values, frame)
    assert np.array_equal(detection.short_range.disparity, expected.disparity)
    assert np.array_equal(detection.short_range.occupancy, expected.short_range.occupancy)
    assert np.array_equal(detection.mask, expected.long_range.mask)


def test_random_centres_get_seeds_one_after_the_other():
    for name, expected in (("random_centres", [7, 8, 9]), ("proposed", [7])):
        (seeded,) = make_setup(choose_methods([name]), {"clustering.seed": 7}, n_seeds=3).methods
        assert [config.clustering.seed for config in seeded.configs] == expected
    with pytest.raises(ValueError, match="seeds is 0"):
        make_setup([], {}, n_seeds=0)


def test_methods_are_chosen_by_name():
    assert [method.name for method in choose_methods(["robust", "proposed"])] == ["robust", "proposed"]
    assert [method.name for method in choose_methods(DEFAULT_METHODS)] == [
        "uv_disparity",
        "proposed",
        "colour_only",
        "texture_only",
        "random_centres",
        "robust",
        "near_to_far",
        "near_to_far_fused",
    ]
    with pytest.raises(ValueError, match="no method 'best'; choose one of uv_disparity, proposed"):
        choose_methods(["best"])
    with pytest.raises(ValueError, match="'robust' is named twice"):
        choose_methods(["robust", "robust"])
    with pytest.raises(ValueError, match="no method is named"):
        choose_methods([])


def test_method_without_scikit_learn_names_the_extra(monkeypatch):
    monkeypatch.setattr(methods_module, "find_spec", lambda name: None)
    assert choose_methods(["robust"])
    with pytest.raises(ValueError, match=r"near_to_far needs scikit-learn: install lrtrav_ros\[evaluation\]"):
        choose_methods(["near_to_far"])


def test_learning_scores_as_a_decent_baseline_on_a_scene():
    learned, fused, robust = detect("near_to_far"), detect("near_to_far_fused"), detect("robust")
    assert score(learned.mask, TRUTH).rmse < 0.25
    assert score(learned.mask, TRUTH).recall > 0.9
    seen = robust.short_range.occupancy
    assert set(np.unique(learned.occupancy)) == {0, 100}
    assert np.array_equal(learned.occupancy == 0, learned.long_range.clusters == 1)
    assert np.array_equal(fused.occupancy, np.where(seen == 255, learned.occupancy, seen))
