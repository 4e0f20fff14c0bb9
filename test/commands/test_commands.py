"""Tests of the command line: help, errors, exit statuses and the options that all share."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from recorded import WIDTH, frames, write_dataset

from lrtrav_ros.benchmark.memory import Memory
from lrtrav_ros.commands import COMMANDS, detect, evaluate, generate, run, run_lrtrav
from lrtrav_ros.commands.options import add_detection_options, config_from, settings_from
from lrtrav_ros.commands.usage_error import UsageError
from lrtrav_ros.config import Config, parameters
from lrtrav_ros.evaluation.scoring.methods import METHODS
from lrtrav_ros.io.bag_writer import FORMATS
from lrtrav_ros.io.result_folder import EXTRAS


def parsed(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_detection_options(parser)
    return parser.parse_args(arguments)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run(command, ["--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: {command}")


def test_help_imports_nothing_heavy() -> None:
    code = f"""
import sys
from lrtrav_ros.commands import run
for name in {list(COMMANDS)}:
    try:
        run(name, ["--help"])
    except SystemExit:
        pass
print("heavy:", sorted(set(sys.modules) & {{"numpy", "numba", "cv2", "scipy", "rclpy", "rosbags"}}))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "heavy: []"


def test_help_of_lrtrav_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run_lrtrav(["--help"])
    listed = {line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  ")}
    assert set(COMMANDS) <= listed


def test_help_of_detect_names_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run("detect", ["--help"])
    text = capsys.readouterr().out
    assert [item.name for item in parameters() if f"  {item.name}={item.default}  " not in text] == []


def test_help_names_what_the_modules_hold_that_it_does_not_import() -> None:
    assert ", ".join(EXTRAS) == detect._EXTRAS
    assert ", ".join(METHODS) == evaluate._METHODS
    assert generate.BAG_FORMATS == FORMATS


@pytest.mark.parametrize("arguments", [[], ["fly"], ["detect"], ["detect", "x"], ["generate", "x", "--frames", "many"]])
def test_wrong_usage_exits_with_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run_lrtrav(arguments)
    assert ended.value.code == 2


def test_failure_is_one_line_on_standard_error_and_exits_with_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_lrtrav(["detect", str(tmp_path / "none"), "--output", str(tmp_path / "out")]) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith("lrtrav detect: ")
    assert str(tmp_path / "none") in printed.err
    assert printed.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["detect", "x", "--output", "y", "--set", "threads"], "--set threads: write STAGE.FIELD=VALUE"),
        (["detect", "x", "--output", "y", "--set", "k=1"], "no parameter 'k'; did you mean clustering.k?"),
        (["detect", "x", "--output", "y", "--set", "clustering.k=many"], "clustering.k is 'many'; give int"),
        (["detect", "x", "--output", "y", "--save", "normals"], "--save normals: cannot save 'normals'; choose one of"),
        (["detect", "x", "--output", "y", "--params", "none.yaml"], "No such file or directory: 'none.yaml'"),
        (["detect", "x", "--output", "y", "--params", "PARAMS"], "PARAMS: no parameter 'stereo.mathcer'; did you mean"),
        (["evaluate", "x", "--output", "y", "--params", "PARAMS"], "PARAMS: no parameter 'stereo.mathcer'"),
        (["detect", "x", "--output", "y", "--jobs", "0", "--set", "memory.frames=5"], "memory.frames is 5, so each"),
        (["detect", "x", "--output", "y", "--jobs", "2", "--set", "ground.memory_s=1"], "ground.memory_s is 1.0, so"),
        (
            ["evaluate", "x", "--output", "y", "--set", "memory.frames=5"],
            "memory.frames is 5, but frames are evaluated",
        ),
        (
            ["evaluate", "x", "--output", "y", "--set", "ground.memory_s=0.5"],
            "ground.memory_s is 0.5, but frames are evaluated",
        ),
        (["benchmark", "--set", "clustering.k=-1"], "clustering.k is -1; give 0 to 1000"),
        (["replay", "x", "--rate", "0"], "rate is 0; give a number above 0"),
        (["replay", "x", "--remap", "/left"], "--remap /left: write FROM:=TO"),
    ],
)
def test_wrong_values_exit_with_2_and_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    if arguments[0] == "replay":
        pytest.importorskip("rclpy")
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {stereo.mathcer: bm}}")
    assert run_lrtrav([text.replace("PARAMS", str(params)) for text in arguments]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith(f"lrtrav {arguments[0]}: ")
    assert message.replace("PARAMS", str(params)) in printed.err
    assert (printed.out, printed.err.count("\n")) == ("", 1)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run_lrtrav(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"lrtrav {importlib.metadata.version('lrtrav_ros')}\n"


def test_package_runs_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "lrtrav_ros", "--help"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("usage: lrtrav")


def test_options_start_from_the_preset_and_set_wins_over_params(tmp_path: Path) -> None:
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {stereo: {matcher: bm}, threads: 2}}")
    config = config_from(parsed("--preset", "paper", "--params", str(params), "--set", "threads=3"))
    assert config == Config.preset("paper").updated({"stereo.matcher": "bm", "threads": 3})


def test_a_preset_in_the_file_counts_unless_another_is_asked_for(tmp_path: Path) -> None:
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {preset: paper, threads: 2}}")
    assert config_from(parsed()) == Config()
    assert config_from(parsed("--params", str(params))) == Config.preset("paper").updated({"threads": 2})
    assert config_from(parsed("--preset", "robust", "--params", str(params))) == Config().updated({"threads": 2})
    assert settings_from(parsed("--params", str(params), "--set", "clustering.k=3")) == {
        "threads": 2,
        "clustering.k": 3,
    }


