"""What the node tests share: a scene as messages, and a graph of nodes that is spun until something holds."""

import signal
import subprocess
import time
from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import Header

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.nodes import diagnostics
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.messages import array_to_image
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

ROOT = Path(__file__).parents[2]
HEIGHT, WIDTH = 120, 160
CAMERA = StereoCamera(fx=150.0, fy=150.0, cx=80.0, cy=40.0, baseline_m=0.2)
CAMERA_HEIGHT_M = 1.0
N_DISPARITIES = 32
FRAME_ID = "left_optical"


def ground_disparity():
    """Return the disparity of flat ground, (H, W) float32, 0 above the horizon."""
    rows = CAMERA.baseline_m / CAMERA_HEIGHT_M * (np.arange(HEIGHT) - CAMERA.cy)
    return np.repeat(np.maximum(rows, 0)[:, None], WIDTH, axis=1).astype(np.float32)


def stereo_pair(seed=0):
    """Return a left and a right BGR image of textured flat ground."""
    left = np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    shifts = np.rint(ground_disparity()[:, 0]).astype(int)
    right = np.stack([np.roll(row, -shift, axis=0) for row, shift in zip(left, shifts, strict=True)])
    return left, right


def header(stamp):
    """Return a header; `stamp` in nanoseconds."""
    return Header(stamp=Time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=FRAME_ID)


def image(pixels, stamp):
    """Return `pixels` as an image with a stamp in nanoseconds."""
    return array_to_image(pixels, header(stamp))


def camera_info(*, right=False, fx=CAMERA.fx, baseline_m=CAMERA.baseline_m, size=(HEIGHT, WIDTH)):
    """Return the CameraInfo of one side; `size` is height and width."""
    shift = -fx * baseline_m if right else 0.0
    p = [fx, 0.0, CAMERA.cx, shift, 0.0, fx, CAMERA.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return CameraInfo(header=header(0), height=size[0], width=size[1], p=p)


class Graph:
    """Nodes under test beside a node that talks to them, all spun by one executor."""

    def __init__(self, *factories, namespace, settings, window_s=0.3):
        overrides = [Parameter(name, value=setting) for name, setting in settings.items()]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(diagnostics, "PERIOD_S", 0.1)  # the tests wait for diagnostics all the time
            patch.setattr(diagnostics, "WINDOW_S", window_s)  # and for failures to be forgotten
            self.nodes = [factory(namespace=namespace, parameter_overrides=overrides) for factory in factories]
        self.tester = Node("tester", namespace=namespace)
        self.received = defaultdict(list)
        self._publishers = {}
        self._clients = {}
        self._executor = SingleThreadedExecutor()
        for node in (*self.nodes, self.tester):
            self._executor.add_node(node)
        self.listen(DiagnosticArray, "/diagnostics")

    def close(self):
        for node in (*self.nodes, self.tester):
            node.destroy_node()
        self._executor.shutdown()

    def spin_until(self, predicate, timeout_s=300.0):
        """Spin until `predicate` holds; fail where it does not in time."""
        deadline = time.monotonic() + timeout_s
        while not predicate():
            assert time.monotonic() < deadline, f"not within {timeout_s} s; received {self.counts()}"
            self._executor.spin_once(timeout_sec=0.05)

    def spin_for(self, seconds):
        """Spin for so long."""
        end = time.monotonic() + seconds
        while (left_s := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left_s)

    def counts(self):
        return {topic: len(messages) for topic, messages in self.received.items()}

    def listen(self, kind, topic):
        """Subscribe, and wait for the publisher; messages go to `received[topic]`."""
        qos = QoSProfile(depth=50, reliability=QoSReliabilityPolicy.RELIABLE)
        subscription = self.tester.create_subscription(kind, topic, self.received[topic].append, qos)
        if topic != "/diagnostics":
            self.spin_until(lambda: self.tester.count_publishers(topic) > 0)
        return subscription

    def publisher(self, kind, topic, n_subscriptions=1):
        """Return the publisher on a topic, matched with as many subscriptions."""
        if topic not in self._publishers:
            self._publishers[topic] = self.tester.create_publisher(kind, topic, QoSProfile(depth=50))
        publisher = self._publishers[topic]
        self.spin_until(lambda: publisher.get_subscription_count() >= n_subscriptions)
        return publisher

    def publish(self, topic, message, n_subscriptions=1):
        """Publish once that many nodes are there to take it."""
        self.publisher(type(message), topic, n_subscriptions).publish(message)

    def stop_publishing(self, topic):
        """Destroy the publisher on a topic."""
        self.tester.destroy_publisher(self._publishers.pop(topic))

    def call(self, kind, name, request, timeout_s=300.0):
        """Call a service, and return its response."""
        if name not in self._clients:  # a new one may take seconds to find its service
            self._clients[name] = self.tester.create_client(kind, name)
        client = self._clients[name]
        self.spin_until(client.service_is_ready)
        future = client.call_async(request)
        self.spin_until(future.done, timeout_s)
        return future.result()

    def at(self, topic, stamp):
        """Wait for the message of a stamp [ns] on a topic, and return it."""

        def matching():
            return [message for message in self.received[topic] if header_stamp_ns(message) == stamp]

        self.spin_until(matching)
        return matching()[0]

    def status(self, node, predicate=lambda status: True, *, name="frames", since_s=None):
        """Wait for a diagnostic status of `node` from now on for which `predicate` holds, and return it.

        `name` is that of one of its topics, or of its frames. What is soon told of no longer may have been said since a
        time before, one of `time.time`.
        """
        begin = time.time() if since_s is None else since_s
        hardware = f"{self.tester.get_namespace().rstrip('/')}/{node}"

        def matching():
            arrays = [array for array in self.received["/diagnostics"] if _seconds(array) >= begin]
            statuses = [item for array in arrays for item in array.status]
            own = [item for item in statuses if (item.name, item.hardware_id) == (f"{node}: {name}", hardware)]
            return [item for item in own if predicate(item)]

        self.spin_until(matching)
        return matching()[-1]


class NodePair:
    """Makes both nodes as `detector` does, the second with the first.

    `long_range_options` are for that node alone.
    """

    def __init__(self, **long_range_options):
        self._options = long_range_options

    def long_range(self, **options):
        self._long_range = LongRangeNode(**options, **self._options)
        return self._long_range

    def short_range(self, **options):
        return ShortRangeNode(long_range=self._long_range, **options)


def _seconds(message):
    return message.header.stamp.sec + message.header.stamp.nanosec / 1e9


def value(status, key):
    """Return a value of a diagnostic status as a number."""
    return float(next(item.value for item in status.values if item.key == key))


@contextmanager
def process_starter():
    """Yield a function that starts a command; at the end, end what runs still."""
    processes = []

    def start(*command):
        processes.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT))
        return processes[-1]

    try:
        yield start
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
            process.communicate()


def signal_at(file, function, number=signal.SIGINT):
    """Return code after which the process signals itself, once, when it first calls a function.

    The function is run only when ROS has shut down, where it is up.
    """
    return f"""
import os, sys, time
import cv2  # old ones cannot be imported while functions are watched
def signal_once(frame, event, _):
    code = frame.f_code
    if event == "call" and code.co_name == {function!r} and code.co_filename.endswith({file!r}):
        sys.setprofile(None)
        os.kill(os.getpid(), {number:d})
        while sys.modules["rclpy"].ok():
            time.sleep(0.01)
sys.setprofile(signal_once)
"""
