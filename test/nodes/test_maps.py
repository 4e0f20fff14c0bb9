"""What the nodes publish in metres: clouds, depth, the camera's pose, the grid and the segmentation, over DDS."""

import itertools
import re

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from ros_graph import (
    CAMERA,
    CAMERA_HEIGHT_M,
    FRAME_ID,
    HEIGHT,
    N_DISPARITIES,
    WIDTH,
    Graph,
    NodePair,
    camera_info,
    ground_disparity,
    header,
    image,
    stereo_pair,
    value,
)
from sensor_msgs.msg import Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from lrtrav_ros import Config, Detector
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.mapping.grid import ground_grid
from lrtrav_ros.mapping.points import free_points, obstacle_points
from lrtrav_ros.mapping.segmentation import segmentation_mask, segmentation_points
from lrtrav_ros.nodes import long_range_outputs
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.messages import disparity_to_message
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

SETTINGS = {
    "stereo.matcher": "sgbm",
    "stereo.n_disparities": N_DISPARITIES,
    "superpixels.n_superpixels": 40,
    "memory.frames": 0,
    "maps.length_m": 12.0,
    "maps.width_m": 8.0,
}
CONFIG = Config().updated(SETTINGS)
STAMPS = itertools.count(1_700_000_000_123_000_000, 100_000_000)
SEGMENTATION = {
    "segmentation/mask": Image,
    "segmentation/confidence": Image,
    "segmentation/points": PointCloud2,
}
OUTPUTS = {
    "obstacles": PointCloud2,
    "free": PointCloud2,
    "depth": Image,
    "short_range/ground_pose": PoseStamped,
    "short_range/ground_disparity": DisparityImage,
    "long_range/grid": OccupancyGrid,
}


def listen(graph):
    """Listen to all outputs, and wait until the nodes know it."""
    for topic, kind in OUTPUTS.items():
        graph.listen(kind, topic)
    qos = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)
    for topic, kind in SEGMENTATION.items():
        graph.tester.create_subscription(kind, topic, graph.received[topic].append, qos)
    wanted = {f"{graph.tester.get_namespace()}/{topic}" for topic in (*OUTPUTS, *SEGMENTATION)}
    publishers = [each for node in graph.nodes for each in node.publishers if each.topic_name in wanted]
    assert len(publishers) == len(wanted)
    graph.spin_until(lambda: all(each.get_subscription_count() for each in publishers))


@pytest.fixture(scope="module")
def linked(ros):
    pair = NodePair()
    graph = Graph(pair.long_range, pair.short_range, namespace="maps_linked", settings=SETTINGS)
    listen(graph)
    yield graph
    graph.close()


@pytest.fixture(scope="module")
def apart(ros):
    """Nodes as in two processes: all goes over topics."""
    graph = Graph(LongRangeNode, ShortRangeNode, namespace="maps_apart", settings=SETTINGS)
    listen(graph)
    names = ("disparity", "short_range/ground_disparity")
    graph.spin_until(lambda: all(graph.tester.count_subscribers(name) > (name != names[0]) for name in names))
    yield graph
    graph.close()


def pair_with_box(seed=0):
    """Return the pair of the flat ground with a box on it, 4 m away, 1 m wide and 1 m high."""
    left, _ = stereo_pair(seed)
    disparity = ground_disparity()
    d = round(CAMERA.fx * CAMERA.baseline_m / 4.0)
    foot = round(CAMERA.cy + d * CAMERA_HEIGHT_M / CAMERA.baseline_m)
    disparity[foot - 37 : foot, 61:99] = d
    right = np.random.default_rng(seed + 1).integers(0, 256, left.shape, np.uint8)  # seen in this image alone
    u = np.arange(WIDTH)
    for v in range(HEIGHT):
        for column in np.argsort(disparity[v], kind="stable"):  # what is near comes last, and hides the rest
            target = u[column] - round(float(disparity[v, column]))
            if target >= 0:
                right[v, target] = left[v, column]
    return left, right


def publish(graph, pair, stamp, *, n_left=1, n_info=1):
    graph.publish("left/camera_info", camera_info(), n_subscriptions=n_info)
    graph.publish("right/camera_info", camera_info(right=True))
    graph.publish("right/image_rect", image(pair[1], stamp))
    graph.publish("left/image_rect", image(pair[0], stamp), n_subscriptions=n_left)


