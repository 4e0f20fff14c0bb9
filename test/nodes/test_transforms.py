"""Poses from tf, and a node whose depth image has a camera of its own."""

import itertools

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from ros_graph import HEIGHT, WIDTH, Graph, camera_info, header, image
from sensor_msgs.msg import CameraInfo, Image

from lrtrav_ros import Config, StereoCamera
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.camera_info import depth_camera
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.nodes import transforms
from lrtrav_ros.nodes.short_range_node import ShortRangeNode
from lrtrav_ros.nodes.transforms import DepthPose, TransformLookup
from lrtrav_ros.pose import Pose
from lrtrav_ros.registration import DepthRegistration

POSE = "0.05 -0.01 0.02 0.01 -0.02 0.015"
DEPTH = StereoCamera(fx=90.0, cx=66.0, cy=40.0, baseline_m=0.1, width=132, height=96)
LEFT = depth_camera(camera_info())
STAMPS = itertools.count(1_700_000_000_000_000_000, 100_000_000)


@pytest.fixture
def node(ros):
    node = Node("asking")
    yield node
    node.destroy_node()


@pytest.fixture(scope="module")
def graph(ros):
    settings = {"source": "depth", "source.depth_registered": False, "source.depth_pose": POSE}
    graph = Graph(ShortRangeNode, namespace="unregistered", settings=settings)
    graph.listen(Image, "short_range/occupancy")
    yield graph
    graph.close()


def depth_info():
    p = [DEPTH.fx, 0.0, DEPTH.cx, 0.0, 0.0, DEPTH.fy, DEPTH.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    message = CameraInfo(header=header(0), height=DEPTH.height, width=DEPTH.width, p=p)
    message.header.frame_id = "depth_optical"
    return message


def ground_depth(camera, pose=None):
    """Return the depth (H, W) of flat ground, 1 m below the left camera, in a camera (of a pose)."""
    v, u = np.indices((camera.height, camera.width))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    origin = np.zeros(3)
    if pose is not None:
        rays, origin = rays @ pose.rotation.T, pose.translation_m
    depth = (1 - origin[1]) / np.maximum(rays[..., 1], 0.05)
    return np.where(depth < 10, depth, 0).astype(np.float32)


def test_a_node_registers_depth_by_the_pose_that_it_is_given(graph):
    depth_m = ground_depth(DEPTH, Pose.parsed(POSE))
    graph.publish("left/camera_info", camera_info())
    graph.publish("depth/camera_info", depth_info())
    stamp = next(STAMPS)
    graph.publish("depth/image_rect", image(depth_m, stamp))
    occupancy = decode_message(graph.at("short_range/occupancy", stamp))
    assert occupancy.shape == (HEIGHT, WIDTH)
    config = Config().updated({"source": "depth"})
    registered = DepthRegistration(DEPTH, LEFT, Pose.parsed(POSE)).registered(depth_m)
    expected = ShortRangeDetector(config).detect(Frame(camera=LEFT, depth_m=registered)).occupancy
    np.testing.assert_array_equal(occupancy, expected)
    itself = ShortRangeDetector(config).detect(Frame(camera=LEFT, depth_m=ground_depth(LEFT))).occupancy
    seen = (registered > 0) & (ground_depth(LEFT) > 0)
    assert seen.mean() > 0.4
    assert np.mean(occupancy[seen] == itself[seen]) > 0.99
    assert np.mean(occupancy[seen] == 0) > 0.95


def test_calibration_of_depth_is_awaited(ros):
    settings = {"source": "depth", "source.depth_registered": False}
    graph = Graph(ShortRangeNode, namespace="without_info", settings=settings)
    try:
        graph.publish("left/camera_info", camera_info())
        graph.publish("depth/image_rect", image(ground_depth(DEPTH), next(STAMPS)))
        status = graph.status("short_range", lambda status: "frames wait for it" in status.message)
        assert "no CameraInfo yet on /without_info/depth/camera_info; frames wait for it" in status.message
        graph.publish("depth/camera_info", depth_info())
        status = graph.status("short_range", lambda status: "no transform" in status.message)
        assert "from 'depth_optical' to 'left_optical'" in status.message
        assert "set source.depth_pose" in status.message
    finally:
        graph.close()


def test_frames_that_tf_does_not_connect(node):
    lookup = TransformLookup(node)
    assert lookup.pose("here", "there", stamp_ns=1_000_000_000) is None
    assert "no transform from 'there' to 'here': " in lookup.problem
    if transforms.tf2_ros is None:
        assert "install tf2_ros" in lookup.problem
    assert lookup.pose("here", "/here").translation_m.tolist() == [0, 0, 0]
    assert lookup.problem == ""


def test_a_pose_that_is_given_asks_no_tf(node):
    pose = DepthPose(node, POSE)
    found = pose.of(camera_info(), depth_info())
    np.testing.assert_array_equal(found.translation_m, Pose.parsed(POSE).translation_m)
    assert pose.problem == ""


def test_transforms_that_never_change(ros):
    messages = pytest.importorskip("tf2_msgs.msg")
    stamped = TransformStamped(header=header(0), child_frame_id="depth_optical")
    stamped.transform.translation.x = 0.25
    graph = Graph(namespace="static", settings={})
    try:
        lookup = TransformLookup(graph.tester)
        qos = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        publisher = graph.tester.create_publisher(messages.TFMessage, "/tf_static", qos)
        publisher.publish(messages.TFMessage(transforms=[stamped]))
        graph.spin_until(lambda: lookup.pose("left_optical", "depth_optical") is not None)
        assert lookup.pose("left_optical", "depth_optical").translation_m.tolist() == [0.25, 0, 0]
    finally:
        graph.close()
