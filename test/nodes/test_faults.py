"""What happens to cameras, networks and nodes on a robot: frames are answered again from the first whole one on."""

import dataclasses
import itertools
from functools import cache

import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time
from hostile_messages import adds_up
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node
from rclpy.qos import QoSProfile
from ros_graph import CAMERA, N_DISPARITIES, Graph, camera_info, image, stereo_pair, value
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image

from lrtrav_ros import Config, Detector
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

SETTINGS = {
    "stereo.matcher": "bm",
    "stereo.n_disparities": N_DISPARITIES,
    "superpixels.n_superpixels": 40,
    "memory.frames": 0,  # each frame is compared with what the detector finds in it alone
    "ground.memory_s": 0.0,
}
STAMPS = itertools.count(1_700_000_000_000_000_000, 100_000_000)
MASK = "long_range/mask"
SMALL = (slice(20, 110), slice(0, 128))  # part of the images that another camera shows


@pytest.fixture(scope="module")
def graph(ros):
    graph = Graph(LongRangeNode, ShortRangeNode, namespace="faults", settings=SETTINGS)
    graph.listen(Image, MASK)
    yield graph
    graph.close()


def publish_left(graph, seed, stamp):
    graph.publish("left/image_rect", image(stereo_pair(seed)[0], stamp), n_subscriptions=2)


def publish_right(graph, seed, stamp):
    graph.publish("right/image_rect", image(stereo_pair(seed)[1], stamp))


def publish_infos(graph):
    graph.publish("left/camera_info", camera_info())
    graph.publish("right/camera_info", camera_info(right=True))


def publish(graph, seed, stamp):
    publish_infos(graph)
    publish_right(graph, seed, stamp)
    publish_left(graph, seed, stamp)


@cache
def expected(seed):
    return Detector(Config().updated(SETTINGS), CAMERA).detect(*stereo_pair(seed)).long_range.mask


def check(graph, seed, stamp):
    """Wait for the mask of a frame, and compare it with that of the detector."""
    np.testing.assert_array_equal(decode_message(graph.at(MASK, stamp)), expected(seed))


def check_next(graph, seed=0):
    """Check that the very next frame is answered."""
    stamp = next(STAMPS)
    publish(graph, seed, stamp)
    check(graph, seed, stamp)


def wait_for_received(graph, n):
    """Wait now and then until the short range has received so many: subscriptions keep five, and lose what is more."""
    if n % 4 == 0:
        graph.status("short_range", lambda status: value(status, "frames received") >= n)


def paired(status):
    return value(status, "frames processed") + value(status, "frames dropped")


def check_counts(graph):
    for node in graph.nodes:
        graph.status(node.get_name(), adds_up)


def test_cameras_stop_and_return(graph, monkeypatch):
    check_next(graph)
    with monkeypatch.context() as patch:
        patch.setattr("lrtrav_ros.nodes.inputs.PATIENCE_S", 0.0)
        status = graph.status("short_range", lambda status: "no messages for" in status.message)
        assert "/faults/left/image_rect: 1 received" in status.message
    check_next(graph)
    check_counts(graph)


def test_one_camera_only(graph, monkeypatch):
    before = value(graph.status("short_range"), "frames received")
    stamps = [next(STAMPS) for _ in range(20)]
    with monkeypatch.context() as patch:
        patch.setattr("lrtrav_ros.nodes.inputs.PATIENCE_S", 0.0)
        for n, stamp in enumerate(stamps, start=1):
            publish_left(graph, 0, stamp)
            wait_for_received(graph, before + n)
        status = graph.status("short_range", lambda status: "no pairs for" in status.message)
    assert "/faults/right/image_rect: " in status.message
    check_next(graph)
    assert value(graph.status("short_range"), "frames unpaired") >= 4  # 16 wait, and those before a pair go with it
    assert not {header_stamp_ns(message) for message in graph.received[MASK]} & set(stamps)
    check_counts(graph)


@pytest.mark.parametrize(("share", "n"), [(0.01, 40), (0.3, 40)])
def test_frames_whose_messages_are_not_lost_are_answered(graph, share, n):
    rng = np.random.default_rng(n)
    for seed in rng.integers(0, 4, n).tolist():
        stamp, parts = next(STAMPS), (publish_right, publish_left)
        if rng.random() >= share:
            publish_infos(graph)
        arrive = [rng.random() >= share for _ in parts]
        for part in itertools.compress(parts, arrive):
            part(graph, seed, stamp)
        if all(arrive):
            check(graph, seed, stamp)
    check_counts(graph)


