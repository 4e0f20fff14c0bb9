"""The methods that are compared, what they share, near-to-far learning, and the studies."""

import dataclasses

import numpy as np
import pytest
from recorded import CAMERA, frames, rendered

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.evaluation.scoring import methods as methods_module
from lrtrav_ros.evaluation.scoring import shared_stages as stages_module
from lrtrav_ros.evaluation.scoring.frame_evaluation import find_all, make_setup
from lrtrav_ros.evaluation.scoring.methods import DEFAULT_METHODS, METHODS, choose_methods
from lrtrav_ros.evaluation.scoring.near_to_far import classify_superpixels
from lrtrav_ros.evaluation.scoring.scores import score
from lrtrav_ros.evaluation.scoring.shared_stages import FrameStages
from lrtrav_ros.evaluation.scoring.studies import study_methods

VALUES = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60, "threads": 1}
FRAME, TRUTH = frames()[0], rendered()[0].truth


def found(name, values=VALUES, frame=FRAME, n_seeds=1):
    setup = make_setup(choose_methods([name]), values, n_seeds=n_seeds)
    ((_, results),) = find_all(FrameStages(frame), setup)
    return results


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
    (result,) = found(name)
    assert np.array_equal(result.mask, expected.long_range.mask)
    assert np.array_equal(result.clusters, expected.long_range.clusters)
    assert np.array_equal(result.superpixels, expected.long_range.superpixels)
    assert all(value > 0 for value in dataclasses.astuple(result.times))


def test_uv_disparity_is_the_short_range_of_the_paper():
    expected = Detector(Config.preset("paper").updated(VALUES), CAMERA).detect(FRAME.left, FRAME.right)
    (result,) = found("uv_disparity")
    assert np.array_equal(result.mask, expected.short_range.mask)
    assert (result.superpixels, result.clusters) == (None, None)
    assert (result.times.superpixels_ms, result.times.extension_ms) == (0.0, 0.0)


def test_disparity_and_superpixels_are_computed_once_for_all_methods(monkeypatch):
    calls = []

    def counted(name, function):
        def call(*arguments, **keywords):
            calls.append(name)
            return function(*arguments, **keywords)

        return call

    for owner, name in ((Detector, "match"), (Detector, "short_range"), (stages_module, "preemptive_slic")):
        monkeypatch.setattr(owner, name, counted(name, getattr(owner, name)))
    setup = make_setup(list(METHODS.values()), VALUES, n_seeds=3)
    assert len(list(find_all(FrameStages(FRAME), setup))) == len(METHODS) == 8
    assert sorted(calls) == ["match", "preemptive_slic", "short_range", "short_range"]


def test_what_methods_share_counts_for_each_of_them():
    stages = FrameStages(FRAME)
    times = {run.method.name: results[0].times for run, results in find_all(stages, setup_of("proposed", "robust"))}
    assert times["proposed"].matching_ms == times["robust"].matching_ms > 0
    assert times["proposed"].ground_ms != times["robust"].ground_ms


def setup_of(*names):
    return make_setup(choose_methods(names), VALUES, n_seeds=1)


@pytest.mark.parametrize("source", ["stereo", "disparity", "depth"])
def test_methods_take_all_sources_up_to_their_limit(source):
    (frame,) = frames(source, n=1)
    values = {**VALUES, "source.max_depth_m": 12.0}
    detector = Detector(Config().updated(values), CAMERA)
    expected = detector.detect(frame.left, frame.right, disparity=frame.disparity, depth_m=frame.depth_m)
    (result,) = found("robust", values, frame)
    assert np.array_equal(result.short_range.occupancy, expected.short_range.occupancy)
    assert np.array_equal(result.mask, expected.long_range.mask)


def test_random_centres_get_seeds_one_after_the_other():
    (run,) = make_setup(choose_methods(["random_centres"]), {"clustering.seed": 7}, n_seeds=3).runs
    assert [config.clustering.seed for config in run.configs] == [7, 8, 9]
    (run,) = make_setup(choose_methods(["proposed"]), {"clustering.seed": 7}, n_seeds=3).runs
    assert [config.clustering.seed for config in run.configs] == [7]
    with pytest.raises(ValueError, match="seeds is 0"):
        make_setup([], {}, n_seeds=0)


