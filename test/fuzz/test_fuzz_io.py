"""Whatever is in a message or a file: what is read is valid, or ValueError says why it is not."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from strategies import SHAPES, images

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, parameters
from lrtrav_ros.frame import Frame
from lrtrav_ros.io import bag_messages, camera_info
from lrtrav_ros.io.dataset_folder import read_camera
from lrtrav_ros.io.encodings import ENCODINGS, decode_compressed, decode_image, decode_message
from lrtrav_ros.io.message_frames import depth_in_metres
from lrtrav_ros.io.parameter_file import dump_parameters, read_parameter_file
from lrtrav_ros.io.rvl import decode_rvl
from lrtrav_ros.io.serialized_message import SerializedMessage

Array = NDArray[Any]
NUMBERS = st.integers(0, 70) | st.integers(0, 2**32 - 1)
FLOATS = st.floats() | st.floats(-100, 100) | st.integers(-(10**400), 10**400)
JSON = st.recursive(
    st.none() | st.booleans() | FLOATS | st.text(max_size=5),
    lambda values: st.lists(values, max_size=5) | st.dictionaries(st.text(max_size=5), values, max_size=5),
    max_leaves=8,
)
TYPES = get_typestore(Stores.ROS2_JAZZY)


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """Return bytes of which some are changed, left out or added, or the end is cut off."""
    data, edits = bytearray(whole), st.tuples(st.integers(0, max(len(whole) - 1, 0)), st.binary(max_size=8))
    for place, new in draw(st.lists(edits, max_size=4)):
        data[place : place + draw(st.sampled_from([0, 1, len(new)]))] = new
    return bytes(data[: draw(st.none() | st.integers(0, len(data)))])


def assert_image(image: Array) -> None:
    assert image.dtype in (np.uint8, np.uint16, np.float32)
    assert image.ndim == 2 or image.shape[2:] == (3,)
    assert image.flags.c_contiguous


@given(
    encoding=st.sampled_from(ENCODINGS) | st.text(max_size=9),
    size=st.tuples(st.integers(1, 20), st.integers(1, 20)) | st.tuples(NUMBERS, NUMBERS),
    step=st.none() | NUMBERS,
    is_bigendian=st.booleans() | st.integers(0, 255),
    data=st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).bytes(4000)) | st.binary(),
)
def test_image_message(encoding: str, size: tuple[int, int], step: int | None, is_bigendian: int, data: bytes) -> None:
    height, width = size
    step = 8 * width if step is None else step
    try:
        image = decode_image(data, encoding=encoding, height=height, width=width, step=step, is_bigendian=is_bigendian)
    except ValueError:
        return
    assert_image(image)
    assert image.shape[:2] == size


FORMATS = ("jpeg", "png", "rgb8; jpeg compressed bgr8", "bgr8; png compressed rgb8", "bayer_rggb8; png", "", ";")
FILES = st.tuples(
    SHAPES.flatmap(lambda shape: images(shape, dtypes=(np.uint8, np.uint16))),
    st.sampled_from((".png", ".jpg", ".tif", ".webp", ".bmp")),
)


@given(
    data=FILES.map(lambda file: _file(*file)).flatmap(damaged) | st.binary(),
    text=st.sampled_from(FORMATS) | st.text(max_size=20),
)
def test_compressed_image(data: bytes, text: str) -> None:
    try:
        image = decode_compressed(data, text)
    except ValueError:
        return
    assert_image(image)


def _file(image: Array, end: str) -> bytes:
    """Return an image as a file; 8 bits where the format has no more."""
    image = (image >> 8).astype(np.uint8) if image.dtype == np.uint16 and end not in (".png", ".tif") else image
    return cv2.imencode(end, image)[1].tobytes()


@given(
    header=st.binary(min_size=12, max_size=12),
    png=st.booleans(),
    depth=SHAPES.flatmap(lambda shape: images(shape, channels=(1,), dtypes=(np.uint16,))).flatmap(
        lambda image: damaged(_file(image, ".png"))
    ),
    size=st.tuples(NUMBERS, NUMBERS),
    words=st.binary(),
    encoding=st.sampled_from(("16UC1", "32FC1", "")),
)
def test_compressed_depth(
    header: bytes, png: bool, depth: bytes, size: tuple[int, int], words: bytes, encoding: str
) -> None:
    sizes = np.array(size, "<u4").tobytes()
    data, kind = (depth, "compressedDepth png") if png else (sizes + words, "compressedDepth rvl")
    try:
        image = decode_compressed(header + data, f"{encoding}; {kind}")
        depth_m = depth_in_metres(image)
    except ValueError:
        return
    assert depth_m.dtype == np.float32
    camera = StereoCamera(fx=50.0, cx=20.0, cy=20.0, baseline_m=0.1)
    frame = Frame(camera=camera, depth_m=depth_m)
    assert np.isfinite(frame.depth_m).all()


@given(words=st.binary(), height=st.integers(-1, 30), width=st.integers(-1, 30))
def test_rvl(words: bytes, height: int, width: int) -> None:
    try:
        depth = decode_rvl(words, height=height, width=width)
    except ValueError:
        return
    assert (depth.dtype, depth.shape) == (np.uint16, (height, width))


def _messages() -> dict[str, Any]:
    """Return a message of each type that is subscribed to, by its type."""
    header = bag_messages.header_message(10**9, "camera")
    camera = StereoCamera(fx=20.0, cx=8.0, cy=6.0, baseline_m=0.1)
    image = np.arange(12 * 16, dtype=np.uint8).reshape(12, 16)
    found = {
        "sensor_msgs/msg/Image": bag_messages.image_message(header, image),
        "sensor_msgs/msg/CameraInfo": bag_messages.camera_info_message(header, camera, (12, 16), baseline_m=0.1),
        "stereo_msgs/msg/DisparityImage": bag_messages.disparity_message(header, image.astype(np.float32), camera),
    }
    compressed = TYPES.types["sensor_msgs/msg/CompressedImage"]
    data = np.frombuffer(_file(image, ".png"), np.uint8)
    return {**found, "sensor_msgs/msg/CompressedImage": compressed(header=header, format="png", data=data)}


SERIALIZED = {name: bytes(TYPES.serialize_cdr(message, name)) for name, message in _messages().items()}


@pytest.mark.parametrize("type_name", SERIALIZED)
@given(data=st.data())
def test_serialized_message(type_name: str, data: st.DataObject) -> None:
    try:
        message = SerializedMessage(data.draw(damaged(SERIALIZED[type_name]) | st.binary()), type_name)
        assert isinstance(message.stamp_ns, int)
        fields = message.decode()
        if type_name.endswith("CameraInfo"):
            assert camera_info.stereo_camera(fields, fields).baseline_m > 0
        elif type_name.endswith("Image") and "stereo" not in type_name:
            assert_image(decode_message(fields))
    except ValueError:
        return


@given(
    p=st.lists(st.floats(), min_size=12, max_size=12) | st.tuples(*12 * (st.floats(-50, 50),)),
    k=st.lists(st.floats(-50, 50) | st.floats(), min_size=9, max_size=9),
    d=st.lists(st.floats(-1, 1) | st.floats(), max_size=15),
    size=st.tuples(st.integers(0, 64), st.integers(0, 64)) | st.tuples(NUMBERS, NUMBERS),
    binning=st.tuples(st.integers(0, 3), st.integers(0, 3)),
    model=st.sampled_from(("plumb_bob", "rational_polynomial", "equidistant", "")) | st.text(max_size=5),
)
def test_camera_info(
    p: list[float], k: list[float], d: list[float], size: tuple[int, int], binning: tuple[int, int], model: str
) -> None:
    header = bag_messages.header_message(10**9, "camera")
    camera = StereoCamera(fx=20.0, cx=8.0, cy=6.0, baseline_m=0.1)
    left, right = (bag_messages.camera_info_message(header, camera, (12, 16), baseline_m=shift) for shift in (0, 0.1))
    right.p, right.k, right.d, right.distortion_model = np.array(p), np.array(k), np.array(d), model
    right.height, right.width = size
    right.binning_x, right.binning_y = binning
    for make in (camera_info.stereo_camera, camera_info.raw_pair_of):
        for one, other in ((left, right), (right, right), (right, left)):
            try:
                found = make(one, other)
            except ValueError:
                continue
            found = found if isinstance(found, StereoCamera) else found.camera
            assert all(map(math.isfinite, found.coefficients))


CALIBRATION = {"fx": 20.0, "fy": 20.0, "cx": 8.0, "cy": 6.0, "baseline_m": 0.1, "width": 16, "height": 12}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz") / "file"


@given(
    data=st.dictionaries(st.sampled_from(tuple(CALIBRATION)), JSON, max_size=2).map(
        lambda changes: json.dumps({**CALIBRATION, **changes}).encode()
    )
    | JSON.map(lambda values: json.dumps(values).encode())
    | damaged(json.dumps(CALIBRATION).encode())
    | st.binary()
)
def test_calibration_file(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    try:
        camera = read_camera(path)
    except ValueError:
        return
    assert all(map(math.isfinite, camera.coefficients))


NAMES = st.sampled_from(tuple(parameter.name for parameter in parameters()))


@given(
    data=st.dictionaries(NAMES, JSON, max_size=3).map(
        lambda values: json.dumps({"/**": {"ros__parameters": values}}).encode()
    )
    | damaged(dump_parameters(Config()).encode())
    | st.text().map(str.encode)
    | st.binary()
)
def test_parameter_file(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    try:
        found = read_parameter_file(path)
    except ValueError:
        return
    assert isinstance(Config().updated(found.values), Config)
