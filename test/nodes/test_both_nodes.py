"""Both nodes over DDS with a stereo pair: results, bad messages, diagnostics, debug topics."""

import itertools
import re
import threading

import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSReliabilityPolicy
from ros_graph import (
    CAMERA,
    FRAME_ID,
    HEIGHT,
    N_DISPARITIES,
    WIDTH,
    Graph,
    camera_info,
    ground_disparity,
    image,
    stereo_pair,
    value,
)
from sensor_msgs.msg import Image
from stereo_msgs.msg import DisparityImage

from lrtrav_ros import Config, Detector
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.io.pictures import overlay
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

SETTINGS = {
    "stereo.matcher": "sgbm",
    "stereo.n_disparities": N_DISPARITIES,
    "superpixels.n_superpixels": 40,
    "clustering.k": 3,
    "memory.frames": 0,  # each frame is compared with what the detector finds in it alone
}
STAMPS = itertools.count(1_700_000_000_123_456_789, 100_000_000)
OUTPUTS = ("short_range/mask", "short_range/occupancy", "long_range/mask", "long_range/occupancy")


@pytest.fixture(scope="module")
def graph(ros):
    graph = Graph(LongRangeNode, ShortRangeNode, namespace="stereo", settings=SETTINGS)
    graph.listen(DisparityImage, "disparity")
    for topic in OUTPUTS:
        graph.listen(Image, topic)
    yield graph
    graph.close()


def publish(graph, left, right, stamp):
    graph.publish("left/camera_info", camera_info())
    graph.publish("right/camera_info", camera_info(right=True))
    graph.publish("right/image_rect", image(right, stamp))
    graph.publish("left/image_rect", image(left, stamp), n_subscriptions=2)


def test_images_before_camera_info_wait_for_it_and_diagnostics_say_so(graph, monkeypatch):
    monkeypatch.setattr("lrtrav_ros.nodes.inputs.CALIBRATION_PATIENCE_S", 0.0)
    left, right = stereo_pair()
    for stamp in (next(STAMPS), next(STAMPS)):
        graph.publish("right/image_rect", image(right, stamp))
        graph.publish("left/image_rect", image(left, stamp), n_subscriptions=2)
    status = graph.status("short_range", lambda status: value(status, "frames dropped") == 1)
    assert status.level > DiagnosticStatus.OK
    assert status.message.splitlines()[0] == (
        "no CameraInfo yet on /stereo/left/camera_info and /stereo/right/camera_info; frames wait for it"
    )
    assert value(status, "frames processed") == 0
    graph.publish("left/camera_info", camera_info())
    graph.publish("right/camera_info", camera_info(right=True))
    assert graph.at("long_range/mask", stamp).header.frame_id == FRAME_ID


def test_outputs_are_those_of_the_detector_with_stamp_and_frame_of_the_left_image(graph):
    left, right = stereo_pair(seed=1)
    stamp = next(STAMPS)
    publish(graph, left, right, stamp)
    expected = Detector(Config().updated(SETTINGS), CAMERA).detect(left, right)
    messages = {topic: graph.at(topic, stamp) for topic in OUTPUTS}
    arrays = {topic: decode_message(message) for topic, message in messages.items()}
    assert {message.header.frame_id for message in messages.values()} == {FRAME_ID}
    assert {message.encoding for message in messages.values()} == {"mono8"}
    np.testing.assert_array_equal(arrays["short_range/mask"], expected.short_range.mask)
    np.testing.assert_array_equal(arrays["short_range/occupancy"], expected.short_range.occupancy)
    np.testing.assert_array_equal(arrays["long_range/mask"], expected.long_range.mask)
    np.testing.assert_array_equal(arrays["long_range/occupancy"], expected.long_range.occupancy)
    # The lower half of the image, right of where matching can start, is ground.
    assert np.mean(arrays["short_range/mask"][80:, N_DISPARITIES:] == 255) > 0.9
    assert np.mean(arrays["short_range/mask"][:40]) == 0


