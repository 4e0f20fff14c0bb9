"""The executables that run nodes: one of the two, or both in one process."""

from __future__ import annotations

import argparse
import os
import signal
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class NodesCommand:
    """A command that runs nodes until a signal ends them.

    Parameters
    ----------
    description : str
        Its help, with examples.
    nodes : tuple of str
        Names of the nodes.
    """

    description: str
    nodes: tuple[str, ...]

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Describe the command; all its arguments are for ROS."""
        parser.description = self.description
        parser.formatter_class = argparse.RawDescriptionHelpFormatter
        parser.epilog = "Everything after --ros-args goes to ROS."

    def run(self, args: argparse.Namespace) -> int:
        """Spin the nodes; return the exit status."""
        # The imports take a second: a signal in that time ends the process as well as a later one does.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: os._exit(0))
        # One may have come while `run_nodes` restarted the process, and waits.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT, signal.SIGTERM))
        from lrtrav_ros.nodes.process import run_nodes

        return run_nodes(self.nodes, ros_args=args.ros_args)


DETECTOR = NodesCommand(
    """\
Runs the short-range and the long-range node in one process: stereo pair in, traversable region out.

Parameters are those of `lrtrav detect --set`, and the YAML files are the same:
  ros2 run lrtrav_ros detector --ros-args -p stereo.matcher:=bm -p source:=stereo
  ros2 run lrtrav_ros detector --ros-args --params-file params.yaml
  ros2 run lrtrav_ros detector --ros-args -p preset:=paper -r __ns:=/front_camera
Topics are relative and can be remapped:
  ros2 run lrtrav_ros detector --ros-args -r left/image_rect:=/camera/left/image_rect
""",
    ("short_range", "long_range"),
)

SHORT_RANGE_NODE = NodesCommand(
    """\
Runs the short-range node alone, which publishes disparity, short_range/mask and short_range/occupancy.
`detector` runs it together with the other node.

  ros2 run lrtrav_ros short_range_node --ros-args -p stereo.matcher:=bm
  ros2 run lrtrav_ros short_range_node --ros-args --params-file params.yaml
""",
    ("short_range",),
)

LONG_RANGE_NODE = NodesCommand(
    """\
Runs the long-range node alone, which publishes long_range/mask and long_range/occupancy.
`detector` runs it together with the other node.

  ros2 run lrtrav_ros long_range_node --ros-args -p clustering.k:=0
  ros2 run lrtrav_ros long_range_node --ros-args --params-file params.yaml
""",
    ("long_range",),
)
