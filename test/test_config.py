"""Tests of the configuration."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lrtrav_ros.config import (
    LONG_RANGE_STAGES,
    NODE_DEFAULTS,
    SHORT_RANGE_STAGES,
    Config,
    find_parameter,
    foreign_names,
    is_general,
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
        "superpixels.n_superpixels": 500,
        "features.texture": "wld",
        "features.distance": "correlation",
        "clustering.seed": 0,
        "extension.rule": "propagation",
        "memory.frames": 0,
        "ground.memory_s": 0.0,
    }
    assert {name: values[name] for name in expected} == expected


def test_every_parameter_is_described_and_its_default_in_range() -> None:
    for parameter in parameters():
        assert len(parameter.description) > 10, parameter.name
        assert parameter.check(parameter.default) == parameter.default
        assert parameter.choices or parameter.type in (bool, str) or parameter.minimum is not None, parameter.name


def test_preset_paper_is_the_letter_of_the_paper() -> None:
    paper = Config.preset("paper")
    assert (paper.clustering.k, paper.extension.rule, paper.ground.shape) == (0, "area", "line")
    assert (paper.superpixels.n_superpixels, paper.memory.frames) == (200, 0)
    ground = paper.ground  # the obstacles are those of the u-disparity alone: no feet, no drops, no filled holes
    assert (ground.min_obstacle_m, ground.contact_margin, ground.min_drop_m, ground.max_hole_px) == (0, 1, 0, 0)
    assert (ground.noise_px, ground.max_step_m) == (1.0, 0.13)


def test_a_pose_of_the_depth_camera_is_checked() -> None:
    text = "0.1 0 0 0 0 0 1"
    assert Config().updated({"source.depth_pose": text}).source.depth_pose == text
    with pytest.raises(ValueError, match=r"source\.depth_pose: pose is '1 2', .* give x y z qx qy qz qw or x y z roll"):
        Config().updated({"source.depth_pose": "1 2"})


def test_there_are_never_more_threads_than_processors() -> None:
    processor = min(os.sched_getaffinity(0))
    code = (
        f"import os; os.sched_setaffinity(0, {{{processor}}}); from lrtrav_ros.config import Config; "
        "print([Config(threads=n).n_threads for n in (0, 1, 256)])"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stdout == "[1, 1, 1]\n"


def test_as_many_threads_as_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("joblib.cpu_count", lambda: 8)
    assert [Config(threads=n).n_threads for n in (0, 1, 3, 256)] == [8, 1, 3, 8]


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
        ("elas.beta", "2e-3", 0.002),
        ("elas.adaptive_mean", "false", False),
    ],
)
def test_parse(name: str, text: str, value: object) -> None:
    parsed = find_parameter(name).parse(text)
    assert (parsed, type(parsed)) == (value, type(value))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("clustering.k", "2.5", "clustering.k is '2.5'; give int: 0 to 1000"),
        ("elas.beta", "nan", "elas.beta is nan; give 0.001 to 10"),
        ("elas.beta", "[", r"elas.beta is '\['; give float"),
        ("elas.adaptive_mean", "3", "elas.adaptive_mean is 3; give bool: true or false"),
        ("elas.adaptive_mean", "[", r"elas.adaptive_mean is '\['; give bool"),
        ("clustering.seed", "-1", "clustering.seed is -1; give 0 to 2147483647"),
    ],
)
def test_parse_refuses_what_does_not_fit(name: str, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        find_parameter(name).parse(text)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("stereo.mathcer", "no parameter 'stereo.mathcer'; did you mean stereo.matcher?"),
        ("k", "no parameter 'k'; did you mean clustering.k?"),
        ("presett", "no parameter 'presett'; did you mean preset?"),
        ("robot_radius", "no parameter 'robot_radius'; `lrtrav detect --help` lists all"),
        ("use_sim_time", "no parameter 'use_sim_time'; `lrtrav detect --help` lists all"),
    ],
)
def test_unknown_name_is_refused_with_the_nearest_only(name: str, message: str) -> None:
    with pytest.raises(ValueError, match="no parameter") as refused:
        find_parameter(name)
    assert str(refused.value) == message


def test_names_for_nodes_of_others_are_told_from_ours() -> None:
    general = ["preset", "use_sim_time", "start_type_description_service", "qos_overrides./tf.publisher.depth"]
    assert all(map(is_general, general))
    names = ["stereo.matcher", "robot_radius", "threads", "source_list", *general, "FollowPath.max_vel_x"]
    assert foreign_names(names) == ("robot_radius", "source_list", "FollowPath.max_vel_x")


@pytest.mark.parametrize("name", ["stereo.mathcer", "stereo.frame_id", "sterio.matcher", "thread", "use_simtime"])
def test_misspelt_names_are_not_taken_for_those_of_others(name: str) -> None:
    with pytest.raises(ValueError, match=f"no parameter '{name}'"):
        foreign_names(["robot_radius", name])


def test_every_stage_belongs_to_a_node() -> None:
    assert {parameter.stage for parameter in parameters()} == {*SHORT_RANGE_STAGES, *LONG_RANGE_STAGES}
    assert find_parameter("source").stage == find_parameter("source.compressed").stage == "source"


def test_defaults_of_the_nodes_are_memories() -> None:
    assert NODE_DEFAULTS == {"memory.frames": 5, "ground.memory_s": 0.5}
    assert Config().memories == {}
    assert Config().updated(NODE_DEFAULTS).memories == NODE_DEFAULTS
    for name, value in NODE_DEFAULTS.items():
        parameter = find_parameter(name)
        assert parameter.check(value) == value != parameter.default


def test_files_that_are_made_from_the_configuration_are_up_to_date() -> None:
    command = [sys.executable, str(ROOT / "docs" / "make_tables.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("up to date", 0)


def test_grids_of_too_many_cells_are_refused():
    assert Config().updated({"maps.cell_m": 0.01}).maps.length_m == 30.0
    with pytest.raises(ValueError, match=r"maps.length_m 30 and maps.width_m 500 are 150000000 cells"):
        Config().updated({"maps.cell_m": 0.01, "maps.width_m": 500.0})


def test_settings_that_together_take_too_long_are_refused():
    config = Config().updated({"features.distance": "chi_square", "superpixels.n_superpixels": 500})
    with pytest.raises(ValueError, match=r"n_superpixels 501 with features.distance 'chi_square' could take more than"):
        config.updated({"superpixels.n_superpixels": 501})
    with pytest.raises(ValueError, match="5 s of CPU time a frame; give 500 at most, or the distance 'correlation'"):
        Config().updated({"superpixels.n_superpixels": 20000}).updated({"features.distance": "earth_mover"})


def test_a_long_grid_in_another_frame_is_bounded_by_the_box_around_it() -> None:
    long = {"maps.length_m": 500.0, "maps.width_m": 1.0, "maps.cell_m": 0.01}
    Config().updated(long)
    with pytest.raises(ValueError, match=r"are 1255005000 cells of maps\.cell_m 0\.01 in another frame"):
        Config().updated({**long, "maps.frame": "odom"})
