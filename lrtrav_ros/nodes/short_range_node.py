"""The short-range node: disparity, and what is ground and obstacle in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.io import topics
from lrtrav_ros.method.ground import ShortRange
from lrtrav_ros.nodes import endpoints, messages
from lrtrav_ros.nodes.diagnostics import Diagnostics, report_failure
from lrtrav_ros.nodes.inputs import INPUTS, Input, Measurement
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.warm_up import compile_kernels
from lrtrav_ros.nodes.worker import Worker

_STAGES = ("threads", "source", "stereo", "elas", "ground")


class ShortRangeNode(Node):
    """Publishes disparity, ``short_range/mask`` and ``short_range/occupancy`` for each frame of its source.

    Raises
    ------
    ValueError
        If a parameter that it is started with does not fit.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("short_range", **options)
        self._settings = Settings(self, _STAGES)
        self._made: tuple[Config, StereoCamera, Detector] | None = None
        self._held: Measurement | None = None
        source = self._settings.config.source.source
        self._advertise(with_disparity=source != "disparity")
        compile_kernels(self._settings.config)
        self._worker: Worker[Measurement] = Worker(self._process, failed=lambda err: report_failure(self, err))
        self._input: Input = INPUTS[source](self, self._settings, self._deliver, self._hand_over)
        self._diagnostics = Diagnostics(self, self._worker, self._problem, lambda: self._input.main)
        self.get_logger().info(f"ready; source: {source}")

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        if hasattr(self, "_worker"):
            self._worker.close()
        super().destroy_node()

    def _advertise(self, *, with_disparity: bool) -> None:
        self._disparity = endpoints.publish_on(self, DisparityImage, topics.DISPARITY) if with_disparity else None
        self._mask = endpoints.publish_on(self, Image, "short_range/mask")
        self._occupancy = endpoints.publish_on(self, Image, "short_range/occupancy")
        self._u_disparity = endpoints.publish_on(self, Image, "short_range/u_disparity")
        self._v_disparity = endpoints.publish_on(self, Image, "short_range/v_disparity")
        self._obstacle_disparity = endpoints.publish_on(self, Image, "short_range/obstacle_disparity")

    def _deliver(self, measurement: Measurement) -> None:
        """Take a frame from the input; the newest waits until the calibration is there."""
        self._worker.dropped += self._held is not None
        self._held = measurement
        self._hand_over()

    def _hand_over(self) -> None:
        if self._held is not None and not self._input.infos.missing:
            self._worker.put(self._held)
            self._held = None

    def _problem(self) -> str:
        missing = self._input.infos.missing
        if self._held is not None and missing:
            return f"no CameraInfo yet on {' and '.join(missing)}; frames wait for it"
        return self._input.problem()

    def _process(self, measurement: Measurement) -> None:
        detector = self._detector(self._input.camera(measurement))
        disparity = self._input.disparity(measurement, detector)
        from_depth = self._settings.config.source.source == "depth"
        short_range = detector.short_range(disparity, from_depth=from_depth)
        self._publish(measurement[0].header, disparity, short_range, detector)

    def _detector(self, camera: StereoCamera) -> Detector:
        """Return the detector for the current parameters; a new one where they or the camera changed."""
        config = self._settings.config
        if self._made is None or self._made[:2] != (config, camera):
            self._made = (config, camera, Detector(config, camera))
        return self._made[2]

    def _publish(
        self, header: Header, disparity: NDArray[np.float32], short_range: ShortRange, detector: Detector
    ) -> None:
        # Occupancy goes first: the long-range node waits for it.
        self._occupancy.publish(messages.array_to_image(short_range.occupancy, header))
        self._mask.publish(messages.array_to_image(short_range.mask, header))
        if self._disparity is not None:
            n = detector.config.stereo.n_disparities
            message = messages.disparity_to_message(disparity, header, detector.camera, n_disparities=n)
            self._disparity.publish(message)
        endpoints.publish_if_wanted(self._u_disparity, header, lambda: short_range.u_disparity)
        endpoints.publish_if_wanted(self._v_disparity, header, lambda: messages.as_uint16(short_range.v_disparity))
        endpoints.publish_if_wanted(self._obstacle_disparity, header, lambda: short_range.obstacle_disparity)
