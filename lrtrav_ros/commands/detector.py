"""``detector``: the short-range and the long-range node in one process."""

from __future__ import annotations

import argparse

PASSES_ROS_ARGS = True

DESCRIPTION = """\
Runs the short-range and the long-range node in one process: stereo pair in, traversable region out.

Parameters are those of `lrtrav detect --set`, and the YAML files are the same:
  ros2 run lrtrav_ros detector --ros-args -p stereo.matcher:=bm -p source:=stereo
  ros2 run lrtrav_ros detector --ros-args --params-file params.yaml
  ros2 run lrtrav_ros detector --ros-args -p preset:=paper -r __ns:=/front_camera
Topics are relative and can be remapped:
  ros2 run lrtrav_ros detector --ros-args -r left/image_rect:=/camera/left/image_rect
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command; all its arguments are for ROS."""
    parser.description = DESCRIPTION
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "Everything after --ros-args goes to ROS."


def run(args: argparse.Namespace) -> int:
    """Spin both nodes until a signal ends them; return the exit status."""
    from lrtrav_ros.nodes.long_range_node import LongRangeNode
    from lrtrav_ros.nodes.process import run_nodes
    from lrtrav_ros.nodes.short_range_node import ShortRangeNode

    # The short range comes last: who waits for its subscriptions, as `replay` does, finds both nodes ready.
    return run_nodes([LongRangeNode, ShortRangeNode], ros_args=args.ros_args)
