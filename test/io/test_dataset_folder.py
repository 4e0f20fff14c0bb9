"""Tests of dataset folders: what is written is read, and what is wrong is named."""

import json
import re

import numpy as np
import pytest
from damaged_files import refusal, variants
from raw_cameras import ROTATION, TRANSLATION_M, pair, texture

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.dataset_folder import DatasetFolder, read_camera, write_calibration, write_frame
from lrtrav_ros.io.image_files import write_image
from lrtrav_ros.rectification import Rectification

HEIGHT, WIDTH = 24, 37
CAMERA = StereoCamera(fx=50.5, fy=51.0, cx=18.25, cy=11.5, baseline_m=0.12, width=WIDTH, height=HEIGHT)


def make_frame(name, **inputs):
    """Return a frame with a left image of its own."""
    random = np.random.default_rng(sum(map(ord, name)))
    left, right = random.integers(0, 256, (2, HEIGHT, WIDTH, 3), np.uint8)
    return Frame(name=name, left=left, camera=CAMERA, **(inputs or {"right": right}))


@pytest.fixture
def depth():
    return np.random.default_rng(5).integers(0, 5000, (HEIGHT, WIDTH)).astype(np.float32) / 256


@pytest.fixture
def folder(tmp_path):
    """A folder of three stereo frames; the second one has ground truth."""
    for name in ("b", "a", "c"):
        write_frame(tmp_path, make_frame(name), truth=truth() if name == "b" else None)
    write_calibration(tmp_path, CAMERA, WIDTH, HEIGHT)
    return tmp_path


def truth():
    values = np.full((HEIGHT, WIDTH), 128, np.uint8)
    values[15:, :20] = 255
    values[:5] = 0
    return values


def change_calibration(folder, **values):
    """Replace values of the calibration; None removes one."""
    path = folder / "calib.json"
    content = {**json.loads(path.read_text()), **values}
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not None}))


def test_stereo_frames_come_back(folder):
    dataset = DatasetFolder(folder)
    assert dataset.names == ["a", "b", "c"]
    assert len(dataset) == 3
    assert dataset.source == "stereo"
    for name in dataset.names:
        frame, written = dataset.frame(name), make_frame(name)
        assert frame.name == name
        assert frame.camera == CAMERA
        assert np.array_equal(frame.left, written.left)
        assert np.array_equal(frame.right, written.right)
        assert frame.disparity is frame.depth_m is frame.stamp_ns is None


@pytest.mark.parametrize("key", ["disparity", "depth_m"])
def test_disparity_and_depth_come_back(tmp_path, depth, key):
    write_frame(tmp_path, make_frame("x", **{key: depth}))
    write_calibration(tmp_path, CAMERA, WIDTH, HEIGHT)
    dataset = DatasetFolder(tmp_path, source="stereo")
    assert dataset.source == key.removesuffix("_m")
    frame = dataset.frame("x")
    assert np.array_equal(getattr(frame, key), depth)
    assert frame.right is None


def test_depth_is_in_millimetres_without_a_scale(tmp_path, depth):
    write_frame(tmp_path, make_frame("x", depth_m=depth))
    write_calibration(tmp_path, CAMERA, WIDTH, HEIGHT)
    change_calibration(tmp_path, depth_scale=None)
    assert DatasetFolder(tmp_path).frame("x").depth_m == pytest.approx(depth * 0.256)
    change_calibration(tmp_path, depth_scale=128)
    assert np.array_equal(DatasetFolder(tmp_path).frame("x").depth_m, depth * 2)


def test_the_preferred_source_is_taken(tmp_path, depth):
    write_frame(tmp_path, make_frame("x"), disparity=depth)
    write_frame(tmp_path, make_frame("x", depth_m=depth + 1))
    write_calibration(tmp_path, CAMERA, WIDTH, HEIGHT)
    for source, field in (("stereo", "right"), ("disparity", "disparity"), ("depth", "depth_m")):
        frame = DatasetFolder(tmp_path, source=source).frame("x")
        given = [name for name in ("right", "disparity", "depth_m") if getattr(frame, name) is not None]
        assert given == [field]
    with pytest.raises(ValueError, match="'lidar'; choose one of stereo, disparity, depth"):
        DatasetFolder(tmp_path, source="lidar")


