"""Measures the running `detector`: frames go in over DDS at a given rate, and the masks that come back are timed."""

from __future__ import annotations

import os
import re
import signal
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.task import Future
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Value
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.topics import DEPTH_IMAGE, DISPARITY, LEFT_IMAGE, LEFT_INFO, RIGHT_IMAGE, RIGHT_INFO
from lrtrav_ros.nodes.messages import array_to_image, disparity_to_message
from lrtrav_ros.nodes.shared_memory import IMAGES_PROFILE, use_segment

_START_S = 300.0  # kernels are compiled at the first start, which takes minutes on a small computer
_MATCHED_S = 15.0
_SETTLE_S = 2.0  # frames before the measurement: caches are filled, and the node's rate has settled
_LATE_S = 1.0  # after the last frame, for the masks that are still to come
_END_S = 10.0
_DOMAINS = range(51, 102)  # the last ids that are safe on every system; tests take those before
_PAGES_PER_MB = 2**20 / os.sysconf("SC_PAGE_SIZE")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True, kw_only=True)
class NodesFigures:
    """How the running `detector` kept up with frames at one rate.

    Attributes
    ----------
    source : str
        Source of disparity: ``stereo``, ``disparity`` or ``depth``.
    rate_in_hz, rate_out_hz : float
        Frames published and masks received per second.
    latency_median_ms, latency_p99_ms : float
        From the publication of a frame's last image until its mask is received; NaN where no mask came.
    frame_ms : float
        Median of the milliseconds that the node that publishes the masks took for a frame, by its diagnostics.
    dropped_share : float
        Share of the frames that no mask came for, 0 to 1.
    cpu_share : float
        Processors that the detector used; 2 are two whole ones.
    start_s : float
        From the start of the process until its nodes were ready.
    first_rss_mb, last_rss_mb, peak_rss_mb : float
        Memory of the detector, shared segments included: when the measurement began, when it ended, and the most that
        it ever was.
    """

    source: str
    rate_in_hz: float
    rate_out_hz: float
    latency_median_ms: float
    latency_p99_ms: float
    frame_ms: float
    dropped_share: float
    cpu_share: float
    start_s: float
    first_rss_mb: float
    last_rss_mb: float
    peak_rss_mb: float


def measure_nodes(
    frames: Sequence[Frame],
    settings: Mapping[str, Value],
    *,
    rate_hz: float,
    seconds: float,
    node: str = "long_range",
) -> NodesFigures:
    """Start the `detector`, publish frames, and time the masks; two seconds of frames go before the measurement.

    It runs in a ROS domain of its own, visible on this machine alone, and ends the process that it started.

    Parameters
    ----------
    frames : sequence of Frame
        Published one after the other, again and again; all from one source.
    settings : mapping of str to value
        Parameters of the nodes, such as ``{"stereo.n_disparities": 64}``.
    rate_hz : float
        Frames per second, above 0.
    seconds : float
        How long to measure, above 0.
    node : str
        Whose masks are timed: ``long_range`` or ``short_range``.

    Returns
    -------
    NodesFigures
        Rates, latency, drops, processor and memory.

    Raises
    ------
    ValueError
        If there are no frames, they have several sources or no left image, or a number is not above 0.
    RuntimeError
        If the detector ends or does not start; the message is its own.
    """
    if not rate_hz > 0 or not seconds > 0:
        raise ValueError(f"rate is {rate_hz:g} Hz for {seconds:g} s; give numbers above 0")
    messages = [_FrameBytes.of(frame) for frame in frames]
    sources = {frame.source for frame in frames}
    if len(sources) != 1:
        raise ValueError(f"frames have the sources {sorted(sources)}; give frames of one source")
    source = sources.pop()
    domain_id = _DOMAINS[os.getpid() % len(_DOMAINS)]
    use_segment(IMAGES_PROFILE)
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    with _Detector(domain_id, {**settings, "source": source}) as detector, _Camera(domain_id, source, node) as camera:
        detector.wait_until_ready()
        camera.wait_for_detector(detector)
        camera.publish(messages, rate_hz=rate_hz, seconds=min(_SETTLE_S, seconds))
        before = detector.usage()
        published_s = camera.publish(messages, rate_hz=rate_hz, seconds=seconds)
        after = detector.usage()
        camera.wait_for(published_s, timeout_s=_LATE_S)
        return _figures(source, published_s, camera, before, after, detector)


