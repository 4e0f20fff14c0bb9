"""The end of ROS in a process that runs until its work is done or a signal ends it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import rclpy
from rclpy.exceptions import NotInitializedException
from rclpy.executors import ExternalShutdownException


@contextmanager
def ros_shut_down() -> Iterator[None]:
    """Shut ROS down after the block, and let the block end well where a signal has shut ROS down before.

    What rclpy raises when it finds ROS gone, anywhere in the block, is no error then. Later signals are ignored, to the
    end of the process.
    """
    numbers = (signal.SIGINT, signal.SIGTERM)
    try:
        yield
    except (ExternalShutdownException, KeyboardInterrupt, SystemExit):
        pass
    except (RuntimeError, NotInitializedException):
        if rclpy.ok():
            raise
    finally:
        for number in numbers:
            signal.signal(number, lambda *_: None)  # one of them would interrupt the shutdown
        with suppress(RuntimeError):  # the thread in which rclpy handles signals may be quicker
            rclpy.try_shutdown()
        # Python gives signals back their own way as it ends: a second one, which `ros2 launch` sends, would kill it.
        for number in numbers:
            signal.signal(number, signal.SIG_IGN)
