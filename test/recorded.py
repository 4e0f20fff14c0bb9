"""Small recordings for tests: one rendered sequence as dataset folder, bags and single frames."""

from __future__ import annotations

import dataclasses
import json
from functools import lru_cache

import cv2
import numpy as np
import pytest

from lrtrav_ros.io import bag_writer
from lrtrav_ros.io.bag_messages import ROS2
from lrtrav_ros.io.dataset_folder import write_calibration, write_frame
from lrtrav_ros.synthetic.rendering import render_sequence
from lrtrav_ros.synthetic.scene_config import SceneConfig

SCENE = SceneConfig(seed=3, style="road", n_frames=4, width=208, height=128, baseline_m=0.3, noise=1.0)
HEIGHT, WIDTH, CAMERA = SCENE.height, SCENE.width, SCENE.camera
N_FRAMES = SCENE.n_frames
FAST = ("--set", "stereo.n_disparities=64", "--set", "superpixels.n_superpixels=60")


@lru_cache(maxsize=1)
def rendered():
    """The sequence: frames of left and right image with exact disparity and truth."""
    return tuple(render_sequence(SCENE))


def frames(source="stereo", *, grey=False, n=N_FRAMES):
    """Return frames that carry one of the sources."""
    result = []
    for item in rendered()[:n]:
        left, right = item.frame.left, item.frame.right
        if grey:
            left, right = left[..., 1].copy(), right[..., 1].copy()
        disparity = np.round(item.disparity * 256) / np.float32(256)  # as a file holds it
        depth_m = np.round(CAMERA.depth_m(item.disparity).clip(0, 250) * 256) / np.float32(256)
        inputs = {"right": right, "disparity": disparity, "depth_m": depth_m}
        keep = {"stereo": "right", "disparity": "disparity", "depth": "depth_m"}[source]
        inputs = {name: value if name == keep else None for name, value in inputs.items()}
        result.append(dataclasses.replace(item.frame, left=left, **inputs))
    return result


def write_dataset(folder, frames, *, truth=False, **calibration):
    """Write frames as a dataset folder, with values of its calibration replaced, or left out where they are None."""
    for frame, item in zip(frames, rendered(), strict=False):
        write_frame(folder, frame, truth=item.truth if truth else None)
    height, width = frames[0].left.shape[:2]
    write_calibration(folder, frames[0].camera, width, height)
    if calibration:
        path = folder / "calib.json"
        values = {**json.loads(path.read_text()), **calibration}
        path.write_text(json.dumps({name: value for name, value in values.items() if value is not None}))
    return folder


def write_compressed_bag(path, frames, suffix=".png", **options):
    """Write frames as a bag whose images are all compressed, as ``.png`` or ``.jpg`` files are."""

    def compressed(header, image):
        data = cv2.imencode(suffix, image)[1].reshape(-1)
        kind = {".png": "png", ".jpg": "jpeg"}[suffix]
        text = f"bgr8; {kind} compressed bgr8"
        return ROS2.types["sensor_msgs/msg/CompressedImage"](header=header, format=text, data=data)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bag_writer, "image_message", compressed)
        patch.setattr(bag_writer, "LEFT_IMAGE", "left/image_rect/compressed")
        patch.setattr(bag_writer, "RIGHT_IMAGE", "right/image_rect/compressed")
        bag_writer.write_stereo_bag(path, frames, **options)
