"""Dataset folders and rosbags with truth, written by the tests."""

import numpy as np
import pytest
from recorded import HEIGHT, WIDTH, frames, rendered, write_dataset

from lrtrav_ros.config import SourceConfig
from lrtrav_ros.evaluation.truth.labels import Labels
from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_set
from lrtrav_ros.io.bag_writer import write_stereo_bag
from lrtrav_ros.io.image_files import write_image

FRAME, TRUTH = frames()[0], rendered()[0].truth


def test_dataset_folder_gives_its_frames_with_truth(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(), truth=True)
    (folder / "gt" / f"{frames()[1].name}.png").unlink()
    opened = open_set(folder, ReaderOptions())
    assert opened.names == [frame.name for i, frame in enumerate(frames()) if i != 1]
    assert (opened.n_without_truth, opened.unknown_rule) == (1, "ignore")
    labelled = next(opened.items([FRAME.name])).read()
    assert np.array_equal(labelled.frame.right, FRAME.right)
    assert np.array_equal(labelled.truth, TRUTH)
    assert {file.parent.name for file in opened.files(FRAME.name)} == {"left", "right", "gt", "set"}


def test_heights_are_read_where_there_are_any(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(n=2), truth=True)
    height_mm = np.zeros((HEIGHT, WIDTH), np.uint16)
    height_mm[30:40, 50:60] = 1250
    write_image(folder / "height" / f"{FRAME.name}.png", height_mm)
    opened = open_set(folder, ReaderOptions())
    first, second = (item.read() for item in opened.items(opened.names))
    assert np.unique(first.height_m).tolist() == [0.0, 1.25]
    assert first.height_m[30, 50] == 1.25
    assert second.height_m is None
    assert folder / "height" / f"{FRAME.name}.png" in opened.files(FRAME.name)
    write_image(folder / "height" / f"{FRAME.name}.png", height_mm.T.copy())
    with pytest.raises(
        ValueError, match=f"the heights are {HEIGHT} x {WIDTH} pixels, but the frame is {WIDTH} x {HEIGHT}"
    ):
        next(opened.items([FRAME.name])).read()


def test_images_of_more_pixels_than_are_allowed_are_refused(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(n=1), truth=True)
    options = ReaderOptions(source=SourceConfig(max_pixels=HEIGHT * WIDTH - 1))
    (item,) = open_set(folder, options).items([FRAME.name])
    with pytest.raises(ValueError, match=f"source.max_pixels allows {HEIGHT * WIDTH - 1}"):
        item.read()


def test_truth_without_its_image_fails_alone(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(), truth=True)
    (folder / "left" / f"{FRAME.name}.png").unlink()
    first, second = list(open_set(folder, ReaderOptions()).items([frame.name for frame in frames()[:2]]))
    with pytest.raises(FileNotFoundError, match=FRAME.name):
        first.read()
    assert second.read().frame.name == frames()[1].name


def test_other_labels_and_sizes_of_the_truth(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(n=1))
    write_image(folder / "gt" / f"{FRAME.name}.png", np.select([TRUTH == 255, TRUTH == 0], [0, 1], 2).astype(np.uint8))
    (item,) = open_set(folder, ReaderOptions()).items([FRAME.name])
    with pytest.raises(ValueError, match=f"gt/{FRAME.name}.png: ground truth has the value 1, .* see --labels"):
        item.read()
    (item,) = open_set(folder, ReaderOptions(labels=Labels(0, 1, 2))).items([FRAME.name])
    assert np.array_equal(item.read().truth, TRUTH)
    write_image(folder / "gt" / f"{FRAME.name}.png", TRUTH.T)
    (item,) = open_set(folder, ReaderOptions()).items([FRAME.name])
    with pytest.raises(
        ValueError, match=f"the ground truth is {HEIGHT} x {WIDTH} pixels, but the frame is {WIDTH} x {HEIGHT}"
    ):
        item.read()


def test_bag_with_a_folder_of_truth(tmp_path):
    bag = tmp_path / "drive"
    write_stereo_bag(bag, frames())
    stamps = [str(frame.stamp_ns) for frame in frames()]
    for stamp, item in zip(stamps[:2], rendered(), strict=False):
        write_image(tmp_path / "labels" / f"{stamp}.png", item.truth)
    write_image(tmp_path / "labels" / "123.png", TRUTH)
    opened = open_set(bag, ReaderOptions(truth=tmp_path / "labels"))
    assert opened.names == sorted(["123", *stamps[:2]])
    *read, missing = opened.items(opened.names)
    assert [item.name for item in read] == stamps[:2]
    assert np.array_equal(read[1].read().frame.left, frames()[1].left)
    assert np.array_equal(read[1].read().truth, rendered()[1].truth)
    with pytest.raises(ValueError, match="drive has no such frame"):
        missing.read()


def test_damage_of_a_bag_is_told(tmp_path):
    write_stereo_bag(tmp_path / "drive", frames())
    stamps = [str(frame.stamp_ns) for frame in frames()]
    write_image(tmp_path / "labels" / f"{stamps[0]}.png", rendered()[0].truth)
    options = ReaderOptions(truth=tmp_path / "labels")
    assert open_set(tmp_path / "drive", options).problems() == []
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((tmp_path / "drive" / "drive.mcap").read_bytes()[:-200])
    for is_read in (False, True):
        damaged = open_set(cut, options)
        assert not is_read or len(list(damaged.items(damaged.names))) == 1
        assert "cut.mcap: damaged or not finished" in damaged.problems()[0]
