"""What a node says while it waits: who publishes with another type or QoS, and which topics could be meant."""

import itertools
from functools import partial

import pytest

pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from ros_graph import Graph, camera_info, image, stereo_pair, value
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.config import LONG_RANGE_STAGES, SHORT_RANGE_STAGES
from lrtrav_ros.nodes import endpoints
from lrtrav_ros.nodes.diagnostics import Diagnostics
from lrtrav_ros.nodes.inputs import INPUTS, received_by
from lrtrav_ros.nodes.long_range_inputs import TopicsInput
from lrtrav_ros.nodes.missing_topics import AwaitedTopics, explain_silence
from lrtrav_ros.nodes.parameters import Settings
from lrtrav_ros.nodes.worker import Worker

ROBOT = "/robot"
STAMPS = itertools.count(1_700_000_000_000_000_000, 100_000_000)
BEST_EFFORT = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=1)
KEPT = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class Waiting(Node):
    """The input of the short-range node and its diagnostics, without the work."""

    def __init__(self, **options):
        super().__init__("waiting", **options)
        settings = Settings(self, SHORT_RANGE_STAGES)
        self.frames = []
        self.worker = Worker(self.frames.append, failed=lambda err: None)
        self.worker.start()
        self.input = INPUTS[settings.config.source.source](self, settings, self.worker.put, print)
        Diagnostics(self, self.worker, lambda: received_by(self.input), problem=self.input.problem)

    def destroy_node(self):
        self.worker.close()
        super().destroy_node()


@pytest.fixture(scope="module")
def graph(ros):
    graph = Graph(partial(Node, "waiting"), namespace="robot", settings={})
    yield graph
    graph.close()


@pytest.fixture
def publish(graph):
    """Advertise a topic until the test ends."""
    publishers = []

    def advertise(topic, kind, qos=RELIABLE):
        publishers.append(graph.tester.create_publisher(kind, topic, qos))
        graph.spin_until(lambda: graph.nodes[0].count_publishers(publishers[-1].topic_name) > 0)

    yield advertise
    names = [publisher.topic_name for publisher in publishers]
    for publisher in publishers:
        graph.tester.destroy_publisher(publisher)
    graph.spin_until(lambda: not any(graph.nodes[0].count_publishers(name) for name in names))


@pytest.fixture
def explain(graph):
    """Return what is said of a subscription."""
    node, subscriptions = graph.nodes[0], []

    def explanation(name, kind=Image, *, qos=BEST_EFFORT, compressed="", waited_s=5.2):
        topic = f"{node.resolve_topic_name(name)}{compressed}"
        subscriptions.append(node.create_subscription(kind, topic, lambda message: None, qos))
        return explain_silence(node, name, subscriptions[-1], waited_s=waited_s)

    yield explanation
    for subscription in subscriptions:
        node.destroy_subscription(subscription)


def test_a_similar_topic_is_named_with_the_remap(publish, explain):
    for side in ("right", "left"):
        publish(f"/zed/{side}/image_rect_color", Image)
    assert explain("left/image_rect") == (
        "nothing has come on /robot/left/image_rect (sensor_msgs/msg/Image, best effort) for 5 s: nobody publishes it; "
        "there are /zed/left/image_rect_color, /zed/right/image_rect_color of this type: "
        "start with -r left/image_rect:=/zed/left/image_rect_color"
    )