def test_disparity_image_is_complete(graph):
    left, right = stereo_pair(seed=2)
    stamp = next(STAMPS)
    publish(graph, left, right, stamp)
    message = graph.at("disparity", stamp)
    disparity = decode_message(message.image)
    assert message.header == message.image.header
    assert (message.f, message.t) == pytest.approx((CAMERA.fx, CAMERA.baseline_m))
    assert (message.min_disparity, message.max_disparity, message.delta_d) == (0.0, N_DISPARITIES - 1, 1 / 16)
    window = message.valid_window
    assert (window.x_offset, window.y_offset, window.height, window.width) == (0, 0, HEIGHT, WIDTH)
    assert np.isfinite(disparity).all()
    valid = disparity >= message.min_disparity
    assert valid[60:, N_DISPARITIES:-20].mean() > 0.9
    assert np.median(np.abs(disparity - ground_disparity())[60:][valid[60:]]) <= 0.5
    assert np.all(disparity[~valid] == -1)


def too_short(left, right):
    del left.data[-1:]
    return (
        f"image data has {HEIGHT * WIDTH * 3 - 1} bytes; {HEIGHT} rows of {WIDTH * 3} bytes need {HEIGHT * WIDTH * 3}"
    )


def unknown_encoding(left, right):
    left.encoding = "bayer_rggb12"
    return "image encoding is 'bayer_rggb12'"


def empty(left, right):
    left.height = left.width = left.step = 0
    del left.data[:]
    return "image is 0 x 0 pixels (width x height); both must be positive"


def other_size(left, right):
    right.height //= 2
    return "the right image is 160 x 60 pixels, but the left image is 160 x 120"


def short_step(left, right):
    left.step = WIDTH
    return f"image step is {WIDTH} bytes; a row of {WIDTH} pixels needs at least {WIDTH * 3}"


LEFT_REFUSED = r"1 of \d messages on /stereo/left/image_rect refused"


@pytest.mark.parametrize(
    ("spoil", "blame"),
    [
        (too_short, LEFT_REFUSED),
        (unknown_encoding, LEFT_REFUSED),
        (empty, LEFT_REFUSED),
        (other_size, r"1 of \d frames failed"),
        (short_step, LEFT_REFUSED),
    ],
)
def test_bad_images_are_reported_and_the_next_good_frame_is_processed(graph, spoil, blame):
    left, right = stereo_pair()
    bad_stamp, good_stamp = next(STAMPS), next(STAMPS)
    bad_left, bad_right = image(left, bad_stamp), image(right, bad_stamp)
    reason = spoil(bad_left, bad_right)
    failed = value(graph.status("short_range"), "frames failed")
    graph.publish("right/image_rect", bad_right)
    graph.publish("left/image_rect", bad_left, n_subscriptions=2)
    status = graph.status("short_range", lambda status: value(status, "frames failed") == failed + 1)
    assert re.search(rf"{blame} in the last 0.3 s; last, \d s ago: {re.escape(reason)}", status.message)
    assert status.level > DiagnosticStatus.OK
    publish(graph, left, right, good_stamp)
    assert graph.at("long_range/mask", good_stamp).width == WIDTH
    assert graph.status("short_range", lambda status: status.message == "running").level == DiagnosticStatus.OK


def test_a_long_text_in_a_message_is_not_told_whole(graph):
    left, right = stereo_pair()
    stamp = next(STAMPS)
    bad = image(left, stamp)
    bad.encoding = "x" * 100_000
    failed = value(graph.status("short_range"), "frames failed")
    graph.publish("right/image_rect", image(right, stamp))
    graph.publish("left/image_rect", bad, n_subscriptions=2)
    status = graph.status("short_range", lambda status: value(status, "frames failed") == failed + 1)
    assert re.search(r"'x{400,500}… \(100\d{3} characters\)$", status.message.splitlines()[0])
    assert len(str(graph.status("short_range", name="left/image_rect"))) < 5000
    graph.status("short_range", lambda status: status.message == "running")


