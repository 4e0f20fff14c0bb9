"""Tests of the configuration."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from lrtrav_ros.config import (
    PRESETS,
    Config,
    find_parameter,
    load_parameters,
    parameters,
)

ROOT = Path(__file__).parents[1]


def test_parameters_of_the_design_have_their_defaults() -> None:
    values = Config().values()
    expected = {
        "source": "stereo",
        "source.max_depth_m": 0.0,
        "stereo.n_disparities": 128,
        "stereo.half_resolution": False,
        "superpixels.n_superpixels": 200,
        "features.texture": "wld",
        "features.distance": "correlation",
        "clustering.seed": 0,
        "extension.rule": "evidence",
    }
    assert {name: values[name] for name in expected} == expected


def test_every_parameter_is_described_and_its_default_in_range() -> None:
    for parameter in parameters():
        assert len(parameter.description) > 10, parameter.name
        assert parameter.check(parameter.default) == parameter.default
        assert parameter.choices or parameter.type is bool or parameter.minimum is not None, parameter.name


def test_preset_paper_is_the_letter_of_the_paper() -> None:
    paper = Config.preset("paper")
    assert (paper.clustering.k, paper.extension.rule, paper.ground.shape) == (0, "area", "line")


def test_unknown_preset() -> None:
    with pytest.raises(ValueError, match="no preset 'best'; choose one of robust, paper"):
        Config.preset("best")


def test_updated_replaces_and_leaves_the_rest() -> None:
    config = Config().updated({"stereo.matcher": "bm", "threads": 3, "elas.beta": 1})
    assert (config.stereo.matcher, config.threads, config.elas.beta) == ("bm", 3, 1.0)
    assert type(config.elas.beta) is float
    assert config.ground == Config().ground


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("stereo.matcher", "best", "stereo.matcher is 'best'; give one of elas, sgbm, bm"),
        ("stereo.n_disparities", 0, "stereo.n_disparities is 0; give 1 to 512 px"),
        ("stereo.n_disparities", 64.0, "stereo.n_disparities is 64.0; give int"),
        ("stereo.half_resolution", 1, "stereo.half_resolution is 1; give bool"),
        ("threads", True, "threads is True; give int"),
        ("ground.max_step_m", float("nan"), "ground.max_step_m is nan"),
        ("ground.max_stepm", 0.1, "no parameter 'ground.max_stepm'; did you mean ground.max_step_m"),
    ],
)
def test_bad_values_are_refused_with_value_and_remedy(name: str, value: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Config().updated({name: value})


def test_a_configuration_checks_what_it_is_made_of() -> None:
    with pytest.raises(ValueError, match=r"clustering\.k is -1"):
        dataclasses.replace(Config().clustering, k=-1)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("stereo.matcher", "bm", "bm"),
        ("clustering.k", "0", 0),
        ("elas.beta", "2", 2.0),
        ("elas.adaptive_mean", "false", False),
    ],
)
def test_parse(name: str, text: str, value: object) -> None:
    assert find_parameter(name).parse(text) == value


def test_files_that_are_made_from_the_configuration_are_up_to_date() -> None:
    command = [sys.executable, str(ROOT / "docs" / "make_tables.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("up to date", 0)


@pytest.mark.parametrize("preset", PRESETS)
def test_files_in_config_are_the_presets(preset: str) -> None:
    assert Config().updated(load_parameters(ROOT / "config" / f"{preset}.yaml")) == Config.preset(preset)


def test_parameter_file_nested_or_with_dots(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"stereo": {"matcher": "bm"}, "elas.beta": 0.5}}}))
    assert load_parameters(path) == {"stereo.matcher": "bm", "elas.beta": 0.5}


@pytest.mark.parametrize(
    ("text", "message"),
    [("", "has no parameters"), ("stereo: {matcher: bm}", "no 'ros__parameters:'"), ("a: [", "is not YAML")],
)
def test_bad_parameter_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        load_parameters(path)


def test_missing_parameter_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.yaml"):
        load_parameters(tmp_path / "none.yaml")
