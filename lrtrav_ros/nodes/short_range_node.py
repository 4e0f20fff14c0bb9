"""The short-range node: disparity, and what is ground and obstacle in it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any

from std_msgs.msg import Header

from lrtrav_ros.config import SHORT_RANGE_STAGES
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.message_frames import FrameMessages, frame_of
from lrtrav_ros.nodes import messages
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure, report_refusal
from lrtrav_ros.nodes.inputs import INPUTS, Input, received_by
from lrtrav_ros.nodes.long_range_inputs import LeftImage, NearGeometry, ShortRangeLink
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.managed_node import ManagedNode
from lrtrav_ros.nodes.short_range_outputs import ShortRangeOutputs
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker


class ShortRangeNode(ManagedNode):
    """Publishes disparity, ``short_range/mask``, ``short_range/occupancy`` and more for each frame of its source.

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
        super().__init__("short_range", SHORT_RANGE_STAGES, **options)
        self._long_range = long_range
        self.start()

    def configure(self) -> None:
        """Make the publishers, and compile the kernels."""
        config = self._settings.config
        self._outputs = ShortRangeOutputs(self, config.source)
        compile_kernels(config)

    def activate(self) -> None:
        """Make the subscriptions and the worker."""
        source = self._settings.config.source.source
        self._cached_detector = ShortRangeDetector(self._settings.config)
        self._worker: Worker[FrameMessages] = Worker(self._process, failed=self._report)
        self._input: Input = INPUTS[source](self, self._settings, self._worker.put, partial(report_refusal, self))
        self._link = self._linked(source)
        self._diagnostics = Diagnostics(self, self._worker, lambda: received_by(self._input), problem=self._problem)
        self._worker.start()
        self.get_logger().info(f"ready; source: {source}")

    def deactivate(self) -> None:
        """End the worker after the frame at hand."""
        self._worker.close()

    def forget(self) -> None:
        """Forget calibration, the ground of the frames before, and statistics."""
        self._input.forget()
        self._worker.forget()
        self._diagnostics.forget()
        self._outputs.forget()
        self._cached_detector = ShortRangeDetector(self._settings.config)

    def _linked(self, source: str) -> ShortRangeLink | None:
        """Return where to hand frames to the other node; None where it is to use topics."""
        # The other sources have no left image, or one of another time.
        if self._long_range is None or source != "stereo":
            return None
        rectified = self._outputs.left
        return self._long_range.link(
            left_topic=self._input.frame_topic.topic if rectified is None else rectified.topic_name,
            occupancy_topic=self._outputs.occupancy.topic_name,
        )

    def _report(self, err: Exception) -> None:
        """Log why a frame failed."""
        report_failure(self, err, self._input.topics)

    def _problem(self) -> str:
        """Return why no frames come, or what is wrong with those that do."""
        return self._input.problem() or self._outputs.problem()

    def _process(self, frame_messages: FrameMessages) -> None:
        decoded = frame_messages.decoded()
        frame = frame_of(decoded, max_pixels=self._settings.config.source.max_pixels)
        header = messages.header_of(decoded)
        self._outputs.publish_left(header, frame)
        detector = self._detector()
        with self._handed_over(frame, header) as give:
            short_range = detector.detect(frame)
            give(NearGeometry(short_range.occupancy, short_range.disparity, short_range.line, frame.camera))
        self._outputs.publish(header, frame, short_range, detector.config)

    def _handed_over(self, frame: Frame, header: Header) -> AbstractContextManager[Callable[[NearGeometry], None]]:
        """Hand a frame to the other node, where it is linked."""
        if self._link is None or frame.left is None:
            return nullcontext(lambda geometry: None)
        return self._link.frame(LeftImage(header, frame.left, frame.unseen))

    def _detector(self) -> ShortRangeDetector:
        """Return the detector for the current parameters; a new one where they have changed."""
        config = self._settings.config
        if self._cached_detector.config is not config:
            self._cached_detector = ShortRangeDetector(config)
        return self._cached_detector
