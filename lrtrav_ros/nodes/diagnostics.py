"""The state of a node on ``/diagnostics``, once a second."""

from __future__ import annotations

import math
import re
import time
import traceback
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from lrtrav_ros.io.pairing import TopicQueue
from lrtrav_ros.nodes.worker import Worker

PERIOD_S = 1.0
_LOG_PERIOD_S = 60.0
_CHANGE_PERIOD_S = 4.5  # between two texts that differ


class Diagnostics:
    """Publishes a worker's counts, and a problem as a warning.

    Parameters
    ----------
    node : rclpy.node.Node
        Publishes them.
    worker : Worker
        Counts the frames.
    problem : callable
        Returns why nothing reaches the worker; empty where something does.
    frame_topic : callable
        Returns the topic whose messages count as frames.
    n_replaced : callable
        Returns how many frames were dropped before they reached the worker.
    """

    def __init__(
        self,
        node: Node,
        worker: Worker[Any],
        *,
        problem: Callable[[], str],
        frame_topic: Callable[[], TopicQueue[Any]],
        n_replaced: Callable[[], int] = lambda: 0,
    ) -> None:
        self._node = node
        self._worker = worker
        self._problem = problem
        self._frame_topic = frame_topic
        self._n_replaced = n_replaced
        self._logged_s = -math.inf
        self._logged_gist = ""
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # The node's own clock stands still where simulated time does.
        node.create_timer(PERIOD_S, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _publish(self) -> None:
        problem = self._problem()
        self._log(problem)
        if not problem and self._worker.error:
            problem = f"last frame failed: {self._worker.error}"
        message = DiagnosticArray(status=[self._status(problem)])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _log(self, problem: str) -> None:
        """Warn when a problem begins, when it says something else, its figures apart, and each minute that it lasts."""
        if not problem:
            self._logged_s = -math.inf
            return
        gist = re.sub(r"\d+", "", problem)
        if time.monotonic() - self._logged_s > (_LOG_PERIOD_S if gist == self._logged_gist else _CHANGE_PERIOD_S):
            self._logged_s, self._logged_gist = time.monotonic(), gist
            self._node.get_logger().warning(problem)

    def _status(self, problem: str) -> DiagnosticStatus:
        worker, frame_topic = self._worker, self._frame_topic()
        values = {
            "frames received": frame_topic.received,
            "frames processed": worker.processed,
            "frames dropped": worker.dropped + self._n_replaced(),
            # Received are the processed, dropped, failed and unpaired ones, and those that wait or are being processed.
            "frames failed": worker.failed + frame_topic.damaged,
            "frames unpaired": frame_topic.unpaired,
            "messages damaged": worker.damaged,
            "rate [Hz]": f"{worker.rate_hz:.2f}",
            "last frame [ms]": f"{worker.last_ms:.1f}",
            "median frame [ms]": f"{worker.median_ms:.1f}",
        }
        return DiagnosticStatus(
            level=DiagnosticStatus.WARN if problem else DiagnosticStatus.OK,
            name=f"{self._node.get_name()}: frames",
            hardware_id=self._node.get_fully_qualified_name(),
            message=problem or "running",
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def report_failure(node: Node, err: Exception) -> None:
    """Log why a frame was skipped, with a traceback where that is unexpected."""
    if not node.context.ok():
        return  # the node is ending: publishing fails then
    if isinstance(err, ValueError):
        node.get_logger().warning(f"frame skipped: {err}", throttle_duration_sec=5.0)
    else:
        text = "".join(traceback.format_exception(err))
        node.get_logger().error(f"frame skipped: {text}", throttle_duration_sec=5.0)
