"""The long-range node: extends short-range ground over the superpixels of the left image."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from std_srvs.srv import Empty

from lrtrav_ros.config import LONG_RANGE_STAGES
from lrtrav_ros.detector import LongRange, LongRangeDetector
from lrtrav_ros.frame import as_8bit
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.io.pairing import StampPairing, TopicQueue
from lrtrav_ros.io.pictures import overlay
from lrtrav_ros.io.topics import LEFT_IMAGE
from lrtrav_ros.nodes import endpoints, messages
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure
from lrtrav_ros.nodes.inputs import PATIENCE_S
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker

_WAITING_LEFT = 30  # one second at 30 Hz: a left image waits while the short-range node works on its frame
_WAITING_OCCUPANCY = 5

ImagePair = tuple[Any, Any]
"""Messages of one frame: the short-range occupancy, and the left image."""


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
        self._cached_detector = LongRangeDetector(self._settings.config)
        self._is_to_forget = threading.Event()
        self.create_service(Empty, "long_range/reset_memory", self._reset_memory)
        self._worker: Worker[ImagePair] = Worker(self._process, failed=lambda err: report_failure(self, err))
        self._pairing = self._subscribe()
        self._diagnostics = Diagnostics(self, self._worker, problem=self._problem, frame_topic=self._pairing.first)
        self.get_logger().info("ready")

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        if hasattr(self, "_worker"):
            self._worker.close()
        super().destroy_node()

    def _advertise(self) -> None:
        self._mask = endpoints.advertise(self, Image, "long_range/mask")
        self._occupancy = endpoints.advertise(self, Image, "long_range/occupancy")
        self._superpixels = endpoints.advertise(self, Image, "long_range/superpixels")
        self._clusters = endpoints.advertise(self, Image, "long_range/clusters")
        self._confidence = endpoints.advertise(self, Image, "long_range/confidence")
        self._overlay = endpoints.advertise(self, Image, "long_range/overlay")

    def _subscribe(self) -> StampPairing[Any, Any]:
        compressed = self._settings.config.source.compressed
        left = endpoints.subscribe_image(self, LEFT_IMAGE, self._take_left, compressed=compressed)
        occupancy = endpoints.subscribe(self, Image, "short_range/occupancy", self._take_occupancy)
        return StampPairing(
            TopicQueue(occupancy.topic_name, _WAITING_OCCUPANCY),
            TopicQueue(left.topic_name, _WAITING_LEFT, is_ordered=True),
        )

    @property
    def _tolerance_ns(self) -> int:
        """Largest difference of stamps: none for stereo; disparity and depth may have stamps of their own."""
        return 0 if self._settings.config.source.source == "stereo" else self._settings.stamp_tolerance_ns

    def _take_left(self, message: Any) -> None:
        stamp_ns = header_stamp_ns(message)
        self._put(self._pairing.add_second(stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _take_occupancy(self, message: Image) -> None:
        stamp_ns = header_stamp_ns(message)
        self._put(self._pairing.add_first(stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _put(self, pair: ImagePair | None) -> None:
        if pair is not None:
            self._worker.put(pair)

    def _problem(self) -> str:
        return "" if self._pairing.idle_s < PATIENCE_S else self._pairing.silence(tolerance_ns=self._tolerance_ns)

    def _process(self, pair: ImagePair) -> None:
        occupancy, left = (decode_message(message) for message in pair)
        image = as_8bit(left)
        long_range = self._detector().detect(image, occupancy, stamp_ns=header_stamp_ns(pair[1]))
        self._publish(pair[1].header, image, occupancy, long_range)

    def _reset_memory(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        # The memory belongs to the worker's thread, which may be at a frame.
        self._is_to_forget.set()
        return response

    def _detector(self) -> LongRangeDetector:
        """Return the detector for the current parameters, with the memory of the one before where that still fits."""
        config, last = self._settings.config, self._cached_detector
        if last.config is not config:
            fits = (last.config.features, last.config.memory) == (config.features, config.memory)
            self._cached_detector = LongRangeDetector(config, memory=last.memory if fits else None)
        if self._is_to_forget.is_set():
            self._is_to_forget.clear()
            self._cached_detector.memory.clear()
        return self._cached_detector

    def _publish(
        self, header: Header, image: NDArray[np.uint8], occupancy: NDArray[np.uint8], long_range: LongRange
    ) -> None:
        self._mask.publish(messages.array_to_image(long_range.mask, header))
        self._occupancy.publish(messages.array_to_image(long_range.occupancy, header))
        endpoints.publish_if_wanted(self._superpixels, header, lambda: messages.as_uint16(long_range.superpixels))
        endpoints.publish_if_wanted(self._clusters, header, lambda: messages.as_uint16(long_range.clusters))
        confidence = long_range.confidence
        if confidence is not None:
            endpoints.publish_if_wanted(self._confidence, header, lambda: confidence)
        endpoints.publish_if_wanted(self._overlay, header, lambda: overlay(image, occupancy, long_range.occupancy))