def test_a_frame_may_have_a_calibration_of_its_own(folder):
    (folder / "calib").mkdir()
    own = json.loads((folder / "calib.json").read_text())
    (folder / "calib" / "b.json").write_text(json.dumps({**own, "fx": 70.0}))
    dataset = DatasetFolder(folder)
    assert [dataset.frame(name).camera.fx for name in dataset.names] == [50.5, 70.0, 50.5]


def test_16_bit_pairs_come_as_they_are(folder):
    left = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH)
    write_image(folder / "left" / "a.png", left)
    write_image(folder / "right" / "a.png", left * 4)
    frame = DatasetFolder(folder).frame("a")
    assert np.array_equal(frame.left, left)
    assert np.array_equal(frame.right, left * 4)
    assert np.array_equal(frame.image, left // 4)  # 887 at most: 10 bits


def test_jpeg_and_png_may_be_mixed(folder):
    (folder / "left" / "a.png").unlink()
    write_image(folder / "left" / "a.JPG", np.full((HEIGHT, WIDTH, 3), 99, np.uint8))
    dataset = DatasetFolder(folder)
    assert dataset.names == ["a", "b", "c"]
    assert np.array_equal(dataset.frame("a").left, np.full((HEIGHT, WIDTH, 3), 99, np.uint8))


def test_a_broken_frame_leaves_the_others(folder):
    left = folder / "left" / "b.png"
    left.write_bytes(left.read_bytes()[:200])
    dataset = DatasetFolder(folder)
    with pytest.raises(ValueError, match=r"b\.png: 200 bytes that cannot be read as an image"):
        dataset.frame("b")
    assert dataset.frame("c").name == "c"


def test_a_missing_image_is_named(folder):
    (folder / "right" / "c.png").unlink()
    dataset = DatasetFolder(folder)
    with pytest.raises(FileNotFoundError, match=r"right/c"):
        dataset.frame("c")
    with pytest.raises(FileNotFoundError, match=r"left/nobody"):
        dataset.frame("nobody")


def test_sizes_must_agree(folder):
    write_image(folder / "right" / "a.png", np.zeros((HEIGHT, WIDTH - 1, 3), np.uint8))
    with pytest.raises(
        ValueError, match=rf"frame a: the right image is 36 x {HEIGHT} pixels, but the left image is {WIDTH}"
    ):
        DatasetFolder(folder).frame("a")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"fx": None}, "fx is missing"),
        ({"baseline_m": None}, "baseline_m is missing"),
        ({"width": None}, "width is missing"),
        ({"baseline_m": 0}, "baseline_m is 0; give a positive number"),
        ({"fy": -3.0}, "fy is -3.0; give a positive number"),
        ({"cx": float("nan")}, "cx is nan; give a finite number"),
        ({"cy": "11"}, "cy is '11'; give a finite number"),
        ({"width": 37.5}, "width is 37.5; give a whole number of pixels"),
        ({"height": -1}, "height is -1; give a whole number of pixels"),
        ({"depth_scale": 0}, "depth_scale is 0; give 1 to 1000000, such as 1000 for millimetres"),
        ({"depth_scale": 1e-50}, "depth_scale is 1e-50; give 1 to 1000000"),
        ({"depth_scale": 1e300}, r"depth_scale is 1e\+300; give 1 to 1000000"),
        ({"fx": 10**400}, "fx is inf; give a finite number"),
        ({"depth_scale": 10**400}, "depth_scale is inf; give 1 to 1000000"),
    ],
)
def test_calibrations_that_cannot_be_are_refused(folder, values, message):
    change_calibration(folder, **values)
    with pytest.raises(ValueError, match=rf"calib\.json: {message}"):
        DatasetFolder(folder).frame("a")


@pytest.mark.parametrize("size", [{"width": 640}, {"height": WIDTH}])
def test_a_calibration_for_another_size_is_refused(folder, size):
    change_calibration(folder, **size)
    with pytest.raises(ValueError, match=r"frame a: the calibration is for .* pixels, but the image is 37 x 24"):
        DatasetFolder(folder).frame("a")


@pytest.mark.parametrize(
    ("text", "message"), [("{", "cannot be read as JSON"), ("", "as JSON"), ("[1]", "is no JSON object")]
)
def test_a_calibration_that_is_no_json_is_refused(folder, text, message):
    (folder / "calib.json").write_text(text)
    with pytest.raises(ValueError, match=rf"calib\.json: .*{message}"):
        DatasetFolder(folder).frame("a")


