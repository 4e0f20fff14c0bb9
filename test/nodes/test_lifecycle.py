"""Managed nodes: their transitions over real services, what each state has and does, and reset."""

import itertools
import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from ros_graph import N_DISPARITIES, WIDTH, Graph, NodePair, camera_info, image, stereo_pair, value
from sensor_msgs.msg import Image
from std_srvs.srv import Empty

from lrtrav_ros.nodes.short_range_node import ShortRangeNode

SETTINGS = {"stereo.matcher": "bm", "stereo.n_disparities": N_DISPARITIES, "superpixels.n_superpixels": 40}
STAMPS = itertools.count(1_700_000_000_000_000_000, 100_000_000)
NODES = ("short_range", "long_range")
WAY_UP = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
WAY_DOWN = (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP)


def make_graph(namespace, **settings):
    pair = NodePair()
    return Graph(pair.long_range, pair.short_range, namespace=namespace, settings={**SETTINGS, **settings})


@pytest.fixture(scope="module")
def managed(ros):
    graph = make_graph("managed", autostart=False)
    yield graph
    graph.close()


@pytest.fixture(scope="module")
def started(ros):
    graph = make_graph("started")
    graph.listen(Image, "long_range/mask")
    yield graph
    graph.close()


def change(graph, node, transition):
    request = ChangeState.Request(transition=Transition(id=transition))
    return graph.call(ChangeState, f"{node}/change_state", request).success


def state(graph, node):
    return graph.call(GetState, f"{node}/get_state", GetState.Request()).current_state.id


def topics(node):
    """Return the topics of this package that a node publishes, and those that it subscribes to."""
    own = ("left/", "right/", "short_range/", "long_range/")
    published, subscribed = (
        {entity.topic_name.partition("/managed/")[2] for entity in entities}
        for entities in (node.publishers, node.subscriptions)
    )
    kept = (
        {name for name in names if name.startswith(own) and "event" not in name} for names in (published, subscribed)
    )
    return tuple(kept)


def publish(graph, pair, stamp):
    graph.publish("left/camera_info", camera_info())
    graph.publish("right/camera_info", camera_info(right=True))
    graph.publish("right/image_rect", image(pair[1], stamp))
    graph.publish("left/image_rect", image(pair[0], stamp))


def test_without_autostart_nodes_wait_and_do_what_they_are_told(managed):
    long_range, short_range = managed.nodes
    for node in NODES:
        assert state(managed, node) == State.PRIMARY_STATE_UNCONFIGURED
    assert topics(short_range) == topics(long_range) == (set(), set())
    for node in NODES:
        assert change(managed, node, Transition.TRANSITION_CONFIGURE)
        assert state(managed, node) == State.PRIMARY_STATE_INACTIVE
    assert "short_range/mask" in topics(short_range)[0]
    assert "long_range/grid" in topics(long_range)[0]
    assert topics(short_range)[1] == set()
    for node in NODES:
        assert change(managed, node, Transition.TRANSITION_ACTIVATE)
    assert topics(short_range)[1] == {"left/image_rect", "right/image_rect", "left/camera_info", "right/camera_info"}
    managed.listen(Image, "long_range/mask")
    stamp = next(STAMPS)
    publish(managed, stereo_pair(), stamp)
    assert managed.at("long_range/mask", stamp).width == WIDTH
    for transition in WAY_DOWN:
        for node in NODES:
            assert change(managed, node, transition)
    assert topics(short_range) == topics(long_range) == (set(), set())


def test_nodes_that_were_cleaned_up_work_again_in_the_other_order(managed):
    for transition in WAY_UP:
        for node in reversed(NODES):
            assert change(managed, node, transition)
    stamp = next(STAMPS)
    publish(managed, stereo_pair(1), stamp)
    assert managed.at("long_range/mask", stamp).width == WIDTH
    assert value(managed.status("short_range"), "frames received") == 1
    for transition in WAY_DOWN:
        for node in NODES:
            assert change(managed, node, transition)


def test_transitions_that_a_state_does_not_have_are_refused(managed):
    assert not change(managed, "short_range", Transition.TRANSITION_ACTIVATE)
    assert not change(managed, "long_range", Transition.TRANSITION_DEACTIVATE)
    assert state(managed, "short_range") == State.PRIMARY_STATE_UNCONFIGURED


def test_a_long_range_that_is_inactive_takes_no_frames_and_goes_on_afterwards(started):
    publish(started, stereo_pair(), (first := next(STAMPS)))
    started.at("long_range/mask", first)
    assert change(started, "long_range", Transition.TRANSITION_DEACTIVATE)
    received = value(started.status("short_range"), "frames processed")
    publish(started, stereo_pair(), (second := next(STAMPS)))
    started.status("short_range", lambda status: value(status, "frames processed") == received + 1)
    assert change(started, "long_range", Transition.TRANSITION_ACTIVATE)
    publish(started, stereo_pair(), (third := next(STAMPS)))
    started.at("long_range/mask", third)
    stamps = [message.header.stamp.nanosec for message in started.received["long_range/mask"]]
    assert second % 10**9 not in stamps
    status = started.status("long_range", lambda status: value(status, "frames processed") == 1)
    assert value(status, "frames received") == 1


