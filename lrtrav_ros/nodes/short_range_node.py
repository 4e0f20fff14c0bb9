"""The short-range node: disparity, and what is ground and obstacle in it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import SHORT_RANGE_STAGES
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.message_frames import FrameMessages, frame_of
from lrtrav_ros.io.topics import DISPARITY
from lrtrav_ros.method.ground import ShortRange
from lrtrav_ros.nodes import messages
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure
from lrtrav_ros.nodes.endpoints import Output
from lrtrav_ros.nodes.inputs import INPUTS, Input
from lrtrav_ros.nodes.long_range_inputs import LeftImage, ShortRangeLink
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker


class ShortRangeNode(Node):
    """Publishes disparity, ``short_range/mask`` and ``short_range/occupancy`` for each frame of its source.

    Parameters
    ----------
    long_range : LongRangeNode, optional
        The other node, where it is in the same process: it is handed the stereo frames of this one, and begins with
        them at the same time.
    **options
        As for `rclpy.node.Node`.

    Raises
    ------
    ValueError
        If a parameter that it is started with does not fit.
    """

    def __init__(self, *, long_range: LongRangeNode | None = None, **options: Any) -> None:
        super().__init__("short_range", **options)
        self._settings = Settings(self, SHORT_RANGE_STAGES)
        source = self._settings.config.source.source
        self._advertise(with_disparity=source != "disparity")
        compile_kernels(self._settings.config)
        self._cached_detector = ShortRangeDetector(self._settings.config)
        self._worker: Worker[FrameMessages] = Worker(self._process, failed=lambda err: report_failure(self, err))
        self._input: Input = INPUTS[source](self, self._settings, self._worker.put, self._worker.refuse)
        # The other sources have no left image, or one of another time.
        self._link = None if long_range is None or source != "stereo" else self._linked(long_range)
        self._diagnostics = Diagnostics(
            self,
            self._worker,
            problem=self._input.problem,
            frame_topic=lambda: self._input.frame_topic,
            n_replaced=lambda: self._input.calibrated.n_replaced,
        )
        self.get_logger().info(f"ready; source: {source}")

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        if hasattr(self, "_worker"):
            self._worker.close()
        super().destroy_node()

    def _linked(self, long_range: LongRangeNode) -> ShortRangeLink | None:
        """Return where to hand frames to the other node; None where it is to use topics."""
        return long_range.link(left_topic=self._input.frame_topic.topic, occupancy_topic=self._occupancy.topic_name)

    def _advertise(self, *, with_disparity: bool) -> None:
        self._disparity = Output(self, DISPARITY, DisparityImage) if with_disparity else None
        self._mask = Output(self, "short_range/mask")
        self._occupancy = Output(self, "short_range/occupancy")
        self._u_disparity = Output(self, "short_range/u_disparity")
        self._v_disparity = Output(self, "short_range/v_disparity")
        self._obstacle_disparity = Output(self, "short_range/obstacle_disparity")

    def _process(self, frame_messages: FrameMessages) -> None:
        decoded = frame_messages.decoded()
        frame, header = frame_of(decoded), messages.header_of(decoded)
        with self._handed_over(frame, header) as give_occupancy:
            short_range = self._detector().detect(frame)
            give_occupancy(short_range.occupancy)
        self._publish(header, short_range, frame.camera)

    def _handed_over(self, frame: Frame, header: Header) -> AbstractContextManager[Callable[[NDArray[np.uint8]], None]]:
        """Hand a frame to the other node, where it is linked."""
        if self._link is None or frame.left is None:
            return nullcontext(lambda occupancy: None)
        return self._link.frame(LeftImage(header, frame.left))

    def _detector(self) -> ShortRangeDetector:
        """Return the detector for the current parameters; a new one where they have changed."""
        config = self._settings.config
        if self._cached_detector.config is not config:
            self._cached_detector = ShortRangeDetector(config)
        return self._cached_detector

    def _publish(self, header: Header, short_range: ShortRange, camera: StereoCamera) -> None:
        # Occupancy goes first: a long-range node in another process waits for it.
        self._occupancy.publish_image(lambda: short_range.occupancy, header)
        self._mask.publish_image(lambda: short_range.mask, header)
        if self._disparity is not None:
            n = self._cached_detector.config.stereo.n_disparities
            self._disparity.publish(
                lambda: messages.disparity_to_message(short_range.disparity, header, camera, n_disparities=n)
            )
        self._u_disparity.publish_image(lambda: short_range.u_disparity, header)
        self._v_disparity.publish_image(lambda: messages.as_uint16(short_range.v_disparity), header)
        self._obstacle_disparity.publish_image(lambda: short_range.obstacle_disparity, header)
