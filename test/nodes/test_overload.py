"""More frames than fit, with bad ones among them: the newest wins, and the counts add up at every moment."""

import itertools
import signal
import statistics
import sys
import threading
import time
from functools import partial

import numpy as np
import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from ros_graph import (
    N_DISPARITIES,
    Graph,
    NodePair,
    camera_info,
    header,
    image,
    process_starter,
    stereo_pair,
    value,
)
from sensor_msgs.msg import Image
from std_srvs.srv import Empty

from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.nodes.endpoints import Output
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

SETTINGS = {"stereo.matcher": "bm", "stereo.n_disparities": N_DISPARITIES, "superpixels.n_superpixels": 40}
STAMPS = itertools.count(1_700_000_000_000_000_000, 10_000_000)
FRAME_COUNTS = ("processed", "dropped", "failed", "unpaired", "waiting")
TOPIC_COUNTS = ("processed", "dropped", "refused", "failed", "unpaired", "waiting")


def linked():
    pair = NodePair()
    return pair.long_range, pair.short_range


@pytest.fixture(scope="module", params=["linked", "topics"])
def graph(ros, request):
    factories = linked() if request.param == "linked" else (LongRangeNode, ShortRangeNode)
    graph = Graph(*factories, namespace=f"overload_{request.param}", settings=SETTINGS, window_s=600.0)
    for topic in ("short_range/mask", "long_range/mask"):
        graph.listen(Image, topic)
    for side in ("left", "right"):
        graph.publish(f"{side}/camera_info", camera_info(right=side == "right"))
    graph.n_left = 1 if request.param == "linked" else 2
    yield graph
    graph.close()


def assert_sums(graph):
    """Check all statuses that came; return how many have counts."""
    statuses = [status for array in graph.received["/diagnostics"] for status in array.status]
    for status in statuses:
        is_frames = status.name.endswith(": frames")
        prefix, names = ("frames ", FRAME_COUNTS) if is_frames else ("", TOPIC_COUNTS)
        counts = {name: value(status, f"{prefix}{name}") for name in (*names, "received")}
        assert counts.pop("received") == sum(counts.values()), status
        assert min(counts.values()) >= 0, status
    return len(statuses)


def publish(graph, pair, stamp):
    graph.publish("right/image_rect", image(pair[1], stamp))
    graph.publish("left/image_rect", image(pair[0], stamp), n_subscriptions=graph.n_left)


def test_counts_add_up_and_the_last_frame_is_answered(graph, monkeypatch):
    detect, turns = ShortRangeDetector.detect, threading.Semaphore(0)

    def slow(self, frame):
        assert turns.acquire(timeout=300.0)
        return detect(self, frame)

    monkeypatch.setattr(ShortRangeDetector, "detect", slow)
    pair, bad = stereo_pair(), image(stereo_pair()[0], 0)
    del bad.data[-1:]
    graph.received["/diagnostics"].clear()
    for i in range(120):
        stamp = next(STAMPS)
        if i % 4 == 0:  # in the time of four frames, there is time for one
            turns.release()
        if i == 62:  # with a frame at hand and others waiting
            graph.call(Empty, "short_range/reset", Empty.Request())
            for side in ("left", "right"):
                graph.publish(f"{side}/camera_info", camera_info(right=side == "right"))
        graph.publish("right/image_rect", image(pair[1], stamp))
        if i % 10 == 3:
            graph.publisher(Image, "left/image_rect").publish(b"\x00\x01\x00\x00")
        elif i % 10 == 9:
            bad.header = header(stamp)
            graph.publish("left/image_rect", bad, n_subscriptions=graph.n_left)
        elif i % 10 != 6:  # of which the right image finds no partner
            graph.publish("left/image_rect", image(pair[0], stamp), n_subscriptions=graph.n_left)
        graph.spin_for(0.005)
    turns.release(120)
    graph.publisher(Image, "left/image_rect").publish(b"\x00\x01\x00\x00")  # the others may have been lost on the way
    graph.status("short_range", lambda status: value(status, "refused") > 0, name="left/image_rect")
    publish(graph, pair, (last := next(STAMPS)))
    graph.at("short_range/mask", last)
    graph.at("long_range/mask", last)
    status = graph.status("short_range", lambda status: value(status, "frames waiting") == 0)
    assert status.level == DiagnosticStatus.WARN
    assert value(status, "frames dropped") > 0
    assert value(status, "frames processed") > 0
    assert value(graph.status("short_range", name="right/image_rect"), "unpaired") > 0
    assert assert_sums(graph) > 50
    stamps = [header_stamp_ns(message) for message in graph.received["short_range/mask"]]
    assert stamps == sorted(stamps)


STUCK = """
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image
rclpy.init()
node = Node("stuck", namespace="stuck")
node.create_subscription(Image, "mask", lambda message: None, 10)
rclpy.spin(node)
"""


def test_a_subscriber_that_is_stuck_blocks_nothing(ros):
    graph = Graph(partial(Node, "camera"), namespace="stuck", settings={})
    try:
        with process_starter() as start:
            process = start(sys.executable, "-c", STUCK)
            output = Output(graph.nodes[0], "mask")
            graph.listen(Image, "mask")
            graph.spin_until(lambda: graph.nodes[0].count_subscribers("mask") == 2)
            graph.spin_until(lambda: output._publisher.get_subscription_count() == 2)
            process.send_signal(signal.SIGSTOP)
            durations_s = []
            for stamp in range(40):  # 37 MB, more than it could take
                begin = time.monotonic()
                output.publish_image(lambda: np.zeros((480, 640, 3), np.uint8), header(stamp))
                durations_s.append(time.monotonic() - begin)
                graph.spin_for(0.005)
            graph.at("mask", 39)
            assert statistics.median(durations_s) < 0.1  # for which Fast DDS would wait for room
    finally:
        graph.close()
