"""The long-range node: extends short-range ground over the superpixels of the left image."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header
from std_srvs.srv import Empty

from lrtrav_ros.config import LONG_RANGE_STAGES, Config
from lrtrav_ros.detector import LongRange, LongRangeDetector
from lrtrav_ros.frame import as_8bit
from lrtrav_ros.io.pictures import overlay
from lrtrav_ros.method.memory import Memory
from lrtrav_ros.nodes import messages
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure
from lrtrav_ros.nodes.endpoints import Output
from lrtrav_ros.nodes.long_range_inputs import LongRangeFrame, LongRangeInput, ShortRangeLink, TopicsInput
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker
from lrtrav_ros.numerics.thread_team import ALONE


class LongRangeNode(Node):
    """Publishes ``long_range/mask`` and ``long_range/occupancy`` for each short-range result.

    It remembers the frames before; the service ``long_range/reset_memory``, a jump in time, and a change of the
    parameters of features or memory make it forget them.

    Raises
    ------
    ValueError
        If a parameter that it is started with does not fit.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("long_range", **options)
        self._settings = Settings(self, LONG_RANGE_STAGES)
        self._advertise()
        compile_kernels(self._settings.config)
        self._cached_detector = _new_detector(self._settings.config, None)
        self._is_to_forget = threading.Event()
        self.create_service(Empty, "long_range/reset_memory", self._reset_memory)
        self._worker: Worker[LongRangeFrame] = Worker(self._process, failed=lambda err: report_failure(self, err))
        self._topics = TopicsInput(self, self._settings, self._worker.put, self._worker.refuse)
        self._input: LongRangeInput = self._topics
        self._diagnostics = Diagnostics(
            self, self._worker, problem=lambda: self._input.problem(), frame_topic=lambda: self._input.frame_topic
        )
        self.get_logger().info("ready")

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        if hasattr(self, "_worker"):
            self._worker.close()
        super().destroy_node()

    def link(self, *, left_topic: str, occupancy_topic: str) -> ShortRangeLink | None:
        """Take frames from the short-range node of this process, and no longer from topics, where both name the same.

        Parameters
        ----------
        left_topic, occupancy_topic : str
            Full names of the short-range node's topics.

        Returns
        -------
        ShortRangeLink or None
            What the short-range node is to give its frames; None where it has other topics than this node.
        """
        if (left_topic, occupancy_topic) != (self._topics.left_topic, self._topics.frame_topic.topic):
            return None
        self._topics.close()
        link = ShortRangeLink(self._topics, self._worker.put)
        self._input = link
        return link

    def _advertise(self) -> None:
        self._mask = Output(self, "long_range/mask")
        self._occupancy = Output(self, "long_range/occupancy")
        self._superpixels = Output(self, "long_range/superpixels")
        self._clusters = Output(self, "long_range/clusters")
        self._confidence = Output(self, "long_range/confidence")
        self._overlay = Output(self, "long_range/overlay")

    def _process(self, frame: LongRangeFrame) -> None:
        left = frame.left()
        image = as_8bit(left.pixels)
        detector = self._detector()
        appearance = detector.look(image)
        occupancy = frame.occupancy()
        long_range = detector.extend(appearance, occupancy, stamp_ns=left.stamp_ns)
        self._publish(left.header, image, occupancy, long_range)

    def _reset_memory(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        # The memory belongs to the worker's thread, which may be at a frame.
        self._is_to_forget.set()
        return response

    def _detector(self) -> LongRangeDetector:
        """Return the detector for the current parameters, with the memory of the one before where that still fits."""
        config, last = self._settings.config, self._cached_detector
        if last.config is not config:
            fits = (last.config.features, last.config.memory) == (config.features, config.memory)
            self._cached_detector = _new_detector(config, last.memory if fits else None)
        if self._is_to_forget.is_set():
            self._is_to_forget.clear()
            self._cached_detector.memory.clear()
        return self._cached_detector

    def _publish(
        self, header: Header, image: NDArray[np.uint8], occupancy: NDArray[np.uint8], long_range: LongRange
    ) -> None:
        self._mask.publish_image(lambda: long_range.mask, header)
        self._occupancy.publish_image(lambda: long_range.occupancy, header)
        self._superpixels.publish_image(lambda: messages.as_uint16(long_range.superpixels), header)
        self._clusters.publish_image(lambda: messages.as_uint16(long_range.clusters), header)
        confidence = long_range.confidence
        if confidence is not None:
            self._confidence.publish_image(lambda: confidence, header)
        self._overlay.publish_image(lambda: overlay(image, occupancy, long_range.occupancy), header)


def _new_detector(config: Config, memory: Memory | None) -> LongRangeDetector:
    """Return a detector on one thread: the processors that are left have the short range of the next frame to do."""
    return LongRangeDetector(config, memory=memory, team=ALONE)
