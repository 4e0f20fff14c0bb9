"""Tests that what the README says of commands, topics, parameters and dependencies is true."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lrtrav_ros.commands import COMMANDS
from lrtrav_ros.config import find_parameter
from lrtrav_ros.io import topics

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    """Return what stands under a heading."""
    return TEXT.split(f"\n## {title}\n")[1].split("\n## ")[0]


def test_every_command_is_in_the_table() -> None:
    listed = set(re.findall(r"`(?:lrtrav )?([a-z_]+)(?: [^`]*)?`", section("Commands")))
    assert set(COMMANDS) <= listed


def test_parameters_have_the_defaults_of_the_table() -> None:
    rows = re.findall(r"^\| `([a-z_.]+)` \| `([^`]*)` \|", section("Parameters"), flags=re.MULTILINE)
    assert len(rows) > 5
    assert {name: str(find_parameter(name).default) for name, _ in rows} == dict(rows)


def test_topics_of_the_table_are_those_of_the_nodes() -> None:
    table = "".join(line.split("|")[3] for line in section("Topics").splitlines() if line.startswith("| "))
    listed = {name for name in re.findall(r"`([a-z_/~]+)`", table) if "." not in name}
    nodes = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "lrtrav_ros" / "nodes").glob("*_*.py"))
    published = set(
        re.findall(r'"((?:(?:short|long)_range|segmentation)/[a-z_]+|obstacles|free|depth|~/[a-z]+)"', nodes)
    )
    named = {value for name, value in vars(topics).items() if name.isupper() and isinstance(value, str)}
    inputs = {name for name in named if "_msgs" not in name}
    assert listed - {"~/change_state"} == published | inputs | {"/diagnostics"}


def test_every_dependency_is_named_with_its_reason() -> None:
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    required = setup.split("install_requires=[")[1].split("\n    ]")[0]
    names = re.findall(r'"([A-Za-z-]+)', required)
    assert len(names) > 8
    assert [name for name in names if name not in section("Dependencies")] == []


@pytest.mark.parametrize("path", re.findall(r"\]\(([^)]+)\)", TEXT))
def test_links_lead_somewhere(path: str) -> None:
    assert (ROOT / path).exists()