def points_of(message):
    return np.frombuffer(message.data, np.float32).reshape(message.height, message.width, -1)[..., :3]


def cells_of(message):
    return np.array(message.data, np.int8).reshape(message.info.height, message.info.width)


def expected_grid(found):
    short = found.short_range
    return ground_grid(found.long_range.occupancy, short, CAMERA, CONFIG.maps)


@pytest.fixture(scope="module")
def pair():
    return pair_with_box()


@pytest.fixture(scope="module")
def found(pair):
    return Detector(CONFIG, CAMERA).detect(*pair)


@pytest.fixture(scope="module")
def messages(linked, pair):
    stamp = next(STAMPS)
    publish(linked, pair, stamp)
    return {topic: linked.at(topic, stamp) for topic in (*OUTPUTS, *SEGMENTATION)}


def test_clouds_are_those_of_the_frame_in_the_camera_frame(messages, found):
    short = found.short_range
    obstacles = obstacle_points(short.disparity, short.occupancy, short.line, CAMERA, CONFIG.maps)
    free = free_points(short.occupancy, short.line, CAMERA, CONFIG.maps)
    assert len(obstacles) > 20
    for topic, points in (("obstacles", obstacles), ("free", free)):
        message = messages[topic]
        assert message.header.frame_id == FRAME_ID
        assert [field.name for field in message.fields] == ["x", "y", "z"]
        np.testing.assert_array_equal(points_of(message)[0], points)
    assert np.median(points_of(messages["obstacles"])[0, :, 2]) == pytest.approx(4.0, abs=0.3)


def test_depth_is_in_metres_with_0_for_none(messages, found):
    message = messages["depth"]
    assert message.encoding == "32FC1"
    np.testing.assert_array_equal(decode_message(message), CAMERA.depth_m(found.short_range.disparity))


def test_pose_is_that_of_the_camera_over_the_ground(messages):
    message = messages["short_range/ground_pose"]
    assert message.header.frame_id == f"{FRAME_ID}_ground"
    position, orientation = message.pose.position, message.pose.orientation
    assert (position.x, position.y) == (0, 0)
    assert position.z == pytest.approx(CAMERA_HEIGHT_M, rel=0.03)
    # A camera that looks level: z ahead, x to the right.
    assert (orientation.x, orientation.y, orientation.z, orientation.w) == pytest.approx(
        (-0.5, 0.5, -0.5, 0.5), abs=0.02
    )


def test_grid_is_that_of_the_frame_in_the_ground_frame(messages, found):
    message, grid = messages["long_range/grid"], expected_grid(found)
    assert message.header.frame_id == f"{FRAME_ID}_ground"
    assert message.info.resolution == pytest.approx(0.1)
    assert (message.info.width, message.info.height) == (120, 80)
    assert (message.info.origin.position.x, message.info.origin.position.y) == (0, -4)
    cells = cells_of(message)
    np.testing.assert_array_equal(cells, grid.cells)
    assert np.all((cells[36:44, 35:40] == 100).any(axis=1))  # the box
    assert np.all(cells[36:44, 25:35] == 0)  # the way to it
    assert np.all(cells[36:44, 45:] == -1)  # behind it


def test_segmentation_has_class_and_place_of_each_pixel(messages, found):
    short, occupancy = found.short_range, found.long_range.occupancy
    np.testing.assert_array_equal(decode_message(messages["segmentation/mask"]), segmentation_mask(occupancy))
    np.testing.assert_array_equal(decode_message(messages["segmentation/confidence"]), found.long_range.confidence)
    message = messages["segmentation/points"]
    assert (message.height, message.width) == (HEIGHT, WIDTH)
    expected = segmentation_points(occupancy, short.disparity, short.line, CAMERA, CONFIG.maps)
    np.testing.assert_array_equal(points_of(message), expected)
    assert messages["segmentation/mask"].step == WIDTH


def test_parameters_of_maps_take_effect_with_the_next_frame(linked, messages, pair):
    long_range, short_range = linked.nodes
    try:
        long_range.set_parameters([Parameter("maps.width_m", value=6.0)])
        short_range.set_parameters([Parameter("maps.length_m", value=3.0)])  # the box is farther away
        publish(linked, pair, (stamp := next(STAMPS)))
        info = linked.at("long_range/grid", stamp).info
        assert (info.width, info.height, info.origin.position.y) == (120, 60, -3)
        assert linked.at("obstacles", stamp).width == 0
        depths = points_of(linked.at("free", stamp))[0, :, 2]
        assert 2 < depths.max() < 3.1
    finally:
        long_range.set_parameters([Parameter("maps.width_m", value=8.0)])
        short_range.set_parameters([Parameter("maps.length_m", value=12.0)])


