"""Hostile messages on every input of the nodes, among good frames that have to be answered as if nothing had happened.

`Siege` is what the suite does shortly and what this file does for long as a command, with the nodes in processes of
their own:

    python test/nodes/hostile_messages.py --messages 20000
    python test/nodes/hostile_messages.py --messages 2000 --scene raw --executable nodes --seed 3
"""

import argparse
import itertools
import json
import struct
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    import conftest  # noqa: F401 - sets the environment of ROS

import cv2
import numpy as np
import rclpy
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import OccupancyGrid
from node_process import NodeProcess, running
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
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
    stereo_pair,
)
from rvl_writer import rvl_of
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header, String
from std_srvs.srv import Empty
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.config import LONG_RANGE_STAGES, SHORT_RANGE_STAGES, parameters
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.nodes.messages import disparity_to_message

SETTINGS = {
    "stereo.matcher": "bm",
    "stereo.n_disparities": N_DISPARITIES,
    "superpixels.n_superpixels": 40,
    # Each good frame is compared with the same one in peace, so it must not depend on those before.
    "memory.frames": 0,
    "ground.memory_s": 0.0,
}
PATIENCE_S = 20.0
MAX_GROWTH_MB = 80.0  # files of 9 million pixels are decoded, and the C library keeps their memory for the next images
EXECUTABLES = ("detector", "nodes")
N_GOOD = 4  # frames that are good, over and over
NAN, INF = float("nan"), float("inf")
NUMBERS = (NAN, INF, -INF, 0.0, -1.0, 1e-300, 5e6, -5e8, 1e38, -1e300)
SIZES = (0, 1, 7, WIDTH + 1, 4 * WIDTH, 65_536, 2**31, 2**32 - 1)
STAMPS_S = (-(2**31), -1, 0, 1, 4_102_444_800 - 2**32, 2**31 - 1)
STAGES = {"short_range": SHORT_RANGE_STAGES, "long_range": LONG_RANGE_STAGES}
VALUES = {
    "long_range/mask": (0, 255),
    "long_range/occupancy": (0, 100, 255),
    "short_range/mask": (0, 255),
    "short_range/occupancy": (0, 100, 255),
}


# What good frames are made of.


def png(pixels, extension=".png"):
    return cv2.imencode(extension, pixels)[1].tobytes()


def compressed(pixels, stamp):
    return CompressedImage(header=header(stamp), format="bgr8; png compressed bgr8", data=png(pixels))


def compressed_depth(depth_m, stamp, compression):
    millimetres = np.minimum(np.rint(depth_m * 1000), 65535).astype(np.uint16)
    sized = np.array(millimetres.shape[::-1], "<u4").tobytes()
    pixels = png(millimetres) if compression == "png" else sized + rvl_of(millimetres)
    return CompressedImage(
        header=header(stamp), format=f"16UC1; compressedDepth {compression}", data=bytes(12) + pixels
    )