@dataclass(frozen=True, slots=True)
class _Usage:
    """What a process used up to a moment."""

    at_s: float
    cpu_s: float
    rss_mb: float


@dataclass(frozen=True, slots=True)
class _FrameBytes:
    """The serialised messages of a frame, by topic, in the order in which they are published."""

    by_topic: dict[str, bytes]

    @classmethod
    def of(cls, frame: Frame) -> _FrameBytes:
        header, camera, left = Header(frame_id="camera"), frame.camera, frame.image
        messages: dict[str, Any] = {LEFT_INFO: _camera_info(camera, left.shape, baseline_m=0.0)}
        messages[RIGHT_INFO] = _camera_info(camera, left.shape, baseline_m=camera.baseline_m)
        messages[LEFT_IMAGE] = array_to_image(left, header)
        if frame.right is not None:
            messages[RIGHT_IMAGE] = array_to_image(frame.right, header)
        elif frame.disparity is not None:
            n = int(frame.disparity.max()) + 2
            messages[DISPARITY] = disparity_to_message(frame.disparity, header, camera, n_disparities=n)
        elif frame.depth_m is not None:
            messages[DEPTH_IMAGE] = array_to_image(frame.depth_m, header)
        return cls({topic: serialize_message(message) for topic, message in messages.items()})


def _camera_info(camera: StereoCamera, shape: Sequence[int], *, baseline_m: float) -> CameraInfo:
    p = [camera.fx, 0.0, camera.cx, -camera.fx * baseline_m, 0.0, camera.fy or camera.fx, camera.cy, 0.0]
    return CameraInfo(height=shape[0], width=shape[1], p=[*map(float, p), 0.0, 0.0, 1.0, 0.0])


class _Detector:
    """The `detector` as a process of its own, which is ended after the block."""

    def __init__(self, domain_id: int, settings: Mapping[str, Value]) -> None:
        self.start_s = float("nan")
        self._started_s = time.monotonic()
        self._lines: deque[str] = deque(maxlen=20)
        self._ready = threading.Semaphore(0)
        parameters = [part for name, value in settings.items() for part in ("-p", f"{name}:={_as_yaml(value)}")]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "lrtrav_ros", "detector", "--ros-args", *parameters],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain_id)},
            stderr=subprocess.PIPE,
            text=True,
        )
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def __enter__(self) -> _Detector:
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reading.join()

    def wait_until_ready(self) -> None:
        """Wait for both nodes; raises RuntimeError where they do not start."""
        for _ in ("short range", "long range"):
            if not self._ready.acquire(timeout=_START_S) or not self.is_running():
                raise RuntimeError(self.failure())
        self.start_s = time.monotonic() - self._started_s

    def is_running(self) -> bool:
        return self._process.poll() is None

    def failure(self) -> str:
        """Return what it said last."""
        return f"the detector is not ready; its last words: {' '.join(self._lines) or 'none'}"

    def usage(self) -> _Usage:
        """Return what it used up to now, from Linux' ``/proc``."""
        process = Path("/proc", str(self._process.pid))
        # The second field is the program's name in parentheses, which may hold anything.
        fields = (process / "stat").read_text().rpartition(")")[2].split()
        pages = int((process / "statm").read_text().split()[1])
        return _Usage(
            at_s=time.monotonic(),
            cpu_s=(int(fields[11]) + int(fields[12])) / _TICKS_PER_S,
            rss_mb=pages / _PAGES_PER_MB,
        )

    @property
    def peak_rss_mb(self) -> float:
        """The most memory that it ever had."""
        status = Path("/proc", str(self._process.pid), "status").read_text()
        found = re.search(r"VmHWM:\s+(\d+) kB", status)
        return int(found[1]) / 1024 if found else float("nan")

    def _read(self) -> None:
        """Read its log to the end, so that it never waits for somebody to do so."""
        assert self._process.stderr is not None
        with self._process.stderr as log:
            for line in log:
                self._lines.append(line.strip())
                if "]: ready" in line:
                    self._ready.release()
        self._process.wait()
        self._ready.release()  # nothing more is to come


def _as_yaml(value: Value) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


