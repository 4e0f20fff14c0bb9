"""Tests of `evaluate`, through the command: what it writes, how it resumes, and what it does with frames that fail."""

import csv
import dataclasses
import itertools
import json
import subprocess
import sys
from pathlib import Path

import cluster as clusters
import cv2
import numpy as np
import pytest
from recorded import FAST, N_FRAMES, frames, rendered, write_dataset
from scipy import ndimage

from lrtrav_ros import detector as detector_module
from lrtrav_ros.commands import run
from lrtrav_ros.config import Config
from lrtrav_ros.evaluation.scoring import evaluation_folder, evaluation_identity
from lrtrav_ros.evaluation.scoring import methods as methods_module
from lrtrav_ros.evaluation.scoring.score_records import MEAN, PaperScores, Summary, from_json
from lrtrav_ros.evaluation.scoring.scores import score
from lrtrav_ros.io.bag_writer import write_stereo_bag
from lrtrav_ros.io.folder_lock import locked_folder
from lrtrav_ros.io.image_files import read_image, write_image
from lrtrav_ros.io.parameter_file import read_parameter_file

METHODS = "uv_disparity,random_centres,robust"
TIMED = ("times", "times.csv", "report.html")  # the same in no two runs


def evaluate(*datasets, output, options=()):
    return run("evaluate", [*map(str, datasets), "--output", str(output), *FAST, *options])