def distorted_info(*, right=False):
    info = camera_info(right=right)
    info.distortion_model, info.d = "plumb_bob", [-0.05, 0.01, 0.0, 0.0, 0.0]
    info.k = [CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fx, CAMERA.cy, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    return info


def stereo(seed, stamp, message=image, transport=""):
    left, right = stereo_pair(seed)
    return {
        "left/camera_info": camera_info(),
        "right/camera_info": camera_info(right=True),
        f"right/image_rect{transport}": message(right, stamp),
        f"left/image_rect{transport}": message(left, stamp),
    }


def raw(seed, stamp):
    left, right = stereo_pair(seed)
    return {
        "left/camera_info": distorted_info(),
        "right/camera_info": distorted_info(right=True),
        "right/image_raw": image(right, stamp),
        "left/image_raw": image(left, stamp),
    }


def disparity(seed, stamp):
    message = disparity_to_message(
        ground_disparity() + np.float32(seed), header(stamp), CAMERA, n_disparities=N_DISPARITIES
    )
    left = image(stereo_pair(seed)[0], stamp)
    return {"left/camera_info": camera_info(), "left/image_rect": left, "disparity": message}


def depth(seed, stamp):
    return {
        "left/camera_info": camera_info(),
        "left/image_rect": image(stereo_pair(seed)[0], stamp),
        "depth/image_rect": image(CAMERA.depth_m(ground_disparity()), stamp),
    }


def unregistered_depth(seed, stamp):
    messages = depth(seed, stamp)
    return {"depth/camera_info": distorted_info(), **messages}


def compressed_depths(seed, stamp):
    depth_m = CAMERA.depth_m(ground_disparity())
    return {
        "left/camera_info": camera_info(),
        "left/image_rect/compressed": compressed(stereo_pair(seed)[0], stamp),
        "depth/image_rect/compressedDepth": compressed_depth(depth_m, stamp, ("png", "rvl")[seed % 2]),
    }


@dataclass(frozen=True)
class Scene:
    """A source of disparity: what makes the messages of a good frame, and the parameters beside `SETTINGS`."""

    frame: object
    settings: dict = field(default_factory=dict)


SCENES = {
    "stereo": Scene(stereo),
    "raw": Scene(raw, {"source.rectify": True}),
    "compressed": Scene(partial(stereo, message=compressed, transport="/compressed"), {"source.compressed": True}),
    "disparity": Scene(disparity, {"source": "disparity"}),
    "depth": Scene(depth, {"source": "depth"}),
    "unregistered": Scene(
        unregistered_depth,
        {"source": "depth", "source.depth_registered": False, "source.depth_pose": "0.02 0 0 0 0 0 1"},
    ),
    "compressed_depth": Scene(compressed_depths, {"source": "depth", "source.compressed": True}),
}
# What the two nodes say to each other, and others can say in their place.
BETWEEN = ("short_range/occupancy", "disparity", "short_range/ground_disparity", "left/image_rect")


# What makes good messages bad: a field, or the bytes.


def spoil_header(rng, message):
    """Give a message another stamp, or a frame without end."""
    if rng.random() < 0.6:
        message.header.stamp.sec = int(rng.choice(STAMPS_S))
        message.header.stamp.nanosec = int(rng.choice([0, 10**9, 2**32 - 1]))
    else:
        message.header.frame_id = str(rng.choice(["", "x" * 100_000, "/../\n\0é" * 10]))


def spoil_image(rng, message):
    """Spoil encoding, size, rows or data."""
    fields = ("encoding", "height", "width", "step", "data", "is_bigendian", "pixels", "size")
    name = rng.choice(fields)
    if name == "encoding":
        known = ("mono8", "mono16", "rgb8", "rgba16", "bayer_rggb8", "nv12", "yuv422", "32FC1", "16UC1", "8UC4")
        message.encoding = str(rng.choice([*known, "", "64FC9", "bgr8;\0", "x" * 100_000]))
    elif name in ("height", "width", "step"):
        setattr(message, name, int(rng.choice(SIZES)))
    elif name == "is_bigendian":
        message.is_bigendian = int(rng.choice([1, 255]))
    elif name == "data":
        message.data = rng.bytes(int(rng.choice([0, 1, len(message.data) - 1, len(message.data) + 1])))
    elif name == "pixels":
        message.data = np.full(len(message.data) // 4, _float32(rng), np.float32).tobytes()
    else:
        height, width = (int(size) for size in rng.choice([1, 2, 3, 40, 119, 121], 2))
        message.height, message.width, message.step = height, width, message.step // message.width * width
        message.data = rng.bytes(height * message.step)


def spoil_disparity(rng, message):
    """Spoil the camera's numbers, or the image within."""
    if rng.random() < 0.5:
        setattr(message, str(rng.choice(["f", "t", "min_disparity", "max_disparity", "delta_d"])), _float32(rng))
    else:
        spoil_image(rng, message.image)


def _float32(rng):
    with np.errstate(over="ignore"):
        return float(np.float32(rng.choice(NUMBERS)))


def bomb(side=3000):
    """Return a small PNG file of many pixels."""
    return png(np.zeros((side, side), np.uint8))


def lying_png(rng):
    """Return a PNG file that claims to be huge, and holds little."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    width, height = (int(size) for size in rng.choice([20_000, 2**20, 2**31 - 1, 2**32 - 1, 0], 2))
    depth_bits, colour = int(rng.choice([1, 8, 16])), int(rng.choice([0, 2, 3, 6]))
    ihdr = struct.pack(">IIBBBBB", width, height, depth_bits, colour, 0, 0, 0)
    content = chunk(b"IHDR", ihdr) + chunk(b"IDAT", zlib.compress(bytes(1000))) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + content


def spoil_compressed(rng, message):
    """Spoil the format, or the file."""
    prefix = bytes(message.data)[:12] if "compressedDepth" in message.format else b""
    file = bytes(message.data)[len(prefix) :]
    pixels = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    makers = (
        bomb,
        lambda: lying_png(rng),
        lambda: png(pixels, ".tiff"),
        lambda: png(pixels, ".webp"),
        lambda: png(pixels, ".bmp"),
        lambda: png(pixels, ".jpg")[: int(rng.integers(2, 1000))],
        lambda: png(pixels[:1, :1]),
        lambda: png(np.dstack([pixels, pixels[..., :1]])),
        lambda: png(pixels.astype(np.uint16)),
        lambda: b"GIF89a" + rng.bytes(100),
        lambda: flipped(rng, file),
        lambda: file[: int(rng.integers(0, len(file)))],
        lambda: struct.pack("<II", *(int(size) for size in rng.choice(SIZES, 2))) + rng.bytes(200),
        lambda: rng.bytes(500),
        lambda: b"",
    )
    kind = int(rng.integers(0, len(makers) + 4))
    if kind < len(makers):
        message.data = prefix + makers[kind]()
    elif prefix and kind == len(makers):
        message.data = np.array([0, *rng.choice([NAN, INF, 0.0, 1e38], 2)], "<f4").tobytes() + file
    else:
        formats = ("", "jpeg", "bayer_rggb8; png", "32FC1; compressedDepth", "16UC1; compressedDepth rvl", "x" * 9999)
        message.format = str(rng.choice(formats))


def spoil_info(rng, message):
    """Spoil the calibration."""
    name = str(rng.choice(["d", "k", "r", "p", "height", "width", "model", "binning", "roi"]))
    if name == "d":
        message.d = [float(rng.choice(NUMBERS)) for _ in range(int(rng.choice([0, 1, 3, 5, 8, 14, 1000])))]
    elif name in ("k", "r", "p"):
        values = np.array(getattr(message, name))
        values[rng.integers(0, len(values))] = rng.choice(NUMBERS)
        setattr(message, name, values)
    elif name in ("height", "width"):
        setattr(message, name, int(rng.choice(SIZES)))
    elif name == "model":
        message.distortion_model = str(rng.choice(["", "fov", "equidistant", "rational_polynomial", "\0" * 1000]))
    elif name == "binning":
        message.binning_x, message.binning_y = (int(size) for size in rng.choice(SIZES, 2))
    else:
        roi = message.roi
        roi.x_offset, roi.y_offset, roi.width, roi.height = (int(size) for size in rng.choice(SIZES, 4))


def flipped(rng, data):
    """Return data with some bits turned over."""
    changed = bytearray(data)
    for at in rng.integers(0, max(len(changed), 1), int(rng.choice([1, 3, 30]))):
        if changed:
            changed[at] ^= 1 << int(rng.integers(0, 8))
    return bytes(changed)


def overwritten(data, at, value):
    return data[:at] + struct.pack("<I", value) + data[at + 4 :]


def spoil_bytes(rng, data, others):
    """Return what a message is not: cut off, of another type, with lengths that are not there."""
    spoilers = {
        "cut off": lambda: data[: int(rng.integers(0, len(data)))],
        "cut off early": lambda: data[: int(rng.integers(0, min(len(data), 100)))],
        "longer": lambda: data + rng.bytes(int(rng.integers(1, 5000))),
        "bits flipped": lambda: flipped(rng, data),
        "early bits flipped": lambda: flipped(rng, data[:120]) + data[120:],
        "random": lambda: bytes([0, 1, 0, 0]) + rng.bytes(int(rng.integers(0, 2000))),
        "noise": lambda: rng.bytes(int(rng.integers(1, 500))),
        "zeros": lambda: bytes(int(rng.integers(4, 2000))),
        "other type": lambda: others[int(rng.integers(0, len(others)))],
        "other byte order": lambda: bytes([0, 0]) + data[2:],
        "other encoding": lambda: bytes([int(rng.integers(0, 3)), int(rng.integers(2, 256))]) + data[2:],
        "huge length": lambda: overwritten(
            data, 4 * int(rng.integers(1, 60)), int(rng.choice([2**20, 2**31 - 1, 2**31, 2**32 - 1]))
        ),
        "huge text": lambda: overwritten(data, 12, int(rng.choice([0, 2**31, 2**32 - 1]))),
        "no UTF-8": lambda: data[:16] + b"\xff\xfe\xc0\x80"[: max(len(data) - 16, 0)] + data[20:],
    }
    name = str(rng.choice(list(spoilers)))
    return name, spoilers[name]()


SPOILERS = {
    Image: spoil_image,
    DisparityImage: spoil_disparity,
    CompressedImage: spoil_compressed,
    CameraInfo: spoil_info,
}


def with_stamp(data, stamp):
    """Return a serialised message with another stamp in its header, which comes first."""
    return data[:4] + struct.pack("<iI", *divmod(stamp, 10**9)) + data[12:]


def _serialized(messages):
    return {topic: serialize_message(message) for topic, message in messages.items()}


def _between_message(kind):
    """Return a good message of one node to the other."""
    if kind is DisparityImage:
        return disparity_to_message(ground_disparity(), header(0), CAMERA, n_disparities=N_DISPARITIES)
    return image(np.zeros((HEIGHT, WIDTH), np.uint8), 0)


class Siege:
    """Sends hostile messages to the nodes of a graph, which the graph's own or other processes run.

    Parameters
    ----------
    graph : Graph
        Its namespace is that of the nodes.
    scene : Scene
        What the nodes were started with.
    is_linked : bool
        Whether the nodes are in one process: stereo frames do not go over topics then.
    seed : int
        Of the choice.

    Attributes
    ----------
    sent : Counter
        Hostile messages by kind.
    n_good : int
        Good frames that were sent, each of which was answered as in peace.
    """

    def __init__(self, graph, scene, *, is_linked, seed=0):
        self._graph = graph
        self._frames = [_serialized(scene.frame(seed, 0)) for seed in range(N_GOOD)]
        self._rng = np.random.default_rng(seed)
        self._stamps = itertools.count(1_700_000_000_000_000_000, 100_000_000)
        self.sent = Counter()
        self.n_good = 0
        self._wrong = []
        self._kinds = {topic: type(message) for topic, message in scene.frame(0, 0).items()}
        self._is_linked = is_linked and scene.settings.get("source", "stereo") == "stereo"
        self._between = {} if self._is_linked else self._between_topics(scene)
        self._bytes_between = _serialized({topic: _between_message(kind) for topic, kind in self._between.items()})
        for topic in VALUES:
            graph.tester.create_subscription(Image, topic, lambda message, topic=topic: self._take(topic, message), 50)
        graph.tester.create_subscription(OccupancyGrid, "long_range/grid", self._take_grid, 50)
        graph.spin_until(lambda: all(graph.tester.count_publishers(topic) for topic in VALUES))
        self._others = [serialize_message(message) for message in (String(data="x" * 99), Header(), camera_info())]
        self._others += self._frames[0].values()
        self._meet()
        self._in_peace = [self._answers(seed) for seed in range(N_GOOD)]

    def go_on(self, n):
        """Send `n` hostile messages, in bursts between good frames."""
        end = sum(self.sent.values()) + n
        while (left := end - sum(self.sent.values())) > 0:
            for _ in range(min(int(self._rng.integers(1, 9)), left)):
                self._send_hostile()
            self.check_good()

    def check_good(self):
        """Send a good frame, and compare the answer with that in peace."""
        seed = self.n_good % N_GOOD
        answers = self._answers(seed)
        self.n_good += 1
        for topic, data in answers.items():
            assert data == self._in_peace[seed][topic], f"{topic} of a good frame differs; sent {self.sent}"
        assert not self._wrong, self._wrong

    def set_hostile_parameters(self, n):
        """Try to set parameters to what they must not be; none of them may change."""
        for node in ("short_range", "long_range"):
            before = self._parameters(node)
            for _ in range(n):
                request = SetParameters.Request(parameters=[self._hostile_parameter(before)])
                result = self._graph.call(SetParameters, f"{node}/set_parameters", request).results[0]
                assert not result.successful, request
                assert result.reason
                self.sent["parameter"] += 1
            # Values as text, where NaN is itself.
            assert str(self._parameters(node)) == str(before)
        self.check_good()

    def storm(self, n):
        """Change states at random and reset, then let the nodes be active again."""
        for _ in range(n):
            node = str(self._rng.choice(["short_range", "long_range"]))
            # 5 to 7 are shutdowns, which end a node for good; 99 is no transition.
            transition = int(self._rng.choice([0, 1, 2, 3, 4, 8, 10, 60, 99]))
            self._graph.call(ChangeState, f"{node}/change_state", _transition(transition))
            self.sent["transition"] += 1
        for node in ("long_range", "short_range"):
            self._activate(node)
        for _ in range(n):
            node = str(self._rng.choice(["short_range", "long_range"]))
            self._reset(node)
            self.sent["reset"] += 1
        self._graph.spin_until(lambda: all(self._graph.tester.count_publishers(topic) for topic in VALUES))
        self._meet()
        self.check_good()

    def offer_other_type(self):
        """Publish another type under the name of an input, as another process may: the nodes never see it."""
        context = Context()
        rclpy.init(args=[], context=context)
        node = Node("stranger", namespace=self._graph.tester.get_namespace(), context=context)
        publisher = node.create_publisher(String, "left/camera_info", 1)
        self._graph.spin_until(lambda: self._graph.tester.count_publishers("left/camera_info") > 1)
        publisher.publish(String(data="x" * 1000))
        self.sent["publisher of another type"] += 1
        self.check_good()
        assert publisher.get_subscription_count() == 0
        node.destroy_node()
        context.shutdown()

    def _between_topics(self, scene):
        """Return the types of the topics between the nodes that this scene has not got as inputs."""
        kinds = {topic: Image if "image" in topic or "occupancy" in topic else DisparityImage for topic in BETWEEN}
        if scene.settings.get("source.compressed"):
            del kinds["left/image_rect"]
        return {topic: kind for topic, kind in kinds.items() if topic not in self._kinds}

    def _send_hostile(self):
        """Send one hostile message, alone or in the place of a good one of a frame."""
        stamp = next(self._stamps)
        frame = self._frames[int(self._rng.integers(0, N_GOOD))]
        topic = str(self._rng.choice([*frame, *self._between]))
        if topic in self._between:
            self._publish(topic, self._spoilt(topic, with_stamp(self._bytes_between[topic], stamp)))
        elif self._rng.random() < 0.3:
            self._publish(topic, self._spoilt(topic, with_stamp(frame[topic], stamp)))
        else:
            for each, data in frame.items():
                stamped = with_stamp(data, stamp)
                self._publish(each, self._spoilt(each, stamped) if each == topic else stamped)

    def _spoilt(self, topic, data):
        """Return a good message's bytes made bad, and count it."""
        if self._rng.random() < 0.5:
            kind, data = spoil_bytes(self._rng, data, self._others)
        else:
            message = deserialize_message(data, self._kind(topic))
            is_header = self._rng.random() < 0.2
            kind = "header" if is_header else "fields"
            (spoil_header if is_header else SPOILERS[type(message)])(self._rng, message)
            data = serialize_message(message)
        self.sent[f"{topic}: {kind}"] += 1
        return data

    def _kind(self, topic):
        return self._kinds.get(topic) or self._between[topic]

    def _publish(self, topic, data):
        # Of stereo pairs both nodes take the left image, of the other sources the long range alone.
        n_nodes = 2 if topic == "left/image_rect" and "right/image_rect" in self._kinds and not self._is_linked else 1
        publisher = self._graph.publisher(self._kind(topic), topic, n_nodes)
        publisher.publish(data)

    def _meet(self):
        """Send good frames until one is answered: the first are lost while nodes do not know yet who publishes."""
        deadline = time.monotonic() + PATIENCE_S
        while not self._answers(0, patience_s=0.5):
            assert time.monotonic() < deadline, f"no good frame is answered; sent {dict(self.sent)}"

    def _answers(self, seed, patience_s=PATIENCE_S):
        """Send a good frame, and return what is found in it, by topic."""
        stamp = next(self._stamps)
        self._found = {}
        self._awaited = stamp
        for topic, data in self._frames[seed].items():
            self._publish(topic, with_stamp(data, stamp))
        try:
            self._graph.spin_until(lambda: len(self._found) == len(VALUES), patience_s)
        except AssertionError as err:
            if patience_s < PATIENCE_S:
                return {}
            raise AssertionError(f"only {sorted(self._found)} of a good frame; sent {dict(self.sent)}") from err
        return self._found

    def _take(self, topic, message):
        """Keep an image that is waited for; note one that no node should have published."""
        pixels = np.frombuffer(message.data, np.uint8)
        is_whole = message.encoding == "mono8" and pixels.size == message.height * message.width > 0
        is_own = topic in self._between  # what is sent here comes back
        if not is_own and not (is_whole and np.isin(pixels, VALUES[topic]).all()):
            self._wrong.append(f"{topic}: {message.width} x {message.height} {message.encoding}")
        if header_stamp_ns(message) == self._awaited:
            self._found[topic] = pixels.tobytes()

    def _take_grid(self, message):
        cells = np.asarray(message.data)
        if cells.size != message.info.height * message.info.width or not np.isin(cells, (-1, 0, 100)).all():
            self._wrong.append(f"grid of {message.info.width} x {message.info.height}: {np.unique(cells)}")

    def _parameters(self, node):
        names = [parameter.name for parameter in parameters() if parameter.stage in STAGES[node]]
        request = GetParameters.Request(names=names)
        values = self._graph.call(GetParameters, f"{node}/get_parameters", request).values
        return dict(zip(names, values, strict=True))

    def _hostile_parameter(self, known):
        """Return a parameter that has a wrong type, is out of range, or does not exist."""
        rng = self._rng
        if rng.random() < 0.2:
            name = str(rng.choice(["nothing", "stereo.", "é" * 1000, "source.rectify", "preset", "autostart"]))
            return Parameter(name, value="x").to_parameter_msg()
        name = str(rng.choice(list(known)))
        if rng.random() < 0.05:
            return ParameterMessage(name=name, value=ParameterValue(type=int(rng.integers(10, 256))))
        kind = known[name].type
        values = {
            ParameterType.PARAMETER_INTEGER: (-(2**63), 2**63 - 1, 1e300, NAN, "x" * 100_000, b"x", [1, 2], True),
            ParameterType.PARAMETER_DOUBLE: (NAN, INF, -INF, 1e300, -1.0, -(2**63), "x", [1.0], False),
            ParameterType.PARAMETER_BOOL: (1, 0.0, "true", [True]),
            ParameterType.PARAMETER_STRING: (1, 0.5, True, ["x"]),
        }[kind]
        value = values[int(rng.integers(0, len(values)))]
        return Parameter(name, value=[value] if isinstance(value, bytes) else value).to_parameter_msg()

    def _reset(self, node):
        """Reset a node; an answer is lost where a service that is made anew does not know its client yet."""
        for timeout_s in (2.0, 2.0, PATIENCE_S):
            try:
                self._graph.call(Empty, f"{node}/reset", Empty.Request(), timeout_s)
            except AssertionError:
                if timeout_s == PATIENCE_S:
                    raise
            else:
                return

    def _activate(self, node):
        """Bring a node from any state but the last to active."""
        way = {State.PRIMARY_STATE_UNCONFIGURED: (1, 3), State.PRIMARY_STATE_INACTIVE: (3,)}
        state = self._graph.call(GetState, f"{node}/get_state", GetState.Request()).current_state.id
        for transition in way.get(state, ()):
            assert self._graph.call(ChangeState, f"{node}/change_state", _transition(transition), 30.0).success


def _transition(number):
    return ChangeState.Request(transition=Transition(id=number))


def adds_up(status):
    """Return whether the frames that a node has received are those of which it says what became of them."""
    counts = {item.key: float(item.value) for item in status.values if item.key.startswith("frames ")}
    return counts.pop("frames received") == sum(counts.values())


class Attack:
    """A siege of one scene, whose nodes are in processes of their own."""

    def __init__(self, scene, executable, folder, seed):
        self.name = f"{scene} {executable}"
        self._scene = SCENES[scene]
        self._is_linked = executable == "detector"
        self._seed = seed
        namespace = f"siege_{scene}_{executable}"
        self._graph = Graph(namespace=namespace, settings={})
        settings = {**SETTINGS, **self._scene.settings}
        options = [part for key, value in settings.items() for part in ("-p", f"{key}:={json.dumps(value)}")]
        names = ("detector",) if self._is_linked else ("short_range_node", "long_range_node")
        self._processes = [
            NodeProcess(name, folder / f"{namespace}_{name}.log", "-r", f"__ns:=/{namespace}", *options)
            for name in names
        ]

    def run(self, n):
        """Send `n` hostile messages; print how it went, and return the siege."""
        begin_s = time.monotonic()
        with running(*self._processes):
            for process in self._processes:
                process.wait_until_ready(self._graph)
            siege = Siege(self._graph, self._scene, is_linked=self._is_linked, seed=self._seed)
            siege.offer_other_type()
            first = self._step(siege, -(-n // 10))
            for _ in range(9):
                last = self._step(siege, -(-n // 10))
            for node in STAGES:
                self._graph.status(node, adds_up)
        self._graph.close()
        self._check_logs()
        seconds = time.monotonic() - begin_s
        print(
            f"{self.name:27} {sum(siege.sent.values()):6} hostile, {siege.n_good:5} good, {seconds:4.0f} s", flush=True
        )
        for process, before, after in zip(self._processes, first, last, strict=True):
            print(f"    {process.name:16} {before}, at the end {after}", flush=True)
            assert after.rss_mb - before.rss_mb < MAX_GROWTH_MB, f"{process.name} grew"
            assert after.n_descriptors <= before.n_descriptors, f"{process.name} has more descriptors"
            assert after.n_threads <= before.n_threads, f"{process.name} has more threads"
        return siege

    def _step(self, siege, n):
        """Send hostile messages, parameters and transitions; return what the processes have afterwards."""
        siege.go_on(n)
        siege.set_hostile_parameters(5)
        siege.storm(10)
        return [process.usage() for process in self._processes]

    def _check_logs(self):
        for process in self._processes:
            n = process.log.read_text().count("Traceback")
            assert not n, f"{n} tracebacks in {process.log}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=20_000, help="hostile messages in all (20000)")
    parser.add_argument("--scene", nargs="+", choices=SCENES, default=list(SCENES), help="sources (all)")
    parser.add_argument("--executable", nargs="+", choices=EXECUTABLES, default=EXECUTABLES, help="(both)")
    parser.add_argument("--seed", type=int, default=0, help="of the choice (0)")
    args = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="siege_"))
    rclpy.init(args=[])
    cases = list(itertools.product(args.scene, args.executable))
    sent, n_failed = Counter(), 0
    for scene, executable in cases:
        try:
            sent += Attack(scene, executable, folder, args.seed).run(-(-args.messages // len(cases))).sent
        except AssertionError as err:  # the others are besieged all the same
            n_failed += 1
            where = traceback.extract_tb(err.__traceback__)[-2]
            print(f"{scene} {executable} FAILED in {where.name}, line {where.lineno}: {err}", flush=True)
    for kind, n in sorted(sent.items()):
        print(f"{n:7} {kind}")
    print(f"{sum(sent.values()):7} in all; {n_failed} of {len(cases)} sieges failed")
    rclpy.try_shutdown()
    return int(n_failed > 0)


if __name__ == "__main__":
    sys.exit(main())
