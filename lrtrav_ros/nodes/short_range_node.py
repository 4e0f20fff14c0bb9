"""The short-range node: disparity, and what is ground and obstacle in it."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import Image
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import SHORT_RANGE_STAGES
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.io.message_frames import FrameMessages, frame_of
from lrtrav_ros.io.topics import DISPARITY
from lrtrav_ros.method.ground import ShortRange
from lrtrav_ros.nodes import endpoints, messages
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure
from lrtrav_ros.nodes.inputs import INPUTS, Input
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker


class ShortRangeNode(Node):
    """Publishes disparity, ``short_range/mask`` and ``short_range/occupancy`` for each frame of its source.

    Raises
    ------
    ValueError
        If a parameter that it is started with does not fit.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("short_range", **options)
        self._settings = Settings(self, SHORT_RANGE_STAGES)
        source = self._settings.config.source.source
        self._advertise(with_disparity=source != "disparity")
        compile_kernels(self._settings.config)
        self._cached_detector = ShortRangeDetector(self._settings.config)
        self._worker: Worker[FrameMessages] = Worker(self._process, failed=lambda err: report_failure(self, err))
        self._input: Input = INPUTS[source](self, self._settings, self._worker.put)
        self._diagnostics = Diagnostics(
            self,
            self._worker,
            problem=self._input.problem,
            frame_topic=self._input.frame_topic,
            n_replaced=lambda: self._input.calibrated.n_replaced,
        )
        self.get_logger().info(f"ready; source: {source}")

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        if hasattr(self, "_worker"):
            self._worker.close()
        super().destroy_node()

    def _advertise(self, *, with_disparity: bool) -> None:
        self._disparity = endpoints.advertise(self, DisparityImage, DISPARITY) if with_disparity else None
        self._mask = endpoints.advertise(self, Image, "short_range/mask")
        self._occupancy = endpoints.advertise(self, Image, "short_range/occupancy")
        self._u_disparity = endpoints.advertise(self, Image, "short_range/u_disparity")
        self._v_disparity = endpoints.advertise(self, Image, "short_range/v_disparity")
        self._obstacle_disparity = endpoints.advertise(self, Image, "short_range/obstacle_disparity")

    def _process(self, frame_messages: FrameMessages) -> None:
        frame = frame_of(frame_messages)
        short_range = self._detector().detect(frame)
        self._publish(frame_messages, short_range, frame.camera)

    def _detector(self) -> ShortRangeDetector:
        """Return the detector for the current parameters; a new one where they have changed."""
        config = self._settings.config
        if self._cached_detector.config is not config:
            self._cached_detector = ShortRangeDetector(config)
        return self._cached_detector

    def _publish(self, frame_messages: FrameMessages, short_range: ShortRange, camera: StereoCamera) -> None:
        header = frame_messages.header
        # Occupancy goes first: the long-range node waits for it.
        self._occupancy.publish(messages.array_to_image(short_range.occupancy, header))
        self._mask.publish(messages.array_to_image(short_range.mask, header))
        if self._disparity is not None:
            n = self._cached_detector.config.stereo.n_disparities
            message = messages.disparity_to_message(short_range.disparity, header, camera, n_disparities=n)
            self._disparity.publish(message)
        endpoints.publish_if_wanted(self._u_disparity, header, lambda: short_range.u_disparity)
        endpoints.publish_if_wanted(self._v_disparity, header, lambda: messages.as_uint16(short_range.v_disparity))
        endpoints.publish_if_wanted(self._obstacle_disparity, header, lambda: short_range.obstacle_disparity)