def usual(*options):
    return ("--methods", METHODS, "--seeds", "2", *options)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Four frames with truth; not to be changed."""
    return write_dataset(tmp_path_factory.mktemp("input") / "road", frames(), truth=True)


@pytest.fixture
def broken(tmp_path):
    """Four frames with truth, to be damaged."""
    return write_dataset(tmp_path / "broken", frames(), truth=True)


@pytest.fixture(scope="module")
def evaluated(dataset, tmp_path_factory):
    """The output of an undisturbed run."""
    output = tmp_path_factory.mktemp("evaluated") / "out"
    assert evaluate(dataset, output=output, options=usual("--save-masks")) == 0
    return output


def contents(output):
    """Return the bytes of all files but those that hold measured times."""
    return {
        str(path.relative_to(output)): path.read_bytes()
        for path in sorted(output.rglob("*"))
        if path.is_file() and path.relative_to(output).parts[0] not in TIMED
    }


def rows(output, name="scores.csv"):
    with (output / name).open(newline="", encoding="utf-8") as table:
        return list(csv.DictReader(table))


def summary_of(output):
    return from_json(Summary, (output / "summary.json").read_text(encoding="utf-8"))


def test_scores_have_a_row_for_each_frame_and_method_and_are_those_of_the_masks(evaluated):
    table = rows(evaluated)
    assert list(table[0])[:7] == ["set", "frame", "method", "precision", "recall", "rmse", "false_positive_rate"]
    assert len(table) == 3 * N_FRAMES
    for row in table:
        if row["method"] != "random_centres":
            truth = next(item.truth for item in rendered() if item.frame.name == row["frame"])
            mask = read_image(evaluated / "masks" / "road" / row["method"] / f"{row['frame']}.png")
            found = [float(row[name]) for name in ("precision", "recall", "rmse", "false_positive_rate")]
            assert found == pytest.approx(dataclasses.astuple(score(mask, truth)), abs=1e-6)


def count_obstacles(mask, truth):
    """Return the number of standing obstacles and of those missed, pixel by pixel as they are defined."""
    labels, n = ndimage.label(truth == 0, structure=np.ones((3, 3)))
    regions = [labels == label for label in range(1, n + 1)]
    standing = [region for region in regions if region.sum() >= 0.001 * truth.size and not region[0].any()]
    return len(standing), sum(2 * np.count_nonzero(mask[region] == 255) > region.sum() for region in standing)


def test_obstacles_and_false_positives_are_those_of_the_masks(broken, tmp_path):
    truths, output = {}, tmp_path / "out"
    for item in rendered():
        truth = truths[item.frame.name] = item.truth.copy()
        truth[:2] = 128  # so that what stands before the sky stands below the top row
        truth[110:120, 90:120] = 0  # a thing that is as flat as the ground
        write_image(broken / "gt" / f"{item.frame.name}.png", truth)
    assert evaluate(broken, output=output, options=("--methods", "uv_disparity,robust", "--save-masks")) == 0
    for method in ("uv_disparity", "robust"):
        n_obstacles, n_missed, rates = 0, 0, []
        for row in [row for row in rows(output) if row["method"] == method]:
            truth = truths[row["frame"]]
            mask = read_image(output / "masks" / "broken" / method / f"{row['frame']}.png")
            found, missed = count_obstacles(mask, truth)
            assert (row["obstacles"], row["missed_obstacles"]) == (str(found), str(missed))
            by_distance = [int(row[f"obstacles_{band}m"]) for band in ("0-5", "5-10", "10-20", "20-40", "40+")]
            assert sum(by_distance) == found
            assert row["obstacles_0-0.2m_high"] == ""
            n_obstacles, n_missed = n_obstacles + found, n_missed + missed
            rates.append((mask[truth == 0] == 255).mean())
        result = next(item for item in summary_of(output).results if item.method == method)
        assert n_obstacles > n_missed >= N_FRAMES
        assert (result.obstacles.total.n_obstacles, result.obstacles.total.n_missed) == (n_obstacles, n_missed)
        assert result.scores.false_positive_rate == pytest.approx(np.mean(rates))


def test_obstacles_are_counted_by_height_where_it_is_known(broken, tmp_path, capsys):
    truth = np.full_like(rendered()[0].truth, 255)
    truth[70:80, 20:40], truth[100:120, 150:180], truth[:20] = 0, 0, 0
    height_mm = np.zeros(truth.shape, np.uint16)
    height_mm[70:80, 20:40], height_mm[100:120, 150:180] = 150, 1250
    name = frames()[0].name
    write_image(broken / "gt" / f"{name}.png", truth)
    write_image(broken / "height" / f"{name}.png", height_mm)
    assert evaluate(broken, output=tmp_path / "out", options=("--methods", "robust")) == 0
    (row,) = [row for row in rows(tmp_path / "out") if row["frame"] == name]
    heights = [row[f"obstacles_{band}m_high"] for band in ("0-0.2", "0.2-0.5", "0.5-1", "1+")]
    assert (row["obstacles"], heights) == ("2", ["1", "0", "0", "1"])
    (result,) = summary_of(tmp_path / "out").results
    low, *_, high = result.obstacles.by_height
    assert (low.n_obstacles, high.n_obstacles) == (1, 1)
    header, line = capsys.readouterr().out.splitlines()[-4:-2]
    assert header.split("  ")[-1] == "1+ m high"
    assert line.split("  ")[-1].strip() == f"{high.n_missed:g} of 1"
    write_image(broken / "height" / f"{name}.png", height_mm.T.copy())
    assert evaluate(broken, output=tmp_path / "out", options=("--methods", "robust")) == 0
    (failed,) = summary_of(tmp_path / "out").sets[0].errors
    assert "the heights are 128 x 208 pixels, but the frame is 208 x 128" in failed.error


def test_unknown_pixels_are_no_obstacles_whatever_they_count_as(broken, tmp_path):
    truth = np.full_like(rendered()[0].truth, 255)
    truth[70:80, 20:40], truth[100:120, 150:180] = 0, 128
    name = frames()[0].name
    write_image(broken / "gt" / f"{name}.png", truth)
    options = ("--methods", "uv_disparity", "--unknown", "not-traversable")
    assert evaluate(broken, output=tmp_path / "out", options=options) == 0
    (row,) = [row for row in rows(tmp_path / "out") if row["frame"] == name]
    assert row["obstacles"] == "1"


def test_flicker_is_that_of_the_masks_that_are_kept(evaluated, broken, tmp_path):
    paths = sorted((evaluated / "masks" / "road" / "robust").iterdir())
    masks = [read_image(path) for path in paths]
    expected = np.mean([np.mean(one != other) for one, other in itertools.pairwise(masks)])
    assert summary_of(evaluated).results[2].flicker == pytest.approx(expected)
    assert evaluate(broken, output=tmp_path / "out", options=("--methods", "uv_disparity")) == 0
    assert summary_of(tmp_path / "out").results[0].flicker is None


def test_calibration_of_a_method_with_confidence_is_measured(broken, tmp_path, monkeypatch, capsys):
    real = methods_module.find_by_superpixels

    def with_confidence(frame, config, run):
        detection = real(frame, config, run)
        confidence = np.full(detection.mask.shape, 204, np.uint8)
        confidence[:50] = 0
        long_range = dataclasses.replace(detection.long_range, confidence=confidence)
        return dataclasses.replace(detection, long_range=long_range)

    robust = dataclasses.replace(methods_module.METHODS["robust"], find=with_confidence)
    monkeypatch.setitem(methods_module.METHODS, "robust", robust)
    assert evaluate(broken, output=tmp_path / "out", options=("--methods", "robust,uv_disparity", "--save-masks")) == 0
    robust, uv_disparity = summary_of(tmp_path / "out").results
    right = [
        (read_image(tmp_path / "out/masks/broken/robust" / f"{item.frame.name}.png") == item.truth)[50:][truth != 128]
        for item in rendered()
        for truth in [item.truth[50:]]
    ]
    share = np.mean(np.concatenate(right))
    assert [item.n_pixels > 0 for item in robust.reliability] == [False] * 6 + [True] + [False] * 3
    assert robust.reliability[6].n_pixels == sum(map(len, right))
    assert robust.reliability[6].share_right == pytest.approx(share)
    assert robust.calibration_error == pytest.approx(abs(share - 0.8))
    assert (uv_disparity.reliability, uv_disparity.calibration_error) == ((), None)
    assert "calibration error" in capsys.readouterr().out
    assert "share that is right, by confidence" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_summary_has_the_means_of_the_rows(evaluated):
    summary = summary_of(evaluated)
    assert [(result.set, result.method) for result in summary.results] == [
        ("road", name) for name in METHODS.split(",")
    ]
    for result in summary.results:
        of_method = [row for row in rows(evaluated) if row["method"] == result.method]
        assert result.scores.rmse == pytest.approx(np.mean([float(row["rmse"]) for row in of_method]), abs=1e-6)
        assert result.reach_m == pytest.approx(np.mean([float(row["reach_m"]) for row in of_method]), abs=0.01)
        assert (result.spread is not None) == (result.method == "random_centres")
        assert (result.n_frames, result.gave_up, result.paper) == (N_FRAMES, (), None)
    assert summary.results[0].gain_m == 0.0
    assert summary.seeds == (0, 1)
    assert summary.means[2].scores == summary.results[2].scores
    assert summary.means[2].set == MEAN


def test_every_method_has_its_configuration_that_detect_takes(dataset, evaluated, tmp_path):
    path = evaluated / "configs" / "robust.yaml"
    values = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60}
    assert read_parameter_file(path).config() == Config().updated(values)
    assert run("detect", [str(dataset), "--params", str(path), "--output", str(tmp_path / "detected")]) == 0
    for name in (frame.name for frame in frames()):
        mask = read_image(evaluated / "masks" / "road" / "robust" / f"{name}.png")
        assert np.array_equal(mask, read_image(tmp_path / "detected" / "long_range" / f"{name}.png"))


def test_times_are_in_files_of_their_own(evaluated):
    table = rows(evaluated, "times.csv")
    assert len(table) == 3 * N_FRAMES
    assert all(float(row["matching_ms"]) > 0 for row in table)
    assert not any("_ms" in text.decode() for name, text in contents(evaluated).items() if name.endswith("json"))


def test_report_is_written(evaluated):
    text = (evaluated / "report.html").read_text(encoding="utf-8")
    assert "random_centres" in text
    assert frames()[0].name in text


def test_table_is_printed(dataset, evaluated, capsys):
    assert evaluate(dataset, output=evaluated, options=usual("--save-masks")) == 0
    printed = capsys.readouterr()
    assert f"{N_FRAMES} frames were finished before" in printed.err
    line = next(line for line in printed.out.splitlines() if line.startswith("road  robust"))
    scores = dataclasses.astuple(summary_of(evaluated).results[2].scores)
    assert line.split()[2:7] == [str(N_FRAMES), *(f"{value:.4f}" for value in scores)]


def test_files_do_not_depend_on_the_number_of_processes(dataset, evaluated, tmp_path):
    assert evaluate(dataset, output=tmp_path / "out", options=usual("--save-masks", "--jobs", "2")) == 0
    assert contents(tmp_path / "out") == contents(evaluated)


def test_interrupted_run_resumes_and_ends_with_the_same_files(dataset, evaluated, tmp_path, monkeypatch):
    output, real, done = tmp_path / "out", evaluation_folder.evaluate_frame, []

    def interrupted(task):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(task.item.name)
        return real(task)

    monkeypatch.setattr(evaluation_folder, "evaluate_frame", interrupted)
    assert evaluate(dataset, output=output, options=usual("--save-masks")) == 130
    assert not (output / "scores.csv").exists()
    (output / "records" / "road" / ".0123456789abcdef.1.tmp").write_text("{")  # as a killed process leaves it
    first = list(done)
    done.clear()
    assert evaluate(dataset, output=output, options=usual("--save-masks")) == 0
    assert sorted(first + done) == sorted(frame.name for frame in frames())
    assert contents(output) == contents(evaluated)


def test_cluster_gives_the_same_files_though_a_worker_dies(dataset, evaluated, tmp_path, monkeypatch, dask_cluster):
    output, write = tmp_path / "out", evaluation_folder.EvaluationFolder.write
    with dask_cluster.another_worker() as worker:

        def write_and_kill(folder, outcome):
            worker.kill()
            write(folder, outcome)

        monkeypatch.setattr(evaluation_folder.EvaluationFolder, "write", write_and_kill)
        assert evaluate(dataset, output=output, options=usual("--save-masks", "--cluster", dask_cluster.address)) == 0
        assert worker.wait(10) != 0
    assert contents(output) == contents(evaluated)


def test_run_after_a_killed_process_resumes(dataset, evaluated, tmp_path):
    output = tmp_path / "out"
    command = [sys.executable, "-m", "lrtrav_ros", "evaluate", dataset, "--output", output, *FAST]
    with subprocess.Popen(list(map(str, [*command, *usual("--save-masks")])), stdout=subprocess.DEVNULL) as process:
        clusters.until(lambda: process.poll() is not None or any(output.glob("records/road/*.json")))
        process.kill()
    assert evaluate(dataset, output=output, options=usual("--save-masks")) == 0
    assert contents(output) == contents(evaluated)


def test_second_run_into_a_folder_is_refused(dataset, tmp_path, capsys):
    with locked_folder(tmp_path / "out"):
        assert evaluate(dataset, output=tmp_path / "out", options=("--methods", "uv_disparity")) == 1
    assert capsys.readouterr().err.startswith(f"evaluate: {tmp_path / 'out'}: another run writes to it; let that end")


def test_run_that_was_killed_while_it_kept_results_aside_resumes(broken, tmp_path, monkeypatch):
    output, options = tmp_path / "out", ("--methods", "uv_disparity")
    assert evaluate(broken, output=output, options=options) == 0
    before = contents(output)
    rename, moved = Path.rename, []

    def killed(self, target):
        moved.append(self.name)
        if len(moved) == 3:
            raise KeyboardInterrupt
        return rename(self, target)

    changed = (*options, "--unknown", "not-traversable")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", killed)
        assert evaluate(broken, output=output, options=changed) == 130
    assert evaluate(broken, output=output, options=changed) == 0
    kept = {**contents(output / "superseded-1"), **contents(output / "superseded-2")}
    assert kept == before


def test_changed_settings_are_named_and_the_earlier_results_kept(broken, tmp_path, capsys):
    output = tmp_path / "out"
    assert evaluate(broken, output=output, options=("--methods", "robust,uv_disparity", "--save-masks")) == 0
    before = contents(output)
    (output / "notes.txt").write_text("mine")
    capsys.readouterr()
    options = ("--methods", "robust", "--set", "clustering.k=5", "--unknown", "not-traversable")
    assert evaluate(broken, output=output, options=options) == 0
    assert capsys.readouterr().err.splitlines() == [
        f"{output}: these have changed since the earlier run:",
        "  --methods: robust, uv_disparity -> robust",
        "  --save-masks: yes -> no",
        "  --unknown: default -> not-traversable",
        "  clustering.k: 10 -> 5",
        f"starting afresh; the earlier results are kept in {output}/superseded-1",
    ]
    assert contents(output / "superseded-1") == before
    assert {row["method"] for row in rows(output)} == {"robust"}
    assert not (output / "masks").exists()
    assert (output / "notes.txt").read_text() == "mine"


def test_changed_code_is_named_and_nothing_is_ever_removed(broken, tmp_path, capsys, monkeypatch):
    output, options = tmp_path / "out", ("--methods", "uv_disparity")
    kept = []
    for digest in ("one", "two", "two", "three"):
        if output.exists():
            kept.append(contents(output))
        monkeypatch.setattr(evaluation_identity, "code_digest", lambda package, without, digest=digest: digest)
        assert evaluate(broken, output=output, options=options) == 0
    first, second, again = kept
    assert first != second == again
    messages = capsys.readouterr().err
    assert messages.count("  the code of lrtrav_ros\n") == 2
    assert messages.count(f"{N_FRAMES} frames were finished before") == 1
    assert contents(output / "superseded-1") == first
    assert contents(output / "superseded-2") == {name: second[name] for name in first}
    assert sorted(path.name for path in output.glob("superseded-*")) == ["superseded-1", "superseded-2"]


@pytest.mark.parametrize("text", ['{"methods": {"uv_disparity": []}, "save_masks": false}', "{", '{"code": 1}'])
def test_results_of_another_version_are_kept_aside(broken, tmp_path, capsys, text):
    output, options = tmp_path / "out", ("--methods", "uv_disparity")
    assert evaluate(broken, output=output, options=options) == 0
    (output / "run.json").write_text(text)
    assert evaluate(broken, output=output, options=options) == 0
    assert "  run.json, which another version wrote\n" in capsys.readouterr().err
    assert (output / "superseded-1" / "run.json").read_text() == text
    assert len(list((output / "superseded-1" / "records" / "broken").iterdir())) == N_FRAMES


def test_changed_frame_is_computed_again(broken, tmp_path, capsys):
    output, name = tmp_path / "out", frames()[1].name
    assert evaluate(broken, output=output, options=("--methods", "uv_disparity")) == 0
    write_image(broken / "gt" / f"{name}.png", np.zeros_like(rendered()[1].truth))
    assert evaluate(broken, output=output, options=("--methods", "uv_disparity")) == 0
    err = capsys.readouterr().err
    assert f"{N_FRAMES - 1} frames were finished before" in err
    assert "frames evaluated again, because their files have changed: 1" in err
    assert next(row["precision"] for row in rows(output) if row["frame"] == name) == "0.000000"


def test_frame_that_fails_does_not_end_the_run_and_is_tried_again(broken, tmp_path, capsys):
    output, name = tmp_path / "out", frames()[2].name
    path = broken / "right" / f"{name}.png"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert evaluate(broken, output=output, options=("--methods", "uv_disparity")) == 0
    (failed,) = summary_of(output).sets[0].errors
    assert failed.frame == name
    assert f"broken/{name}: {failed.error}" in capsys.readouterr().err
    (row,) = [row for row in rows(output) if row["frame"] == name]
    assert (row["rmse"], row["problem"]) == ("", failed.error)
    assert summary_of(output).results[0].n_frames == N_FRAMES - 1
    path.write_bytes(whole)
    assert evaluate(broken, output=output, options=("--methods", "uv_disparity")) == 0
    assert not summary_of(output).sets[0].errors


def test_error_of_opencv_in_a_frame_does_not_end_the_run(broken, tmp_path, capsys, monkeypatch):
    real, seen = detector_module.detect_ground, []

    def failing(disparity, *args, **kwargs):
        seen.append(disparity)
        if len(seen) == 2:
            raise cv2.error("OpenCV: out of its mind")
        return real(disparity, *args, **kwargs)

    monkeypatch.setattr(detector_module, "detect_ground", failing)
    assert evaluate(broken, output=tmp_path / "out", options=("--methods", "robust")) == 0
    assert "OpenCV: out of its mind" in capsys.readouterr().err
    (failed,) = summary_of(tmp_path / "out").sets[0].errors
    assert failed.frame == sorted(frame.name for frame in frames())[1]
    assert summary_of(tmp_path / "out").results[0].n_frames == N_FRAMES - 1


def test_all_frames_failing_is_a_failure(broken, tmp_path, capsys):
    for path in broken.glob("right/*"):
        path.unlink()
        path.write_bytes(b"")
    assert evaluate(broken, output=tmp_path / "out", options=("--methods", "uv_disparity")) == 1
    assert len(summary_of(tmp_path / "out").sets[0].errors) == N_FRAMES


def test_damaged_bag_is_told_by_the_status_of_every_run(tmp_path, capsys):
    write_stereo_bag(tmp_path / "drive", frames())
    bag, options = tmp_path / "cut.mcap", ("--methods", "uv_disparity", "--truth", str(tmp_path / "gt"))
    for frame, item in zip(frames()[:2], rendered(), strict=False):
        write_image(tmp_path / "gt" / f"{frame.stamp_ns}.png", item.truth)
    whole = (tmp_path / "drive" / "drive.mcap").read_bytes()
    for data, status in ((whole, 0), (whole[:-200], 1), (whole[:-200], 1)):
        bag.write_bytes(data)
        assert evaluate(bag, output=tmp_path / "out", options=options) == status
        assert not summary_of(tmp_path / "out").sets[0].errors
        assert ("cut.mcap: damaged or not finished" in capsys.readouterr().err) == (status == 1)


def test_frame_without_ground_is_named_and_scored(broken, tmp_path, capsys):
    name = frames()[0].name
    for side in ("left", "right"):
        write_image(broken / side / f"{name}.png", np.full_like(frames()[0].left, 90))
    assert evaluate(broken, output=tmp_path / "out", options=("--methods", "uv_disparity,proposed")) == 0
    assert f"broken, proposed: no ground line found in {name}" in capsys.readouterr().err
    (row, _) = [row for row in rows(tmp_path / "out") if row["frame"] == name]
    assert (row["precision"], row["recall"], row["reach_m"]) == ("0.000000", "0.000000", "")
    assert row["problem"] == "no ground line found"
    result = summary_of(tmp_path / "out").results[0]
    assert (result.n_frames, result.gave_up) == (N_FRAMES, (name,))


def test_unknown_pixels_follow_the_flag(broken, tmp_path):
    name = frames()[0].name
    write_image(broken / "gt" / f"{name}.png", np.where(rendered()[0].truth == 0, 128, 255).astype(np.uint8))
    precision = {}
    for rule in ("ignore", "not-traversable"):
        options = ("--methods", "uv_disparity", "--unknown", rule)
        assert evaluate(broken, output=tmp_path / rule, options=options) == 0
        precision[rule] = float(next(row["precision"] for row in rows(tmp_path / rule) if row["frame"] == name))
        assert summary_of(tmp_path / rule).sets[0].unknown == rule
    assert precision["ignore"] == 1.0
    assert precision["not-traversable"] < 1.0


def test_six_lagr_sets_have_the_papers_means_beside_them(tmp_path):
    names = ("DS1A", "DS1B", "DS2A", "DS2B", "DS3A", "DS3B")
    sets = [write_dataset(tmp_path / name, frames(n=1), truth=True) for name in names]
    assert evaluate(*sets, output=tmp_path / "out", options=("--methods", "proposed,near_to_far")) == 0
    proposed, near_to_far = summary_of(tmp_path / "out").means
    assert proposed.paper == PaperScores(rmse=0.2692, precision=0.9452, recall=0.9011)
    assert near_to_far.paper == PaperScores(rmse=0.273)
    assert [result.paper.rmse for result in summary_of(tmp_path / "out").results if result.paper] == [
        0.2521,
        0.2347,
        0.2662,
        0.2856,
        0.2545,
        0.3224,
    ]


def test_study_prints_the_comparison(broken, tmp_path, capsys):
    assert evaluate(broken, output=tmp_path / "out", options=("--study", "texture")) == 0
    out = capsys.readouterr().out
    for texture in ("wld", "lbp", "cs_lbp", "ltp", "homogeneity"):
        assert f"proposed-{texture} " in out
        assert f"features.texture: {texture}\n" in (tmp_path / "out/configs" / f"proposed-{texture}.yaml").read_text()


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ([], 2, "give at least one DATASET"),
        (["DATASET"], 2, "--output DIR"),
        (["DATASET", "--output", "OUT", "--methods", "best"], 2, "no method 'best'"),
        (["DATASET", "--output", "OUT", "--methods", "robust,robust"], 2, "'robust' is named twice"),
        (["DATASET", "--output", "OUT", "--methods", ","], 2, "no method is named"),
        (["DATASET", "--output", "OUT", "--study", "texture", "--methods", "uv_disparity"], 2, "does not cluster"),
        (["DATASET", "--output", "OUT", "--seeds", "0"], 2, "seeds is 0"),
        (["DATASET", "--output", "OUT", "--labels", "1,1,2"], 2, "three different values"),
        (["DATASET", "--output", "OUT", "--field", "image"], 2, "write FIELD=NAME"),
        (["DATASET", "--output", "OUT", "--field", "picture=a"], 2, "no field 'picture'"),
        (["DATASET", "--output", "OUT", "--field", "layout=diagonal"], 2, "layout is 'diagonal'"),
        (["DATASET", "--output", "OUT", "--set", "clustering.n=3"], 2, "clustering.n"),
        (["DATASET", "--output", "OUT", "--set", "clustering.k=-1"], 2, "clustering.k is -1"),
        (["DATASET", "--output", "DATASET"], 1, "holds the input"),
        (["DATASET", "--output", "DATASET/gt"], 1, "is, or is in, a folder of the input"),
        (["DATASET", "--output", "DATASET/left/out"], 1, "is, or is in, a folder of the input"),
        (["DATASET", "--output", "MINE"], 1, "exists and is no evaluation"),
        (["OUT", "--output", "OUT"], 1, "there is no such folder"),
        (["--inspect", "OUT"], 1, "No such file"),
    ],
)
def test_wrong_use_is_one_line(dataset, tmp_path, capsys, arguments, status, message):
    (tmp_path / "mine" / "diary").mkdir(parents=True)
    places = {"DATASET": str(dataset), "OUT": str(tmp_path / "out"), "MINE": str(tmp_path / "mine")}
    named = [argument.partition("/") for argument in arguments]
    assert run("evaluate", [places.get(place, place) + slash + rest for place, slash, rest in named]) == status
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert message in lines[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", [["--labels", "1,2"], ["--unknown", "maybe"], ["--study", "colour"]])
def test_wrong_option_is_wrong_usage(dataset, option, capsys):
    with pytest.raises(SystemExit, match="2"):
        run("evaluate", [str(dataset), *option])
    assert option[1] in capsys.readouterr().err


def test_summary_is_plain_json(evaluated):
    content = json.loads((evaluated / "summary.json").read_text(encoding="utf-8"))
    assert content["results"][0]["scores"]["precision"] > 0.5
    assert content["methods"][0]["configuration"]["stereo.n_disparities"] == 64