def test_late_and_reordered_messages_pair_with_their_own(graph):
    publish_infos(graph)
    begin, status = len(graph.received[MASK]), graph.status("short_range")
    before, n_paired = value(status, "frames received"), paired(status)
    stamps = [next(STAMPS) for _ in range(12)]
    order = np.argsort(np.arange(12) + np.random.default_rng(0).uniform(0, 3, 12)).tolist()
    for at, late in enumerate(order):
        publish_left(graph, at % 4, stamps[at])
        publish_right(graph, late % 4, stamps[late])
        wait_for_received(graph, before + at + 1)
    check_next(graph)
    answered = [header_stamp_ns(message) for message in graph.received[MASK][begin:-1]]
    assert paired(graph.status("short_range")) - n_paired >= 6  # how many of them are dropped, the computer decides
    assert answered
    for stamp in answered:
        check(graph, stamps.index(stamp) % 4, stamp)
    check_counts(graph)


def test_a_second_publisher_on_a_topic(graph):
    other = graph.tester.create_publisher(Image, "left/image_rect", QoSProfile(depth=50))
    graph.spin_until(lambda: other.get_subscription_count() == 2)
    for seed in range(4):
        stamp = next(STAMPS)
        publish_infos(graph)
        publish_right(graph, seed, stamp)
        other.publish(image(stereo_pair(9)[0][:60], stamp + 50_000_000))
        publish_left(graph, seed, stamp)
        check(graph, seed, stamp)
    graph.tester.destroy_publisher(other)
    check_counts(graph)


def test_a_subscriber_that_takes_nothing_holds_nobody_up(graph):
    slow = Node("slow", namespace="faults")  # in no executor
    slow.create_subscription(Image, MASK, lambda message: None, 1)
    n_subscribers = graph.nodes[0].count_subscribers(f"/faults/{MASK}")
    graph.spin_until(lambda: graph.nodes[0].count_subscribers(f"/faults/{MASK}") >= max(n_subscribers, 2))
    for seed in range(8):
        check_next(graph, seed % 4)
    slow.destroy_node()


@pytest.mark.parametrize("jump_s", [-3600, 365 * 86_400])
def test_time_jumps(graph, jump_s):
    check_next(graph)
    stamps = itertools.count(next(STAMPS) + jump_s * 10**9, 100_000_000)
    for seed in range(3):
        stamp = next(stamps)
        publish(graph, seed, stamp)
        check(graph, seed, stamp)
    check_next(graph)
    check_counts(graph)


def test_simulated_time_that_stops_and_jumps_back(ros):
    graph = Graph(LongRangeNode, ShortRangeNode, namespace="simulated", settings={**SETTINGS, "use_sim_time": True})
    graph.listen(Image, MASK)

    def told(at_s):
        """Return who published diagnostics at a time of the simulation."""
        arrays = [array for array in graph.received["/diagnostics"] if array.header.stamp.sec == at_s]
        return {array.status[0].hardware_id for array in arrays}

    try:
        for at_s in (1000, 2000, 500):
            graph.publish("/clock", Clock(clock=Time(sec=at_s)), n_subscriptions=2)
            check_next(graph)
            graph.spin_until(lambda at_s=at_s: told(at_s) == {"/simulated/short_range", "/simulated/long_range"})
    finally:
        graph.close()


def test_a_looped_recording_gives_the_same_again_although_nodes_remember(ros):
    graph = Graph(
        LongRangeNode,
        ShortRangeNode,
        namespace="loop",
        settings={**SETTINGS, "memory.frames": 5, "ground.memory_s": 0.5},
    )
    graph.listen(Image, MASK)
    try:
        stamps, masks = [next(STAMPS) for _ in range(4)], []
        for _ in range(2):
            graph.received[MASK].clear()
            for seed, stamp in enumerate(stamps):
                publish(graph, seed, stamp)
                masks.append(decode_message(graph.at(MASK, stamp)))
        for first, second in zip(masks[:4], masks[4:], strict=True):
            np.testing.assert_array_equal(first, second)
    finally:
        graph.close()


def test_a_camera_of_another_resolution_takes_over(graph):
    rows, columns = SMALL
    camera = dataclasses.replace(CAMERA, cy=CAMERA.cy - rows.start)
    left, right = (side[SMALL] for side in stereo_pair(1))
    stamp = next(STAMPS)
    check_next(graph)
    for is_right in (False, True):
        info: CameraInfo = camera_info(right=is_right, size=(rows.stop - rows.start, columns.stop))
        info.p[6] = camera.cy
        graph.publish(f"{'right' if is_right else 'left'}/camera_info", info)
    graph.publish("right/image_rect", image(right, stamp))
    graph.publish("left/image_rect", image(left, stamp), n_subscriptions=2)
    mask = Detector(Config().updated(SETTINGS), camera).detect(left, right).long_range.mask
    np.testing.assert_array_equal(decode_message(graph.at(MASK, stamp)), mask)
    check_next(graph)
    check_counts(graph)


def test_the_short_range_pauses(graph):
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        request = ChangeState.Request(transition=Transition(id=transition))
        assert graph.call(ChangeState, "short_range/change_state", request).success
        if transition == Transition.TRANSITION_DEACTIVATE:
            graph.publish("left/image_rect", image(stereo_pair(0)[0], next(STAMPS)))
    check_next(graph)
    check_counts(graph)
