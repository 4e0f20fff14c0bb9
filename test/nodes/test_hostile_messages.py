"""A short siege of the nodes; `hostile_messages` besieges every source, and for longer."""

import pytest

pytest.importorskip("rclpy")

from hostile_messages import SCENES, SETTINGS, Siege, adds_up
from ros_graph import Graph, NodePair

from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.short_range_node import ShortRangeNode


@pytest.mark.parametrize(("name", "is_linked"), [("raw", True), ("compressed_depth", False)])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_good_frames_among_hostile_messages_are_answered_as_in_peace(ros, name, is_linked):
    scene, pair = SCENES[name], NodePair()
    factories = (pair.long_range, pair.short_range) if is_linked else (LongRangeNode, ShortRangeNode)
    graph = Graph(*factories, namespace=f"siege_{name}", settings={**SETTINGS, **scene.settings})
    try:
        siege = Siege(graph, scene, is_linked=is_linked)
        siege.go_on(60)
        siege.set_hostile_parameters(5)
        siege.storm(5)
        siege.go_on(20)
        for node in graph.nodes:
            graph.status(node.get_name(), adds_up)
    finally:
        graph.close()
