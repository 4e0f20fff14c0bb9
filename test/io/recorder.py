"""Bags for the tests of io: frames to write, and a recorder of either ROS."""

import cv2
import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.bag_frames import StereoBag

HEIGHT, WIDTH = 30, 41
START_NS = 1_700_000_000_000_000_000
CAMERA = StereoCamera(fx=50.5, fy=51.0, cx=18.25, cy=11.5, baseline_m=0.25, width=WIDTH, height=HEIGHT)
ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def random_image(seed, channels=3):
    shape = (HEIGHT, WIDTH, 3) if channels == 3 else (HEIGHT, WIDTH)
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def make_frames(n=6, **inputs):
    """Return frames 0.1 s apart."""
    return [
        Frame(
            name=str(START_NS + i * 10**8),
            left=random_image(2 * i),
            camera=CAMERA,
            stamp_ns=START_NS + i * 10**8,
            **(inputs or {"right": random_image(2 * i + 1)}),
        )
        for i in range(n)
    ]


class Recorder:
    """Writes messages with the types of ROS 1 or ROS 2, as a recorder of that system does."""

    def __init__(self, path, kind="mcap", compression=None, *, mode="STORAGE"):
        self.path = path
        self.is_ros1 = kind == "rosbag1"
        self.store = ROS1 if self.is_ros1 else ROS2
        self.connections = {}
        if self.is_ros1:
            self.bag = rosbag1.Writer(path)
            self.bag.chunk_threshold = 20_000
            if compression:
                self.bag.set_compression(rosbag1.Writer.CompressionFormat[compression])
        else:
            self.bag = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[kind.upper()])
            if compression:
                self.bag.set_compression(rosbag2.CompressionMode[mode], rosbag2.CompressionFormat[compression])
        self.bag.open()

    def close(self):
        self.bag.close()

    def make(self, kind, **fields):
        return self.store.types[kind](**fields)

    def header(self, stamp_ns):
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        seq = {"seq": 7} if self.is_ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id="camera", **seq)

    def write(self, topic, message, time_ns):
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.bag.add_connection(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        self.bag.write(self.connections[topic], time_ns, serialize(message, kind))

    def image_message(self, image, stamp_ns, encoding, **fields):
        values = {
            "header": self.header(stamp_ns),
            "height": image.shape[0],
            "width": image.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": image.strides[0],
            "data": np.frombuffer(image.tobytes(), np.uint8),
        }
        return self.make("sensor_msgs/msg/Image", **{**values, **fields})

    def image(self, topic, image, stamp_ns, encoding="bgr8", *, delay_ns=0, **fields):
        self.write(topic, self.image_message(image, stamp_ns, encoding, **fields), stamp_ns + delay_ns)

    def compressed(self, topic, image, stamp_ns, text="bgr8; png compressed bgr8"):
        data = cv2.imencode(".png", image)[1].reshape(-1)
        header = self.header(stamp_ns)
        message = self.make("sensor_msgs/msg/CompressedImage", header=header, format=text, data=data)
        self.write(topic, message, stamp_ns)

    def region(self, height=0, width=0):
        kind = "sensor_msgs/msg/RegionOfInterest"
        return self.make(kind, x_offset=0, y_offset=0, height=height, width=width, do_rectify=False)

    def info(self, topic, stamp_ns, *, baseline_m=0.0, fx=CAMERA.fx, size=(HEIGHT, WIDTH)):
        self.info_of(
            topic,
            stamp_ns,
            height=size[0],
            width=size[1],
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=np.eye(3).reshape(-1),
            r=np.eye(3).reshape(-1),
            p=np.array([fx, 0, CAMERA.cx, -fx * baseline_m, 0, CAMERA.fy, CAMERA.cy, 0, 0, 0, 1, 0]),
        )

    def info_of(self, topic, stamp_ns, **fields):
        """Write a CameraInfo of these fields."""
        message = self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp_ns),
            **{name.upper() if self.is_ros1 and len(name) == 1 else name: value for name, value in fields.items()},
            binning_x=0,
            binning_y=0,
            roi=self.region(),
        )
        self.write(topic, message, stamp_ns)

    def infos(self, stamp_ns=START_NS, namespace=""):
        self.info(f"{namespace}/left/camera_info", stamp_ns)
        self.info(f"{namespace}/right/camera_info", stamp_ns, baseline_m=CAMERA.baseline_m)

    def disparity(self, topic, disparity, stamp_ns, *, min_disparity=0.0, f=60.0, t=0.5):
        message = self.make(
            "stereo_msgs/msg/DisparityImage",
            header=self.header(stamp_ns),
            image=self.image_message(disparity, stamp_ns, "32FC1"),
            f=f,
            valid_window=self.region(HEIGHT, WIDTH),
            min_disparity=min_disparity,
            max_disparity=64.0,
            delta_d=0.125,
            **{"T" if self.is_ros1 else "t": t},
        )
        self.write(topic, message, stamp_ns)


def read(recorder, **options):
    """Close the recorder; return its bag's frames and problems."""
    recorder.close()
    with StereoBag(recorder.path, **options) as bag:
        return list(bag.frames()), bag.problems


def record_pairs(recorder, n):
    """Record calibration and `n` pairs, 1 ns apart."""
    recorder.infos()
    for i in range(n):
        recorder.image("/left/image_rect", random_image(i), START_NS + i)
        recorder.image("/right/image_rect", random_image(i), START_NS + i)


def storage_file(path):
    """Return the file that holds the messages of a bag."""
    return path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")


def assert_same(frame, written):
    assert (frame.name, frame.stamp_ns) == (written.name, written.stamp_ns)
    for field in ("left", "right", "disparity", "depth_m"):
        value, expected = getattr(frame, field), getattr(written, field)
        assert (value is None) == (expected is None)
        if value is not None:
            assert value.dtype == expected.dtype
            assert np.array_equal(value, expected)
