"""Studies of one setting."""

import dataclasses

import pytest
from recorded import frames, rendered

from lrtrav_ros.config import Config
from lrtrav_ros.evaluation.scoring.methods import choose_methods
from lrtrav_ros.evaluation.scoring.studies import study_methods

VALUES = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60, "threads": 1}
FRAME, TRUTH = frames()[0], rendered()[0].truth


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
