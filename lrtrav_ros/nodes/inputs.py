"""The three sources of the short-range node: a stereo pair, a disparity image or a depth image."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.detector import Detector
from lrtrav_ros.io import camera_info as calibration
from lrtrav_ros.io import encodings as images
from lrtrav_ros.io import topics
from lrtrav_ros.io.pairing import Pairing, Side
from lrtrav_ros.nodes import endpoints, messages
from lrtrav_ros.nodes.parameters import Settings

PATIENCE_S = 5.0
"""Seconds without a frame after which a node says why there is none."""

_WAITING_IMAGES = 10

Measurement = tuple[Any, ...]
"""The messages of one frame; the first one's header is that of the frame."""

Deliver = Callable[[Measurement], None]


class Input(Protocol):
    """A source of disparity: subscribes, and hands each frame's messages to `deliver`."""

    infos: CameraInfos

    @property
    def main(self) -> Side[Any]:
        """The topic that brings a frame's first message."""

    def problem(self) -> str:
        """Return why there are no frames; empty where there are."""

    def camera(self, measurement: Measurement) -> StereoCamera:
        """Return the calibration of a frame; raises ValueError where there is none in its messages."""

    def disparity(self, measurement: Measurement, detector: Detector) -> NDArray[np.float32]:
        """Return the disparity (H, W) of a frame in pixels, 0 where there is none; raises ValueError."""


class CameraInfos:
    """Keeps the latest CameraInfo of the topics `needed` and `optional`; `arrived` is called when one comes."""

    def __init__(
        self, node: Node, needed: tuple[str, ...], arrived: Callable[[], None], *, optional: tuple[str, ...] = ()
    ) -> None:
        self._topics = {name: node.resolve_topic_name(name) for name in needed}
        self._latest: dict[str, CameraInfo] = {}
        self._arrived = arrived
        for name in (*needed, *optional):
            endpoints.subscribe(node, CameraInfo, name, self._keeper(name), depth=1)

    def _keeper(self, name: str) -> Callable[[CameraInfo], None]:
        def keep(info: CameraInfo) -> None:
            self._latest[name] = info
            self._arrived()

        return keep

    def __getitem__(self, name: str) -> CameraInfo:
        return self._latest[name]

    def get(self, name: str) -> CameraInfo | None:
        """Return the latest of a topic, or None where none came."""
        return self._latest.get(name)

    @property
    def missing(self) -> list[str]:
        """The topics that are needed and on which none came."""
        return [topic for name, topic in self._topics.items() if name not in self._latest]


class StereoInput:
    """A rectified pair of images, paired by stamp."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, arrived: Callable[[], None]) -> None:
        self._settings = settings
        self._deliver = deliver
        self.infos = CameraInfos(node, (topics.LEFT_INFO, topics.RIGHT_INFO), arrived)
        compressed = settings.config.source.compressed
        left = endpoints.subscribe_image(node, topics.LEFT_IMAGE, self._take_left, compressed=compressed)
        right = endpoints.subscribe_image(node, topics.RIGHT_IMAGE, self._take_right, compressed=compressed)
        self._pairing: Pairing[Any, Any] = Pairing(
            (left.topic_name, _WAITING_IMAGES), (right.topic_name, _WAITING_IMAGES)
        )

    @property
    def main(self) -> Side[Any]:
        """The left images."""
        return self._pairing.first

    def problem(self) -> str:
        """Return why nothing pairs."""
        if self._pairing.idle_s < PATIENCE_S:
            return ""
        return self._pairing.reason(tolerance_ns=self._settings.stamp_tolerance_ns)

    def camera(self, measurement: Measurement) -> StereoCamera:
        """Return the calibration in the two CameraInfo."""
        return calibration.stereo_camera(self.infos[topics.LEFT_INFO], self.infos[topics.RIGHT_INFO])

    def disparity(self, measurement: Measurement, detector: Detector) -> NDArray[np.float32]:
        """Match the two images."""
        left, right = (images.decode_message(message) for message in measurement)
        return detector.match(images.as_8bit(left), images.as_8bit(right, like=left))

    def _take_left(self, message: Any) -> None:
        tolerance_ns = self._settings.stamp_tolerance_ns
        self._hand_over(self._pairing.add_first(messages.stamp_ns(message), message, tolerance_ns=tolerance_ns))

    def _take_right(self, message: Any) -> None:
        tolerance_ns = self._settings.stamp_tolerance_ns
        self._hand_over(self._pairing.add_second(messages.stamp_ns(message), message, tolerance_ns=tolerance_ns))

    def _hand_over(self, pair: Measurement | None) -> None:
        if pair is not None:
            self._deliver(pair)


class _SingleInput:
    """One message a frame, and the CameraInfo of the left camera."""

    def __init__(self, deliver: Deliver, infos: CameraInfos) -> None:
        self._deliver = deliver
        self._last_s = time.monotonic()
        self.infos = infos
        self.main: Side[None] = Side("", capacity=1)

    def problem(self) -> str:
        """Return that nothing comes."""
        idle_s = time.monotonic() - self._last_s
        return f"no message for {idle_s:.0f} s; {self.main}" if idle_s >= PATIENCE_S else ""

    def _take(self, message: Any) -> None:
        self._last_s = time.monotonic()
        self.main.received += 1
        self.main.last_stamp_ns = messages.stamp_ns(message)
        self._deliver((message,))


class DisparityInput(_SingleInput):
    """A disparity image from elsewhere, such as ``stereo_image_proc`` or an FPGA."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, arrived: Callable[[], None]) -> None:
        super().__init__(deliver, CameraInfos(node, (topics.LEFT_INFO,), arrived))
        self.main.topic = endpoints.subscribe(node, DisparityImage, topics.DISPARITY, self._take).topic_name

    def camera(self, measurement: Measurement) -> StereoCamera:
        """Return the calibration in the disparity image; the principal point is that of CameraInfo."""
        return calibration.disparity_camera(measurement[0], self.infos[topics.LEFT_INFO])

    def disparity(self, measurement: Measurement, detector: Detector) -> NDArray[np.float32]:
        """Return what the message holds."""
        return messages.message_to_disparity(measurement[0])


class DepthInput(_SingleInput):
    """A depth image that is registered to the left image."""

    def __init__(self, node: Node, settings: Settings, deliver: Deliver, arrived: Callable[[], None]) -> None:
        super().__init__(deliver, CameraInfos(node, (topics.LEFT_INFO,), arrived, optional=(topics.RIGHT_INFO,)))
        self.main.topic = endpoints.subscribe_image(
            node,
            topics.DEPTH_IMAGE,
            self._take,
            compressed=settings.config.source.compressed,
            transport="compressedDepth",
        ).topic_name

    def camera(self, measurement: Measurement) -> StereoCamera:
        """Return the calibration in CameraInfo; the baseline is virtual unless the right camera's is there too."""
        return calibration.depth_camera(self.infos[topics.LEFT_INFO], self.infos.get(topics.RIGHT_INFO))

    def disparity(self, measurement: Measurement, detector: Detector) -> NDArray[np.float32]:
        """Express depth as disparity."""
        return detector.disparity_of_depth(messages.message_to_depth(measurement[0]))


INPUTS: dict[str, Callable[[Node, Settings, Deliver, Callable[[], None]], Input]] = {
    "stereo": StereoInput,
    "disparity": DisparityInput,
    "depth": DepthInput,
}