def test_damaged_calibrations_are_refused_by_name_or_read_as_what_they_say(folder):
    path = folder / "calib.json"
    for damaged in variants(path.read_bytes(), n_flips=40, step=8):
        path.write_bytes(damaged)
        assert re.match(f"{path}: |$", refusal(read_camera, path))


def test_a_missing_calibration_is_named(folder):
    (folder / "calib.json").unlink()
    with pytest.raises(ValueError, match=r"no calibration; add calib\.json"):
        DatasetFolder(folder)
    (folder / "calib").mkdir()
    with pytest.raises(FileNotFoundError, match=r"calib/a\.json"):
        DatasetFolder(folder).frame("a")


def test_folders_that_are_none_are_refused(folder, tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no such folder"):
        DatasetFolder(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="is not a folder"):
        DatasetFolder(folder / "calib.json")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="empty/left: holds no images"):
        DatasetFolder(tmp_path / "empty")
    write_image(tmp_path / "empty" / "left" / "a.png", np.zeros((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(ValueError, match="only left images"):
        DatasetFolder(tmp_path / "empty")


def test_two_images_of_one_name_are_refused(folder):
    write_image(folder / "left" / "a.jpg", np.zeros((HEIGHT, WIDTH), np.uint8))
    with pytest.raises(ValueError, match=r"a\.png: the folder has a\.jpg too"):
        DatasetFolder(folder)


def lens_values(lens):
    names = ("fx", "fy", "cx", "cy", "distortion_model", "distortion")
    return {name: getattr(lens, name) for name in names}


@pytest.fixture
def raw_folder(tmp_path):
    """A folder of one raw pair."""
    raw = pair()
    for i, side in enumerate(("left", "right")):
        write_image(tmp_path / side / "a.png", texture(i))
    values = {"left": lens_values(raw.left), "right": lens_values(raw.right), "rotation": ROTATION.tolist()}
    size = {"width": raw.left.width, "height": raw.left.height}
    (tmp_path / "calib.json").write_text(json.dumps({**size, **values, "translation_m": TRANSLATION_M.tolist()}))
    return tmp_path


def test_raw_pairs_are_rectified(raw_folder):
    dataset, raw = DatasetFolder(raw_folder), pair()
    (frame,) = dataset.frames()
    left, right = Rectification(raw).rectify(texture(0), texture(1))
    assert frame.camera == raw.camera
    assert np.array_equal(frame.left, left)
    assert np.array_equal(frame.right, right)
    assert dataset.problems == []
    (file,) = dataset.items()
    assert np.array_equal(file.read().left, left)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"right": None}, "right is missing"),
        ({"rotation": None}, "rotation is missing"),
        ({"rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1]}, r"rotation is \[1, .*give 3 rows of 3 numbers"),
        ({"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 2]]}, "give a rotation matrix"),
        ({"translation_m": 0.1}, "translation_m is 0.1; give"),
        ({"translation_m": [0.1, 0, 0]}, "the right camera is not to the right of the left one"),
        ({"left": [1, 2]}, r"left is \[1, 2\]; give an object with fx, fy"),
        ({"left": {"fx": 1.0}}, "left: fy is missing"),
        ({"left": {**lens_values(pair().left), "distortion_model": "fov"}}, "left: distortion model 'fov' is not supp"),
        ({"left": {**lens_values(pair().left), "distortion_model": 7}}, "left: distortion_model is no text"),
        ({"right": {**lens_values(pair().left), "distortion": 0.1}}, "right: .* distortion no list"),
        ({"right": {**lens_values(pair().left), "fx": "wide"}}, "right: fx is 'wide'; give a finite number"),
        ({"width": 321}, "frame a: the calibration is for 321 x 200 pixels, but the left image is 320 x 200"),
    ],
)
def test_a_raw_calibration_that_cannot_be_is_named(raw_folder, values, message):
    change_calibration(raw_folder, **values)
    with pytest.raises(ValueError, match=message):
        DatasetFolder(raw_folder).frame("a")


def test_a_raw_calibration_is_for_pairs(raw_folder):
    write_frame(raw_folder, Frame(name="a", camera=pair().camera, disparity=np.zeros((200, 320), np.float32)))
    with pytest.raises(ValueError, match="is for raw pairs, not for disparity; add right/"):
        DatasetFolder(raw_folder, source="disparity").frame("a")
