"""Tests that the pages in docs/ and the files in config/ name what there is, and that their links lead somewhere."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from lrtrav_ros.commands import COMMANDS
from lrtrav_ros.config import Config, parameters

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
NAV2 = yaml.safe_load((ROOT / "config" / "nav2.yaml").read_text(encoding="utf-8"))
STAGES = {parameter.stage for parameter in parameters() if "." in parameter.name}


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^a-z0-9_ -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)]+)\)", page.read_text(encoding="utf-8")):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_parameters_that_are_named_exist(page: Path) -> None:
    known = {parameter.name for parameter in parameters()}
    named = set(re.findall(r"(?<![\w./])([a-z]+\.[a-z_]+)(?=[`=: ])", page.read_text(encoding="utf-8")))
    named = {name for name in named if name.partition(".")[0] in STAGES}
    assert named <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_that_are_named_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"(?:lrtrav|ros2 run lrtrav_ros) ([a-z_]+)", text)
    assert set(named) <= set(COMMANDS)


def test_every_camera_family_is_in_the_table() -> None:
    families = {path.stem for path in (ROOT / "config" / "cameras").iterdir()}
    text = (ROOT / "docs" / "cameras.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| \[`([a-z_]+)`\]", text, re.MULTILINE)) == families


def test_every_argument_of_the_launch_file_is_in_the_table() -> None:
    launch = (ROOT / "launch" / "detector.launch.py").read_text(encoding="utf-8")
    arguments = re.findall(r'^    "([a-z_]+)": \(', launch, re.MULTILINE)
    table = (ROOT / "docs" / "robot.md").read_text(encoding="utf-8").split("| argument |")[1].split("\n\n")[0]
    rows = re.findall(r"^\| (.*?) \|", table, re.MULTILINE)
    assert [name for row in rows for name in re.findall(r"`([a-z_]+)`", row)] == arguments


@pytest.mark.parametrize("costmap", ["local_costmap", "global_costmap"])
def test_costmaps_have_the_settings_of_all_three_ways(costmap: str) -> None:
    settings = NAV2[costmap][costmap]["ros__parameters"]
    assert {"grid_layer", "points_layer", "segmentation_layer"} <= settings.keys()
    assert all("plugin" in settings[name] for name in settings["plugins"])
    assert settings["rolling_window"] is True
    assert settings["grid_layer"]["map_subscribe_transient_local"] is False
    assert settings["resolution"] == NAV2["long_range"]["ros__parameters"]["maps.cell_m"]
    assert settings["global_frame"] == NAV2["long_range"]["ros__parameters"]["maps.frame"]


def test_settings_of_the_nodes_beside_nav2_fit() -> None:
    for node in ("short_range", "long_range"):
        Config().updated(NAV2[node]["ros__parameters"])


def test_viewers_and_costmaps_show_what_the_nodes_publish() -> None:
    files = [*(ROOT / "lrtrav_ros" / "nodes").glob("*.py"), ROOT / "lrtrav_ros" / "io" / "topics.py"]
    source = "".join(path.read_text(encoding="utf-8") for path in files)
    topics = {topic.strip("/") for topic in (*foxglove_topics(), *rviz_topics(), *nav2_topics(NAV2))}
    assert {"long_range/grid", "obstacles", "free", "segmentation/mask"} <= topics
    assert [topic for topic in topics if f'"{topic}"' not in source] == []


def foxglove_topics() -> list[str]:
    layout = json.loads((ROOT / "config" / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    assert set(re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(layout["layout"]))) == panels.keys()
    images = [panel["imageMode"]["imageTopic"] for name, panel in panels.items() if name.startswith("Image!")]
    return [*images, *panels["3D!maps"]["topics"]]


def rviz_topics() -> list[str]:
    displays = yaml.safe_load((ROOT / "config" / "detector.rviz").read_text(encoding="utf-8"))["Visualization Manager"]
    return [display["Topic"]["Value"] for display in displays["Displays"] if "Topic" in display]


def nav2_topics(settings: Any) -> list[str]:
    """Return the values of all keys that name a topic of this package: they are absolute, and of no costmap."""
    if not isinstance(settings, dict):
        return []
    named = [value for key, value in settings.items() if key.endswith("topic") and str(value).startswith("/")]
    own = [topic for topic in named if "costmap" not in topic]
    return [*own, *(topic for value in settings.values() for topic in nav2_topics(value))]
