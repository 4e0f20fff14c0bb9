"""The command ``lrtrav`` and its subcommands, each of which is an executable of its own as well."""

from __future__ import annotations

import argparse
import io
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from lrtrav_ros.commands.reporting import warn
from lrtrav_ros.commands.usage_error import UsageError


@dataclass(frozen=True, slots=True)
class Command:
    """A subcommand, and where it is.

    Parameters
    ----------
    summary : str
        Its line in the help of ``lrtrav``.
    module : str
        The module in this package that has its ``add_arguments(parser)`` and ``run(args)``.
    attribute : str
        What has them in the module's place, where the module has several commands.
    takes_ros_args : bool
        ``--ros-args`` and all that follows is left to ROS; `run` finds it as ``args.ros_args``.
    """

    summary: str
    module: str
    attribute: str = ""
    takes_ros_args: bool = False

    def load(self) -> Any:
        """Return what has ``add_arguments`` and ``run``; nothing of it is imported before."""
        module = import_module(f"lrtrav_ros.commands.{self.module}")
        return getattr(module, self.attribute) if self.attribute else module


COMMANDS = {
    "demo": Command("makes a sequence, replays it through both nodes, scores the masks and draws them", "demo"),
    "detect": Command("detects the traversable region in dataset folders and rosbags", "detect"),
    "evaluate": Command("scores methods on frames with ground truth: table, CSV, JSON and a report", "evaluate"),
    "benchmark": Command("measures time per stage and memory", "benchmark"),
    "generate": Command("renders synthetic stereo sequences with exact truth", "generate"),
    "replay": Command("publishes the stereo topics of a rosbag", "replay", takes_ros_args=True),
    "detector": Command("runs both nodes in one process", "run_nodes", "DETECTOR", takes_ros_args=True),
    "short_range_node": Command(
        "runs the node for disparity and short-range ground", "run_nodes", "SHORT_RANGE_NODE", takes_ros_args=True
    ),
    "long_range_node": Command(
        "runs the node for the region to the horizon", "run_nodes", "LONG_RANGE_NODE", takes_ros_args=True
    ),
}


class _ShowVersion(argparse.Action):
    """Prints the version and ends; it is looked up only then, for that takes as long as all the rest of ``--help``."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from lrtrav_ros import __version__

        print(f"lrtrav {__version__}")
        parser.exit()


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
        epilog="commands:\n" + "\n".join(f"  {name:{width}}{command.summary}" for name, command in COMMANDS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_ShowVersion, nargs=0, help="show the version and exit")
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="one of those below")
    parser.add_argument("arguments", nargs=argparse.REMAINDER, metavar="...", help="see lrtrav COMMAND --help")
    args = parser.parse_args(arguments)
    return run(args.command, args.arguments, prog=f"lrtrav {args.command}")


def run(name: str, arguments: Sequence[str], *, prog: str = "") -> int:
    """Run one subcommand and return the exit status: 0 done, 1 it failed, 2 wrong usage, 130 Ctrl-C.

    Only the module of that command is imported, and it imports what is heavy when it runs.
    """
    prog = prog or name
    if isinstance(sys.stdout, io.TextIOWrapper):  # as on standard error: a file name may be in no encoding
        sys.stdout.reconfigure(errors="backslashreplace")
    command = COMMANDS[name].load()
    parser = argparse.ArgumentParser(prog=prog, description=(command.__doc__ or "").split("\n")[0])
    command.add_arguments(parser)
    own, ros_args = _split_ros_args(arguments) if COMMANDS[name].takes_ros_args else (arguments, [])
    args = parser.parse_args(own, argparse.Namespace(ros_args=ros_args))
    try:
        with _terminable():
            return int(command.run(args))
    except KeyboardInterrupt:
        return 130
    except (OSError, ValueError, RuntimeError) as err:
        warn(f"{prog}: {err}")
        return 2 if isinstance(err, UsageError) else 1


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM end the block as Ctrl-C does, so that nothing temporary stays, decompressed bags above all.

    What sets a handler of its own, as nodes do, keeps it to the end of the process.
    """

    def end(*_: object) -> None:
        sys.exit(128 + signal.SIGTERM)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGTERM) is end:
            signal.signal(signal.SIGTERM, before)


def _split_ros_args(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the arguments before ``--ros-args``, and those from there on."""
    arguments = list(arguments)
    at = arguments.index("--ros-args") if "--ros-args" in arguments else len(arguments)
    return arguments[:at], arguments[at:]
