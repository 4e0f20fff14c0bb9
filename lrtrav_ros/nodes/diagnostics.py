"""The state of a node and of its inputs on ``/diagnostics``, once a second."""

from __future__ import annotations

import math
import re
import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from lrtrav_ros.nodes.counts import Counts, Received
from lrtrav_ros.nodes.health import Health, Window, frames_health, silent_health, topic_health
from lrtrav_ros.nodes.input_topic import InputTopic, shortened
from lrtrav_ros.nodes.missing_topics import explain_publishers
from lrtrav_ros.nodes.worker import Worker, WorkerCounts

PERIOD_S = 1.0

WINDOW_S = 10.0
"""Seconds for which a failure is told of, however many good frames come after it."""

_LOG_PERIOD_S = 60.0
_CHANGE_PERIOD_S = 4.5  # between two texts that differ
_FRAMES = "frames"


class Diagnostics:
    """Publishes the status of a node's frames, and one of each topic that it subscribes to; see `health` for the rules.

    Parameters
    ----------
    node : rclpy.node.Node
        Publishes them.
    worker : Worker
        Counts the frames.
    received : callable
        Returns what came before the worker.
    problem : callable
        Returns why nothing reaches the worker; empty where something does.
    """

    def __init__(
        self,
        node: Node,
        worker: Worker[Any],
        received: Callable[[], Received],
        *,
        problem: Callable[[], str],
    ) -> None:
        self._node = node
        self._worker = worker
        self._received = received
        self._problem = problem
        self._window = Window(WINDOW_S)
        self._logged_s = -math.inf
        self._logged_gist = ""
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # The node's own clock stands still where simulated time does.
        node.create_timer(PERIOD_S, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def forget(self) -> None:
        """Forget the counts of the last seconds."""
        self._window.forget()

    def _publish(self) -> None:
        message = DiagnosticArray(status=self._statuses())
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _statuses(self) -> list[DiagnosticStatus]:
        """Return the status of the frames, then those of the topics."""
        received, worker = self._received(), self._worker.counts()
        counts = {_FRAMES: received.frames(worker)}
        counts |= {topic.name: received.messages(topic, worker) for topic in received.topics}
        self._window.add(counts)
        problem = self._problem()
        self._log(problem)
        topics = {topic: self._topic_health(topic, received, worker) for topic in received.topics}
        frames = frames_health(
            self._window.recent(_FRAMES),
            self._window,
            last_failure=worker.failed_by("").last,
            problem=problem,
            topics=list(topics.values()),
        )
        return [
            self._status(_FRAMES, frames, "running", self._frame_values(counts, received)),
            *(
                self._topic_status(topic, health, counts[topic.name], received, worker)
                for topic, health in topics.items()
            ),
        ]

    def _topic_health(self, topic: InputTopic, received: Received, worker: WorkerCounts) -> Health:
        return topic_health(
            topic.topic,
            self._window.recent(topic.name),
            self._window,
            last_refusal=received.last_refusal(topic, worker),
            needs_partner=topic.needs_partner,
            publishers=explain_publishers(self._node, topic.topic),
        )

    def _log(self, problem: str) -> None:
        """Warn when a problem begins, when it says something else, its figures apart, and each minute that it lasts."""
        if not problem:
            self._logged_s = -math.inf
            return
        gist = re.sub(r"\d+", "", problem)
        if time.monotonic() - self._logged_s > (_LOG_PERIOD_S if gist == self._logged_gist else _CHANGE_PERIOD_S):
            self._logged_s, self._logged_gist = time.monotonic(), gist
            self._node.get_logger().warning(problem)

    def _frame_values(self, counts: Mapping[str, Counts], received: Received) -> dict[str, object]:
        """Return the counts of the frames: those received are the sum of the five after it."""
        frames, worker = counts[_FRAMES], self._worker
        return {
            "frames received": frames.received,
            "frames processed": frames.processed,
            "frames dropped": frames.dropped,
            "frames failed": frames.failed + frames.refused,
            "frames unpaired": frames.unpaired,
            "frames waiting": frames.waiting,
            "messages refused": sum(counts[topic.name].refused for topic in received.topics),
            "rate [Hz]": f"{worker.rate_hz:.2f}",
            "last frame [ms]": f"{worker.last_ms:.1f}",
            "median frame [ms]": f"{worker.median_ms:.1f}",
        }

    def _topic_status(
        self, topic: InputTopic, health: Health, counts: Counts, received: Received, worker: WorkerCounts
    ) -> DiagnosticStatus:
        """Return the status of a topic, whose messages received are the sum of the six counts after it."""
        refusal = received.last_refusal(topic, worker)
        rate_hz = self._window.rate_hz(topic.name)
        if topic.part:  # why nothing comes, the frames' status says
            health = silent_health(self._window.recent(topic.name), self._window) or health
        values = {
            "topic": topic.topic,
            "received": counts.received,
            "processed": counts.processed,
            "dropped": counts.dropped,
            "refused": counts.refused,
            "failed": counts.failed,
            "unpaired": counts.unpaired,
            "waiting": counts.waiting,
            "rate [Hz]": f"{rate_hz:.2f}",
            "last refusal": "none" if refusal is None else refusal.reason,
            "last refusal [s ago]": "" if refusal is None else f"{self._window.now_s - refusal.at_s:.0f}",
        }
        return self._status(topic.name, health, f"{rate_hz:.1f} Hz", values)

    def _status(self, name: str, health: Health, all_well: str, values: Mapping[str, object]) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=bytes([health.level]),
            name=f"{self._node.get_name()}: {name}",
            hardware_id=self._node.get_fully_qualified_name(),
            message="\n".join(health.lines) or all_well,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )


def report_failure(node: Node, err: Exception, topics: Iterable[InputTopic]) -> None:
    """Log why a frame failed, and by which topic, with a traceback where it is unexpected."""
    if not node.context.ok():
        return  # the node is ending: publishing fails then
    part = getattr(err, "part", None)
    text = ": ".join(["frame failed", *(topic.topic for topic in topics if topic.part == part), shortened(str(err))])
    if isinstance(err, ValueError):
        node.get_logger().warning(text, throttle_duration_sec=5.0)
    else:
        node.get_logger().error(f"{text}\n{''.join(traceback.format_exception(err))}", throttle_duration_sec=5.0)


def report_refusal(node: Node, text: str) -> None:
    """Log why a message was refused."""
    if node.context.ok():
        node.get_logger().warning(f"message refused: {text}", throttle_duration_sec=5.0)
