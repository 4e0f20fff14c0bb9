"""``short_range_node``: disparity, and what is ground and obstacle in it."""

from __future__ import annotations

import argparse

PASSES_ROS_ARGS = True

DESCRIPTION = """\
Runs the short-range node alone, which publishes disparity, short_range/mask and short_range/occupancy.
`detector` runs it together with the other node.

  ros2 run lrtrav_ros short_range_node --ros-args -p stereo.matcher:=bm
  ros2 run lrtrav_ros short_range_node --ros-args --params-file params.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command; all its arguments are for ROS."""
    parser.description = DESCRIPTION
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "Everything after --ros-args goes to ROS."


def run(args: argparse.Namespace) -> int:
    """Spin the node until a signal ends it; return the exit status."""
    from lrtrav_ros.nodes.process import run_nodes
    from lrtrav_ros.nodes.short_range_node import ShortRangeNode

    return run_nodes([ShortRangeNode], ros_args=args.ros_args)