def test_a_frame_whose_maps_cannot_be_made_fails_when_its_masks_are_out(linked, messages, pair, monkeypatch):
    def refuse(*parts):
        raise ValueError("too many cells")

    failed = value(linked.status("long_range"), "frames failed")
    with monkeypatch.context() as patch:
        patch.setattr(long_range_outputs, "ground_grid", refuse)
        publish(linked, pair, (stamp := next(STAMPS)))
        linked.at("segmentation/mask", stamp)
        status = linked.status("long_range", lambda status: value(status, "frames failed") == failed + 1)
    assert re.search(r" s ago: too many cells$", status.message, re.MULTILINE)
    publish(linked, pair, (stamp := next(STAMPS)))
    linked.at("long_range/grid", stamp)
    assert value(linked.status("long_range"), "frames failed") == failed + 1


def test_nodes_apart_give_the_same_maps(apart, pair, found):
    stamp = next(STAMPS)
    publish(apart, pair, stamp, n_left=2, n_info=2)
    np.testing.assert_array_equal(cells_of(apart.at("long_range/grid", stamp)), expected_grid(found).cells)
    points = points_of(apart.at("segmentation/points", stamp))
    short = found.short_range
    expected = segmentation_points(found.long_range.occupancy, short.disparity, short.line, CAMERA, CONFIG.maps)
    np.testing.assert_allclose(points, expected, rtol=1e-4, atol=1e-4)


def test_without_ground_the_grid_is_unknown(apart):
    stamp = next(STAMPS)
    flat = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    publish(apart, (flat, flat), stamp, n_left=2, n_info=2)
    assert np.all(cells_of(apart.at("long_range/grid", stamp)) == -1)


def test_maps_of_a_disparity_image(ros):
    graph = Graph(
        LongRangeNode, ShortRangeNode, namespace="maps_disparity", settings={**SETTINGS, "source": "disparity"}
    )
    try:
        graph.listen(OccupancyGrid, "long_range/grid")
        graph.spin_until(lambda: graph.tester.count_subscribers("disparity") == 2)
        stamp = next(STAMPS)
        message = disparity_to_message(ground_disparity(), header(stamp), CAMERA, n_disparities=N_DISPARITIES)
        graph.publish("left/camera_info", camera_info(), n_subscriptions=2)
        graph.publish("disparity", message, n_subscriptions=2)
        graph.publish("left/image_rect", image(stereo_pair()[0], stamp))
        cells = cells_of(graph.at("long_range/grid", stamp))
        assert np.mean(cells[38:42, 20:40] == 0) > 0.9
        assert not np.any(cells == 100)
    finally:
        graph.close()


def test_a_grid_in_the_frame_of_the_images_needs_no_tf_even_before_1970(ros):
    pair, stamp = NodePair(), -(10**9)
    settings = {**SETTINGS, "maps.frame": FRAME_ID}
    graph = Graph(pair.long_range, pair.short_range, namespace="maps_own_frame", settings=settings)
    try:
        graph.listen(OccupancyGrid, "long_range/grid")
        publish(graph, pair_with_box(), stamp)
        assert graph.at("long_range/grid", stamp).header.frame_id == FRAME_ID
    finally:
        graph.close()


def test_a_grid_in_another_frame_needs_tf(ros):
    from lrtrav_ros.nodes import transforms

    if transforms.tf2_ros is not None:
        pytest.skip("tf2_ros is installed")
    pair = NodePair()
    settings = {**SETTINGS, "maps.frame": "base_link"}
    graph = Graph(pair.long_range, pair.short_range, namespace="maps_framed", settings=settings)
    try:
        graph.listen(OccupancyGrid, "long_range/grid")
        publish(graph, pair_with_box(), next(STAMPS))
        status = graph.status("long_range", lambda status: status.message.startswith("no grid"))
        assert status.message == (
            f"no grid in base_link: no transform from '{FRAME_ID}' to 'base_link': install tf2_ros, which is not there"
        )
        assert graph.received["long_range/grid"] == []
    finally:
        graph.close()