@pytest.mark.parametrize(
    ("side", "info", "reason"),
    [
        ("right", camera_info(right=True, baseline_m=0.0), "P[3] = -0, thus no baseline"),
        ("right", camera_info(right=True, fx=float("nan")), "P[0] = nan"),
        ("left", camera_info(fx=0.0), "CameraInfo of 'left_optical' is not calibrated"),
    ],
)
def test_camera_info_that_cannot_be_one_is_refused_and_the_one_before_stays(graph, side, info, reason):
    left, right = stereo_pair()
    publish(graph, left, right, (first := next(STAMPS)))
    graph.at("short_range/mask", first)
    failed, name = value(graph.status("short_range"), "frames failed"), f"{side}/camera_info"
    refused = value(graph.status("short_range", name=name), "refused")
    graph.publish(name, info)
    status = graph.status("short_range", lambda status: value(status, "refused") == refused + 1, name=name)
    assert status.level > DiagnosticStatus.OK
    assert re.search(rf"\d of \d messages on /stereo/{name} refused in the last 0.3 s", status.message)
    assert reason in status.message
    assert reason in next(item.value for item in status.values if item.key == "last refusal")
    stamp = next(STAMPS)
    graph.publish("right/image_rect", image(right, stamp))
    graph.publish("left/image_rect", image(left, stamp), n_subscriptions=2)
    assert graph.at("short_range/mask", stamp).width == WIDTH
    assert value(graph.status("short_range"), "frames failed") == failed


def test_camera_info_for_another_size_is_reported(graph):
    left, right = stereo_pair()
    graph.publish("left/camera_info", camera_info(size=(WIDTH, HEIGHT)))
    bad_stamp, good_stamp = next(STAMPS), next(STAMPS)
    graph.publish("right/image_rect", image(right, bad_stamp))
    graph.publish("left/image_rect", image(left, bad_stamp), n_subscriptions=2)
    status = graph.status("short_range", lambda status: "frames failed" in status.message)
    assert "calibration is for 120 x 160 pixels, but the image is 160 x 120" in status.message
    publish(graph, left, right, good_stamp)
    assert graph.at("short_range/mask", good_stamp).width == WIDTH


def test_stamps_that_never_pair_are_explained(graph, monkeypatch):
    monkeypatch.setattr("lrtrav_ros.nodes.inputs.PATIENCE_S", 0.0)
    left, right = stereo_pair()
    stamp = next(STAMPS)
    before = value(graph.status("short_range"), "frames received")
    graph.publish("right/image_rect", image(right, stamp + 40_000_000))
    graph.publish("left/image_rect", image(left, stamp), n_subscriptions=2)
    status = graph.status("short_range", lambda status: value(status, "frames received") == before + 1)
    assert status.level > DiagnosticStatus.OK
    assert f"/stereo/left/image_rect: {before + 1:.0f} received, last stamp {stamp / 1e9:.6f}" in status.message
    assert "/stereo/right/image_rect: " in status.message
    assert f"last stamp {(stamp + 40_000_000) / 1e9:.6f}" in status.message
    assert "stamps differ by at least 0.04 s, allowed are 0.005 s" in status.message
    silent = graph.status(
        "short_range", lambda status: status.message == "no message in the last 0.3 s", name="left/image_rect"
    )
    assert silent.level == DiagnosticStatus.ERROR
    good_stamp = next(STAMPS)
    publish(graph, left, right, good_stamp)
    graph.at("long_range/mask", good_stamp)
    assert value(graph.status("short_range"), "frames unpaired") >= 1


def test_one_late_image_keeps_no_other_from_pairing(graph):
    left, right = stereo_pair()
    stamp = next(STAMPS)
    graph.publish("left/image_rect", image(left, stamp), n_subscriptions=2)
    graph.publish("left/image_rect", image(left, stamp - 10**9), n_subscriptions=2)
    graph.publish("right/image_rect", image(right, stamp))
    assert graph.at("long_range/mask", stamp).width == WIDTH


def test_an_occupancy_of_16_bits_is_reported(graph):
    left, right = stereo_pair()
    stamp, good_stamp = next(STAMPS), next(STAMPS)
    graph.publish("left/image_rect", image(left, stamp), n_subscriptions=2)
    graph.publish("short_range/occupancy", image(np.full((HEIGHT, WIDTH), 40_000, np.uint16), stamp))
    status = graph.status("long_range", lambda status: "refused" in status.message)
    assert "messages on /stereo/short_range/occupancy refused in the last 0.3 s" in status.message
    assert "occupancy has shape (120, 160) and type uint16; give mono8" in status.message
    names = "/stereo/short_range and /stereo/tester"
    assert f"2 publishers on /stereo/short_range/occupancy: {names}; end all but one, or remap" in status.message
    graph.stop_publishing("short_range/occupancy")
    publish(graph, left, right, good_stamp)
    assert graph.at("long_range/mask", good_stamp).width == WIDTH


