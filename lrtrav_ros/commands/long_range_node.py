"""``long_range_node``: extends short-range ground over the left image, to the horizon."""

from __future__ import annotations

import argparse

PASSES_ROS_ARGS = True

DESCRIPTION = """\
Runs the long-range node alone, which publishes long_range/mask and long_range/occupancy.
`detector` runs it together with the other node.

  ros2 run lrtrav_ros long_range_node --ros-args -p clustering.k:=0
  ros2 run lrtrav_ros long_range_node --ros-args --params-file params.yaml
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command; all its arguments are for ROS."""
    parser.description = DESCRIPTION
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "Everything after --ros-args goes to ROS."


def run(args: argparse.Namespace) -> int:
    """Spin the node until a signal ends it; return the exit status."""
    from lrtrav_ros.nodes.long_range_node import LongRangeNode
    from lrtrav_ros.nodes.process import run_nodes

    return run_nodes([LongRangeNode], ros_args=args.ros_args)
