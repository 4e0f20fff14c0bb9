"""Tests of what a detection writes: frames.csv, files that are whole, and folders that are never lost."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
import recorded

from lrtrav_ros import Config, Detector
from lrtrav_ros.io.image_files import read_disparity, read_image
from lrtrav_ros.io.parameter_file import read_parameter_file
from lrtrav_ros.io.result_folder import (
    EXTRAS,
    ResultFolder,
    available_extras,
    checked_extras,
    frame_result,
    unusable_frame,
)
from lrtrav_ros.mapping.grid import ground_grid

CONFIG = Config().updated({"stereo.n_disparities": 64, "superpixels.n_superpixels": 60})


@pytest.fixture(scope="module")
def detection():
    frame = recorded.frames(n=1)[0]
    return Detector(CONFIG, frame.camera).detect_frame(frame)


def rows(path):
    with (path / "frames.csv").open(newline="", encoding="utf-8") as table:
        return list(csv.DictReader(table))


def test_frame_is_written_with_all_extras(tmp_path, detection):
    with ResultFolder(tmp_path / "out", CONFIG) as results:
        results.write(frame_result("a b", detection, recorded.CAMERA, extras=tuple(EXTRAS)))
    out = tmp_path / "out"
    short, long = detection.short_range, detection.long_range
    assert np.array_equal(read_image(out / "short_range/a b.png"), short.mask)
    assert np.array_equal(read_image(out / "long_range/a b.png"), long.mask)
    assert read_image(out / "overlay/a b.jpg").shape == detection.image.shape
    np.testing.assert_allclose(read_disparity(out / "disparity/a b.png"), detection.disparity, atol=1 / 512)
    assert np.array_equal(read_image(out / "superpixels/a b.png"), long.superpixels)
    assert np.array_equal(read_image(out / "clusters/a b.png"), long.clusters)
    assert np.array_equal(read_image(out / "occupancy/a b.png"), long.occupancy)
    confidence = read_image(out / "confidence/a b.png")
    assert (confidence.dtype, confidence.shape) == (np.uint8, detection.image.shape[:2])
    assert np.array_equal(confidence, long.confidence)
    grid = read_image(out / "grid/a b.png")
    assert np.array_equal(grid, ground_grid(long.occupancy, short, recorded.CAMERA, CONFIG.maps).image)
    assert read_image(out / "u_disparity/a b.png").shape[:2] == short.u_disparity.shape
    assert read_image(out / "v_disparity/a b.png").shape[:2] == short.v_disparity.shape
    for extra in ("obstacle_disparity", "wld"):
        assert read_image(out / extra / "a b.png").shape[:2] == detection.image.shape[:2]


def test_row_says_what_was_measured(tmp_path, detection):
    with ResultFolder(tmp_path, CONFIG) as results:
        results.write(frame_result("a", detection, recorded.CAMERA))
    (row,) = rows(tmp_path)
    line = detection.short_range.line
    assert row["name"] == "a"
    assert float(row["matching_ms"]) == pytest.approx(detection.times.matching_ms, abs=0.006)
    assert float(row["slope"]) == pytest.approx(line.slope, rel=1e-4)
    assert float(row["camera_height_m"]) == pytest.approx(line.camera_height_m(recorded.CAMERA), rel=1e-4)
    assert float(row["pitch_deg"]) == pytest.approx(math.degrees(line.pitch_rad(recorded.CAMERA)), rel=1e-4)
    assert int(row["n_superpixels"]) == len(detection.long_range.superpixel_clusters)
    assert int(row["n_clusters"]) == len(set(detection.long_range.superpixel_clusters.tolist()))
    assert row["problem"] == ""


def test_frame_that_could_not_be_used_has_its_row_and_no_files(tmp_path):
    with ResultFolder(tmp_path, CONFIG) as results:
        results.write(unusable_frame("a", 'left/a.png: "no" image, at all'))
    (row,) = rows(tmp_path)
    assert (row["name"], row["problem"], row["slope"]) == ("a", 'left/a.png: "no" image, at all', "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["config.yaml", "frames.csv"]


def test_frame_without_ground_says_so():
    image = np.zeros((20, 30, 3), np.uint8)
    detection = Detector(CONFIG, recorded.CAMERA).detect(image, image)
    result = frame_result("a", detection, recorded.CAMERA)
    assert result.problem == "no ground line found"
    assert {"short_range/a.png", "long_range/a.png", "overlay/a.jpg"} == set(result.files)


def test_rows_are_on_disk_as_soon_as_they_are_written(tmp_path):
    with ResultFolder(tmp_path, CONFIG) as results:
        results.write(unusable_frame("a", "no"))
        assert [row["name"] for row in rows(tmp_path)] == ["a"]


def test_configuration_is_read_back(tmp_path):
    with ResultFolder(tmp_path, CONFIG):
        pass
    assert read_parameter_file(tmp_path / "config.yaml").config() == CONFIG


def test_unknown_extra_is_refused():
    with pytest.raises(ValueError, match="cannot save 'normals'; choose one of disparity, superpixels"):
        checked_extras(["disparity", "normals"], CONFIG)


def test_confidence_is_there_by_propagation_alone():
    assert available_extras(CONFIG) == tuple(EXTRAS)
    assert checked_extras(["confidence"], CONFIG) == ("confidence",)
    evidence = CONFIG.updated({"extension.rule": "evidence"})
    assert available_extras(evidence) == tuple(name for name in EXTRAS if name != "confidence")
    message = "cannot save 'confidence': only the rule propagation finds it; set extension.rule to that"
    with pytest.raises(ValueError, match=message):
        checked_extras(["disparity", "confidence"], evidence)
    frame = recorded.frames(n=1)[0]
    with pytest.raises(ValueError, match=message):
        frame_result("a", Detector(evidence).detect_frame(frame), frame.camera, extras=("confidence",))