def test_16_bit_pairs_give_what_the_detector_gives(graph):
    grey = [pixels[..., 1].astype(np.uint16) for pixels in stereo_pair()]
    left, right = grey[0] * 5, grey[1] * 9  # 11 and 12 bits
    stamp = next(STAMPS)
    publish(graph, left, right, stamp)
    expected = Detector(Config().updated(SETTINGS), CAMERA).detect(left, right)
    np.testing.assert_array_equal(decode_message(graph.at("long_range/mask", stamp)), expected.long_range.mask)


def test_frames_after_a_jump_back_in_time_are_processed(graph):
    left, right = stereo_pair()
    graph.publish("left/image_rect", image(left, next(STAMPS)), n_subscriptions=2)  # waits for ever
    stamp = 1_600_000_000_000_000_000
    publish(graph, left, right, stamp)
    assert graph.at("long_range/mask", stamp).width == WIDTH


@pytest.mark.parametrize("sides", [("left",), ("right", "left")])
@pytest.mark.parametrize(
    ("sec", "nanosec"), [(2**31 - 1, 2**32 - 1), (-(2**31), 0), (-1, 10**9), (0, 0), (10, 2**32 - 1)]
)
def test_stamps_of_no_time_keep_no_other_frame_from_its_answer(graph, sec, nanosec, sides):
    pair = dict(zip(("left", "right"), stereo_pair(), strict=True))
    for side in sides:
        odd = image(pair[side], 0)
        odd.header.stamp = Time(sec=sec, nanosec=nanosec)
        graph.publish(f"{side}/image_rect", odd, n_subscriptions=2 if side == "left" else 1)
    if len(sides) == 2:
        graph.at("long_range/mask", sec * 10**9 + nanosec)  # and it is one as any other
    stamp = next(STAMPS)
    publish(graph, pair["left"], pair["right"], stamp)
    assert graph.at("long_range/mask", stamp).width == WIDTH


def test_the_newest_frame_wins(graph, monkeypatch):
    entered, gate = threading.Event(), threading.Event()
    detect = ShortRangeDetector.detect

    def gated(self, frame):
        entered.set()
        assert gate.wait(10)
        return detect(self, frame)

    monkeypatch.setattr(ShortRangeDetector, "detect", gated)
    left, right = stereo_pair()
    before = graph.status("short_range")
    stamps = [next(STAMPS) for _ in range(4)]
    publish(graph, left, right, stamps[0])
    graph.spin_until(entered.is_set)
    for stamp in stamps[1:]:
        publish(graph, left, right, stamp)
    received = value(before, "frames received") + 4
    graph.status("short_range", lambda status: value(status, "frames received") == received)
    gate.set()
    graph.at("short_range/mask", stamps[-1])
    processed = value(before, "frames processed") + 2
    after = graph.status("short_range", lambda status: value(status, "frames processed") == processed)
    assert value(after, "frames dropped") - value(before, "frames dropped") == 2
    seen = {header_stamp_ns(message) for message in graph.received["short_range/mask"]}
    assert seen & set(stamps) == {stamps[0], stamps[-1]}


