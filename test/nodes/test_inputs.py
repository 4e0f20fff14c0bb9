"""The other sources of the short-range node: disparity, depth, and compressed images."""

import dataclasses
import itertools
import re
import time

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy")

from raw_cameras import calibrations
from rclpy.serialization import serialize_message
from ros_graph import (
    CAMERA,
    FRAME_ID,
    HEIGHT,
    N_DISPARITIES,
    WIDTH,
    Graph,
    camera_info,
    ground_disparity,
    header,
    image,
    stereo_pair,
    value,
)
from rvl_writer import rvl_of
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from stereo_msgs.msg import DisparityImage

from lrtrav_ros import Config, Detector, StereoCamera
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.camera_info import VIRTUAL_BASELINE_M, depth_camera
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.messages import array_to_image, disparity_to_message
from lrtrav_ros.nodes.short_range_node import ShortRangeNode
from lrtrav_ros.rectification import Lens, RawPair, Rectification

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


def assert_same(graph, stamp, detection, unseen=np.zeros((HEIGHT, WIDTH), np.bool_)):  # noqa: B008 - never changed
    occupancy, mask = results(graph, stamp)
    np.testing.assert_array_equal(occupancy, detection.short_range.occupancy)
    np.testing.assert_array_equal(mask, detection.long_range.mask)
    assert np.mean(mask[60:][~unseen[60:]] == 255) > 0.9


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
def of_compressed_depth(ros):
    settings = {"source": "depth", "source.compressed": True}
    graph = Graph(ShortRangeNode, namespace="compressed_depth", settings=settings)
    graph.listen(Image, "short_range/occupancy")
    yield graph, Config().updated(settings)
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
    status = graph.status("short_range", lambda status: "frames failed" in status.message)
    assert "f = 0 and t = 0.2" in status.message
    assert value(status, "frames failed") == 1


def test_calibration_that_cannot_be_decoded_is_refused(of_disparity):
    graph, _ = of_disparity
    topic = "left/camera_info"
    before = graph.status("short_range", name=topic)
    data = serialize_message(camera_info())
    no_text = data[:16] + b"\xff\xfe\xc0\x80" + data[20:]
    for n, damaged in enumerate((data[:4], data[:60], no_text), start=1):
        graph.publisher(CameraInfo, topic).publish(damaged)
        refused = value(before, "refused") + n
        status = graph.status("short_range", lambda status, n=refused: value(status, "refused") == n, name=topic)
    assert value(status, "received") == value(before, "received") + 3
    reason = next(item.value for item in status.values if item.key == "last refusal")
    assert reason.startswith(f"damaged message: {len(data)} bytes are no sensor_msgs/msg/CameraInfo")


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


@pytest.mark.parametrize("compression", ["png", "rvl"])
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_compressed_depth(of_compressed_depth, compression, encoding):
    graph, config = of_compressed_depth
    depth_m = CAMERA.depth_m(ground_disparity())
    if encoding == "16UC1":
        parameters = (0.0, 0.0)
        stored = np.minimum(np.rint(depth_m * 1000), 65535).astype(np.uint16)
        depth_m = stored.astype(np.float32) / np.float32(1000)
    else:
        parameters = (1000.0, 2.0)  # of the inverse depth that is stored: 1000 / depth + 2
        stored = np.where(depth_m > 0, np.rint(1000 / np.maximum(depth_m, 0.1) + 2), 0).astype(np.uint16)
        depth_m = np.where(stored > 0, np.float32(1000) / (stored.astype(np.float32) - 2), np.float32(0))
    size = np.array(stored.shape[::-1], "<u4").tobytes()
    pixels = cv2.imencode(".png", stored)[1].tobytes() if compression == "png" else size + rvl_of(stored)
    data = bytes(4) + np.array(parameters, "<f4").tobytes() + pixels
    stamp = next(STAMPS)
    graph.publish("left/camera_info", camera_info())
    message = CompressedImage(header=header(stamp), format=f"{encoding}; compressedDepth {compression}", data=data)
    graph.publish("depth/image_rect/compressedDepth", message)
    occupancy = decode_message(graph.at("short_range/occupancy", stamp))
    expected = ShortRangeDetector(config).detect(Frame(camera=depth_camera(camera_info()), depth_m=depth_m)).occupancy
    np.testing.assert_array_equal(occupancy, expected)
    assert np.mean(occupancy[60:] == 0) > 0.9


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
    assert re.match(r"no message for \d+ s; /depth_1/depth/image_rect: ", status.message)


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
    status = graph.status("short_range", lambda status: "refused" in status.message)
    assert "messages on /stereo_1/left/image_rect/compressed refused" in status.message
    assert "compressed image of format 'jpeg'" in status.message


