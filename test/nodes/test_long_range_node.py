"""The long-range node alone, over DDS: its memory and what makes it forget, and confidence."""

import itertools
import threading
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import OccupancyGrid
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_graph import (
    CAMERA,
    HEIGHT,
    N_DISPARITIES,
    WIDTH,
    Graph,
    camera_info,
    ground_disparity,
    header,
    image,
    value,
)
from sensor_msgs.msg import Image
from std_srvs.srv import Empty

from lrtrav_ros.config import NODE_DEFAULTS, Config
from lrtrav_ros.detector import LongRangeDetector
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import PartError, header_stamp_ns
from lrtrav_ros.nodes import long_range_inputs
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.messages import disparity_to_message

SETTINGS = {"superpixels.n_superpixels": 40}
CONFIG = Config().updated({**SETTINGS, **NODE_DEFAULTS})
PERIOD_NS = 100_000_000
RUNS = itertools.count(1_700_000_000, 1000)


@pytest.fixture(scope="module")
def shared_graph(ros):
    graph = Graph(LongRangeNode, namespace="long", settings=SETTINGS)
    for topic in ("long_range/mask", "long_range/occupancy"):
        graph.listen(Image, topic)
    yield graph
    graph.close()


@pytest.fixture
def graph(shared_graph):
    """The node with its first parameters; each test has stamps of its own, far from those before."""
    yield shared_graph
    set_parameters(shared_graph, {name: CONFIG.values()[name] for name in CHANGED_BY_TESTS})


CHANGED_BY_TESTS = (
    *("superpixels.n_superpixels", "features.texture", "extension.rule", "extension.min_share"),
    *("memory.frames", "memory.max_gap_s", "source.max_pixels"),
)


