"""Tests of `detect`, through the command: all that it writes, every kind of input, and every kind of bad input."""

from __future__ import annotations

import csv
import errno
import io
import os
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recorded import CAMERA, FAST, HEIGHT, N_FRAMES, WIDTH, frames, rendered, write_compressed_bag, write_dataset

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.commands import run
from lrtrav_ros.commands.detect import output_names
from lrtrav_ros.config import Config
from lrtrav_ros.evaluation.scoring.scores import score
from lrtrav_ros.frame import Frame
from lrtrav_ros.io import bag_writer
from lrtrav_ros.io.bag_writer import FORMATS, write_stereo_bag
from lrtrav_ros.io.folder_lock import locked_folder
from lrtrav_ros.io.image_files import read_disparity, read_image, write_image
from lrtrav_ros.io.output_folder import MARK_FILE
from lrtrav_ros.io.parameter_file import read_parameter_file
from lrtrav_ros.io.result_folder import EXTRAS, ResultFolder

NAMES = [frame.name for frame in frames()]
MASKS = ("short_range", "long_range")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Four stereo frames; not to be changed."""
    return write_dataset(tmp_path_factory.mktemp("input") / "dataset", frames())


@pytest.fixture
def broken(tmp_path):
    """Four stereo frames, to be damaged."""
    return write_dataset(tmp_path / "broken", frames())


@pytest.fixture(scope="module")
def detected(dataset, tmp_path_factory):
    """The output of the command with default options."""
    output = tmp_path_factory.mktemp("detected") / "out"
    assert detect(dataset, output) == 0
    return output


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


def detect(path, output, *options):
    inputs = path if isinstance(path, list) else [path]
    return run("detect", [*map(str, inputs), "--output", str(output), *FAST, *options])


def rows(output):
    with (output / "frames.csv").open(newline="", encoding="utf-8") as table:
        return list(csv.DictReader(table))


def contents(output, *folders):
    """Return the bytes of all files by path; of frames.csv all columns but times."""
    files = {
        path.relative_to(output): path.read_bytes()
        for path in sorted(output.rglob("*"))
        if path.is_file()
        and path.name not in ("frames.csv", MARK_FILE)
        and (not folders or path.parent.name in folders)
    }
    if folders:
        return files
    table = [{key: value for key, value in row.items() if not key.endswith("_ms")} for row in rows(output)]
    return files, table


def failure(capsys):
    """Return the one line on standard error of a run that failed."""
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1, printed
    assert printed.startswith("detect: ")
    return printed


# What it writes


def test_writes_masks_overlay_table_and_configuration(detected):
    files = {str(path.relative_to(detected)) for path in detected.rglob("*") if path.is_file()}
    expected = {f"{mask}/{name}.png" for mask in MASKS for name in NAMES} | {f"overlay/{name}.jpg" for name in NAMES}
    assert files == expected | {"frames.csv", "config.yaml", MARK_FILE}
    for name in NAMES:
        for mask in MASKS:
            image = read_image(detected / mask / f"{name}.png")
            assert (image.shape, image.dtype) == ((HEIGHT, WIDTH), np.uint8)
            assert set(np.unique(image)) == {0, 255}
        assert read_image(detected / "overlay" / f"{name}.jpg").shape == (HEIGHT, WIDTH, 3)


def test_masks_are_right(detected):
    for item in rendered():
        scores = score(read_image(detected / "long_range" / f"{item.frame.name}.png"), item.truth)
        assert scores.precision > 0.9
        assert scores.recall > 0.9


def test_table_has_times_ground_line_and_numbers(detected):
    table = rows(detected)
    assert [row["name"] for row in table] == NAMES
    stages = ("matching", "ground", "superpixels", "features", "clustering", "extension")
    ground = ("slope", "intercept", "tilt", "horizon_row", "camera_height_m", "pitch_deg", "roll_deg")
    counts = ("n_superpixels", "n_clusters")
    assert tuple(table[0]) == ("name", *(f"{stage}_ms" for stage in stages), *ground, *counts, "problem")
    for row in table:
        assert [stage for stage in stages if not float(row[f"{stage}_ms"])] == ["clustering"]  # propagation needs none
        assert float(row["camera_height_m"]) == pytest.approx(1.0, abs=0.15)
        assert 0 < float(row["horizon_row"]) < HEIGHT / 2
        assert 30 <= int(row["n_superpixels"]) <= 90
        assert 2 <= int(row["n_clusters"]) <= 10
        assert row["problem"] == ""


def test_says_how_many_frames_were_detected(dataset, out, capsys):
    assert detect(dataset, out) == 0
    assert capsys.readouterr().out == f"{N_FRAMES} frames: {out}\n"


# Options


def test_configuration_that_is_written_reproduces_the_run(dataset, out, tmp_path):
    options = ("--preset", "paper", "--set", "clustering.seed=7", "--set", "features.texture=lbp")
    assert detect(dataset, out, *options) == 0
    config = Config.preset("paper").updated({"clustering.seed": 7, "features.texture": "lbp"})
    assert read_parameter_file(out / "config.yaml").config() == config.updated(
        {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60}
    )
    again = tmp_path / "again"
    assert run("detect", [str(dataset), "--output", str(again), "--params", str(out / "config.yaml")]) == 0
    assert contents(again) == contents(out)


def test_preset_paper_gives_other_masks(dataset, detected, out):
    assert detect(dataset, out, "--preset", "paper") == 0
    values = read_parameter_file(out / "config.yaml").values
    assert (values["extension.rule"], values["clustering.k"]) == ("area", 0)
    assert contents(out, *MASKS) != contents(detected, *MASKS)


def test_set_wins_over_params(dataset, out, tmp_path):
    params = tmp_path / "params.yaml"
    params.write_text("/**:\n  ros__parameters:\n    clustering: {k: 4, seed: 2}\n")
    assert detect(dataset, out, "--params", str(params), "--set", "clustering.k=5") == 0
    values = read_parameter_file(out / "config.yaml").values
    assert (values["clustering.k"], values["clustering.seed"]) == (5, 2)


def test_save_all_adds_all(dataset, out):
    assert detect(dataset, out, "--save", "all") == 0
    for extra in EXTRAS:
        assert sorted(path.stem for path in (out / extra).iterdir()) == NAMES
    labels = read_image(out / "superpixels" / f"{NAMES[0]}.png")
    assert (labels.dtype, labels.shape) == (np.uint16, (HEIGHT, WIDTH))
    assert int(labels.max()) + 1 == int(rows(out)[0]["n_superpixels"])
    occupancy = read_image(out / "occupancy" / f"{NAMES[0]}.png")
    assert np.array_equal(occupancy == 0, read_image(out / "long_range" / f"{NAMES[0]}.png") == 255)
    assert set(np.unique(occupancy)) <= {0, 100, 255}
    assert read_image(out / "confidence" / f"{NAMES[0]}.png").dtype == np.uint8


def test_save_all_leaves_confidence_out_where_there_is_none(dataset, out):
    assert detect(dataset, out, "--save", "all", "--set", "extension.rule=evidence") == 0
    assert {path.name for path in out.iterdir() if path.is_dir()} == {*MASKS, "overlay", *EXTRAS} - {"confidence"}


def test_each_input_begins_with_an_empty_memory(dataset, out, tmp_path):
    again, without = write_dataset(tmp_path / "again", frames()), tmp_path / "without"
    assert detect([dataset, again], out, "--save", "confidence", "--set", "memory.frames=5") == 0
    assert contents(out / "again") == contents(out / "dataset")
    assert detect(dataset, without, "--save", "confidence") == 0
    with_memory, single = contents(out / "dataset", "confidence"), contents(without, "confidence")
    first, *others = (single[path] == with_memory[path] for path in sorted(single))
    assert (first, all(others)) == (True, False)


@pytest.mark.parametrize("options", [("--jobs", "2"), ("--cluster", "tcp://127.0.0.1:1")])
def test_memory_needs_frames_in_their_order(dataset, out, capsys, options):
    assert detect(dataset, out, "--set", "memory.frames=5", *options) == 2
    assert "memory.frames is 5, so each frame needs those before it" in failure(capsys)
    assert not out.exists()


def test_save_adds_what_is_named(dataset, out):
    assert detect(dataset, out, "--save", "wld, clusters") == 0
    assert {path.name for path in out.iterdir() if path.is_dir()} == {*MASKS, "overlay", "wld", "clusters"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--save", "normals"), "cannot save 'normals'; choose one of disparity"),
        (("--save", "confidence", "--preset", "paper"), "--save confidence: cannot save 'confidence': only the rule"),
        (("--set", "clustering.q=3"), "no parameter 'clustering.q'; did you mean clustering.k"),
        (("--set", "clustering.k=many"), "clustering.k is 'many'"),
        (("--set", "clustering.k"), "write STAGE.FIELD=VALUE"),
        (("--params", "/none.yaml"), "/none.yaml"),
    ],
)
def test_wrong_values_are_one_line_and_write_nothing(dataset, out, capsys, options, message):
    assert detect(dataset, out, *options) == 2
    assert message in failure(capsys)
    assert not out.exists()


@pytest.mark.parametrize("options", [("--jobs", "-1"), ("--jobs", "two"), ("--preset", "none"), ("--frames", "3")])
def test_wrong_usage_exits_with_2(dataset, out, options):
    with pytest.raises(SystemExit) as ended:
        detect(dataset, out, *options)
    assert ended.value.code == 2


# Kinds of input


@pytest.mark.parametrize("format", FORMATS)
def test_bag_gives_the_masks_of_the_folder_byte_for_byte(dataset, detected, out, tmp_path, format):  # noqa: A002
    bag = tmp_path / ("stereo.bag" if format == "rosbag1" else "bag")
    write_stereo_bag(bag, frames(), format=format)
    assert detect(bag, out) == 0
    assert contents(out) == contents(detected)


@pytest.mark.parametrize("source", ["disparity", "depth"])
@pytest.mark.parametrize("is_bag", [False, True])
def test_disparity_and_depth_are_detected_in(out, tmp_path, source, is_bag):
    path = tmp_path / "input"
    if is_bag:
        write_stereo_bag(path, frames(source))
    else:
        write_dataset(path, frames(source))
    assert detect(path, out, "--save", "disparity") == 0
    for item in rendered():
        name = f"{item.frame.name}.png"
        assert score(read_image(out / "long_range" / name), item.truth).precision > 0.9
        # a bag holds depth alone, for a camera of another baseline
        scale = np.median(
            read_disparity(out / "disparity" / name)[item.disparity > 2] / item.disparity[item.disparity > 2]
        )
        assert is_bag or scale == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_bag_of_compressed_images_alone_is_detected_in(detected, out, tmp_path, suffix):
    bag = tmp_path / "bag"
    write_compressed_bag(bag, frames(), suffix)
    (bag / "metadata.yaml").unlink()
    assert detect(bag, out) == 0
    assert [row["name"] for row in rows(out)] == NAMES
    if suffix == ".png":
        assert contents(out, *MASKS) == contents(detected, *MASKS)
    else:  # of which the pixels are others
        for name in NAMES:
            masks = [read_image(folder / "long_range" / f"{name}.png") for folder in (out, detected)]
            assert (masks[0] == masks[1]).mean() > 0.8


def test_topics_of_a_bag_can_be_named(detected, out, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bag_writer, "LEFT_IMAGE", "zed/left/color/rect/image")
    monkeypatch.setattr(bag_writer, "RIGHT_IMAGE", "zed/right/color/rect/image")
    bag = tmp_path / "bag"
    write_stereo_bag(bag, frames())
    left, right = (("--remap", f"/zed/{side}/color/rect/image:={side}/image_rect") for side in ("left", "right"))
    infos = [f"--remap=/{side}/camera_info:={side}/camera_info" for side in ("left", "right")]
    assert detect(bag, out, *left, *right, *infos) == 0
    assert contents(out, *MASKS) == contents(detected, *MASKS)
    shutil.rmtree(out)
    assert detect(bag, out, *left, "--remap", "/nothing:=right/image_rect") == 1
    assert "has no topic '/nothing'" in failure(capsys)
    assert detect(bag, out, "--remap", "left/image_rect") == 2
    assert "write FROM:=TO" in failure(capsys)


def test_topics_of_a_folder_are_refused(dataset, out, capsys):
    assert detect(dataset, out, "--remap", "/left:=left/image_rect") == 1
    assert "has no topics to remap" in failure(capsys)


def test_depth_is_cut_where_it_is_asked_for(out, tmp_path):
    path = write_dataset(tmp_path / "input", frames("depth"))
    assert detect(path, out, "--save", "disparity", "--set", "source.max_depth_m=6") == 0
    disparity = read_disparity(out / "disparity" / f"{NAMES[0]}.png")
    assert disparity[disparity > 0].min() >= CAMERA.fx * CAMERA.baseline_m / 6 - 1 / 256


def test_source_is_preferred_where_a_folder_holds_several(out, tmp_path):
    path = write_dataset(tmp_path / "input", frames())
    write_dataset(path, frames("disparity"))
    assert detect(path, out, "--set", "source=disparity", "--save", "disparity") == 0
    written = read_disparity(out / "disparity" / f"{NAMES[0]}.png")
    assert np.array_equal(written, read_disparity(path / "disparity" / f"{NAMES[0]}.png"))


@pytest.mark.parametrize("options", [(), ("--preset", "paper")])
def test_grey_images_are_detected_in(out, tmp_path, options):
    path = write_dataset(tmp_path / "input", frames(grey=True))
    assert detect(path, out, *options) == 0
    if not options:
        for item in rendered():
            assert score(read_image(out / "long_range" / f"{item.frame.name}.png"), item.truth).recall > 0.8


def test_images_of_16_bits_are_detected_in(out, tmp_path):
    path = write_dataset(tmp_path / "input", frames())
    for image in [*(path / "left").iterdir(), *(path / "right").iterdir()]:
        write_image(image, read_image(image).astype(np.uint16) << 8)
    assert detect(path, out) == 0
    assert read_image(out / "overlay" / f"{NAMES[0]}.jpg").dtype == np.uint8


# Several inputs, processes, a cluster


def test_several_inputs_have_folders_of_their_own(dataset, detected, out, tmp_path, capsys):
    bag = tmp_path / "drive.bag"
    write_stereo_bag(bag, frames(n=2), format="rosbag1")
    assert detect([dataset, bag], out) == 0
    assert sorted(path.name for path in out.iterdir()) == [MARK_FILE, "dataset", "drive"]
    assert contents(out / "dataset") == contents(detected)
    assert [row["name"] for row in rows(out / "drive")] == NAMES[:2]
    assert capsys.readouterr().out == f"{N_FRAMES} frames: {out / 'dataset'}\n2 frames: {out / 'drive'}\n"


def test_inputs_of_one_name_are_told_apart_by_what_is_around_them(tmp_path):
    assert output_names([tmp_path / "a/bag", tmp_path / "b/bag"]) == ["a_bag", "b_bag"]
    assert output_names([tmp_path / "a", tmp_path / "b"]) == ["a", "b"]
    assert output_names([tmp_path / "a"]) == [""]
    assert output_names([tmp_path / "a/b_c", tmp_path / "a_b/c", tmp_path / "z/c"]) == ["b_c_1", "c_2", "c_3"]
    with pytest.raises(ValueError, match="given twice"):
        output_names([tmp_path / "a", tmp_path / "a"])


def test_input_that_cannot_be_used_leaves_the_others(dataset, detected, out, tmp_path, capsys):
    empty = tmp_path / "empty"
    empty.mkdir()
    assert detect([empty, dataset], out) == 1
    assert f"{empty}: is empty" in capsys.readouterr().err
    assert contents(out / "dataset") == contents(detected)


@pytest.mark.parametrize("kind", ["folder", "mcap", "sqlite3", "rosbag1"])
def test_number_of_processes_changes_nothing(dataset, detected, out, tmp_path, kind):
    path = dataset
    if kind != "folder":
        path = tmp_path / "bag"
        write_stereo_bag(path, frames(), format=kind)
    assert detect(path, out, "--jobs", "2") == 0
    assert contents(out) == contents(detected)


def test_processes_report_frames_in_their_order(broken, out, tmp_path, capsys):
    (broken / "left" / f"{NAMES[1]}.png").write_bytes(b"no image")
    (broken / "right" / f"{NAMES[2]}.png").unlink()
    single = tmp_path / "single"
    assert detect(broken, single) == 0
    printed = capsys.readouterr()
    assert detect(broken, out, "--jobs", "2") == 0
    assert contents(out) == contents(single)
    again = capsys.readouterr()
    assert (again.err, again.out) == (printed.err, printed.out.replace("single", "out"))
    assert f"2 frames, 2 skipped: {single}" in printed.out


def test_cluster_gives_the_same_files_though_a_worker_is_killed(
    dataset, detected, out, tmp_path, monkeypatch, dask_cluster
):
    bag = tmp_path / "bag"
    write_stereo_bag(bag, frames())
    with dask_cluster.another_worker() as worker:
        write = ResultFolder.write

        def write_and_kill(self, result):
            write(self, result)
            worker.kill()

        monkeypatch.setattr(ResultFolder, "write", write_and_kill)
        assert detect([dataset, bag], out, "--cluster", dask_cluster.address) == 0
        assert worker.wait(10) != 0
        assert dask_cluster.worker.poll() is None
    assert contents(out / "dataset") == contents(detected)
    assert contents(out / "bag") == contents(detected)


def test_cluster_that_is_not_there_is_an_error(dataset, out, capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("lrtrav_ros.offline.parallel._CONNECT_S", 0.3)
    assert detect(dataset, out, "--cluster", "tcp://127.0.0.1:1") == 1
    assert "tcp://127.0.0.1:1" in failure(capsys)


# Bad frames: they are skipped, counted, reported, and named in frames.csv


def skipped(broken, out, capsys, name, message, *, n_done=N_FRAMES - 1):
    """Check that one frame alone was skipped, for the reason given."""
    assert detect(broken, out) == 0
    printed = capsys.readouterr()
    assert printed.out == f"{n_done} frames, {N_FRAMES - n_done} skipped: {out}\n"
    lines = printed.err.splitlines()
    assert len(lines) == N_FRAMES - n_done
    assert all(line.startswith(f"{broken}: skipped frame ") for line in lines)
    table = rows(out)
    assert [row["name"] for row in table] == NAMES
    problems = {row["name"]: row["problem"] for row in table if row["problem"]}
    assert len(problems) == N_FRAMES - n_done
    assert re.search(message, problems[name]), problems[name]
    assert {path.stem for path in (out / "long_range").iterdir()} == set(NAMES) - set(problems)


def test_missing_image_is_skipped(broken, out, capsys):
    (broken / "right" / f"{NAMES[1]}.png").unlink()
    skipped(broken, out, capsys, NAMES[1], "right.*there is no such image")


def test_unreadable_image_is_skipped(broken, out, capsys):
    (broken / "left" / f"{NAMES[1]}.png").write_bytes(b"\x89PNG and no more")
    skipped(broken, out, capsys, NAMES[1], "cannot be read as an image; give a whole PNG or JPEG")


def test_truncated_image_is_skipped(broken, out, capsys):
    path = broken / "left" / f"{NAMES[2]}.png"
    path.write_bytes(path.read_bytes()[:-500])
    skipped(broken, out, capsys, NAMES[2], "cannot be read as an image; give a whole PNG or JPEG")


def test_images_of_different_size_are_skipped(broken, out, capsys):
    path = broken / "right" / f"{NAMES[0]}.png"
    write_image(path, read_image(path)[:, :-8])
    skipped(
        broken, out, capsys, NAMES[0], f"is {WIDTH - 8} x {HEIGHT} pixels, but the left image is {WIDTH} x {HEIGHT}"
    )


def test_grey_image_beside_colour_is_skipped(broken, out, capsys):
    path = broken / "right" / f"{NAMES[0]}.png"
    write_image(path, read_image(path)[..., 0])
    skipped(broken, out, capsys, NAMES[0], "give images with the same number of channels")


def test_image_of_another_bit_depth_is_skipped(out, tmp_path, capsys):
    broken = write_dataset(tmp_path / "broken", frames("disparity"))
    path = broken / "disparity" / f"{NAMES[3]}.png"
    write_image(path, (read_image(path) >> 8).astype(np.uint8))
    skipped(broken, out, capsys, NAMES[3], "give a grey PNG of 16 bits")


def test_calibration_missing_for_a_frame_is_skipped(broken, out, capsys):
    calibration = (broken / "calib.json").read_bytes()
    (broken / "calib.json").unlink()
    (broken / "calib").mkdir()
    for name in NAMES[1:]:
        (broken / "calib" / f"{name}.json").write_bytes(calibration)
    skipped(broken, out, capsys, NAMES[0], "there is no such calibration")


def test_frame_of_a_bag_that_does_not_fit_is_skipped(out, tmp_path, capsys):
    recorded = frames()
    small = recorded[1]
    recorded[1] = Frame(
        name=small.name, left=small.left[:-8], right=small.right[:-8], camera=CAMERA, stamp_ns=small.stamp_ns
    )
    bag = tmp_path / "bag"
    write_mixed_bag(bag, recorded)
    skipped(bag, out, capsys, NAMES[1], f"the calibration is for {WIDTH} x {HEIGHT} pixels, but the image is")


def write_mixed_bag(path, recorded):
    """Write a bag whose CameraInfo is always that of the first frame."""
    original, size = bag_writer.camera_info_message, recorded[0].left.shape[:2]

    def first(header, camera, _, *, baseline_m):
        return original(header, camera, size, baseline_m=baseline_m)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bag_writer, "camera_info_message", first)
        write_stereo_bag(path, recorded)


# Bad inputs as a whole: one line, status 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"fx": None}, "fx is missing"),
        ({"baseline_m": None}, "baseline_m is missing"),
        ({"fx": 0}, "fx is 0; give a positive number"),
        ({"fy": -100.0}, "fy is -100.0; give a positive number"),
        ({"baseline_m": 0}, "baseline_m is 0; give a positive number"),
        ({"baseline_m": -0.3}, "baseline_m is -0.3; give a positive number"),
        ({"cx": float("nan")}, "cx is nan; give a finite number"),
        ({"fx": float("inf")}, "fx is inf; give a finite number"),
        ({"fx": "wide"}, "fx is 'wide'; give a finite number"),
        ({"width": WIDTH + 1}, f"calibration is for {WIDTH + 1} x {HEIGHT} pixels, but the image is {WIDTH}"),
    ],
)
def test_calibration_that_cannot_be_is_refused(out, tmp_path, capsys, values, message):
    path = write_dataset(tmp_path / "input", frames(), **values)
    assert detect(path, out) == 1
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == 1 + (N_FRAMES if "width" in values else 1)  # the same reason is told once
    assert all(message in line for line in printed[:-1])
    assert printed[-1] == f"detect: {path}: none of its {N_FRAMES} frames could be used"
    assert [row["name"] for row in rows(out)] == NAMES


def test_calibration_that_is_no_json_is_refused(broken, out, capsys):
    (broken / "calib.json").write_text("fx: 100")
    assert detect(broken, out) == 1
    assert "cannot be read as JSON" in capsys.readouterr().err


def test_missing_calibration_is_refused(broken, out, capsys):
    (broken / "calib.json").unlink()
    assert detect(broken, out) == 1
    assert "has no calibration; add calib.json or calib/NAME.json" in failure(capsys)
    assert not out.exists()


def test_input_that_does_not_exist_is_refused(out, tmp_path, capsys):
    assert detect(tmp_path / "none", out) == 1
    assert "none: there is no such folder or file" in failure(capsys)
    assert not out.exists()


def test_one_missing_input_of_several_is_refused_before_the_work(dataset, out, tmp_path, capsys):
    assert detect([dataset, tmp_path / "none"], out) == 1
    assert "none: there is no such folder or file" in failure(capsys)
    assert not out.exists()


def test_empty_folder_is_refused(out, tmp_path, capsys):
    path = tmp_path / "empty"
    path.mkdir()
    assert detect(path, out) == 1
    assert "empty: is empty; give a dataset folder with left/, or a rosbag" in failure(capsys)
    assert not out.exists()


def test_folder_without_left_images_is_refused(broken, out, capsys):
    shutil.rmtree(broken / "left")
    (broken / "left").mkdir()
    assert detect(broken, out) == 1
    assert "holds no images" in failure(capsys)


def test_folder_with_only_left_images_is_refused(broken, out, capsys):
    shutil.rmtree(broken / "right")
    assert detect(broken, out) == 1
    assert "has only left images; add right/, disparity/ or depth/" in failure(capsys)


def test_file_that_is_no_bag_is_refused(out, tmp_path, capsys):
    path = tmp_path / "notes.bag"
    path.write_text("not a bag\n" * 100)
    assert detect(path, out) == 1
    assert str(path) in failure(capsys)


def test_bag_without_the_topics_is_refused(out, tmp_path, capsys):
    bag = tmp_path / "bag"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lrtrav_ros.io.bag_writer.RIGHT_IMAGE", "right/other")
        write_stereo_bag(bag, frames())
    assert detect(bag, out) == 1
    message = failure(capsys)
    assert "right/image_rect" in message
    assert "/right/other" in message  # what there is
    assert not out.exists()


@pytest.mark.parametrize("format", FORMATS)
def test_truncated_bag_is_read_as_far_as_it_goes(detected, out, tmp_path, capsys, format):  # noqa: A002
    bag = tmp_path / ("stereo.bag" if format == "rosbag1" else "bag")
    write_stereo_bag(bag, frames(), format=format)
    file = bag if bag.is_file() else max(bag.iterdir(), key=lambda path: path.stat().st_size)
    size = file.stat().st_size
    with file.open("r+b") as stream:
        stream.truncate(size * 6 // 10)
    status = detect(bag, out)
    printed = capsys.readouterr().err
    assert "Traceback" not in printed
    assert re.search("damaged|intact", printed)
    assert status == 1  # something is lost, though what is left is done
    assert printed.endswith(f"{bag}: is damaged; what could be read of it is done\n")
    done = [row["name"] for row in rows(out) if not row["problem"]]
    assert 1 <= len(done) < N_FRAMES
    for name in done:
        expected = (detected / "long_range" / f"{name}.png").read_bytes()
        assert (out / "long_range" / f"{name}.png").read_bytes() == expected


# Images with nothing to see


@pytest.mark.parametrize("value", [0, 128, 255], ids=["black", "no texture", "white"])
@pytest.mark.parametrize("options", [(), ("--preset", "paper"), ("--set", "stereo.matcher=bm")])
def test_images_with_nothing_in_them_have_no_ground(out, tmp_path, capsys, value, options):
    image = np.full((HEIGHT, WIDTH, 3), value, np.uint8)
    path = write_dataset(tmp_path / "input", [Frame(name="a", left=image, right=image, camera=CAMERA)])
    assert detect(path, out, *options) == 0
    assert capsys.readouterr().out == f"1 frames, 1 without ground in sight: {out}\n"
    assert rows(out)[0]["problem"] == "no ground line found"
    for mask in MASKS:
        assert not read_image(out / mask / "a.png").any()


def test_no_ground_in_sight(out, tmp_path):
    left = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    wall = Frame(name="a", left=left, right=np.roll(left, -20, axis=1), camera=CAMERA)
    path = write_dataset(tmp_path / "input", [wall])
    assert detect(path, out) == 0
    assert not read_image(out / "long_range" / "a.png").any()


@pytest.mark.parametrize("size", [(16, 16), (1, 1), (9, 40)])
@pytest.mark.parametrize("options", [(), ("--preset", "paper")])
def test_tiny_images_are_worked_on(out, tmp_path, size, options):
    left, right = np.random.default_rng(0).integers(0, 256, (2, *size, 3), np.uint8)
    camera = StereoCamera(fx=20.0, cx=size[1] / 2, cy=size[0] / 2, baseline_m=0.1)
    path = write_dataset(tmp_path / "input", [Frame(name="a", left=left, right=right, camera=camera)])
    assert detect(path, out, "--save", "all", *options) == 0
    assert read_image(out / "long_range" / "a.png").shape == size


# The output folder


def test_output_folder_that_exists_is_refused(dataset, out, capsys):
    out.mkdir()
    (out / "mine").touch()
    assert detect(dataset, out) == 1
    assert "exists and is not an empty folder; choose another\n" in failure(capsys)
    assert detect(dataset, out, "--overwrite") == 1
    assert "holds what lrtrav did not make (.lrtrav is not in it), and is not replaced; choose another" in failure(
        capsys
    )
    assert [path.name for path in out.iterdir()] == ["mine"]


def test_overwrite_replaces_the_output_folder(dataset, detected, out, capsys):
    assert detect(dataset, out) == 0
    assert detect(dataset, out) == 1
    assert "exists and is not an empty folder; choose another or give --overwrite" in failure(capsys)
    (out / "old").touch()
    assert detect(dataset, out, "--overwrite") == 0
    assert contents(out) == contents(detected)
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_overwrite_leaves_the_old_results_where_nothing_could_be_used(out, tmp_path, capsys):
    out.mkdir()
    for name in (MARK_FILE, "old"):
        (out / name).touch()
    path = write_dataset(tmp_path / "input", frames(), fx=0)
    assert detect(path, out, "--overwrite") == 1
    assert sorted(file.name for file in out.iterdir()) == [MARK_FILE, "old"]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_interrupted_run_leaves_the_old_results(dataset, out, monkeypatch, jobs):
    out.mkdir()
    for name in (MARK_FILE, "old"):
        (out / name).touch()

    def interrupted(self, result):
        raise KeyboardInterrupt

    monkeypatch.setattr("lrtrav_ros.io.result_folder.ResultFolder.write", interrupted)
    assert detect(dataset, out, "--overwrite", "--jobs", jobs) == 130
    assert sorted(path.name for path in out.iterdir()) == [MARK_FILE, "old"]
    assert [path.name for path in out.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("output", ["", ".."])
def test_inputs_are_never_overwritten(broken, capsys, output):
    before = sorted(broken.rglob("*"))
    assert detect(broken, broken / output, "--overwrite") == 1
    assert "holds the input" in failure(capsys)
    assert sorted(broken.rglob("*")) == before


@pytest.mark.parametrize("output", ["left", "gt", "left/found", "found/../right"])
def test_folders_of_an_input_are_not_written_to(broken, capsys, output):
    before = sorted(broken.rglob("*"))
    for options in ((), ("--overwrite",)):
        assert detect(broken, broken / output, *options) == 1
        assert f"is, or is in, a folder of the input {broken}; choose another folder" in failure(capsys)
    assert sorted(broken.rglob("*")) == before


def test_output_may_lie_in_the_input(broken):
    assert detect(broken, broken / "found") == 0
    assert len(rows(broken / "found")) == N_FRAMES


# Where nobody reads what is printed


class Broken(io.TextIOWrapper):
    """A standard output or error whose reader has gone, or whose disk is full."""

    def write(self, text):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")


@pytest.mark.parametrize("options", [(), ("--overwrite",)])
@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize("is_damaged", [False, True])
def test_result_is_whole_though_nothing_can_be_printed(
    broken, detected, out, capsys, monkeypatch, options, stream, is_damaged
):
    if options:
        assert detect(broken, out) == 0
        (out / "old").touch()
        capsys.readouterr()
    path = broken
    if is_damaged:
        path = [broken, broken.parent / "none.bag"]
        path[1].write_bytes(b"no bag")
    with monkeypatch.context() as patch:
        patch.setattr(sys, stream, Broken(io.BytesIO()))
        assert detect(path, out, *options) == int(is_damaged)
    printed = capsys.readouterr()
    if stream == "stdout":
        assert printed.err.startswith("standard output: Broken pipe; the results are written\n")
    else:
        assert printed.out == f"{N_FRAMES} frames: {out / 'broken' if is_damaged else out}\n"
    assert contents(out / "broken" if is_damaged else out) == contents(detected)
    assert not (out / "old").exists()
    assert [item.name for item in out.parent.glob("*out*")] == ["out"]


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_process_ends_with_the_status_of_the_run_though_standard_output_is_full(dataset, out, unbuffered):
    command = [sys.executable, "-m", "lrtrav_ros", "detect", str(dataset), "--output", str(out), *FAST]
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, env=environment, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr == "standard output: No space left on device; the results are written\n"
    assert len(rows(out)) == N_FRAMES


# As a process


def test_process_prints_no_progress_where_there_is_no_terminal(dataset, out):
    done = subprocess.run(
        [sys.executable, "-m", "lrtrav_ros", "detect", str(dataset), "--output", str(out), "--jobs", "2", *FAST],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{N_FRAMES} frames: {out}\n"


def test_address_of_no_scheduler_is_wrong_usage(dataset, out, capsys):
    for address in ("nonsense", "tcp://127.0.0.1:99999", "foo://127.0.0.1:1"):
        with pytest.raises(SystemExit) as stopped:
            detect(dataset, out, "--cluster", address)
        assert stopped.value.code == 2
        message = f"argument --cluster: '{address}' is no address of a scheduler; write it as tcp://host:8786\n"
        assert capsys.readouterr().err.endswith(message)
    assert not out.exists()


# Interrupted, and beside another run


def interrupt_after(monkeypatch, n_frames, error=KeyboardInterrupt):
    """Have runs end after so many frames; return the list of frames that are written."""
    written, write = [], ResultFolder.write

    def write_or_end(self, result):
        if len(written) == n_frames:
            raise error
        written.append(result.name)
        write(self, result)

    monkeypatch.setattr(ResultFolder, "write", write_or_end)
    return written


@pytest.mark.parametrize(
    ("is_bag", "options", "n_kept"),
    [
        (False, (), 2),
        (True, (), 2),
        (False, ("--jobs", "2"), 2),
        (False, ("--set", "memory.frames=2"), 0),
        (True, ("--output-bag", "BAG"), 0),
    ],
)
def test_interrupted_run_resumes_and_ends_with_the_same_files(
    dataset, out, tmp_path, capsys, monkeypatch, is_bag, options, n_kept
):
    path, bag = dataset, tmp_path / "out.mcap"
    if is_bag:
        path = tmp_path / "bag"
        write_stereo_bag(path, frames())
    options = [str(bag) if option == "BAG" else option for option in options]
    whole = tmp_path / "whole"
    assert detect(path, whole, *options) == 0
    bag_of_whole = bag.read_bytes() if bag.exists() else b""
    bag.unlink(missing_ok=True)
    with monkeypatch.context() as patch:
        interrupt_after(patch, 2)
        assert detect(path, out, *options) == 130
    assert not bag.exists()
    assert len(rows(out)) == 2
    capsys.readouterr()
    with monkeypatch.context() as patch:
        written = interrupt_after(patch, -1)
        assert detect(path, out, *options) == 0
    printed = capsys.readouterr()
    assert written == NAMES[n_kept:]
    assert printed.err == (f"{n_kept} frames were finished before\n" if n_kept else "")
    assert printed.out == f"{N_FRAMES} frames: {out}\n"
    assert contents(out) == contents(whole)
    assert (bag.read_bytes() if bag.exists() else b"") == bag_of_whole


def test_interrupted_run_keeps_the_frames_that_could_not_be_used(broken, out, capsys, monkeypatch):
    (broken / "left" / f"{NAMES[0]}.png").write_bytes(b"no image")
    with monkeypatch.context() as patch:
        interrupt_after(patch, 2)
        assert detect(broken, out) == 130
    assert detect(broken, out) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith(f"2 frames were finished before\n{broken}: skipped frame {NAMES[0]}: ")
    assert printed.out == f"{N_FRAMES - 1} frames, 1 skipped: {out}\n"
    assert [row["name"] for row in rows(out)] == NAMES


def test_interrupted_run_of_several_inputs_resumes(dataset, detected, out, tmp_path, capsys, monkeypatch):
    other = write_dataset(tmp_path / "other", frames())
    with monkeypatch.context() as patch:
        interrupt_after(patch, N_FRAMES + 1)
        assert detect([dataset, other], out) == 130
    assert detect([dataset, other], out) == 0
    assert capsys.readouterr().err == f"{N_FRAMES} frames were finished before\n1 frames were finished before\n"
    for name in ("dataset", "other"):
        assert contents(out / name) == contents(detected)


def test_run_is_not_resumed_where_something_changed(broken, out, capsys, monkeypatch):
    with monkeypatch.context() as patch:
        interrupt_after(patch, 2)
        assert detect(broken, out) == 130
    before = contents(out)
    (broken / "left" / f"{NAMES[0]}.png").touch()
    assert detect(broken, out, "--save", "wld", "--set", "clustering.k=5") == 1
    changes = f"the files of {broken}, --save: none -> wld, clustering.k: 10 -> 5"
    message = f"{out} holds what another run has not finished; since then changed: {changes}; choose another or give"
    assert message in failure(capsys)
    assert contents(out) == before
    assert detect(broken, out, "--overwrite") == 0
    assert len(rows(out)) == N_FRAMES
    assert not list(out.parent.glob(".*"))


def test_full_disk_is_named_and_the_run_resumed_when_there_is_space(dataset, detected, out, capsys):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    largest = max(path.stat().st_size for path in (detected / "overlay").iterdir())
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest - 1, limits[1]))
    try:
        assert detect(dataset, out) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert re.fullmatch(rf"detect: \[Errno 27\] File too large: '{out}/overlay/\d+.jpg'\n", capsys.readouterr().err)
    whole, _ = contents(detected)
    if out.exists():
        unfinished = [*out.rglob("*.png"), *out.rglob("*.jpg")]
        assert all(path.read_bytes() == whole[path.relative_to(out)] for path in unfinished)
        assert not [path for path in out.rglob(".*") if path.name != ".unfinished"]
    assert detect(dataset, out) == 0
    assert contents(out) == contents(detected)


def test_second_run_into_a_folder_is_refused(dataset, out, capsys):
    with locked_folder(out):
        for options in ((), ("--overwrite",)):
            assert detect(dataset, out, *options) == 1
            assert failure(capsys).startswith(
                f"detect: {out}: another run writes to it; let that end, or choose another"
            )
    assert not out.exists()
