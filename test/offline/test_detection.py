"""Tests of detection with memory: frames in their order, each recording by itself."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros import Config, Detector, StereoCamera
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.bag_writer import write_stereo_bag
from lrtrav_ros.io.dataset_folder import write_calibration, write_frame
from lrtrav_ros.io.image_files import read_image
from lrtrav_ros.offline.detection import detect_recording

HEIGHT, WIDTH = 120, 160
CAMERA = StereoCamera(fx=150.0, fy=150.0, cx=80.0, cy=40.0, baseline_m=0.25)
HEDGE = slice(48, 66)
SINGLE = Config().updated({"superpixels.n_superpixels": 80})
CONFIG = SINGLE.updated({"memory.frames": 2})
NAMES = ("0", "100000000", "200000000")


def frame(name: str, *, is_near: bool) -> Frame:
    """Return sky, a hedge and ground before it; far away, only the lowest rows of the ground have disparity."""
    left = np.random.default_rng(int(name)).integers(0, 40, (HEIGHT, WIDTH, 3))
    left += (200, 190, 170)
    left[HEDGE] += np.array((30, 140, 60)) - (200, 190, 170)
    left[HEDGE.stop :] += np.array((120, 110, 100)) - (200, 190, 170)
    ground = CAMERA.baseline_m / 1.0 * np.maximum(np.arange(HEIGHT) - CAMERA.cy, 0)
    disparity = np.where(np.arange(HEIGHT) < HEDGE.stop, ground[HEDGE.stop], ground)
    disparity[: HEDGE.start if is_near else 90] = 0
    return Frame(
        name=name,
        camera=CAMERA,
        left=left.astype(np.uint8),
        disparity=np.repeat(disparity.astype(np.float32)[:, None], WIDTH, axis=1),
        stamp_ns=int(name),
    )


NEAR, FAR, FAR_AGAIN = (frame(name, is_near=name == "0") for name in NAMES)


def masks(config: Config, *frames: Frame) -> list[NDArray[np.uint8]]:
    """Return the masks of frames that one detector sees after each other."""
    detector = Detector(config)
    return [detector.detect_frame(item).long_range.mask for item in frames]


def written(folder: Path, *frames: Frame) -> Path:
    for item in frames:
        write_frame(folder, item)
    write_calibration(folder, CAMERA, WIDTH, HEIGHT)
    return folder


def detected(path: Path, output: Path, config: Config = CONFIG) -> list[NDArray[np.uint8]]:
    detect_recording(path, output, config)
    return [read_image(file) for file in sorted((output / "long_range").iterdir())]


@pytest.mark.parametrize("is_bag", [False, True])
def test_frames_lend_those_after_them_their_evidence(tmp_path: Path, is_bag: bool) -> None:
    path = tmp_path / "input"
    if is_bag:
        write_stereo_bag(path, [NEAR, FAR, FAR_AGAIN])
    else:
        written(path, NEAR, FAR, FAR_AGAIN)
    results = detected(path, tmp_path / "out")
    for result, expected in zip(results, masks(CONFIG, NEAR, FAR, FAR_AGAIN), strict=True):
        np.testing.assert_array_equal(result, expected)
    # The hedge is known from the first frame; in the others alone, more than a third of it is taken for ground.
    assert [float(np.mean(result[HEDGE])) for result in results] == [0, 0, 0]
    assert np.mean(masks(SINGLE, FAR)[0][HEDGE]) > 255 / 3


def test_without_memory_each_frame_stands_alone(tmp_path: Path) -> None:
    results = detected(written(tmp_path / "input", NEAR, FAR), tmp_path / "out", SINGLE)
    for result, item in zip(results, (NEAR, FAR), strict=True):
        np.testing.assert_array_equal(result, masks(SINGLE, item)[0])


def test_each_recording_begins_with_an_empty_memory(tmp_path: Path) -> None:
    first, second = written(tmp_path / "first", NEAR), written(tmp_path / "second", FAR)
    detected(first, tmp_path / "out1")
    (result,) = detected(second, tmp_path / "out2")
    np.testing.assert_array_equal(result, masks(SINGLE, FAR)[0])


def test_a_frame_that_cannot_be_used_leaves_the_memory(tmp_path: Path) -> None:
    path = written(tmp_path / "input", NEAR, FAR, FAR_AGAIN)
    (path / "left" / f"{FAR.name}.png").write_bytes(b"no image")
    results = detected(path, tmp_path / "out")
    for result, expected in zip(results, masks(CONFIG, NEAR, FAR_AGAIN), strict=True):
        np.testing.assert_array_equal(result, expected)


def test_a_gap_in_time_makes_it_forget(tmp_path: Path) -> None:
    late = dataclasses.replace(FAR, name="2100000000", stamp_ns=2_100_000_000)
    write_stereo_bag(tmp_path / "bag", [NEAR, late])
    results = detected(tmp_path / "bag", tmp_path / "out")
    np.testing.assert_array_equal(results[1], masks(SINGLE, FAR)[0])


@pytest.mark.parametrize(("jobs", "cluster"), [(2, None), (0, None), (1, "tcp://127.0.0.1:1")])
def test_frames_side_by_side_are_refused_before_anything_is_written(
    tmp_path: Path, jobs: int, cluster: str | None
) -> None:
    message = "memory.frames is 2, so each frame needs those before it: detect in one process, with --jobs 1"
    with pytest.raises(ValueError, match=message):
        detect_recording(written(tmp_path / "in", NEAR), tmp_path / "out", CONFIG, jobs=jobs, cluster=cluster)
    assert not (tmp_path / "out").exists()
