"""`generate`: what it writes, its options, and what it refuses."""

import argparse
import json
import signal
from pathlib import Path

import numpy as np
import pytest

from lrtrav_ros.commands import generate, run
from lrtrav_ros.config import settings_of
from lrtrav_ros.io import dataset_folder
from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.dataset_folder import DatasetFolder, write_frame
from lrtrav_ros.io.folder_lock import locked_folder
from lrtrav_ros.io.image_files import read_image
from lrtrav_ros.synthetic.rendering import render_sequence
from lrtrav_ros.synthetic.scene_config import SceneConfig


@pytest.mark.parametrize(("bag", "name"), [("mcap", "bag"), ("rosbag1", "stereo.bag")])
def test_command_writes_a_dataset_folder_and_a_bag(tmp_path, capsys, bag, name):
    folder = tmp_path / "new" / "scene"
    assert run("generate", [str(folder), "--frames", "2", "--size", "96x64", "--seed", "4", "--bag", bag]) == 0
    assert capsys.readouterr().out == f"2 frames written to {folder}\n"
    expected = list(render_sequence(SceneConfig(seed=4, width=96, height=64, n_frames=2)))
    dataset = DatasetFolder(folder)
    disparities = DatasetFolder(folder, source="disparity")
    assert dataset.names == [item.frame.name for item in expected]
    with StereoBag(folder / name) as recorded:
        frames = list(recorded.frames())
    assert [frame.stamp_ns for frame in frames] == [item.frame.stamp_ns for item in expected]
    for item, frame in zip(expected, frames, strict=True):
        read = dataset.frame(item.frame.name)
        for stored in (read, frame):
            np.testing.assert_array_equal(stored.left, item.frame.left)
            np.testing.assert_array_equal(stored.right, item.frame.right)
            assert stored.camera.baseline_m == pytest.approx(0.12)
            assert stored.camera.fx == pytest.approx(item.frame.camera.fx)
        np.testing.assert_array_equal(read_image(folder / "gt" / f"{item.frame.name}.png"), item.truth)
        exact = disparities.frame(item.frame.name).disparity
        np.testing.assert_allclose(exact, item.disparity, atol=0.5 / 256)
        heights = read_image(folder / "height" / f"{item.frame.name}.png")
        assert heights.dtype == np.uint16
        np.testing.assert_allclose(heights / 1000, item.height_m, atol=0.0005)
        assert heights.max() > 500


def test_heights_beyond_16_bits_are_the_highest_value(tmp_path):
    item = next(iter(render_sequence(SceneConfig(width=64, height=48, n_frames=1))))
    height_m = np.linspace(0, 100, 48 * 64, dtype=np.float32).reshape(48, 64)
    write_frame(tmp_path, item.frame, height_m=height_m)
    written = read_image(tmp_path / "height" / f"{item.frame.name}.png")
    assert written[height_m > 65.535].min() == 65535
    np.testing.assert_allclose(written[height_m < 65], 1000 * height_m[height_m < 65], atol=0.51)


def test_command_writes_several_sequences(tmp_path):
    assert run("generate", [str(tmp_path), "--frames", "1", "--size", "64x48", "--sequences", "2"]) == 0
    lefts = [DatasetFolder(tmp_path / f"sequence_0{i}") for i in (0, 1)]
    assert (lefts[0].frame(lefts[0].names[0]).left != lefts[1].frame(lefts[1].names[0]).left).mean() > 0.5
    assert json.loads((tmp_path / "sequence_01" / "calib.json").read_text())["height"] == 48