def test_a_short_range_that_was_inactive_gives_frames_again(started):
    publish(started, stereo_pair(), (first := next(STAMPS)))
    started.at("long_range/mask", first)
    before = started.status("long_range", lambda status: value(status, "frames processed") > 0)
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        assert change(started, "short_range", transition)
    publish(started, stereo_pair(), (second := next(STAMPS)))
    started.at("long_range/mask", second)
    n_processed = value(before, "frames processed") + 1
    status = started.status("long_range", lambda status: value(status, "frames processed") == n_processed)
    assert value(status, "frames received") == value(before, "frames received") + 1


def test_reset_forgets_calibration_and_statistics(started):
    stamp = next(STAMPS)
    publish(started, stereo_pair(), stamp)
    started.at("long_range/mask", stamp)
    for node in NODES:
        assert value(started.status(node), "frames received") > 0
        started.call(Empty, f"{node}/reset", Empty.Request())
        status = started.status(node, lambda status: value(status, "frames received") == 0)
        assert [value(status, f"frames {count}") for count in ("processed", "dropped", "failed", "unpaired")] == [0] * 4
    waiting = next(STAMPS)
    started.publish("right/image_rect", image(stereo_pair()[1], waiting))
    started.publish("left/image_rect", image(stereo_pair()[0], waiting))
    assert "no CameraInfo yet" in started.status("short_range", lambda status: status.message != "running").message
    started.publish("left/camera_info", camera_info())
    started.publish("right/camera_info", camera_info(right=True))
    started.at("long_range/mask", waiting)


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize("kind", [10, 200])
def test_a_parameter_of_a_type_that_ros_does_not_have_is_refused(started, node, kind):
    good = Parameter("extension.rule", value="ratio").to_parameter_msg()
    bad = ParameterMessage(name="extension.rule", value=ParameterValue(type=kind))
    expected = f"extension.rule has a value of type {kind}, which ROS does not have"
    request = SetParameters.Request(parameters=[good, bad])
    results = started.call(SetParameters, f"{node}/set_parameters", request).results
    assert [(result.successful, result.reason) for result in results] == [(False, expected)] * 2
    request = SetParametersAtomically.Request(parameters=[good, bad])
    result = started.call(SetParametersAtomically, f"{node}/set_parameters_atomically", request).result
    assert (result.successful, result.reason) == (False, expected)


def test_a_node_that_cannot_be_configured_stays_unconfigured_and_says_why(ros):
    name = "qos_overrides./refused/short_range/mask.publisher.reliability"
    node = ShortRangeNode(
        namespace="refused",
        parameter_overrides=[Parameter("autostart", value=False), Parameter(name, value="nonsense")],
    )
    graph = Graph(namespace="refused", settings={})
    graph._executor.add_node(node)
    try:
        assert not change(graph, "short_range", Transition.TRANSITION_CONFIGURE)
        assert state(graph, "short_range") == State.PRIMARY_STATE_UNCONFIGURED
        assert not [publisher for publisher in node.publishers if "mask" in publisher.topic_name]
    finally:
        node.destroy_node()
        graph.close()


def test_a_node_that_cannot_be_activated_says_why_and_leaves_nothing_behind(started, monkeypatch):
    def fail(*args, **options):
        raise ValueError("no such thing")

    threads, errors = set(threading.enumerate()), []
    assert change(started, "short_range", Transition.TRANSITION_DEACTIVATE)
    with monkeypatch.context() as patch:
        patch.setattr("lrtrav_ros.nodes.short_range_node.Diagnostics", fail)
        patch.setattr(started.nodes[1], "get_logger", lambda: SimpleNamespace(error=errors.append))
        assert not change(started, "short_range", Transition.TRANSITION_ACTIVATE)
    assert errors == ["transition failed: no such thing"]
    assert set(threading.enumerate()) < threads  # without the worker
    assert state(started, "short_range") == State.PRIMARY_STATE_INACTIVE
    assert change(started, "short_range", Transition.TRANSITION_ACTIVATE)
    publish(started, stereo_pair(), (stamp := next(STAMPS)))
    started.at("long_range/mask", stamp)


def test_transitions_amid_frames(started):
    """Whatever comes between, no frame fails, and the next one is detected."""
    pair = stereo_pair()
    for node in (*NODES, *NODES):
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
            for _ in range(3):
                stamp = next(STAMPS)
                for side, pixels in zip(("right", "left"), reversed(pair), strict=True):
                    started.publisher(Image, f"{side}/image_rect", 0).publish(image(pixels, stamp))
            assert change(started, node, transition)
    publish(started, pair, (stamp := next(STAMPS)))
    started.at("long_range/mask", stamp)
    for node in NODES:
        status = started.status(node, lambda status: value(status, "frames processed") > 0)
        assert (value(status, "frames failed"), status.message) == (0, "running")


def test_shutdown_ends_the_work(ros):
    graph = make_graph("finalized")
    try:
        assert change(graph, "short_range", Transition.TRANSITION_ACTIVE_SHUTDOWN)
        assert state(graph, "short_range") == State.PRIMARY_STATE_FINALIZED
        assert not [each for each in graph.nodes[1].subscriptions if "image" in each.topic_name]
    finally:
        graph.close()