def test_names_for_nodes_of_others_are_reported_and_ignored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    params = tmp_path / "params.yaml"
    params.write_text("/**: {ros__parameters: {robot_radius: 0.3, threads: 2, map: m}}")
    assert config_from(parsed("--params", str(params))) == Config().updated({"threads": 2})
    assert capsys.readouterr().err == f"--params: {params}: not for this package, ignored: robot_radius, map\n"


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("threads", "write STAGE.FIELD=VALUE"),
        ("thread=3", "did you mean threads"),
        ("threads=many", "threads is 'many'; give int"),
    ],
)
def test_bad_settings(setting: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        config_from(parsed("--set", setting))


TINY = ("--frames", "1", "--rounds", "1", "--threads", "1", "--set", "stereo.matcher=sgbm")


def test_benchmark_prints_every_stage_and_writes_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "figures.json"
    assert run("benchmark", ["--sizes", "160x120", *TINY, "--json", str(file)]) == 0
    (workload,) = json.loads(file.read_text())["workloads"]
    assert (workload["width"], workload["height"], workload["n_disparities"]) == (160, 120, 16)
    names = {times["name"] for times in workload["times"]}
    stages = {"matching", "ground", "superpixels", "features", "clustering", "extension"}
    expected = {*stages, "whole frame", "after matching", "matching, sgbm", "OpenCV StereoSGBM", "OpenCV StereoBM"}
    assert expected <= names
    printed = capsys.readouterr().out
    assert all(name in printed for name in (*expected, "frames/s", "memory: at most"))


def test_benchmark_refuses_files_that_cannot_be_written_before_it_measures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lrtrav_ros.benchmark.figures.measure", None)
    sweep = ["--sizes", "160x120,240x160"]
    os.mkfifo(tmp_path / "pipe.json")
    places = (
        ("--json", Path("/proc/figures.json")),
        ("--json", tmp_path / "pipe.json"),
        ("--chart", tmp_path / "folder.svg"),
    )
    for option, path in places:
        (tmp_path / "folder.svg").mkdir(exist_ok=True)
        assert run("benchmark", [*sweep, *TINY, option, str(path)]) == 1
        assert str(path) in capsys.readouterr().err


def test_benchmark_of_several_sizes_and_numbers_of_superpixels_draws_how_time_grows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    json_file, chart = tmp_path / "figures.json", tmp_path / "new" / "chart.svg"
    monkeypatch.setattr("lrtrav_ros.benchmark.figures.measure_memory", lambda workload: Memory(1.0, 2.0))
    sweep = ["--sizes", "96x64,128x96", "--superpixels", "30,60,30"]
    assert run("benchmark", [*sweep, *TINY, "--json", str(json_file), "--chart", str(chart)]) == 0
    workloads = json.loads(json_file.read_text())["workloads"]
    assert [(item["width"], item["n_superpixels"]) for item in workloads] == [(96, 30), (96, 60), (128, 30)]
    assert chart.read_text().startswith("<svg ")
    assert set(tmp_path.iterdir()) == {json_file, chart.parent}
    rows = [line.split()[:4] for line in capsys.readouterr().out.splitlines() if re.match(r"\d+ x \d+ +\d+ ", line)]
    assert rows == [["96", "x", "64", "30"], ["96", "x", "64", "60"], ["128", "x", "96", "30"]]


def test_benchmark_takes_frames_and_settings_that_are_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("joblib.cpu_count", lambda *_, **__: 5)
    monkeypatch.setattr("lrtrav_ros.benchmark.figures.measure_memory", lambda workload: Memory(1.0, 2.0))
    folder, file = write_dataset(tmp_path / "set", frames("disparity", n=2)), tmp_path / "figures.json"
    settings = ["--set", "threads=3", "--set", "stereo.n_disparities=40", "--set", "superpixels.n_superpixels=50"]
    arguments = ["--input", str(folder), "--rounds", "1", *settings, "--json", str(file)]
    assert run("benchmark", arguments) == 0
    (workload,) = json.loads(file.read_text())["workloads"]
    assert (workload["width"], workload["n_frames"], workload["n_disparities"]) == (WIDTH, 2, 40)
    whole = [times["n_threads"] for times in workload["times"] if times["name"] == "whole frame"]
    assert whole == [3]


@pytest.mark.parametrize("number", ["0", "1000001", "1" + "0" * 21, "9" * 5000])
@pytest.mark.parametrize("option", ["--frames", "--rounds", "--threads", "--superpixels", "--seconds"])
def test_benchmark_of_nothing_or_without_end_is_refused(
    option: str, number: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        run("benchmark", [option, number])
    assert f"{option}: '{number}' is not a whole number from 1 to 1000000" in capsys.readouterr().err


@pytest.mark.parametrize("jobs", ["-1", "1025", "9" * 5000])
@pytest.mark.parametrize("command", ["detect", "evaluate"])
def test_numbers_of_processes_are_bounded(command: str, jobs: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run(command, ["x", "--output", "y", f"--jobs={jobs}"])
    message = f"--jobs: '{jobs}' is not a number of processes; give 1 to 1024, or 0 for one on each processor"
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("size", ["640", "640x", "9999999x480", "640x" + "9" * 5000])
def test_sizes_are_bounded(size: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run("benchmark", ["--sizes", size])
    assert f"{size!r} is not a size; write it as 640x480" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["detect", "x", "--output"], ["evaluate", "x", "--output"], ["generate"], ["demo", "--output"]]
)
def test_output_without_a_name_is_refused(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").touch()
    with pytest.raises(SystemExit, match="2"):
        run(arguments[0], [*arguments[1:], ""])
    assert "no folder is named; give its name, or . for the working directory" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--threads", "2", "--set", "threads=1"], "--threads and the parameter threads are both given"),
        (
            ["--superpixels", "20,40", "--set", "superpixels.n_superpixels=30"],
            "--superpixels and the parameter superpixels.n_superpixels are both given",
        ),
        (["--input", "x", "--sizes", "96x64"], "--sizes is for synthetic images"),
        (["--chart", "x.png", "--sizes", "96x64,128x96"], "--chart x.png: give a name that ends in .svg"),
        (["--chart", "x.svg"], "give several --sizes or --superpixels"),
        (["--sizes", "20x20"], "--sizes: width is 20"),
        (["--superpixels", "1000000"], "superpixels.n_superpixels is 1000000"),
    ],
)
def test_benchmark_used_wrongly_ends_with_2_and_one_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("benchmark", ["--frames", "1", *arguments]) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert (printed.out, printed.err.count("\n")) == ("", 1)


def test_benchmark_of_nodes_needs_ros(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "lrtrav_ros.nodes.measurement", raising=False)
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert run("benchmark", ["--ros"]) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith("benchmark: --ros: ")
    assert "source the setup.bash of ROS 2" in printed.err
    assert (printed.out, printed.err.count("\n")) == ("", 1)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the parser that rclpy imports with the first message
def test_benchmark_measures_running_nodes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rclpy")
    file = tmp_path / "figures.json"
    arguments = ["--sizes", "160x120", "--frames", "2", "--superpixels", "60", "--seconds", "1"]
    assert run("benchmark", ["--ros", "10", *arguments, "--json", str(file)]) == 0
    figures = json.loads(file.read_text())
    assert figures["workloads"] == []
    stereo, disparity = figures["nodes"]
    assert [run["measured"]["source"] for run in (stereo, disparity)] == ["stereo", "disparity"]
    assert (stereo["width"], stereo["n_superpixels"], stereo["threads"], stereo["seconds"]) == (160, 60, 0, 1)
    rows = [line.split()[:5] for line in capsys.readouterr().out.splitlines() if line.startswith("160 x 120")]
    assert rows == [["160", "x", "120", "all", source] for source in ("stereo", "disparity")]


def test_demo_shows_all_of_it(tmp_path: Path) -> None:
    output = tmp_path / "demo"
    command = [sys.executable, "-m", "lrtrav_ros", "demo", "--output", str(output), "--frames", "3", "--rate", "0.1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "3 of 3 frames detected" in done.stdout
    rows = {line.split()[0]: line.split()[1:] for line in done.stdout.splitlines() if "_range " in line}
    precision, recall, _ = map(float, rows["long_range"])
    assert precision > 0.9
    assert recall > float(rows["short_range"][1])
    assert len(list((output / "long_range").glob("*.png"))) == 3
    assert (output / "overlay.mp4").stat().st_size > 10_000
    assert all((output / name).stat().st_size > 10_000 for name in ("stages.jpg", "grid.jpg"))
    assert (output / "bag").is_dir()
