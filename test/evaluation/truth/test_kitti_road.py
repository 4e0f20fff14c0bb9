"""KITTI Road in its own layout, written by the tests."""

import re

import numpy as np
import pytest
from damaged_files import refusal, variants
from recorded import HEIGHT, WIDTH, frames, rendered

from lrtrav_ros.config import SourceConfig
from lrtrav_ros.evaluation.truth.kitti_road import read_calibration
from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_set
from lrtrav_ros.io.image_files import write_image

FRAME, TRUTH = frames()[0], rendered()[0].truth
KITTI_CALIBRATION = (
    "P0: 1 0 0 0 0 1 0 0 0 0 1 0\n"
    "P2: 200 0 100 8 0 201 60 0 0 0 1 0.003\n"
    "P3: 200 0 100 -52 0 201 60 0 0 0 1 0.003\n\nTr: 1 2 3\n"
)


def test_kitti_road_in_its_own_layout(tmp_path):
    training = tmp_path / "data_road" / "training"
    for number in ("000000", "000001"):
        write_image(training / "image_2" / f"um_{number}.png", FRAME.left)
        write_image(training / "image_3" / f"um_{number}.png", FRAME.right)
    marked = np.zeros((HEIGHT, WIDTH, 3), np.uint8)  # BGR: red is valid, red and blue is road, black is neither
    marked[40:, :, 2] = 255
    marked[80:, 30:, 0] = 255
    write_image(training / "gt_image_2" / "um_road_000000.png", marked)
    write_image(training / "gt_image_2" / "um_lane_000001.png", marked)
    (training / "calib").mkdir()
    (training / "calib" / "um_000000.txt").write_text(KITTI_CALIBRATION)
    for path in (training, training.parent):
        opened = open_set(path, ReaderOptions())
        assert (opened.names, opened.n_without_truth) == (["um_000000"], 1)
        labelled = next(opened.items(["um_000000"])).read()
        camera = labelled.frame.camera
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == (200.0, 201.0, 100.0, 60.0)
        assert camera.baseline_m == pytest.approx(0.3)
        assert np.array_equal(labelled.frame.right, FRAME.right)
        assert [labelled.truth[v, 31] for v in (0, 50, 90)] == [128, 0, 255]
        assert labelled.truth[90, 29] == 0
    options = ReaderOptions(source=SourceConfig(max_pixels=HEIGHT * WIDTH - 1))
    with pytest.raises(ValueError, match=f"source.max_pixels allows {HEIGHT * WIDTH - 1}"):
        next(open_set(training, options).items(["um_000000"])).read()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("P2: 1 2\n", "P2 is no matrix"),
        ("P0: 1\n", "has no P2 and P3"),
        (KITTI_CALIBRATION.replace("P2: 200", "P2: 0"), "P2 has the focal length 0; give a positive one"),
        (KITTI_CALIBRATION.replace("-52", "-" + "9" * 400), "baseline_m is inf"),
        (KITTI_CALIBRATION.replace("-52", "nan"), "baseline_m is nan"),
    ],
)
def test_bad_kitti_calibration_is_refused(tmp_path, text, message):
    write_image(tmp_path / "image_2" / "um_000000.png", FRAME.left)
    write_image(tmp_path / "image_3" / "um_000000.png", FRAME.right)
    write_image(tmp_path / "gt_image_2" / "um_road_000000.png", FRAME.left)
    (tmp_path / "calib").mkdir()
    (tmp_path / "calib" / "um_000000.txt").write_text(text)
    (item,) = open_set(tmp_path, ReaderOptions()).items(["um_000000"])
    with pytest.raises(ValueError, match=f"um_000000.txt: {message}"):
        item.read()


def test_damaged_calibrations_are_refused_by_name_or_read_as_what_they_say(tmp_path):
    path = tmp_path / "um_000000.txt"
    for damaged in variants(KITTI_CALIBRATION.encode(), n_flips=40, step=8):
        path.write_bytes(damaged)
        assert re.match(f"{path}: |$", refusal(read_calibration, path))


def test_images_of_16_bits_are_read_as_they_are(tmp_path):
    left, right = FRAME.left.astype(np.uint16) * 16, FRAME.right.astype(np.uint16) * 32  # the right one is brighter
    write_image(tmp_path / "image_2" / "um_000000.png", left)
    write_image(tmp_path / "image_3" / "um_000000.png", right)
    write_image(tmp_path / "gt_image_2" / "um_road_000000.png", FRAME.left)
    (tmp_path / "calib").mkdir()
    (tmp_path / "calib" / "um_000000.txt").write_text(KITTI_CALIBRATION)
    (item,) = open_set(tmp_path, ReaderOptions()).items(["um_000000"])
    assert np.array_equal(item.read().frame.left, left)
    assert np.array_equal(item.read().frame.right, right)