def frame(*, is_near):
    """Return a hedge above ground, and what short range says: all of it, or only of the ground's lowest rows."""
    left = np.random.default_rng(is_near).integers(0, 40, (HEIGHT, WIDTH, 3))
    left[: HEIGHT // 2] += (30, 140, 60)
    left[HEIGHT // 2 :] += (120, 110, 100)
    occupancy = np.full((HEIGHT, WIDTH), 255, np.uint8)
    occupancy[90:] = 0
    if is_near:
        occupancy[: HEIGHT // 2], occupancy[HEIGHT // 2 :] = 100, 0
    return left.astype(np.uint8), occupancy


NEAR, FAR = frame(is_near=True), frame(is_near=False)


def alone(config=CONFIG):
    """Return the far frame's mask where nothing is remembered."""
    return LongRangeDetector(config).detect(*FAR).mask


def remembered():
    """Return the far frame's mask after the near frame."""
    detector = LongRangeDetector(CONFIG)
    detector.detect(*NEAR, stamp_ns=0)
    return detector.detect(*FAR, stamp_ns=PERIOD_NS).mask


def detected(graph, pair, stamp):
    """Publish a frame, and return the mask that the node answers with."""
    left, occupancy = pair
    graph.publish("left/image_rect", image(left, stamp))
    graph.publish("short_range/occupancy", image(occupancy, stamp))
    return decode_message(graph.at("long_range/mask", stamp))


def start(graph):
    """Let the node see the near frame, long after all others, and return the stamp of the next one."""
    stamp = next(RUNS) * 10**9
    detected(graph, NEAR, stamp)
    return stamp + PERIOD_NS


def set_parameters(graph, values):
    parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    answer = graph.call(SetParameters, "long_range/set_parameters", SetParameters.Request(parameters=parameters))
    assert [result.reason for result in answer.results] == [""] * len(values)


def reset(graph):
    graph.call(Empty, "long_range/reset", Empty.Request())


def test_what_was_near_teaches_the_next_frame(graph):
    stamp = start(graph)
    mask = detected(graph, FAR, stamp)
    np.testing.assert_array_equal(mask, remembered())
    # The hedge is known from the frame before; in the frame alone, a quarter of it is taken for ground.
    assert np.mean(mask[: HEIGHT // 2]) == 0
    assert np.mean(alone()[: HEIGHT // 2]) > 255 / 4
    np.testing.assert_array_equal(detected(graph, FAR, stamp + PERIOD_NS), mask)


def test_the_service_makes_it_forget(graph):
    stamp = start(graph)
    reset(graph)
    np.testing.assert_array_equal(detected(graph, FAR, stamp), alone())
    np.testing.assert_array_equal(detected(graph, NEAR, stamp + PERIOD_NS)[: HEIGHT // 2], 0)
    np.testing.assert_array_equal(detected(graph, FAR, stamp + 2 * PERIOD_NS)[: HEIGHT // 2], 0)


def test_a_frame_at_hand_ends_as_it_began_and_the_one_after_a_reset_remembers_nothing(graph, monkeypatch):
    entered, gate = threading.Event(), threading.Event()
    extend = LongRangeDetector.extend

    def gated(self, *args, **options):
        entered.set()
        assert gate.wait(10)
        return extend(self, *args, **options)

    stamp = start(graph)
    monkeypatch.setattr(LongRangeDetector, "extend", gated)
    left, occupancy = FAR
    graph.publish("left/image_rect", image(left, stamp))
    graph.publish("short_range/occupancy", image(occupancy, stamp))
    graph.spin_until(entered.is_set)
    reset(graph)
    gate.set()
    np.testing.assert_array_equal(decode_message(graph.at("long_range/mask", stamp)), remembered())
    np.testing.assert_array_equal(detected(graph, FAR, stamp + PERIOD_NS), alone())


@pytest.mark.parametrize(("step_s", "is_remembered"), [(1.9, True), (2.1, False), (-0.1, False), (0.0, True)])
def test_a_jump_in_time_makes_it_forget(graph, step_s, is_remembered):
    stamp = start(graph) - PERIOD_NS + round(step_s * 1e9)
    if step_s == 0:  # a stamp again, as of a camera that stands: the mask of before must not count as the new one
        graph.received["long_range/mask"].clear()
    np.testing.assert_array_equal(detected(graph, FAR, stamp), remembered() if is_remembered else alone())


@pytest.mark.parametrize("values", [{"features.texture": "cs_lbp"}, {"memory.frames": 3}, {"memory.max_gap_s": 3.0}])
def test_parameters_of_features_and_memory_make_it_forget(graph, values):
    stamp = start(graph)
    set_parameters(graph, values)
    np.testing.assert_array_equal(detected(graph, FAR, stamp), alone(CONFIG.updated(values)))


def test_other_parameters_leave_the_memory(graph):
    stamp = start(graph)
    values = {"extension.min_share": 0.6, "superpixels.n_superpixels": 60}
    set_parameters(graph, values)
    detector = LongRangeDetector(CONFIG)
    detector.detect(*NEAR)
    expected = LongRangeDetector(CONFIG.updated(values), memory=detector.memory).detect(*FAR).mask
    np.testing.assert_array_equal(detected(graph, FAR, stamp), expected)
    assert np.mean(expected[: HEIGHT // 2]) == 0


def test_without_memory_each_frame_stands_alone(graph):
    set_parameters(graph, {"memory.frames": 0})
    np.testing.assert_array_equal(detected(graph, FAR, start(graph)), alone())


def test_confidence_is_published_only_by_the_rule_that_finds_it(graph):
    stamp = start(graph)
    subscription = graph.listen(Image, "long_range/confidence")
    publisher = next(p for p in graph.nodes[0].publishers if p.topic_name == "/long/long_range/confidence")
    graph.spin_until(lambda: publisher.get_subscription_count() == 1)
    set_parameters(graph, {"extension.rule": "evidence"})
    detected(graph, FAR, stamp)
    set_parameters(graph, {"extension.rule": "propagation"})
    reset(graph)
    detected(graph, FAR, stamp + PERIOD_NS)
    message = graph.at("long_range/confidence", stamp + PERIOD_NS)
    assert (message.encoding, message.header.frame_id) == ("mono8", "left_optical")
    np.testing.assert_array_equal(decode_message(message), LongRangeDetector(CONFIG).detect(*FAR).confidence)
    assert stamp not in [header_stamp_ns(message) for message in graph.received["long_range/confidence"]]
    graph.tester.destroy_subscription(subscription)
    graph.spin_until(lambda: publisher.get_subscription_count() == 0)


@pytest.fixture
def mapped(graph):
    """The graph while somebody wants grids, which the node knows."""
    subscription = graph.listen(OccupancyGrid, "long_range/grid")
    names = ("disparity", "short_range/ground_disparity", "left/camera_info")
    graph.spin_until(lambda: all(graph.tester.count_subscribers(name) for name in names))
    yield graph
    graph.tester.destroy_subscription(subscription)
    graph.spin_until(lambda: not any(graph.tester.count_subscribers(name) for name in names))


def publish_geometry(graph, stamp, topics=("short_range/ground_disparity", "disparity")):
    message = disparity_to_message(ground_disparity(), header(stamp), CAMERA, n_disparities=N_DISPARITIES)
    for topic in topics:
        graph.publish(topic, message)


def test_masks_do_not_wait_for_a_geometry_that_does_not_come(mapped, monkeypatch):
    monkeypatch.setattr(long_range_inputs, "_GEOMETRY_TIMEOUT_S", 0.1)
    monkeypatch.setattr(long_range_inputs, "PATIENCE_S", 0.0)
    failed = value(mapped.status("long_range"), "frames failed")
    stamp = start(mapped)
    status = mapped.status("long_range", lambda status: "no maps" in status.message)
    monkeypatch.setattr(long_range_inputs, "_GEOMETRY_TIMEOUT_S", 60.0)
    detected(mapped, FAR, stamp)
    detected(mapped, FAR, stamp + PERIOD_NS)
    begin, *lines = status.message.splitlines()[-4:]
    assert begin == (
        "no maps: nothing with the stamp of the occupancy has come on "
        "/long/disparity and /long/short_range/ground_disparity and /long/left/camera_info"
    )
    for line, topic in zip(lines, ("disparity", "short_range/ground_disparity", "left/camera_info"), strict=True):
        assert line.startswith(f"nothing has come on /long/{topic} (")
    assert value(mapped.status("long_range"), "frames failed") == failed
    assert mapped.received["long_range/grid"] == []


def test_a_geometry_that_comes_is_waited_for_until_it_is_lost(mapped, monkeypatch):
    monkeypatch.setattr(long_range_inputs, "_GEOMETRY_TIMEOUT_S", 0.0)
    geometry = mapped.nodes[0]._topics._geometry
    first = start(mapped)
    late, lost, last = (first + i * PERIOD_NS for i in range(1, 4))
    mapped.publish("left/camera_info", camera_info())
    n_processed = value(
        mapped.status("long_range", lambda status: value(status, "frames waiting") == 0), "frames processed"
    )
    detected(mapped, FAR, first)
    mapped.status("long_range", lambda status: value(status, "frames processed") == n_processed + 1)
    assert not geometry._is_coming
    monkeypatch.setattr(long_range_inputs, "_GEOMETRY_TIMEOUT_S", 60.0)
    publish_geometry(mapped, first)  # too late, but now the node knows that it comes
    mapped.spin_until(lambda: geometry._is_coming)
    detected(mapped, FAR, late)
    publish_geometry(mapped, late)
    assert mapped.at("long_range/grid", late).info.height > 0
    detected(mapped, FAR, lost)
    publish_geometry(mapped, last)
    detected(mapped, FAR, last)
    mapped.at("long_range/grid", last)
    assert {header_stamp_ns(message) for message in mapped.received["long_range/grid"]} == {late, last}


TOO_LARGE = "image is 160 x 240 pixels (width x height); source.max_pixels allows 19200"


@pytest.mark.parametrize("spoilt", ["disparity", "short_range/ground_disparity"])
def test_a_geometry_that_is_refused_costs_the_maps_alone(mapped, spoilt):
    set_parameters(mapped, {"source.max_pixels": HEIGHT * WIDTH})
    failed, first = value(mapped.status("long_range"), "frames failed"), start(mapped)
    others = [name for name in ("short_range/ground_disparity", "disparity") if name != spoilt]
    mapped.publish("left/camera_info", camera_info())
    sizes = ((HEIGHT // 2, "disparity is 160 x 60 pixels, but the occupancy is 160 x 120"), (2 * HEIGHT, TOO_LARGE))
    for n_before, (height, reason) in enumerate(sizes):
        stamp = first + n_before * PERIOD_NS
        publish_geometry(mapped, stamp, others)
        disparity = np.resize(ground_disparity(), (height, WIDTH))
        mapped.publish(spoilt, disparity_to_message(disparity, header(stamp), CAMERA, n_disparities=N_DISPARITIES))
        detected(mapped, FAR, stamp)
        n_refused = n_before + 1
        status = mapped.status("long_range", lambda status, n=n_refused: value(status, "refused") == n, name=spoilt)
        assert value(status, "received") == value(status, "processed") + n_refused
        assert reason in status.message
    assert value(mapped.status("long_range"), "frames failed") == failed
    publish_geometry(mapped, stamp + PERIOD_NS)
    detected(mapped, FAR, stamp + PERIOD_NS)
    mapped.at("long_range/grid", stamp + PERIOD_NS)
    assert not {first, stamp} & {header_stamp_ns(message) for message in mapped.received["long_range/grid"]}


def test_an_occupancy_of_more_pixels_than_are_allowed_is_refused(graph):
    set_parameters(graph, {"source.max_pixels": HEIGHT * WIDTH})
    stamp = start(graph)
    graph.publish("left/image_rect", image(FAR[0], stamp))
    begin_s = time.time()
    graph.publish("short_range/occupancy", image(np.zeros((2 * HEIGHT, WIDTH), np.uint8), stamp))
    graph.status("long_range", lambda status: value(status, "refused") == 1, name="short_range/occupancy")
    graph.status("long_range", lambda status: TOO_LARGE in status.message, since_s=begin_s)


def test_a_geometry_from_before_a_reset_is_not_counted_when_it_is_refused(mapped, monkeypatch):
    entered, gate = threading.Event(), threading.Event()

    def refuse_late(*messages):
        entered.set()
        gate.wait(60)
        raise PartError("disparity", "late")

    stamp = start(mapped)
    mapped.publish("left/camera_info", camera_info())
    publish_geometry(mapped, stamp)
    with monkeypatch.context() as patch:
        patch.setattr(long_range_inputs, "_geometry_of", refuse_late)
        detected(mapped, FAR, stamp)
        mapped.spin_until(entered.is_set)
        reset(mapped)
        gate.set()
        detected(mapped, FAR, stamp + PERIOD_NS)  # without geometry: the calibration is forgotten
    status = mapped.status("long_range", name="disparity")
    assert (value(status, "received"), value(status, "processed"), value(status, "refused")) == (0, 0, 0)


def test_a_node_that_waits_for_its_geometry_is_deactivated_at_once(mapped, monkeypatch):
    monkeypatch.setattr(long_range_inputs, "_GEOMETRY_TIMEOUT_S", 60.0)
    stamp = start(mapped)
    mapped.publish("left/camera_info", camera_info())
    publish_geometry(mapped, stamp)
    detected(mapped, FAR, stamp)
    mapped.at("long_range/grid", stamp)
    detected(mapped, FAR, stamp + PERIOD_NS)  # and waits now
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=transition))
        assert mapped.call(ChangeState, "long_range/change_state", request).success


def test_each_topic_has_a_status_of_its_own(ros):
    graph = Graph(LongRangeNode, namespace="raw", settings={**SETTINGS, "source.rectify": True})
    try:
        graph.listen(OccupancyGrid, "long_range/grid")
        graph.publish("left/camera_info", camera_info(), n_subscriptions=2)  # of the geometry, and of unseen pixels
        graph.status("long_range", lambda status: value(status, "processed") == 1, name="left/camera_info")
        # Without a matrix K nothing can be rectified.
        graph.status("long_range", lambda status: value(status, "refused") == 1, name="left/camera_info (raw)")
        assert value(graph.status("long_range"), "messages refused") == 1
        names = [status.name for status in graph.received["/diagnostics"][-1].status]
        assert len(set(names)) == len(names)
    finally:
        graph.close()
