"""The other sources of the short-range node: disparity, depth, and compressed images."""

import itertools

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_graph import CAMERA, N_DISPARITIES, Graph, camera_info, ground_disparity, header, image, stereo_pair, value
from sensor_msgs.msg import CompressedImage, Image
from stereo_msgs.msg import DisparityImage

from lrtrav_ros import Config, Detector, StereoCamera
from lrtrav_ros.io.camera_info import VIRTUAL_BASELINE_M
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.messages import array_to_image, disparity_to_message
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

SETTINGS = {
    "stereo.matcher": "bm",
    "stereo.n_disparities": N_DISPARITIES,
    "superpixels.n_superpixels": 40,
    "memory.frames": 0,  # each frame is compared with what the detector finds in it alone
}
STAMPS = itertools.count(1_700_000_000_000_000_000, 100_000_000)


def make_graph(source, **more):
    settings = {**SETTINGS, "source": source, **more}
    graph = Graph(LongRangeNode, ShortRangeNode, namespace=f"{source}_{len(more)}", settings=settings)
    for topic in ("short_range/occupancy", "long_range/mask"):
        graph.listen(Image, topic)
    return graph, Config().updated(settings)


def results(graph, stamp):
    return [decode_message(graph.at(topic, stamp)) for topic in ("short_range/occupancy", "long_range/mask")]


def assert_same(graph, stamp, detection):
    occupancy, mask = results(graph, stamp)
    np.testing.assert_array_equal(occupancy, detection.short_range.occupancy)
    np.testing.assert_array_equal(mask, detection.long_range.mask)
    assert np.mean(mask[60:] == 255) > 0.9


@pytest.fixture(scope="module")
def of_disparity(ros):
    graph, config = make_graph("disparity")
    yield graph, config
    graph.close()


@pytest.fixture(scope="module")
def of_depth(ros):
    graph, config = make_graph("depth", **{"source.max_depth_m": 20.0})
    graph.listen(DisparityImage, "disparity")
    yield graph, config
    graph.close()


@pytest.fixture(scope="module")
def of_compressed(ros):
    graph, config = make_graph("stereo", **{"source.compressed": True})
    yield graph, config
    graph.close()


def test_disparity_from_elsewhere(of_disparity):
    graph, config = of_disparity
    left, disparity = stereo_pair()[0], ground_disparity()
    stamp = next(STAMPS)
    graph.publish("left/camera_info", camera_info())
    graph.publish("left/image_rect", image(left, stamp))
    graph.publish("disparity", disparity_to_message(disparity, header(stamp), CAMERA, n_disparities=N_DISPARITIES))
    camera = StereoCamera(
        fx=CAMERA.fx, fy=CAMERA.fx, cx=CAMERA.cx, cy=CAMERA.cy, baseline_m=float(np.float32(CAMERA.baseline_m))
    )
    assert_same(graph, stamp, Detector(config, camera).detect(left, disparity=disparity))
    assert graph.tester.count_publishers("disparity") == 1  # the tester's own: the node does not answer itself


def test_disparity_without_geometry_is_reported(of_disparity):
    graph, _ = of_disparity
    graph.publish("left/camera_info", camera_info())
    message = DisparityImage(header=header(next(STAMPS)), image=image(ground_disparity(), 0), f=0.0, t=0.2)
    graph.publish("disparity", message)
    status = graph.status("short_range", lambda status: "last frame failed" in status.message)
    assert "f = 0 and t = 0.2" in status.message
    assert value(status, "frames failed") == 1


@pytest.mark.parametrize("encoding", ["32FC1", "16UC1"])
def test_depth(of_depth, encoding):
    graph, config = of_depth
    left, disparity = stereo_pair()[0], ground_disparity()
    camera = StereoCamera(fx=CAMERA.fx, fy=CAMERA.fx, cx=CAMERA.cx, cy=CAMERA.cy, baseline_m=VIRTUAL_BASELINE_M)
    depth_m = CAMERA.depth_m(disparity)
    stamp = next(STAMPS)
    if encoding == "16UC1":
        message = array_to_image(np.minimum(np.rint(depth_m * 1000), 65535).astype(np.uint16), header(stamp))
        message.encoding = encoding
        depth_m = np.minimum(np.rint(depth_m * 1000), 65535).astype(np.uint16).astype(np.float32) / np.float32(1000)
    else:
        message = array_to_image(np.where(depth_m > 0, depth_m, np.float32(np.nan)), header(stamp))
    graph.publish("left/camera_info", camera_info())
    graph.publish("left/image_rect", image(left, stamp))
    graph.publish("depth/image_rect", message)
    assert_same(graph, stamp, Detector(config, camera).detect(left, depth_m=depth_m))
    out = graph.at("disparity", stamp)
    assert out.t == pytest.approx(VIRTUAL_BASELINE_M)
    valid = decode_message(out.image) >= 0
    np.testing.assert_array_equal(valid, (depth_m > 0) & (depth_m <= 20.0))


def test_depth_of_another_stamp_within_the_tolerance(of_depth):
    graph, _ = of_depth
    left = stereo_pair()[0]
    stamp = next(STAMPS)
    graph.publish("left/image_rect", image(left, stamp))
    graph.publish("depth/image_rect", image(CAMERA.depth_m(ground_disparity()), stamp + 4_000_000))
    assert graph.at("long_range/mask", stamp).width == left.shape[1]


def test_silence_is_explained(of_depth, monkeypatch):
    monkeypatch.setattr("lrtrav_ros.nodes.inputs.PATIENCE_S", 0.0)
    status = of_depth[0].status("short_range", lambda status: status.message != "running")
    assert "no message for 0 s; /depth_1/depth/image_rect: " in status.message


def test_compressed_images(of_compressed):
    graph, config = of_compressed
    left, right = stereo_pair()
    stamp = next(STAMPS)
    graph.publish("left/camera_info", camera_info())
    graph.publish("right/camera_info", camera_info(right=True))
    for side, pixels, n_subscriptions in (("right", right, 1), ("left", left, 2)):
        data = cv2.imencode(".png", pixels)[1].tobytes()
        message = CompressedImage(header=header(stamp), format="bgr8; png compressed bgr8", data=data)
        graph.publish(f"{side}/image_rect/compressed", message, n_subscriptions)
    occupancy, mask = results(graph, stamp)
    detection = Detector(config, CAMERA).detect(left, right)
    np.testing.assert_array_equal(occupancy, detection.short_range.occupancy)
    np.testing.assert_array_equal(mask, detection.long_range.mask)


def test_a_broken_compressed_image_is_reported(of_compressed):
    graph, _ = of_compressed
    stamp = next(STAMPS)
    for side, n_subscriptions in (("right", 1), ("left", 2)):
        message = CompressedImage(header=header(stamp), format="jpeg", data=b"\xff\xd8\xff")
        graph.publish(f"{side}/image_rect/compressed", message, n_subscriptions)
    status = graph.status("short_range", lambda status: "last frame failed" in status.message)
    assert "compressed image of format 'jpeg'" in status.message
