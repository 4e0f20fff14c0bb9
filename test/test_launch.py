"""Tests of the launch file; those that execute all of it need a ROS installation."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

LAUNCH_FILE = Path(__file__).parents[1] / "launch" / "detector.launch.py"
GIVEN = [
    ("", "", []),
    ("", "paper", ["-p", "preset:=paper"]),
    ("mine.yaml", "", ["--params-file", "mine.yaml"]),
    ("mine.yaml", "paper", ["--params-file", "mine.yaml", "-p", "preset:=paper"]),
]


def without_imports() -> dict[str, Any]:
    """Return the names that the launch file defines, made without what it imports."""
    tree = ast.parse(LAUNCH_FILE.read_text(encoding="utf-8"))
    future = ast.parse("from __future__ import annotations").body
    tree.body = future + [node for node in tree.body if not isinstance(node, (ast.Import, ast.ImportFrom))]
    namespace: dict[str, Any] = {}
    exec(compile(tree, str(LAUNCH_FILE), "exec"), namespace)
    return namespace


def test_no_file_and_no_preset_are_given_by_default() -> None:
    arguments = without_imports()["ARGUMENTS"]
    assert (arguments["params_file"][0], arguments["preset"][0]) == ("", "")


@pytest.mark.parametrize(("params_file", "preset", "expected"), GIVEN)
def test_only_what_is_given_is_passed_on_and_the_preset_prevails(
    params_file: str, preset: str, expected: list[str]
) -> None:
    parameter_arguments: Callable[..., list[str]] = without_imports()["parameter_arguments"]
    assert parameter_arguments(params_file=params_file, preset=preset) == expected


@pytest.mark.parametrize(("params_file", "preset", "expected"), GIVEN)
def test_arguments_reach_the_detector(params_file: str, preset: str, expected: list[str]) -> None:
    pytest.importorskip("launch_ros")
    from launch import LaunchContext
    from launch.utilities import perform_substitutions

    namespace: dict[str, Any] = {}
    exec(compile(LAUNCH_FILE.read_text(encoding="utf-8"), str(LAUNCH_FILE), "exec"), namespace)
    context = LaunchContext()
    context.launch_configurations.update({"params_file": params_file, "preset": preset})
    *declared, process = namespace["generate_launch_description"]().entities
    assert [argument.name for argument in declared] == list(namespace["ARGUMENTS"])
    for argument in declared:
        argument.execute(context)
    (node,) = process.execute(context)
    assert (node.node_package, node.node_executable) == ("lrtrav_ros", "detector")
    words = [perform_substitutions(context, word) for word in node.cmd[1:]]
    assert words[: len(expected) + 1] == ["--ros-args", *expected]
