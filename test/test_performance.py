"""Tests that docs/performance.md and the README name commands, stages and files that there are."""

from __future__ import annotations

import argparse
import re
import shlex
from pathlib import Path

import pytest

from lrtrav_ros.commands import benchmark
from lrtrav_ros.commands.options import config_from
from lrtrav_ros.detector import Stage

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^\$ lrtrav benchmark(.*)$", TEXT + README, flags=re.MULTILINE)


def test_there_are_commands() -> None:
    assert len(COMMANDS) > 4
    assert "\n$ lrtrav benchmark\n" in TEXT
    assert "\n$ lrtrav benchmark --ros\n" in TEXT


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_have_options_that_there_are(command: str) -> None:
    parser = argparse.ArgumentParser()
    benchmark.add_arguments(parser)
    args = parser.parse_args(shlex.split(command.partition("|")[0]))
    config_from(args)
    benchmark._check(args)


def test_stages_of_the_table_are_those_of_the_method() -> None:
    rows = re.findall(r"^\| ([a-z]+) \|", TEXT.split("## What bounds it")[1], flags=re.MULTILINE)
    assert sorted(set(rows) - {"stage"}) == sorted(stage.value for stage in Stage)


@pytest.mark.parametrize("path", re.findall(r"\]\(([^)]+)\)|`pytest ([^`]+)`", TEXT))
def test_what_is_named_is_there(path: tuple[str, str]) -> None:
    linked, tested = path
    assert (ROOT / "docs" / linked).is_file() if linked else (ROOT / tested).is_file()
