"""Running nodes in one process, until the user or the launch system ends it."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable, Sequence

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError

from lrtrav_ros.config import Config
from lrtrav_ros.nodes.shared_memory import use_large_segment
from lrtrav_ros.nodes.warm_up import compile_kernels

_M_MMAP_THRESHOLD = -3  # malloc.h
_IMAGE_BYTES = 256 * 1024

_COMPILED = "LRTRAV_KERNELS_COMPILED"


def run_nodes(factories: Sequence[Callable[[], Node]], *, ros_args: Sequence[str]) -> int:
    """Spin the nodes that `factories` make; return the exit status.

    Parameters
    ----------
    ros_args : sequence of str
        Arguments for ROS, such as ``--ros-args -p stereo.matcher:=bm``.

    Returns
    -------
    int
        0 when ended by a signal, 2 where `ros_args` or the nodes' parameters are wrong.
    """
    _compile_apart()
    use_large_segment()
    _return_freed_images()
    try:
        rclpy.init(args=list(ros_args))
    except RuntimeError as err:
        return _wrong_usage(err)
    nodes: list[Node] = []
    try:
        _spin(factories, nodes)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ValueError, ParameterException, InvalidQosOverridesError, NameValidationException) as err:
        return _wrong_usage(err)
    except RuntimeError:
        if rclpy.ok():  # else a signal ended ROS while a node was being made
            raise
    finally:
        # A second signal, which `ros2 launch` sends, would interrupt this cleanup.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(factories: Sequence[Callable[[], Node]], nodes: list[Node]) -> None:
    """Make the nodes, add them to `nodes`, and spin them."""
    executor = SingleThreadedExecutor()
    for factory in factories:
        nodes.append(factory())
        executor.add_node(nodes[-1])
    executor.spin()


def _wrong_usage(err: Exception) -> int:
    print(f"wrong parameters or ROS arguments: {' '.join(str(err).split())}", file=sys.stderr)
    return 2


def _return_freed_images() -> None:
    """Let the C library (glibc) return the memory of freed images at once; its heaps keep some 60 MB otherwise."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _IMAGE_BYTES)


def _compile_apart() -> None:
    """Compile what is not cached yet, then restart the process: the compiler would keep 130 MB that nothing needs."""
    if compile_kernels(Config()) and _COMPILED not in os.environ:
        os.environ[_COMPILED] = "1"  # once only: there may be no place to cache kernels
        os.execv(sys.executable, sys.orig_argv)
