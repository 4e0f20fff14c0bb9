"""Outputs: what nobody subscribes to is not made, unless it is kept for who comes late."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from ros_graph import Graph, header
from sensor_msgs.msg import Image

from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.nodes.endpoints import Output

PIXELS = np.arange(12, dtype=np.uint8).reshape(3, 4)


@pytest.fixture
def graph(ros):
    graph = Graph(namespace="outputs", settings={})
    yield graph
    graph.close()


def test_an_image_is_made_only_where_it_is_wanted(graph):
    made = []

    def pixels():
        made.append(1)
        return PIXELS

    output = Output(graph.tester, "mask")
    output.publish_image(pixels, header(1))
    assert made == []
    graph.listen(Image, "mask")
    graph.spin_until(lambda: output._publisher.get_subscription_count() == 1)
    output.publish_image(pixels, header(2))
    np.testing.assert_array_equal(decode_message(graph.at("mask", 2)), PIXELS)
    assert made == [1]


def test_a_depth_that_does_not_fit_is_named(graph):
    name = "qos_overrides./outputs/deep.publisher.depth"
    node = Node("deep", namespace="outputs", parameter_overrides=[Parameter(name, value=2**62)])
    try:
        with pytest.raises(ValueError, match=r"a parameter qos_overrides\./outputs/deep… does not fit"):
            Output(node, "deep")
    finally:
        node.destroy_node()


def test_an_output_that_is_kept_reaches_who_comes_late(graph):
    name = "qos_overrides./outputs/kept.publisher.durability"
    node = Node("keeper", namespace="outputs", parameter_overrides=[Parameter(name, value="transient_local")])
    try:
        Output(node, "kept").publish_image(lambda: PIXELS, header(5))
        qos = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        graph.tester.create_subscription(Image, "kept", graph.received["kept"].append, qos)
        np.testing.assert_array_equal(decode_message(graph.at("kept", 5)), PIXELS)
    finally:
        node.destroy_node()