def test_methods_are_chosen_by_name():
    assert [method.name for method in choose_methods(["robust", "proposed"])] == ["robust", "proposed"]
    assert len(DEFAULT_METHODS) == 7
    with pytest.raises(ValueError, match="no method 'best'; choose out of uv_disparity, proposed"):
        choose_methods(["best"])
    with pytest.raises(ValueError, match="'robust' is named twice"):
        choose_methods(["robust", "robust"])


def test_method_without_scikit_learn_names_the_extra(monkeypatch):
    monkeypatch.setattr(methods_module, "find_spec", lambda name: None)
    assert choose_methods(["robust"])
    with pytest.raises(ValueError, match=r"near_to_far needs scikit-learn: install lrtrav_ros\[evaluation\]"):
        choose_methods(["near_to_far"])


def test_learning_scores_as_a_decent_baseline_on_a_scene():
    (learned,), (fused,), (short,) = found("near_to_far"), found("near_to_far_fused"), found("robust")
    assert score(learned.mask, TRUTH).rmse < 0.25
    assert score(learned.mask, TRUTH).recall > 0.9
    judged = short.short_range.occupancy != 255
    assert np.array_equal(fused.occupancy[judged], short.short_range.occupancy[judged])
    assert np.array_equal(fused.occupancy[~judged], learned.occupancy[~judged])


def two_kinds():
    """Eight superpixels in a row, the even ones of one kind and the odd ones of another, each 4 x 6 pixels."""
    superpixels = np.repeat(np.repeat(np.arange(8, dtype=np.int32)[None], 6, axis=1), 4, axis=0)
    superpixels = np.sort(superpixels, axis=1)
    histograms = np.zeros((8, 5), np.float32)
    histograms[::2, :2], histograms[1::2, 2:4] = 0.5, 0.5
    return histograms, superpixels


def test_learning_carries_over_to_superpixels_without_evidence():
    histograms, superpixels = two_kinds()
    occupancy = np.full(superpixels.shape, 255, np.uint8)
    occupancy[:, :6] = 0  # the first is ground
    occupancy[2:, 6:9] = 100  # some of the second is not
    assert classify_superpixels(histograms, superpixels, occupancy).tolist() == [True, False] * 4


def test_learning_weighs_examples_by_their_evidence():
    histograms, superpixels = two_kinds()
    occupancy = np.full(superpixels.shape, 100, np.uint8)
    occupancy[:, :6] = 0
    occupancy[:, 12:] = 255
    occupancy[0, 12] = 100  # one pixel says that this kind is not ground, 24 that it is
    assert classify_superpixels(histograms, superpixels, occupancy).tolist() == [True, False] * 4


@pytest.mark.parametrize(("value", "expected"), [(0, True), (100, False), (255, False)])
def test_learning_from_one_class_or_none(value, expected):
    histograms, superpixels = two_kinds()
    occupancy = np.full(superpixels.shape, 255, np.uint8)
    occupancy[1, 3:8] = value
    assert classify_superpixels(histograms, superpixels, occupancy).tolist() == [expected] * 8


@pytest.mark.parametrize(("study", "n_choices"), [("texture", 5), ("distance", 6)])
def test_study_varies_one_setting(study, n_choices):
    variants = study_methods(choose_methods(["proposed", "robust"]), study)
    assert len({variant.name for variant in variants}) == len(variants) == 2 * n_choices
    configs = [variant.configuration({}) for variant in variants]
    assert len({getattr(config.features, study) for config in configs}) == n_choices
    for config, variant in zip(configs, variants, strict=True):
        default = getattr(Config.preset(variant.preset).features, study)
        features = dataclasses.replace(config.features, **{study: default})
        assert dataclasses.replace(config, features=features) == Config.preset(variant.preset)


def test_study_refuses_a_method_without_clusters():
    with pytest.raises(ValueError, match="uv_disparity does not cluster superpixels"):
        study_methods(choose_methods(["uv_disparity"]), "texture")
