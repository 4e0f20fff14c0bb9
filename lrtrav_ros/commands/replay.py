"""Publishes the stereo topics of a rosbag, of ROS 1 or ROS 2, in the bag's own timing."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import topic_remap
from lrtrav_ros.commands.reporting import warn
from lrtrav_ros.commands.usage_error import UsageError
from lrtrav_ros.io.topics import PARTNER

if TYPE_CHECKING:
    from lrtrav_ros.nodes.bag_player import ReplayOptions

DESCRIPTION = """\
Publishes the stereo topics of a rosbag (ROS 1 or ROS 2), in the bag's own timing, under the names that the detector
subscribes to. Beside `ros2 run lrtrav_ros detector`, it needs nothing else:
  ros2 run lrtrav_ros replay recording.mcap
  ros2 run lrtrav_ros replay recording.bag --rate 0.5 --loop --remap /cam0/image_raw:=left/image_rect
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    parser.description = DESCRIPTION
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "Everything after --ros-args goes to ROS, such as -r __ns:=/front_camera."
    parser.add_argument(
        "bag", type=Path, help=".bag, .mcap or .db3 file, compressed with zstd or not, or a ROS 2 bag's folder"
    )
    parser.add_argument("--rate", type=float, default=1.0, help="factor on the speed (%(default)s)")
    parser.add_argument("--loop", action="store_true", help="start over at the end, until interrupted")
    parser.add_argument("--start", type=float, default=0.0, metavar="S", help="begin this many seconds into the bag")
    parser.add_argument("--duration", type=float, metavar="S", help="end after this many seconds of the bag")
    parser.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="FROM:=TO",
        help="publish the bag's topic FROM as TO, such as left/image_rect; can be repeated",
    )
    parser.add_argument(
        "--source", choices=PARTNER, default="stereo", help="what to publish of a bag that holds several (%(default)s)"
    )
    parser.add_argument(
        "--raw",
        action="store_true",
        help="publish raw pairs as left/image_raw and right/image_raw, for nodes with source.rectify",
    )
    parser.add_argument("--all", action="store_true", help="publish the bag's other topics too, such as /tf")
    parser.add_argument("--clock", action="store_true", help="publish /clock")
    parser.add_argument("--no-wait", action="store_true", help="begin at once, not when somebody subscribes")


def run(args: argparse.Namespace) -> int:
    """Publish the bag; return the exit status, which is 1 where something of the bag is damaged."""
    from lrtrav_ros.nodes.bag_player import RosArgumentsError, replay

    try:
        is_whole = replay(args.bag, _options(args), ros_args=args.ros_args)
    except RosArgumentsError as err:
        raise UsageError(str(err)) from err
    if not is_whole:
        warn(f"{args.bag}: is damaged; what could be read of it is published")
    return 0 if is_whole else 1


def _options(args: argparse.Namespace) -> ReplayOptions:
    """Return what the arguments ask for."""
    from lrtrav_ros.nodes.bag_player import ReplayOptions

    try:
        return ReplayOptions(
            source=args.source,
            raw=args.raw,
            rate=args.rate,
            loop=args.loop,
            start_s=args.start,
            duration_s=args.duration,
            remap=dict(map(topic_remap, args.remap)),
            all_topics=args.all,
            clock=args.clock,
            wait=not args.no_wait,
        )
    except ValueError as err:
        raise UsageError(str(err)) from err