def test_command_refuses_a_folder_with_files(tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("keep")
    assert run("generate", [str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{tmp_path} exists and is not an empty folder; choose another" in error
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


TINY = ("--frames", "3", "--size", "64x48")


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(("options", "n_kept"), [((), 2), (("--sequences", "2"), 4), (("--bag", "mcap"), 0)])
def test_interrupted_command_leaves_nothing_temporary_and_resumes(
    tmp_path, capsys, monkeypatch, number, status, options, n_kept
):
    folder, whole = tmp_path / "scene", tmp_path / "whole"
    assert run("generate", [str(whole), *TINY, *options]) == 0
    n_written, real = 0, dataset_folder.frame_files

    def interrupted(*args, **kwargs):
        nonlocal n_written
        n_written += 1
        if n_written > max(n_kept, 2) + n_kept // 4:  # the sequence before is finished
            signal.raise_signal(number)
        return real(*args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(dataset_folder, "frame_files", interrupted)
        try:
            ended = run("generate", [str(folder), *TINY, *options])
        except SystemExit as err:
            ended = err.code
    assert ended == status
    assert {path.name for path in tmp_path.rglob(".*")} == {".unfinished"}
    capsys.readouterr()
    assert run("generate", [str(folder), *TINY, *options]) == 0
    n_kept += n_kept // 4
    assert capsys.readouterr().err == (f"{n_kept} frames were finished before\n" if n_kept else "")
    found, expected = contents(folder), contents(whole)
    assert found.keys() == expected.keys()
    assert [name for name in found if found[name] != expected[name]] == []


def test_frames_are_written_though_that_cannot_be_printed(tmp_path, capsys, monkeypatch):
    with Path("/dev/full").open("w", encoding="utf-8") as full, monkeypatch.context() as patch:
        patch.setattr("sys.stdout", full)
        assert run("generate", [str(tmp_path / "scene"), *TINY]) == 0
    assert capsys.readouterr().err == "standard output: No space left on device; the results are written\n"
    assert len(DatasetFolder(tmp_path / "scene")) == 3


def test_second_command_into_a_folder_is_refused(tmp_path, capsys):
    with locked_folder(tmp_path / "out"):
        assert run("generate", [str(tmp_path / "out"), *TINY]) == 1
    assert capsys.readouterr().err.startswith(f"generate: {tmp_path / 'out'}: another run writes to it; let that end")


@pytest.mark.parametrize(
    "arguments",
    [
        ["--size", "640"],
        ["--size", "8x8"],
        ["--size", "640x-9"],
        ["--style", "desert"],
        ["--frames", "many"],
        ["--noise", "-1"],
        ["--sequences", "0"],
        ["--drops", "hole"],
        ["--dapple", "2"],
    ],
)
def test_command_refuses_wrong_usage(tmp_path, capsys, arguments):
    with pytest.raises(SystemExit) as stopped:
        run("generate", [str(tmp_path / "new"), *arguments])
    assert stopped.value.code == 2
    assert f"argument {arguments[0]}: " in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def parser():
    made = argparse.ArgumentParser()
    generate.add_arguments(made)
    return made


def test_help_states_description_range_and_default_of_every_setting():
    stated = {action.dest: action for action in parser()._actions}
    assert stated["size"].help.endswith("(640x480)")
    settings = settings_of(SceneConfig)
    for field in settings.keys() - {"width", "height", "shadows"}:
        parameter = settings[field]
        default = parameter.default if isinstance(parameter.default, str) else f"{parameter.default:g}"
        assert stated[field].help == f"{parameter.description}; {parameter.range_text} ({default})"
        assert stated[field].metavar == {str: "NAME", int: "N", float: "X"}[parameter.type]


def test_options_make_the_scene():
    text = (
        "DIR --frames 2 --seed 3 --style park --rate 4 --speed 5 --hfov 60 --baseline 0.7 --camera-height 0.8"
        " --pitch -9 --roll -1.5 --sway 1e-1 --undulation 0 --obstacles 13 --noise 0.5 --exposure-difference -0.1"
        " --drops step --small-things 3 --sun-elevation 15 --sun-hardness 0.3 --dapple 0.6 --exposure 1.2"
        " --no-shadows --size 64x48"
    )
    assert generate._scene(parser().parse_args(text.split())) == SceneConfig(
        n_frames=2, seed=3, style="park", rate_hz=4.0, speed_m_s=5.0, hfov_deg=60.0, baseline_m=0.7,
        camera_height_m=0.8, pitch_deg=-9.0, roll_deg=-1.5, sway_deg=0.1, undulation_m=0.0, n_obstacles=13, noise=0.5,
        exposure_difference=-0.1, drops="step", n_small_things=3, sun_elevation_deg=15.0, sun_hardness=0.3, dapple=0.6,
        exposure=1.2, shadows=False, width=64, height=48,
    )  # fmt: skip


def test_without_options_the_scene_is_the_default_one():
    assert generate._scene(parser().parse_args(["DIR"])) == SceneConfig()