class _Camera:
    """Publishes the messages of a camera, and notes when masks come."""

    def __init__(self, domain_id: int, source: str, node: str) -> None:
        self.received_s: dict[int, float] = {}
        self.frame_ms = float("nan")
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain_id)
        self._node = Node("camera", context=self._context)
        partner: dict[str, tuple[str, type[Any]]] = {
            "stereo": (RIGHT_IMAGE, Image),
            "disparity": (DISPARITY, DisparityImage),
            "depth": (DEPTH_IMAGE, Image),
        }
        kinds = dict([(LEFT_INFO, CameraInfo), (RIGHT_INFO, CameraInfo), (LEFT_IMAGE, Image), partner[source]])
        qos = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
        self._publishers: dict[str, Publisher] = {
            topic: self._node.create_publisher(kind, topic, qos) for topic, kind in kinds.items()
        }
        self._masks = self._node.create_subscription(Image, f"{node}/mask", self._take, QoSProfile(depth=5), raw=True)
        self._status = f"{node}: frames"
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._take_diagnostics, QoSProfile(depth=5))
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._ended = Future()
        spin = self._executor.spin_until_future_complete
        self._thread = threading.Thread(target=spin, args=(self._ended,), name="camera", daemon=True)

    def __enter__(self) -> _Camera:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._ended.set_result(None)
        self._thread.join()  # rclpy raises whatever it is about to do where ROS is shut down while it spins
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def wait_for_detector(self, detector: _Detector) -> None:
        """Wait until both sides know each other."""
        images = [publisher for topic, publisher in self._publishers.items() if not topic.endswith("_info")]
        deadline = time.monotonic() + _MATCHED_S
        while not self._masks.get_publisher_count() or not all(image.get_subscription_count() for image in images):
            if not detector.is_running() or time.monotonic() > deadline:
                raise RuntimeError(detector.failure())
            time.sleep(0.01)

    def publish(self, frames: Sequence[_FrameBytes], *, rate_hz: float, seconds: float) -> dict[int, float]:
        """Publish frames for some seconds; return when each one's last image was published, by its stamp."""
        published_s: dict[int, float] = {}
        begin = time.monotonic()
        for index in range(max(round(rate_hz * seconds), 1)):
            time.sleep(max(begin + index / rate_hz - time.monotonic(), 0))
            stamp_ns = time.time_ns()
            for topic, data in frames[index % len(frames)].by_topic.items():
                message = _with_stamp(data, stamp_ns)
                published_s[stamp_ns] = time.monotonic()
                self._publishers[topic].publish(message)
        time.sleep(max(begin + seconds - time.monotonic(), 0))
        return published_s

    def wait_for(self, stamps_ns: Mapping[int, float], *, timeout_s: float) -> None:
        """Wait for the masks of frames, or until time is up."""
        deadline = time.monotonic() + timeout_s
        while not stamps_ns.keys() <= self.received_s.keys() and time.monotonic() < deadline:
            time.sleep(0.01)

    def _take(self, message: bytes) -> None:
        sec, nanosec = struct.unpack_from("<iI", message, 4)
        self.received_s[sec * 10**9 + nanosec] = time.monotonic()

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._status:
                self.frame_ms = float(next(each.value for each in status.values if each.key == "median frame [ms]"))


def _with_stamp(data: bytes, stamp_ns: int) -> bytes:
    """Return a serialised message with another stamp, which is the first that a message with a header holds."""
    return b"".join((data[:4], struct.pack("<iI", *divmod(stamp_ns, 10**9)), memoryview(data)[12:]))


def _figures(
    source: str,
    published_s: Mapping[int, float],
    camera: _Camera,
    before: _Usage,
    after: _Usage,
    detector: _Detector,
) -> NodesFigures:
    received_s = camera.received_s
    latencies_ms = [1e3 * (received_s[stamp] - at_s) for stamp, at_s in published_s.items() if stamp in received_s]
    seconds = after.at_s - before.at_s
    in_time = sum(before.at_s <= at_s < after.at_s for at_s in received_s.values())
    median_ms, p99_ms = np.percentile(latencies_ms, (50, 99)) if latencies_ms else (np.nan, np.nan)
    return NodesFigures(
        source=source,
        rate_in_hz=len(published_s) / seconds,
        rate_out_hz=in_time / seconds,
        latency_median_ms=float(median_ms),
        latency_p99_ms=float(p99_ms),
        frame_ms=camera.frame_ms,
        dropped_share=1 - len(latencies_ms) / len(published_s),
        cpu_share=(after.cpu_s - before.cpu_s) / seconds,
        start_s=detector.start_s,
        first_rss_mb=before.rss_mb,
        last_rss_mb=after.rss_mb,
        peak_rss_mb=detector.peak_rss_mb,
    )
