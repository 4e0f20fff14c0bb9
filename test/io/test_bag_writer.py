"""Bags that are written: what comes back, and that none is half done."""

import dataclasses
import itertools

import numpy as np
import pytest
from recorder import (
    CAMERA,
    assert_same,
    make_frames,
    random_image,
)

from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_writer import FORMATS, write_stereo_bag


@pytest.mark.parametrize("kind", FORMATS)
def test_frames_come_back(kind, tmp_path):
    frames = make_frames()
    write_stereo_bag(tmp_path / "bag", frames, format=kind)
    with StereoBag(tmp_path / "bag") as bag:
        assert (len(bag), bag.source) == (6, "stereo")
        result = list(bag.frames())
        assert bag.problems == []
    for frame, written in zip(result, frames, strict=True):
        assert_same(frame, written)
        assert dataclasses.astuple(frame.camera) == pytest.approx(dataclasses.astuple(CAMERA))
    assert [file.name for file in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize("key", ["disparity", "depth_m"])
def test_disparity_and_depth_frames_come_back(key, tmp_path):
    values = random_image(9, channels=1).astype(np.float32) / 7
    values[3:9, 4:30] = 0
    frames = make_frames(2, **{key: values})
    write_stereo_bag(tmp_path / "bag", frames)
    with StereoBag(tmp_path / "bag") as bag:
        assert bag.source == key.removesuffix("_m")
        result = list(bag.frames())
        for frame, written in zip(result, frames, strict=True):
            assert_same(frame, written)
            assert dataclasses.astuple(frame.camera) == pytest.approx(dataclasses.astuple(CAMERA))


def test_writing_replaces_nothing_and_leaves_nothing_half_done(tmp_path):
    path = tmp_path / "bag"
    with pytest.raises(ValueError, match="'zip'; choose one of mcap, sqlite3, rosbag1"):
        write_stereo_bag(path, [], format="zip")
    unstamped = dataclasses.replace(make_frames(1)[0], stamp_ns=None)
    with pytest.raises(ValueError, match="has no stamp"):
        write_stereo_bag(path, itertools.chain(make_frames(2), [unstamped]))
    assert list(tmp_path.iterdir()) == []
    write_stereo_bag(path, make_frames(1))
    with pytest.raises(FileExistsError, match="exists; remove it"):
        write_stereo_bag(path, make_frames(2))
    with StereoBag(path) as bag:
        assert len(bag) == 1