@pytest.mark.parametrize(
    ("name", "kind", "published", "arguments"),
    [
        # the side, as drivers name it
        (
            "right/image_rect",
            Image,
            {"/camera/infra1/image_rect_raw": Image, "/camera/infra2/image_rect_raw": Image, "/image": Image},
            "-r right/image_rect:=/camera/infra2/image_rect_raw",
        ),
        # rectified before raw
        (
            "left/image_rect",
            Image,
            {"/zed/left_raw/image_raw_color": Image, "/zed/left/image_rect_gray": Image, "/zed/depth/image": Image},
            "-r left/image_rect:=/zed/left/image_rect_gray",
        ),
        (
            "left/image_rect",
            Image,
            {
                f"/zed/zed_node/left/{colour}/{kind}/image": Image
                for colour in ("gray", "color")
                for kind in ("rect", "raw")
            },
            "-r left/image_rect:=/zed/zed_node/left/color/rect/image",
        ),
        (
            "left/image_rect",
            Image,
            {"/Bumblebee_X/serial_1/rectified_left_image": Image, "/Bumblebee_X/serial_1/depth_image": Image},
            "-r left/image_rect:=/Bumblebee_X/serial_1/rectified_left_image",
        ),
        # what a parameter chooses
        ("left/image_rect", Image, {"left/image_rect/compressed": CompressedImage}, "-p source.compressed:=true"),
        ("left/image_rect", Image, {"left/image_raw": Image}, "-p source.rectify:=true"),
        (
            "right/image_rect",
            Image,
            {"/cam/right/image_raw/compressed": CompressedImage, "/cam/right/image_rect/theora": CompressedImage},
            "-p source.compressed:=true -p source.rectify:=true -r right/image_raw:=/cam/right/image_raw",
        ),
        (
            "depth/image_rect",
            Image,
            {
                "/camera/color/image_rect": Image,
                "/camera/depth/image_rect_raw": Image,
                "/camera/aligned_depth_to_color/image_raw": Image,
            },
            "-r depth/image_rect:=/camera/aligned_depth_to_color/image_raw",
        ),
        (
            "depth/image_rect",
            Image,
            {"depth/image_rect/compressedDepth": CompressedImage},
            "-p source.compressed:=true",
        ),
        (
            "depth/image_rect",
            Image,
            {"/stereo/left/image_rect": Image, "/stereo/image_raw": Image},
            "-r depth/image_rect:=/stereo/image_raw",
        ),
        ("disparity", DisparityImage, {"/stereo/disparity": DisparityImage}, "-r disparity:=/stereo/disparity"),
        (
            "right/camera_info",
            CameraInfo,
            {"/c/right_raw/camera_info": CameraInfo, "/c/right/camera_info": CameraInfo, "/camera_info": CameraInfo},
            "-r right/camera_info:=/c/right/camera_info",
        ),
        (
            "short_range/occupancy",
            Image,
            {"/a/short_range/occupancy": Image},
            "-r short_range/occupancy:=/a/short_range/occupancy",
        ),
    ],
)
def test_the_likeliest_topic_is_chosen(publish, explain, name, kind, published, arguments):
    for topic, other in published.items():
        publish(topic, other)
    assert explain(name, kind).endswith(f": start with {arguments}")


@pytest.mark.parametrize(
    ("parameters", "name", "published", "end"),
    [
        ({"source": "depth"}, "left/image_rect", "/cam/color/image_raw", "-r left/image_rect:=/cam/color/image_raw"),
        (
            {"source.rectify": True},
            "left/image_raw",
            "/cam/left/image_rect",
            "-p source.rectify:=false -r left/image_rect:=/cam/left/image_rect",
        ),
        (
            {"source.rectify": True},
            "left/camera_info",
            "/cam/left/camera_info",
            "left/camera_info:=/cam/left/camera_info",
        ),
        (
            {"source": "depth"},
            "depth/camera_info",
            "/c/depth/camera_info",
            "-r depth/camera_info:=/c/depth/camera_info",
        ),
        # which the short-range node makes of it
        ({"source.rectify": True}, "left/image_rect", "/cam/left/image_raw", "start the short-range node, or remap it"),
    ],
)
def test_what_is_meant_depends_on_the_parameters(publish, parameters, name, published, end):
    node = Node("parametrised")
    node.declare_parameters("", list(parameters.items()))
    kind = CameraInfo if name.endswith("info") else Image
    publish(published, kind)
    subscription = node.create_subscription(kind, name, lambda message: None, BEST_EFFORT)
    text = explain_silence(node, name, subscription, waited_s=5.0)
    node.destroy_node()
    assert text.endswith(end)


def test_plain_images_in_place_of_compressed_ones(publish, explain):
    publish("left/image_rect", Image)
    text = explain("left/image_rect", CompressedImage, compressed="/compressed")
    assert text.endswith(
        "there is /robot/left/image_rect (sensor_msgs/msg/Image): start with -p source.compressed:=false"
    )