TURN = cv2.Rodrigues(np.array([0.01, -0.02, 0.015]))[0]
LENS = Lens(
    width=WIDTH,
    height=HEIGHT,
    fx=170.0,
    fy=169.0,
    cx=81.0,
    cy=42.0,
    distortion_model="plumb_bob",
    distortion=(-0.2, 0.04, 0.001, -0.001, 0.0),
)
RAW = RawPair(
    left=LENS,
    right=dataclasses.replace(LENS, cx=78.0),
    left_rotation=tuple(TURN.reshape(-1)),
    right_rotation=tuple(TURN.T.reshape(-1)),
    camera=dataclasses.replace(CAMERA, width=WIDTH, height=HEIGHT),
)


def raw_pair_of_ground():
    """Return the raw images of flat ground."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    p = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]])
    sides = ((RAW.left, RAW.left_rotation), (RAW.right, RAW.right_rotation))
    raw = []
    for pixels, (lens, turn) in zip(stereo_pair(), sides, strict=True):
        points = np.dstack([u, v]).reshape(-1, 1, 2)
        seen = cv2.undistortPoints(points, lens.matrix, lens.coefficients, R=np.reshape(turn, (3, 3)), P=p)
        smooth = cv2.normalize(cv2.GaussianBlur(pixels, (0, 0), 1), None, 0, 255, cv2.NORM_MINMAX)
        raw.append(cv2.remap(smooth, seen.reshape(HEIGHT, WIDTH, 2), None, cv2.INTER_LINEAR))
    return raw


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "compressed"])
def of_raw(ros, request):
    more = {"source.rectify": True, "source.compressed": request.param, "stereo.matcher": "elas"}
    graph, config = make_graph("stereo", **more)
    graph.listen(Image, "left/image_rect")
    yield graph, config
    graph.close()


def publish_raw(graph, config, stamp, raw, **changed):
    """Publish a raw pair and its calibration, with some fields changed."""
    for i, side in ((1, "right"), (0, "left")):
        fields = {**calibrations(RAW)[i], **changed}
        graph.publish(f"{side}/camera_info", CameraInfo(header=header(0), **fields))
        if config.source.compressed:
            data = cv2.imencode(".png", raw[i])[1].tobytes()
            message = CompressedImage(header=header(stamp), format="bgr8; png compressed bgr8", data=data)
            graph.publish(f"{side}/image_raw/compressed", message)
        else:
            graph.publish(f"{side}/image_raw", image(raw[i], stamp))


def test_raw_pairs_are_rectified(of_raw):
    graph, config = of_raw
    raw, stamp = raw_pair_of_ground(), next(STAMPS)
    publish_raw(graph, config, stamp, raw)
    rectification = Rectification(RAW)
    left, right = rectification.rectify(*raw)
    assert 0.01 < rectification.unseen.mean() < 0.3
    frame = Frame(camera=RAW.camera, left=left, right=right, unseen=rectification.unseen)
    assert_same(graph, stamp, Detector(config).detect_frame(frame), rectification.unseen)
    assert not results(graph, stamp)[1][rectification.unseen].any()
    published = graph.at("left/image_rect", stamp)
    np.testing.assert_array_equal(decode_message(published), left)
    assert published.header.frame_id == FRAME_ID


def test_a_slow_calibration_is_waited_for_in_silence(of_raw, monkeypatch):
    graph, _ = of_raw
    monkeypatch.setattr("lrtrav_ros.nodes.inputs.CALIBRATION_PATIENCE_S", 60.0)
    calibrated = graph.nodes[1]._input.calibrated
    calibrated.forget()
    calibrated.put(None, None)
    assert calibrated.problem() == ""
    monkeypatch.setattr("lrtrav_ros.nodes.inputs.CALIBRATION_PATIENCE_S", 0.0)
    assert "no CameraInfo yet" in calibrated.problem()
    calibrated.forget()


def test_a_lens_that_cannot_be_rectified_is_refused(of_raw):
    graph, _ = of_raw
    fields, begin_s = {**calibrations(RAW)[0], "distortion_model": "fov"}, time.time()
    graph.publish("left/camera_info", CameraInfo(header=header(0), **fields), n_subscriptions=2)
    for node in ("short_range", "long_range"):
        status = graph.status(node, lambda status: "refused" in status.message, since_s=begin_s)
        assert "/left/camera_info refused" in status.message
        assert "distortion model 'fov' is not supported" in status.message
