"""Writes what is made from the configuration: docs/parameters.md and config/*.yaml. `--check` only compares."""

from __future__ import annotations

import sys
from pathlib import Path

from lrtrav_ros.config import NODE_DEFAULTS, PRESETS, Config, find_parameter, parameters
from lrtrav_ros.io.parameter_file import dump_parameters

ROOT = Path(__file__).parents[1]
HEADS = {
    "robust": "# The defaults, more robust than the paper's letter: for --params of commands, --params-file of nodes.",
    "paper": "# The letter of the paper: for --params of commands, --params-file of nodes.",
}


def parameter_table() -> str:
    """Return docs/parameters.md."""
    paper = Config.preset("paper").values()
    lines = [
        "# Parameters",
        "",
        "For the nodes (`--ros-args -p NAME:=VALUE`, `ros2 param set`), for the commands (`--set NAME=VALUE`) and in",
        "YAML files for both. Those marked † are read when a node starts; all others can be changed while it runs.",
        "",
        "The files are ROS 2 parameter files: a section for each node, `/short_range` and `/long_range` with the",
        "namespace, or `/**` for all nodes; `*` stands for one part of a name, `**` for any number, and a section",
        "overrides those before it. `preset: paper` in one changes the defaults of all other parameters.",
        "",
        "| name | `robust` | `paper` | may be | what it does |",
        "|---|---|---|---|---|",
    ]
    for item in parameters():
        other = "" if paper[item.name] == item.default else f"`{paper[item.name]}`"
        mark = " †" if item.read_only else ""
        text = item.description.replace("|", "\\|")
        in_nodes = f", in nodes `{NODE_DEFAULTS[item.name]}`" if item.name in NODE_DEFAULTS else ""
        default = "''" if item.default == "" else item.default
        lines.append(f"| `{item.name}`{mark} | `{default}`{in_nodes} | {other} | {item.range_text} | {text} |")
    return "\n".join(lines) + "\n"


def preset_file(preset: str) -> str:
    """Return config/PRESET.yaml, for nodes and commands: what they have other defaults for stays as it is in each."""
    text = f"{HEADS[preset]}\n{dump_parameters(Config.preset(preset))}"
    for name, in_nodes in NODE_DEFAULTS.items():
        default = find_parameter(name).default
        comment = f"# {name}: {default} in commands and {in_nodes} in nodes, unless it is set here"
        text = text.replace(f"{name}: {default}", comment)
    return text


def main() -> int:
    """Write the files, or compare them; return the exit status."""
    texts = {ROOT / "docs" / "parameters.md": parameter_table()}
    for preset in PRESETS:
        texts[ROOT / "config" / f"{preset}.yaml"] = preset_file(preset)
    if "--check" in sys.argv:
        stale = [path.name for path, text in texts.items() if path.read_text(encoding="utf-8") != text]
        print(f"stale: {stale}; run make tables" if stale else "up to date")
        return 1 if stale else 0
    for path, text in texts.items():
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