def test_what_could_not_be_meant_is_listed_without_a_remap(publish, explain):
    for side in ("a", "b", "c", "d", "e"):
        publish(f"/{side}/right/image_rect", Image)
    assert explain("left/image_rect").endswith(
        "nobody publishes it; there are /a/right/image_rect, /b/right/image_rect, /c/right/image_rect and 2 more "
        "of this type"
    )


def test_outputs_of_this_package_and_topics_without_a_publisher_are_not_offered(graph, publish, explain):
    publish("short_range/mask", Image)
    subscription = graph.tester.create_subscription(Image, "/other/left/image_rect", lambda message: None, 1)
    assert explain("left/image_rect").endswith("nobody publishes it, nor any other topic of this type")
    assert explain("short_range/occupancy").endswith("nobody publishes it: start the short-range node, or remap it")
    graph.tester.destroy_subscription(subscription)


def test_another_type_is_named_with_its_publisher(graph, publish, explain):
    publish("/cam/left/image_rect", Image)
    context = Context()  # one participant of DDS has one type for a topic
    context.init(args=[])
    camera = Node("driver", namespace="cam", context=context)
    camera.create_publisher(CompressedImage, "/robot/left/image_rect", 1)
    node = graph.nodes[0]
    graph.spin_until(
        lambda: [each.node_name for each in node.get_publishers_info_by_topic("left/image_rect")] == ["driver"]
    )
    assert explain("left/image_rect").endswith(
        ": it is published by /cam/driver as sensor_msgs/msg/CompressedImage, not sensor_msgs/msg/Image; "
        "there is /cam/left/image_rect of this type: start with -r left/image_rect:=/cam/left/image_rect"
    )
    camera.destroy_node()
    context.shutdown()
    graph.spin_until(lambda: node.count_publishers("left/image_rect") == 0)


@pytest.mark.parametrize(
    ("published", "subscribed", "description", "reason"),
    [
        (BEST_EFFORT, RELIABLE, "reliable", ("reliability", "best_effort", "reliable")),
        (RELIABLE, KEPT, "reliable, transient local", ("durability", "volatile", "transient_local")),
    ],
)
def test_another_qos_is_named_with_its_remedy(publish, explain, published, subscribed, description, reason):
    publish("left/image_rect", Image, published)
    policy, given, asked = reason
    text = explain("left/image_rect", qos=subscribed)
    assert f"(sensor_msgs/msg/Image, {description})" in text
    assert text.endswith(
        f": it is published by /robot/tester with {policy} {given}, which a {asked} subscription does not get: "
        f"set qos_overrides./robot/left/image_rect.subscription.{policy} to {given}"
    )


def test_a_publisher_that_fits_but_sends_nothing(publish, explain):
    publish("left/image_rect", Image)
    assert "it is published by /robot/tester, but no message has come" in explain("left/image_rect")


def test_only_topics_that_have_not_come_are_told_of_and_only_after_some_time(graph):
    node = graph.nodes[0]
    awaited = AwaitedTopics(node)
    subscription = endpoints.subscribe_info(node, "left/camera_info", print, print)
    awaited.add("left/camera_info", subscription, lambda: False)
    awaited.add("right/image_rect", endpoints.subscribe_image(node, "right/image_rect", print, print), lambda: False)
    awaited.add("left/image_rect", subscription, lambda: True)
    assert awaited.problem(patience_s=60.0) == ""
    lines = awaited.problem(patience_s=0.0).splitlines()
    assert [line.split()[4] for line in lines] == ["/robot/right/image_rect", "/robot/left/camera_info"]


def test_a_node_that_has_ended_gives_no_reason(ros):
    node = Node("ended")
    subscription = node.create_subscription(Image, "left/image_rect", lambda message: None, 1)
    node.destroy_node()
    text = explain_silence(node, "left/image_rect", subscription, waited_s=7.0)
    assert text.startswith("nothing has come on left/image_rect for 7 s (")


