"""The long-range node: extends short-range ground over the superpixels of the left image."""

from __future__ import annotations

import threading
from functools import partial
from typing import Any

from lrtrav_ros.config import LONG_RANGE_STAGES, Config
from lrtrav_ros.detector import LongRangeDetector
from lrtrav_ros.frame import as_8bit
from lrtrav_ros.method.memory import Memory
from lrtrav_ros.nodes.counts import Received
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure, report_refusal
from lrtrav_ros.nodes.long_range_inputs import (
    LongRangeFrame,
    LongRangeInput,
    ShortRangeLink,
    TopicsInput,
    input_topics,
)
from lrtrav_ros.nodes.long_range_outputs import LongRangeOutputs
from lrtrav_ros.nodes.managed_node import ManagedNode
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker
from lrtrav_ros.numerics.thread_team import ALONE


class LongRangeNode(ManagedNode):
    """Publishes ``long_range/mask``, ``long_range/occupancy``, ``long_range/grid`` and more for each frame.

    It remembers the frames before; the service ``~/reset``, a jump in time, and a change of the parameters of features
    or memory make it forget them.

    Raises
    ------
    ValueError
        If a parameter that it is started with does not fit.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("long_range", LONG_RANGE_STAGES, **options)
        self._link: ShortRangeLink | None = None
        self._is_to_forget = threading.Event()
        self.start()

    def configure(self) -> None:
        """Make the publishers, and compile the kernels."""
        config = self._settings.config
        self._outputs = LongRangeOutputs(self, config.maps)
        compile_kernels(config)

    def activate(self) -> None:
        """Make the subscriptions and the worker."""
        self._cached_detector = _new_detector(self._settings.config, None)
        self._worker: Worker[LongRangeFrame] = Worker(self._process, failed=self._report)
        self._topics = self._subscribed() if self._link is None else None
        self._input.forget()  # what a link has counted so far was not for this worker
        self._diagnostics = Diagnostics(self, self._worker, self._received, problem=self._problem)
        self._worker.start()
        self.get_logger().info("ready")

    def deactivate(self) -> None:
        """End the worker after the frame at hand."""
        self._input.give_up()
        self._worker.close()

    def forget(self) -> None:
        """Forget calibration, the frames before, and statistics."""
        # The memory belongs to the worker's thread, which may be at a frame.
        self._is_to_forget.set()
        self._input.forget()
        self._worker.forget()
        self._diagnostics.forget()

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
        topics = input_topics(self, self._settings)
        if (left_topic, occupancy_topic) != (topics.left, topics.occupancy):
            return None
        if self.is_active and self._topics is not None:
            self._topics.close()
        self._topics = None
        if self._link is None:  # the short range may end and begin again, and the counts go on
            self._link = ShortRangeLink(self._deliver)
        return self._link

    @property
    def _input(self) -> LongRangeInput:
        """Where frames come from now."""
        if self._topics is not None:
            return self._topics
        assert self._link is not None  # one of the two is there while the node is active
        return self._link

    def _subscribed(self) -> TopicsInput:
        report = partial(report_refusal, self)
        return TopicsInput(self, self._settings, self._worker.put, report, is_mapped=lambda: self._outputs.are_mapped)

    def _deliver(self, frame: LongRangeFrame) -> None:
        """Take a frame from the link, while the node is active."""
        if self.is_active:
            self._worker.put(frame)

    def _received(self) -> Received:
        return Received(self._input.topics, self._input.frame_topic)

    def _report(self, err: Exception) -> None:
        """Log why a frame failed."""
        report_failure(self, err, self._input.topics)

    def _problem(self) -> str:
        """Return why no frames come, or what is wrong with those that do."""
        return self._input.problem() or self._outputs.problem()

    def _process(self, frame: LongRangeFrame) -> None:
        left = frame.left()
        image = as_8bit(left.pixels)
        detector = self._detector()
        appearance = detector.look(image)
        occupancy = frame.occupancy()
        long_range = detector.extend(appearance, occupancy, stamp_ns=left.stamp_ns).without(left.unseen)
        self._outputs.publish(left.header, image, occupancy, long_range)
        if self._outputs.are_mapped and (geometry := frame.geometry()) is not None:
            self._outputs.publish_maps(left.header, long_range, geometry, detector.config.maps)

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


def _new_detector(config: Config, memory: Memory | None) -> LongRangeDetector:
    """Return a detector on one thread: the processors that are left have the short range of the next frame to do."""
    return LongRangeDetector(config, memory=memory, team=ALONE)
