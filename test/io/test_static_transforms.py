"""Poses from /tf_static, and bags whose depth images have a camera of their own."""

import numpy as np
import pytest
from recorder import ROS1, ROS2, START_NS, Recorder, read
from rosbags.typesys import get_types_from_msg
from scipy.spatial.transform import Rotation

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.detector import ShortRangeDetector
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.io.camera_info import VIRTUAL_BASELINE_M
from lrtrav_ros.io.recording import open_recording
from lrtrav_ros.io.static_transforms import TRANSFORMS_TYPE, StaticTransforms
from lrtrav_ros.pose import Pose

LEFT = StereoCamera(fx=150.0, cx=80.0, cy=40.0, baseline_m=VIRTUAL_BASELINE_M, width=160, height=120)
DEPTH = StereoCamera(fx=90.0, fy=91.0, cx=66.0, cy=40.0, baseline_m=VIRTUAL_BASELINE_M, width=132, height=96)
IN_BODY = {"body_left": "0.3 0.1 0.8 -1.6 0.05 -1.5", "depth": "0.31 0.02 0.82 -1.55 0.02 -1.55"}
POSE = Pose.parsed(IN_BODY["body_left"]).inverse() @ Pose.parsed(IN_BODY["depth"])


def quaternion(rotation):
    return Rotation.from_matrix(rotation).as_quat().tolist()


def transforms(poses, types=ROS2.types):
    """Return a TFMessage with the pose of each frame in its parent, by (parent, frame)."""
    geometry = "geometry_msgs/msg"
    stamped = []
    for (parent, child), pose in poses.items():
        translation = types[f"{geometry}/Vector3"](**dict(zip("xyz", pose.translation_m.tolist(), strict=True)))
        rotation = types[f"{geometry}/Quaternion"](**dict(zip("xyzw", quaternion(pose.rotation), strict=True)))
        stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        seq = {"seq": 0} if "seq" in types["std_msgs/msg/Header"].__annotations__ else {}
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=parent, **seq)
        transform = types[f"{geometry}/Transform"](translation=translation, rotation=rotation)
        stamped.append(types[f"{geometry}/TransformStamped"](header=header, child_frame_id=child, transform=transform))
    return types[TRANSFORMS_TYPE](transforms=stamped)


ROBOT = {
    ("base_link", "body_left"): Pose.parsed(IN_BODY["body_left"]),
    ("body_left", "left"): Pose.parsed("0 0 0 0 0 0"),
    ("/base_link", "/depth"): Pose.parsed(IN_BODY["depth"]),
    ("elsewhere", "alone"): Pose.parsed("0 0 0 0 0 0"),
}


def assert_same_pose(pose, expected):
    np.testing.assert_allclose(pose.rotation, expected.rotation, atol=1e-9)
    np.testing.assert_allclose(pose.translation_m, expected.translation_m, atol=1e-9)


def test_poses_along_the_tree():
    tree = StaticTransforms()
    tree.add(transforms(ROBOT))
    assert_same_pose(tree.pose("left", "depth"), POSE)
    assert_same_pose(tree.pose("depth", "/left"), POSE.inverse())
    assert_same_pose(tree.pose("base_link", "left"), Pose.parsed(IN_BODY["body_left"]))
    assert_same_pose(tree.pose("left", "left"), Pose.parsed("0 0 0 0 0 0"))
    assert tree.pose("left", "alone") is None
    assert tree.pose("left", "nowhere") is None


def test_circles_and_what_is_no_rotation():
    tree = StaticTransforms()
    still = Pose.parsed("0 0 0 0 0 0")
    message = transforms({("a", "b"): still, ("b", "a"): still, ("c", "d"): still})
    message.transforms[2].transform.rotation.w = 0.0
    tree.add(message)
    assert_same_pose(tree.pose("a", "b"), still)
    assert tree.pose("a", "c") is None
    assert tree.pose("c", "d") is None


def scene(camera, pose=None):
    """Return the depth (H, W) of flat ground, 0.8 m below the left camera, and of a box on it."""
    v, u = np.indices((camera.height, camera.width))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    origin = np.zeros(3)
    if pose is not None:
        rays, origin = rays @ pose.rotation.T, pose.translation_m
    down = np.maximum(rays[..., 1], 1e-3)
    ground = (0.8 - origin[1]) / down
    front = (3.0 - origin[2]) / rays[..., 2]
    x, y = origin[0] + front * rays[..., 0], origin[1] + front * rays[..., 1]
    is_box = (abs(x + 0.2) < 0.4) & (y > 0.1) & (y < 0.8)
    depth = np.where(is_box, front, ground)
    return np.where(depth < 9, depth, 0).astype(np.float32)


@pytest.fixture
def robot_recorder(any_recorder):
    """A recorder of any format whose types have tf's."""
    if any_recorder.is_ros1 and TRANSFORMS_TYPE not in ROS1.types:
        ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS_TYPE))
    return any_recorder


