"""Tests of the launch file; those that execute all of it need a ROS installation."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest
import yaml

from lrtrav_ros.commands import COMMANDS
from lrtrav_ros.config import Config

ROOT = Path(__file__).parents[1]
LAUNCH_FILE = ROOT / "launch" / "detector.launch.py"
FAMILIES = sorted((ROOT / "config" / "cameras").iterdir())
GIVEN = [
    ({}, []),
    ({"preset": "paper"}, ["-p", "preset:=paper"]),
    ({"params_file": "mine.yaml"}, ["--params-file", "mine.yaml"]),
    (
        {"params_file": "mine.yaml", "preset": "paper", "source": "depth", "rectify": "true", "autostart": "false"},
        [
            *("--params-file", "mine.yaml", "-p", "preset:=paper", "-p", "source:=depth"),
            *("-p", "source.rectify:=true", "-p", "autostart:=false"),
        ],
    ),
]


def launch_file() -> dict[str, Any]:
    """Return the names that the launch file defines, made without the packages of ROS that it imports."""
    tree = ast.parse(LAUNCH_FILE.read_text(encoding="utf-8"))
    tree.body = [
        node for node in tree.body if not (isinstance(node, ast.ImportFrom) and str(node.module).startswith("launch"))
    ]
    namespace: dict[str, Any] = {"__file__": str(LAUNCH_FILE)}
    exec(compile(tree, str(LAUNCH_FILE), "exec"), namespace)
    return namespace


def arguments(**given: str) -> dict[str, str]:
    """Return the values of all arguments, of which some are given."""
    defaults = {name: default for name, (default, _) in launch_file()["ARGUMENTS"].items()}
    assert given.keys() <= defaults.keys()
    return {**defaults, **given}


@pytest.mark.parametrize(("given", "expected"), GIVEN)
def test_only_parameters_that_are_given_are_passed_on(given: dict[str, str], expected: list[str]) -> None:
    assert launch_file()["parameter_arguments"](arguments(**given), None) == expected


def test_parameters_of_the_camera_family_come_before_those_that_prevail() -> None:
    names = launch_file()
    family = names["family_file"]("realsense_depth")
    words = names["parameter_arguments"](arguments(params_file="mine.yaml", source="stereo"), family)
    assert words == ["--params-file", str(family), "--params-file", "mine.yaml", "-p", "source:=stereo"]


def test_nothing_is_remapped_by_default() -> None:
    assert launch_file()["named_topics"](arguments()) == []


def test_topics_that_are_named_are_remapped_raw_ones_too() -> None:
    assert launch_file()["named_topics"](arguments(left="/zed/left", depth="/zed/depth/image")) == [
        ("left/image_rect", "/zed/left/image_rect"),
        ("left/image_raw", "/zed/left/image_raw"),
        ("left/camera_info", "/zed/left/camera_info"),
        ("depth/image_rect", "/zed/depth/image"),
        ("depth/camera_info", "/zed/depth/camera_info"),
    ]
    assert launch_file()["named_topics"](arguments(depth="depth_image")) == [
        ("depth/image_rect", "depth_image"),
        ("depth/camera_info", "camera_info"),
    ]


def test_a_family_of_ones_own_is_given_as_a_file(tmp_path: Path) -> None:
    own = tmp_path / "mine.yaml"
    own.write_text("# remap: disparity:=/fpga/disparity\n", encoding="utf-8")
    names = launch_file()
    assert names["family_file"](str(own)) == own
    assert names["family_topics"](own.read_text(encoding="utf-8")) == [("disparity", "/fpga/disparity")]


@pytest.mark.parametrize("camera", ["realsens", "missing.yaml"])
def test_a_family_that_does_not_exist_is_refused_with_those_that_do(camera: str) -> None:
    with pytest.raises(ValueError, match=f"camera is '{camera}'; give one of bumblebee_x, flir_pair, oak_d, "):
        launch_file()["family_file"](camera)


def test_replay_takes_the_drivers_topics_for_the_detectors() -> None:
    names = launch_file()
    text = names["family_file"]("zed_depth").read_text(encoding="utf-8")
    words = names["replay_arguments"](arguments(bag="drive.mcap"), text)
    assert words[:4] == ["drive.mcap", "--clock", "--source", "depth"]
    assert words[4:6] == ["--remap", "/zed/zed_node/rgb/color/rect/image:=left/image_rect"]
    assert words.count("--remap") == 3


@pytest.mark.parametrize(("camera", "rectify", "expected"), [("flir_pair", "", 1), ("", "true", 1), ("oak_d", "", 0)])
def test_replay_publishes_raw_images_where_they_are_rectified(camera: str, rectify: str, expected: int) -> None:
    names = launch_file()
    text = names["family_file"](camera).read_text(encoding="utf-8") if camera else ""
    assert names["replay_arguments"](arguments(bag="drive.mcap", rectify=rectify), text).count("--raw") == expected


def test_replay_alone_publishes_what_the_bag_has() -> None:
    names = launch_file()
    assert names["replay_arguments"](arguments(bag="drive.mcap"), "") == ["drive.mcap", "--clock"]
    assert names["replay_arguments"](arguments(bag="a", source="depth"), "")[2:] == ["--source", "depth"]


@pytest.mark.parametrize(("text", "expected"), [("true", True), ("False", False)])
def test_switches_are_true_or_false(text: str, expected: bool) -> None:
    assert launch_file()["is_true"](arguments(rviz=text), "rviz") is expected


def test_another_word_for_a_switch_is_refused() -> None:
    with pytest.raises(ValueError, match="two_processes is 'yes'; give true or false"):
        launch_file()["is_true"](arguments(two_processes="yes"), "two_processes")


@pytest.mark.parametrize("path", FAMILIES, ids=lambda path: path.stem)
def test_each_camera_family_has_topics_and_settings_of_one_source(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    settings = yaml.safe_load(text)["/**"]["ros__parameters"]
    config = Config().updated(settings)
    topics = launch_file()["family_topics"](text)
    assert len(topics) == text.count("remap:")
    image = "image_raw" if settings.get("source.rectify") else "image_rect"
    right = {f"right/{image}", "right/camera_info"} if config.source.source == "stereo" else {"depth/image_rect"}
    assert {name for name, _ in topics} == {f"left/{image}", "left/camera_info", *right}
    assert all(topic.startswith("/") for _, topic in topics)
    assert config.source.max_depth_m > 0
    assert {"# Driver", "# Images", "# Rate"} <= {line.partition(":")[0] for line in text.splitlines()}


def test_what_the_launch_file_starts_is_installed() -> None:
    assert {"detector", "short_range_node", "long_range_node", "replay"} <= set(COMMANDS)
    assert (ROOT / "config" / "detector.rviz").is_file()


@pytest.mark.parametrize(("given", "expected"), GIVEN)
def test_arguments_reach_the_detector(given: dict[str, str], expected: list[str]) -> None:
    (node,) = executed(**given)
    assert (node.node_package, node.node_executable) == ("lrtrav_ros", "detector")
    assert words_of(node)[: len(expected) + 1] == ["--ros-args", *expected]


def test_bag_and_rviz_run_beside_both_nodes() -> None:
    nodes = executed(bag="drive.mcap", rviz="true", two_processes="true")
    assert [node.node_executable for node in nodes] == ["short_range_node", "long_range_node", "replay", "rviz2"]
    assert "use_sim_time:=true" in words_of(nodes[0])
    assert words_of(nodes[2])[:2] == ["drive.mcap", "--clock"]


def executed(**given: str) -> list[Any]:
    """Return the processes that the launch file starts; needs a ROS installation."""
    pytest.importorskip("launch_ros")
    from launch import LaunchContext

    namespace: dict[str, Any] = {"__file__": str(LAUNCH_FILE)}
    exec(compile(LAUNCH_FILE.read_text(encoding="utf-8"), str(LAUNCH_FILE), "exec"), namespace)
    context = LaunchContext()
    context.launch_configurations.update(given)
    *declared, processes = namespace["generate_launch_description"]().entities
    assert [argument.name for argument in declared] == list(namespace["ARGUMENTS"])
    for argument in declared:
        argument.execute(context)
    return list(processes.execute(context))


def words_of(node: Any) -> list[str]:
    """Return the command line of a process, without its executable."""
    from launch import LaunchContext
    from launch.utilities import perform_substitutions

    return [perform_substitutions(LaunchContext(), word) for word in node.cmd[1:]]
