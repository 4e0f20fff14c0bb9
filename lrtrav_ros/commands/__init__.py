"""The command ``lrtrav`` and its subcommands, each of which is an executable of its own as well."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

COMMANDS = {
    "demo": "makes a sequence, replays it through both nodes, scores the masks and draws them",
    "detect": "detects the traversable region in dataset folders and rosbags",
    "evaluate": "scores methods on frames with ground truth: table, CSV, JSON and a report",
    "benchmark": "measures time per stage and memory",
    "generate": "renders synthetic stereo sequences with exact truth",
    "replay": "publishes the stereo topics of a rosbag",
    "detector": "runs both nodes in one process",
    "short_range_node": "runs the node for disparity and short-range ground",
    "long_range_node": "runs the node for the region to the horizon",
}


def main() -> int:
    """Run the subcommand that the executable is named after, or that the first argument of ``lrtrav`` names."""
    name = Path(sys.argv[0]).stem
    return run(name, sys.argv[1:]) if name in COMMANDS else run_lrtrav(sys.argv[1:])


def run_lrtrav(arguments: Sequence[str]) -> int:
    """Run ``lrtrav ARGUMENTS`` and return the exit status."""
    width = max(map(len, COMMANDS)) + 2
    parser = argparse.ArgumentParser(
        prog="lrtrav",
        description="Finds where a mobile robot can drive, far beyond the range of its stereo camera.",
        epilog="commands:\n" + "\n".join(f"  {name:{width}}{text}" for name, text in COMMANDS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="one of those below")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="see lrtrav COMMAND --help")
    args = parser.parse_args(arguments)
    return run(args.command, args.arguments, prog=f"lrtrav {args.command}")


def run(name: str, arguments: Sequence[str], *, prog: str = "") -> int:
    """Run one subcommand and return the exit status: 0 done, 1 it failed, 2 wrong usage.

    Only the module of that command is imported, and it imports what is heavy when it runs.
    """
    module = import_module(f"lrtrav_ros.commands.{name}")
    prog = prog or name
    parser = argparse.ArgumentParser(prog=prog, description=(module.__doc__ or "").split("\n")[0])
    module.add_arguments(parser)
    own, ros_args = _split_ros_args(arguments) if getattr(module, "PASSES_ROS_ARGS", False) else (arguments, [])
    args = parser.parse_args(own, argparse.Namespace(ros_args=ros_args))
    try:
        return int(module.run(args))
    except KeyboardInterrupt:
        return 130
    except (OSError, ValueError, RuntimeError) as err:
        print(f"{prog}: {err}", file=sys.stderr)
        return 1


def _split_ros_args(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the arguments before ``--ros-args``, and those from there on."""
    arguments = list(arguments)
    at = arguments.index("--ros-args") if "--ros-args" in arguments else len(arguments)
    return arguments[:at], arguments[at:]