def test_an_unexpected_error_does_not_end_the_worker(graph, monkeypatch):
    left, right = stereo_pair()
    with monkeypatch.context() as patch:
        patch.setattr(ShortRangeDetector, "detect", lambda self, frame: 1 // 0)
        publish(graph, left, right, next(STAMPS))
        status = graph.status("short_range", lambda status: "frames failed in" in status.message)
    assert " s ago: integer division or modulo by zero" in status.message
    stamp = next(STAMPS)
    publish(graph, left, right, stamp)
    assert graph.at("short_range/mask", stamp).width == WIDTH


def drawn(detection):
    return overlay(detection.image, detection.short_range.occupancy, detection.long_range.occupancy)


@pytest.mark.parametrize(
    ("topic", "encoding", "expected"),
    [
        ("short_range/u_disparity", "mono16", lambda detection: detection.short_range.u_disparity),
        ("short_range/v_disparity", "mono16", lambda detection: detection.short_range.v_disparity),
        ("short_range/obstacle_disparity", "32FC1", lambda detection: detection.short_range.obstacle_disparity),
        ("long_range/superpixels", "mono16", lambda detection: detection.long_range.superpixels),
        ("long_range/clusters", "mono16", lambda detection: detection.long_range.clusters),
        ("long_range/confidence", "mono8", lambda detection: detection.long_range.confidence),
        ("long_range/overlay", "bgr8", drawn),
    ],
)
def test_debug_topics_when_subscribed(graph, topic, encoding, expected):
    subscription = graph.listen(Image, topic)
    publisher = next(p for node in graph.nodes for p in node.publishers if p.topic_name == f"/stereo/{topic}")
    graph.spin_until(lambda: publisher.get_subscription_count() == 1)
    left, right = stereo_pair()
    stamp = next(STAMPS)
    publish(graph, left, right, stamp)
    message = graph.at(topic, stamp)
    assert (message.encoding, message.header.frame_id) == (encoding, FRAME_ID)
    detection = Detector(Config().updated(SETTINGS), CAMERA).detect(left, right)
    np.testing.assert_array_equal(decode_message(message), expected(detection))
    graph.tester.destroy_subscription(subscription)
    graph.spin_until(lambda: publisher.get_subscription_count() == 0)


def test_debug_topics_cost_nothing_when_nobody_subscribes(graph, monkeypatch):
    calls = []
    monkeypatch.setattr("lrtrav_ros.nodes.long_range_outputs.overlay", lambda *arguments: calls.append(arguments))
    monkeypatch.setattr("lrtrav_ros.nodes.messages.as_uint16", calls.append)
    monkeypatch.setattr("lrtrav_ros.detector.spectral_clusters", lambda *arguments: calls.append(arguments))
    stamp = next(STAMPS)
    publish(graph, *stereo_pair(), stamp)
    graph.at("long_range/occupancy", stamp)
    assert graph.status("long_range").message == "running"
    assert calls == []


def test_parameters_change_while_running(graph):
    client = graph.tester.create_client(SetParameters, "short_range/set_parameters")
    graph.spin_until(client.service_is_ready)

    def answer(name, setting):
        request = SetParameters.Request(parameters=[Parameter(name, value=setting).to_parameter_msg()])
        future = client.call_async(request)
        graph.spin_until(future.done)
        return future.result().results[0]

    refused = answer("stereo.matcher", "magic")
    assert not refused.successful
    assert refused.reason == "stereo.matcher is 'magic'; give one of elas, sgbm, bm"
    assert answer("stereo.matcher", "bm").successful
    left, right = stereo_pair()
    stamp = next(STAMPS)
    publish(graph, left, right, stamp)
    disparity = decode_message(graph.at("disparity", stamp).image)
    expected = Detector(Config().updated({**SETTINGS, "stereo.matcher": "bm"}), CAMERA).detect(left, right).disparity
    np.testing.assert_array_equal(disparity, np.where(expected > 0, expected, np.float32(-1)))
    assert answer("stereo.matcher", "sgbm").successful


def test_inputs_are_best_effort_and_outputs_reliable(graph):
    inputs = ("left/image_rect", "right/image_rect", "left/camera_info", "right/camera_info")
    subscriptions = [info for topic in inputs for info in graph.tester.get_subscriptions_info_by_topic(topic)]
    own = [info for info in subscriptions if info.node_name in ("short_range", "long_range")]
    assert len(own) == 5
    assert {info.qos_profile.reliability for info in own} == {QoSReliabilityPolicy.BEST_EFFORT}
    for topic in (*OUTPUTS, "disparity"):
        infos = [i for i in graph.tester.get_publishers_info_by_topic(topic) if i.node_name != "tester"]
        assert [info.qos_profile.reliability for info in infos] == [QoSReliabilityPolicy.RELIABLE]


def test_quality_of_service_can_be_overridden(ros):
    name = "qos_overrides./qos/left/image_rect.subscription.reliability"
    node = LongRangeNode(namespace="qos", parameter_overrides=[Parameter(name, value="reliable")])
    try:
        infos = node.get_subscriptions_info_by_topic("left/image_rect")
        assert [info.qos_profile.reliability for info in infos] == [QoSReliabilityPolicy.RELIABLE]
        assert node.get_parameter(name.replace("reliability", "depth")).value == 5
    finally:
        node.destroy_node()