def test_a_node_says_what_it_waits_for_until_frames_come(ros, monkeypatch):
    monkeypatch.setattr("lrtrav_ros.nodes.inputs.PATIENCE_S", 0.5)
    monkeypatch.setattr("lrtrav_ros.nodes.diagnostics._CHANGE_PERIOD_S", 0.0)
    graph = Graph(Waiting, namespace="waits", settings={}, window_s=60.0)
    try:
        graph.listen(Log, "/rosout")
        status = graph.status("waiting", lambda status: "nothing has come" in status.message)
        assert status.level == DiagnosticStatus.WARN
        topics = [line.split()[4] for line in status.message.splitlines()]
        names = ("left/image_rect", "right/image_rect", "left/camera_info", "right/camera_info")
        assert topics == [f"/waits/{name}" for name in names]
        n_before = len(graph.received["/diagnostics"])
        graph.spin_until(lambda: len(graph.received["/diagnostics"]) >= n_before + 3)
        logs = [log.msg for log in graph.received["/rosout"] if log.name == "waits.waiting"]
        assert [text.split(" (")[0] for text in logs] == [f"nothing has come on {topics[0]}"]  # and no more
        left, right = stereo_pair()
        stamp = next(STAMPS)
        graph.publish("left/image_rect", image(left, stamp))
        graph.publish("right/image_rect", image(right, stamp))
        status = graph.status("waiting", lambda status: "frames wait for it" in status.message)
        first, *rest = status.message.splitlines()
        assert first == (
            "no CameraInfo yet on /waits/left/camera_info and /waits/right/camera_info; frames wait for it"
        )
        assert [line.split()[4] for line in rest] == ["/waits/left/camera_info", "/waits/right/camera_info"]
        graph.spin_until(lambda: any("frames wait for it" in log.msg for log in graph.received["/rosout"]))
        graph.publish("left/camera_info", camera_info())
        graph.publish("right/camera_info", camera_info(right=True))
        graph.spin_until(lambda: graph.nodes[0].frames)
        monkeypatch.setattr("lrtrav_ros.nodes.inputs.PATIENCE_S", 60.0)
        assert graph.status("waiting").message == "running"
    finally:
        graph.close()


@pytest.mark.parametrize(
    ("source", "needed"),
    [("disparity", ["disparity", "left/camera_info"]), ("depth", ["depth/image_rect", "left/camera_info"])],
)
def test_other_sources_say_what_they_wait_for(ros, monkeypatch, source, needed):
    monkeypatch.setattr("lrtrav_ros.nodes.inputs.PATIENCE_S", 0.0)
    node = Waiting(parameter_overrides=[Parameter("source", value=source)])
    lines = node.input.problem().splitlines()
    node.destroy_node()
    assert [line.split()[4] for line in lines] == [f"/{name}" for name in needed]


def test_the_long_range_says_what_it_waits_for(ros, monkeypatch):
    monkeypatch.setattr("lrtrav_ros.nodes.long_range_inputs.PATIENCE_S", 0.0)
    node = Node("long")
    settings = Settings(node, LONG_RANGE_STAGES)
    topics = TopicsInput(node, settings, lambda frame: None, print, is_mapped=lambda: False)
    left, occupancy = topics.problem().splitlines()
    node.destroy_node()
    assert left.startswith("nothing has come on /left/image_rect (sensor_msgs/msg/Image, best effort) for 0 s: nobody")
    assert occupancy.startswith("nothing has come on /short_range/occupancy (")
    assert occupancy.endswith(": nobody publishes it: start the short-range node, or remap it")


def test_the_counts_add_up_whatever_is_damaged(ros):
    graph = Graph(Waiting, namespace="counts", settings={})
    try:
        left, right = stereo_pair()
        for side in ("left", "right"):
            graph.publish(f"{side}/camera_info", camera_info(right=side == "right"))
            graph.publisher(Image, f"{side}/image_rect").publish(b"\x00\x01\x00\x00")
        bad_stamp, stamp = next(STAMPS), next(STAMPS)
        graph.publish("left/image_rect", image(left, bad_stamp))
        graph.publish("left/image_rect", image(left, stamp))
        graph.publish("right/image_rect", image(right, stamp))
        status = graph.status("waiting", lambda status: value(status, "frames processed") == 1)
        counts = {name: value(status, f"frames {name}") for name in ("received", "dropped", "failed", "unpaired")}
        assert counts == {"received": 3, "dropped": 0, "failed": 1, "unpaired": 1}
        assert value(status, "messages refused") == 2
    finally:
        graph.close()
