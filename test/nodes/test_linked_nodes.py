"""Both nodes as `detector` makes them: frames go from one to the other without topics, where these are the same."""

import itertools
import re
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_graph import CAMERA, FRAME_ID, N_DISPARITIES, WIDTH, Graph, NodePair, camera_info, image, stereo_pair, value
from sensor_msgs.msg import Image

from lrtrav_ros import Config, Detector
from lrtrav_ros.config import NODE_DEFAULTS
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.encodings import decode_message

SETTINGS = {"stereo.matcher": "bm", "stereo.n_disparities": N_DISPARITIES, "superpixels.n_superpixels": 40}
STAMPS = itertools.count(1_700_000_000_123_456_789, 100_000_000)
OUTPUTS = ("short_range/mask", "short_range/occupancy", "long_range/mask", "long_range/occupancy")


def make_graph(namespace, settings, **long_range_options):
    pair = NodePair(**long_range_options)
    return Graph(pair.long_range, pair.short_range, namespace=namespace, settings=settings)


@pytest.fixture(scope="module")
def graph(ros):
    graph = make_graph("linked", SETTINGS)
    for topic in OUTPUTS:
        graph.listen(Image, topic)
    yield graph
    graph.close()


def publish(graph, pair, stamp, *, n_left):
    graph.publish("left/camera_info", camera_info())
    graph.publish("right/camera_info", camera_info(right=True))
    graph.publish("right/image_rect", image(pair[1], stamp))
    graph.publish("left/image_rect", image(pair[0], stamp), n_subscriptions=n_left)


def subscribed(node):
    return {subscription.topic_name for subscription in node.subscriptions}


def test_a_sequence_gives_what_the_detector_gives(graph):
    long_range, _ = graph.nodes
    assert not {name for name in subscribed(long_range) if "image" in name or "occupancy" in name}
    detector = Detector(Config().updated({**SETTINGS, **NODE_DEFAULTS}), CAMERA)  # with memory
    for seed in range(4):
        pair, stamp = stereo_pair(seed), next(STAMPS)
        publish(graph, pair, stamp, n_left=1)
        found = detector.detect_frame(Frame(camera=CAMERA, left=pair[0], right=pair[1], stamp_ns=stamp))
        messages = {topic: graph.at(topic, stamp) for topic in OUTPUTS}
        assert {message.header.frame_id for message in messages.values()} == {FRAME_ID}
        expected = (found.short_range.mask, found.short_range.occupancy, found.long_range.mask)
        for topic, array in zip(OUTPUTS, expected, strict=False):
            np.testing.assert_array_equal(decode_message(messages[topic]), array)
        np.testing.assert_array_equal(decode_message(messages[OUTPUTS[3]]), found.long_range.occupancy)
    status = graph.status("long_range", lambda status: value(status, "frames processed") >= 4)
    assert value(status, "frames received") == value(status, "frames processed")
    assert value(status, "frames unpaired") == 0
    assert status.message == "running"


def test_where_the_short_range_fails_the_long_range_gives_up_quietly(graph, monkeypatch):
    before, begin_s = graph.status("long_range"), time.time()
    with monkeypatch.context() as patch:
        patch.setattr(ShortRangeDetector, "detect", lambda self, frame: 1 // 0)
        publish(graph, stereo_pair(), next(STAMPS), n_left=1)
        dropped = value(before, "frames dropped") + 1
        after = graph.status("long_range", lambda status: value(status, "frames dropped") == dropped)
    assert value(after, "frames failed") == value(before, "frames failed")
    assert "failed" not in after.message
    graph.status("short_range", lambda status: "division" in status.message, since_s=begin_s)
    stamp = next(STAMPS)
    publish(graph, stereo_pair(), stamp, n_left=1)
    assert graph.at("long_range/mask", stamp).width == WIDTH


def test_a_damaged_image_is_skipped_and_counted_once(graph):
    before = {node: value(graph.status(node), "frames failed") for node in ("short_range", "long_range")}
    graph.publisher(Image, "left/image_rect").publish(b"\x00\x01\x00\x00")
    status = graph.status("short_range", lambda status: value(status, "frames failed") == before["short_range"] + 1)
    assert "messages on /linked/left/image_rect refused in the last 0.3 s; last, " in status.message
    assert "damaged message: 4 bytes are no sensor_msgs/msg/Image" in status.message
    stamp = next(STAMPS)
    publish(graph, stereo_pair(), stamp, n_left=1)
    assert graph.at("long_range/mask", stamp).width == WIDTH
    assert value(graph.status("long_range"), "frames failed") == before["long_range"]


def test_silence_is_explained(graph, monkeypatch):
    monkeypatch.setattr("lrtrav_ros.nodes.long_range_inputs.PATIENCE_S", 0.0)
    status = graph.status("long_range", lambda status: status.message != "running")
    assert re.fullmatch(r"no frame from the short-range node for \d+ s", status.message)


def test_a_topic_with_another_name_is_listened_to(ros):
    remapping = ["--ros-args", "-r", "short_range/occupancy:=merged/occupancy"]
    graph = make_graph("remapped", SETTINGS, cli_args=remapping)
    try:
        graph.listen(Image, "short_range/occupancy")
        graph.listen(Image, "long_range/mask")
        assert {"/remapped/left/image_rect", "/remapped/merged/occupancy"} <= subscribed(graph.nodes[0])
        pair, stamp = stereo_pair(), next(STAMPS)
        publish(graph, pair, stamp, n_left=2)
        occupancy = graph.at("short_range/occupancy", stamp)
        graph.publish("merged/occupancy", occupancy)
        expected = Detector(Config().updated(SETTINGS), CAMERA).detect(*pair).long_range.mask
        np.testing.assert_array_equal(decode_message(graph.at("long_range/mask", stamp)), expected)
    finally:
        graph.close()


@pytest.mark.parametrize("source", ["disparity", "depth"])
def test_other_sources_use_topics(ros, source):
    graph = make_graph(source, {**SETTINGS, "source": source})
    try:
        names = {f"/{source}/left/image_rect", f"/{source}/short_range/occupancy"}
        assert names <= subscribed(graph.nodes[0])
    finally:
        graph.close()
