"""Both nodes with the file of each camera family, on the topics, types and encodings of its driver."""

import re
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("rclpy")

from ros_graph import CAMERA, HEIGHT, WIDTH, Graph, camera_info, ground_disparity, header, stereo_pair
from sensor_msgs.msg import Image

from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

FAMILIES = {path.stem: path for path in (Path(__file__).parents[2] / "config" / "cameras").iterdir()}
STAMP = 1_700_000_000_123_456_789
SETTINGS = {"superpixels.n_superpixels": 40, "memory.frames": 0}


def remaps_of(family):
    """Return the topics of a family's driver by the names of this package."""
    return dict(re.findall(r"^# remap: (\S+):=(\S+)$", FAMILIES[family].read_text(encoding="utf-8"), re.MULTILINE))


class Driver(Graph):
    """Both nodes as the file of a family starts them, and a driver that publishes what the family's does."""

    def __init__(self, family):
        self.topics = remaps_of(family)
        remaps = [word for name, topic in self.topics.items() for word in ("-r", f"{name}:={topic}")]
        arguments = ["--ros-args", "--params-file", str(FAMILIES[family]), *remaps]
        factories = [partial(factory, cli_args=arguments) for factory in (LongRangeNode, ShortRangeNode)]
        super().__init__(*factories, namespace=family, settings=SETTINGS)
        self.listen(Image, "long_range/mask")

    def send(self, name, message, n_subscriptions=1):
        """Publish on the driver's topic for a name of this package."""
        self.publish(self.topics[name], message, n_subscriptions)

    def send_infos(self, *names):
        """Publish calibrations as they come from drivers, with distortion, intrinsics and rotation too."""
        for name in names:
            info = camera_info(right=name.startswith("right"))
            info.distortion_model, info.d = "plumb_bob", [0.0] * 5
            info.k = [CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0]
            info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
            self.send(name, info)

    def mask(self):
        """Wait for the mask of the left image, and return it."""
        message = self.at("long_range/mask", STAMP)
        return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)


def encoded(pixels, encoding, stamp=STAMP):
    """Return an image message whose bytes are `pixels`, (H, W) or (H, W, C)."""
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    step = WIDTH * channels * pixels.dtype.itemsize
    data = np.ascontiguousarray(pixels).tobytes()
    return Image(header=header(stamp), encoding=encoding, height=HEIGHT, width=WIDTH, step=step, data=data)


def smooth_pair():
    """Return a left and a right grey image, smooth enough for a mosaic of colours."""
    left = cv2.GaussianBlur(stereo_pair()[0][..., 0], (0, 0), 1.0)
    left = cv2.normalize(left, None, 0, 255, cv2.NORM_MINMAX)
    shifts = np.rint(ground_disparity()[:, 0]).astype(int)
    right = np.stack([np.roll(row, -shift) for row, shift in zip(left, shifts, strict=True)])
    return left, right


def depth_m():
    """Return the depth of the ground, NaN where there is none."""
    disparity = ground_disparity()
    with np.errstate(divide="ignore"):
        return np.where(disparity > 0, CAMERA.fx * CAMERA.baseline_m / disparity, np.nan).astype(np.float32)


def send_pair(driver, encoding, image="image_rect", right_stamp=STAMP):
    left, right = smooth_pair()
    layers = {"mono8": 1, "bayer_rggb8": 1, "bgra8": 4}[encoding]
    left, right = (side if layers == 1 else np.repeat(side[..., None], layers, axis=2) for side in (left, right))
    driver.send_infos("left/camera_info", "right/camera_info")
    # The rectified left image is taken by both nodes.
    driver.send(f"left/{image}", encoded(left, encoding), 2 if image == "image_rect" else 1)
    driver.send(f"right/{image}", encoded(right, encoding, right_stamp))


def send_depth(driver, encoding, depth, depth_encoding, depth_stamp=STAMP):
    layers = {"rgb8": 3, "bgra8": 4}[encoding]
    left = np.repeat(smooth_pair()[0][..., None], layers, axis=2)
    driver.send_infos("left/camera_info")
    driver.send("left/image_rect", encoded(left, encoding))
    driver.send("depth/image_rect", encoded(depth, depth_encoding, depth_stamp))


def millimetres():
    return np.nan_to_num(depth_m() * 1000).clip(0, 65535).astype(np.uint16)


FRAMES = {
    "realsense_stereo": partial(send_pair, encoding="mono8"),
    "realsense_depth": partial(send_depth, encoding="rgb8", depth=millimetres(), depth_encoding="16UC1"),
    "zed_stereo": partial(send_pair, encoding="bgra8"),
    "zed_depth": partial(send_depth, encoding="bgra8", depth=depth_m(), depth_encoding="32FC1"),
    "oak_d": partial(send_pair, encoding="mono8", right_stamp=STAMP + 8_000_000),
    "bumblebee_x": partial(
        send_depth, encoding="rgb8", depth=depth_m(), depth_encoding="32FC1", depth_stamp=STAMP + 15_000_000
    ),
    "flir_pair": partial(send_pair, encoding="bayer_rggb8", image="image_raw"),
}


def test_each_family_has_a_driver():
    assert FRAMES.keys() == FAMILIES.keys()


@pytest.mark.parametrize("family", FAMILIES)
def test_frames_of_the_driver_become_masks(ros, family):
    driver = Driver(family)
    try:
        FRAMES[family](driver)
        mask = driver.mask()
    finally:
        driver.close()
    assert mask.shape == (HEIGHT, WIDTH)
    assert np.mean(mask[HEIGHT // 2 :] == 255) > 0.9
    assert not mask[: round(CAMERA.cy) - 8].any()