def record_camera(recorder, side, camera):
    """Record the CameraInfo of a camera, whose frame has its name."""
    header = recorder.header(START_NS)
    header.frame_id = side
    matrices = {
        "d": np.zeros(5),
        "k": np.eye(3).reshape(-1),
        "r": np.eye(3).reshape(-1),
        "p": np.array([camera.fx, 0, camera.cx, 0, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0]),
    }
    message = recorder.make(
        "sensor_msgs/msg/CameraInfo",
        header=header,
        height=camera.height,
        width=camera.width,
        distortion_model="plumb_bob",
        **{name.upper() if recorder.is_ros1 else name: value for name, value in matrices.items()},
        binning_x=0,
        binning_y=0,
        roi=recorder.region(),
    )
    recorder.write(f"/robot/{side}/camera_info", message, START_NS)


def left_image():
    return np.random.default_rng(0).integers(0, 256, (LEFT.height, LEFT.width), np.uint8)


def record(recorder, *, with_transforms=True):
    """Record a frame whose depth has a camera of its own."""
    record_camera(recorder, "left", LEFT)
    record_camera(recorder, "depth", DEPTH)
    recorder.image("/robot/left/image_rect", left_image(), START_NS, "mono8")
    millimetres = np.rint(scene(DEPTH, POSE) * 1000).astype(np.uint16)
    recorder.image("/robot/depth/image_rect", millimetres, START_NS, "16UC1")
    if with_transforms:
        # Recorded last: transforms that never change are published once, at any time.
        recorder.write("/tf_static", transforms(ROBOT, recorder.store.types), START_NS + 10**9)


def assert_registered(frame):
    """Check the frame's depth and what is ground in it against depth that the left camera itself sees."""
    expected = scene(LEFT)
    both = (frame.depth_m > 0) & (expected > 0)
    assert both.mean() > 0.5 * (expected > 0).mean()
    errors = np.abs(frame.depth_m - expected)[both] / expected[both]
    assert np.percentile(errors, 95) < 0.002  # others are at the edges of the box
    detector = ShortRangeDetector(Config().updated({"source": "depth"}))
    found = detector.detect(frame).occupancy
    wanted = detector.detect(Frame(camera=LEFT, left=left_image(), depth_m=np.where(both, expected, 0))).occupancy
    assert np.mean(wanted == 0) > 0.2
    assert np.mean(wanted == 100) > 0.02
    assert np.mean(found == wanted) > 0.98


def test_depth_is_registered_by_the_transforms_of_the_bag(robot_recorder):
    record(robot_recorder)
    (frame,), problems = read(robot_recorder, source="depth", depth_registered=False)
    assert problems == []
    assert frame.camera == LEFT
    assert_registered(frame)
    with BagReader(robot_recorder.path) as reader:
        assert_same_pose(StaticTransforms.recorded(reader).pose("left", "depth"), POSE)


def test_a_pose_that_is_given_comes_before_that_of_the_bag(recorder):
    record(recorder, with_transforms=False)
    text = " ".join(map(repr, [*POSE.translation_m.tolist(), *quaternion(POSE.rotation)]))
    recorder.close()
    config = Config().updated({"source": "depth", "source.depth_registered": False, "source.depth_pose": text})
    with open_recording(recorder.path, config.source) as bag:
        (frame,) = bag.frames()
    assert_registered(frame)


def test_without_a_pose_the_remedy_is_told(recorder):
    record(recorder, with_transforms=False)
    recorder.close()
    with (
        StereoBag(recorder.path, source="depth", depth_registered=False) as bag,
        pytest.raises(ValueError, match=r"no transform from 'depth' to 'left', .* or set source\.depth_pose"),
    ):
        next(bag.frames())
    with StereoBag(recorder.path, source="depth") as bag:
        assert list(bag.frames()) == []
        assert "depth image is 132 x 96 pixels, but the left CameraInfo is for 160 x 120" in bag.problems[0]
        assert "set source.depth_registered to false" in bag.problems[0]


def test_calibration_of_depth_is_required_where_it_is_to_be_registered(tmp_path):
    recorder = Recorder(tmp_path / "bag")
    record_camera(recorder, "left", LEFT)
    recorder.image("/robot/left/image_rect", left_image(), START_NS, "mono8")
    recorder.image("/robot/depth/image_rect", scene(LEFT), START_NS, "32FC1")
    recorder.close()
    with StereoBag(recorder.path, source="depth") as bag:
        (frame,) = bag.frames()
        assert np.array_equal(frame.depth_m, scene(LEFT))
    with pytest.raises(ValueError, match=r"depth/image_rect, left/camera_info, depth/camera_info; there are"):
        StereoBag(recorder.path, source="depth", depth_registered=False)
