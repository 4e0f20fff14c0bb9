"""Running nodes in one process, until the user or the launch system ends it."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Collection, Iterator, Sequence

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError

from lrtrav_ros.config import NODE_DEFAULTS, Config
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.process_memory import keep_freed_images, settle
from lrtrav_ros.nodes.ros_shutdown import ros_shut_down
from lrtrav_ros.nodes.shared_memory import DETECTOR_PROFILE, use_segment
from lrtrav_ros.nodes.short_range_node import ShortRangeNode
from lrtrav_ros.nodes.warm_up import compile_kernels

_COMPILED = "LRTRAV_KERNELS_COMPILED"


def run_nodes(names: Collection[str], *, ros_args: Sequence[str]) -> int:
    """Spin nodes; return the exit status.

    Parameters
    ----------
    names : collection of str
        ``short_range``, ``long_range`` or both, which are linked then.
    ros_args : sequence of str
        Arguments for ROS, such as ``--ros-args -p stereo.matcher:=bm``.

    Returns
    -------
    int
        0 when ended by a signal, 2 where `ros_args` or the nodes' parameters are wrong.
    """
    keep_freed_images()
    _compile_apart()
    use_segment(DETECTOR_PROFILE)
    # Once it is up, ROS itself shuts down at a signal; a KeyboardInterrupt besides could come anywhere, even twice.
    is_up = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None if is_up.is_set() else os._exit(0))
    try:
        rclpy.init(args=list(ros_args))
    except RuntimeError as err:
        return _wrong_usage(err)
    is_up.set()
    nodes: list[Node] = []
    with ros_shut_down():
        try:
            _spin(names, nodes)
        except (ValueError, ParameterException, InvalidQosOverridesError, NameValidationException) as err:
            return _wrong_usage(err)
        finally:
            for node in nodes:
                node.destroy_node()
    return 0


def _spin(names: Collection[str], nodes: list[Node]) -> None:
    """Make the nodes, add them to `nodes`, and spin them."""
    executor = SingleThreadedExecutor()
    for node in _create(names):
        nodes.append(node)
        executor.add_node(node)
    settle()
    while rclpy.ok():
        try:
            executor.spin()
        except ExternalShutdownException:
            return
        except Exception as err:  # of rclpy, which raises what it cannot take: a time before 1970 on /clock is one
            if rclpy.ok():
                text = str(err) if isinstance(err, ValueError) else "".join(traceback.format_exception(err))
                nodes[0].get_logger().error(f"rclpy cannot take a message: {text}", throttle_duration_sec=5.0)


def _create(names: Collection[str]) -> Iterator[Node]:
    """Make the nodes. The short range is last: who waits for its subscriptions, as `replay` does, finds both ready."""
    long_range = LongRangeNode() if "long_range" in names else None
    if long_range is not None:
        yield long_range
    if "short_range" in names:
        yield ShortRangeNode(long_range=long_range)


def _wrong_usage(err: Exception) -> int:
    print(f"wrong parameters or ROS arguments: {' '.join(str(err).split())}", file=sys.stderr)
    return 2


def _compile_apart() -> None:
    """Compile what is not cached yet, then restart the process: the compiler would keep 130 MB that nothing needs."""
    if compile_kernels(Config().updated(NODE_DEFAULTS)) and _COMPILED not in os.environ:
        os.environ[_COMPILED] = "1"  # once only: there may be no place to cache kernels
        # Python would be killed by a signal until it has begun anew.
        signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
        os.execv(sys.executable, sys.orig_argv)
