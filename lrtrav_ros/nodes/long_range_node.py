"""The long-range node: extends short-range ground over the clusters of the left image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector, LongRange
from lrtrav_ros.io import encodings as images
from lrtrav_ros.io import topics
from lrtrav_ros.io.pairing import Pairing
from lrtrav_ros.io.pictures import overlay
from lrtrav_ros.nodes import endpoints, messages
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure
from lrtrav_ros.nodes.inputs import PATIENCE_S
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker

_STAGES = ("source", "superpixels", "features", "clustering", "extension")

_WAITING_LEFT = 30  # one second at 30 Hz: a left image waits while the short-range node works on its frame
_WAITING_OCCUPANCY = 5

# The long range needs no calibration.
_ANY_CAMERA = StereoCamera(fx=1.0, cx=0.0, cy=0.0, baseline_m=1.0)

Pair = tuple[Any, Any]
"""Messages of one frame: the short-range occupancy, and the left image."""


class LongRangeNode(Node):
    """Publishes ``long_range/mask`` and ``long_range/occupancy`` for each short-range result.

    Raises
    ------
    ValueError
        If a parameter that it is started with does not fit.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("long_range", **options)
        self._settings = Settings(self, _STAGES)
        self._made: tuple[Config, Detector] | None = None
        self._advertise()
        compile_kernels(self._settings.config)
        self._worker: Worker[Pair] = Worker(self._process, failed=lambda err: report_failure(self, err))
        self._pairing = self._subscribe()
        self._diagnostics = Diagnostics(self, self._worker, self._problem, lambda: self._pairing.first)
        self.get_logger().info("ready")

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        if hasattr(self, "_worker"):
            self._worker.close()
        super().destroy_node()

    def _advertise(self) -> None:
        self._mask = endpoints.publish_on(self, Image, "long_range/mask")
        self._occupancy = endpoints.publish_on(self, Image, "long_range/occupancy")
        self._superpixels = endpoints.publish_on(self, Image, "long_range/superpixels")
        self._clusters = endpoints.publish_on(self, Image, "long_range/clusters")
        self._overlay = endpoints.publish_on(self, Image, "long_range/overlay")

    def _subscribe(self) -> Pairing[Any, Any]:
        compressed = self._settings.config.source.compressed
        left = endpoints.subscribe_image(self, topics.LEFT_IMAGE, self._take_left, compressed=compressed)
        occupancy = endpoints.subscribe(self, Image, "short_range/occupancy", self._take_occupancy)
        return Pairing((occupancy.topic_name, _WAITING_OCCUPANCY), (left.topic_name, _WAITING_LEFT))

    @property
    def _tolerance_ns(self) -> int:
        """What stamps may differ by: nothing, but for depth cameras, whose two images may have stamps of their own."""
        return 0 if self._settings.config.source.source == "stereo" else self._settings.stamp_tolerance_ns

    def _take_left(self, message: Any) -> None:
        stamp_ns = messages.stamp_ns(message)
        self._hand_over(self._pairing.add_second(stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _take_occupancy(self, message: Image) -> None:
        stamp_ns = messages.stamp_ns(message)
        self._hand_over(self._pairing.add_first(stamp_ns, message, tolerance_ns=self._tolerance_ns))

    def _hand_over(self, pair: Pair | None) -> None:
        if pair is not None:
            self._worker.put(pair)

    def _problem(self) -> str:
        return "" if self._pairing.idle_s < PATIENCE_S else self._pairing.reason(tolerance_ns=self._tolerance_ns)

    def _process(self, pair: Pair) -> None:
        occupancy, left = (images.decode_message(message) for message in pair)
        long_range = self._detector().long_range(left, occupancy)
        self._publish(pair[1].header, left, occupancy, long_range)

    def _detector(self) -> Detector:
        """Return the detector for the current parameters."""
        config = self._settings.config
        if self._made is None or self._made[0] is not config:
            self._made = (config, Detector(config, _ANY_CAMERA))
        return self._made[1]

    def _publish(self, header: Header, left: NDArray[Any], occupancy: NDArray[np.uint8], long_range: LongRange) -> None:
        self._mask.publish(messages.array_to_image(long_range.mask, header))
        self._occupancy.publish(messages.array_to_image(long_range.occupancy, header))
        endpoints.publish_if_wanted(self._superpixels, header, lambda: messages.as_uint16(long_range.superpixels))
        endpoints.publish_if_wanted(self._clusters, header, lambda: messages.as_uint16(long_range.clusters))
        endpoints.publish_if_wanted(
            self._overlay, header, lambda: overlay(images.as_8bit(left), occupancy, long_range.occupancy)
        )
