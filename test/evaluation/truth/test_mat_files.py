"""Frames in MATLAB files, all written by the tests."""

import dataclasses
import json

import numpy as np
import pytest
from recorded import CAMERA, FAST, HEIGHT, WIDTH, frames, rendered
from scipy.io import savemat

from lrtrav_ros.commands import run
from lrtrav_ros.evaluation.scoring.score_records import PaperScores, Summary, from_json
from lrtrav_ros.evaluation.truth.labels import Labels
from lrtrav_ros.evaluation.truth.mat_arrays import read_arrays
from lrtrav_ros.evaluation.truth.mat_files import MatFields
from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_set
from lrtrav_ros.io.dataset_folder import write_calibration

FRAME, TRUTH = frames()[0], rendered()[0].truth


def lagr_labels(truth):
    """Truth as the LAGR files label it."""
    return np.select([truth == 255, truth == 0], [0, 1], 2).astype(np.uint8)


def write_mat(path, *, columns=True, **arrays):
    """Write a frame as a `.mat` file, arrays with columns first as in the LAGR files."""
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {name: np.swapaxes(array, 0, 1) if columns else array for name, array in arrays.items()}
    savemat(path, content, do_compression=True)
    write_calibration(path.parent, CAMERA, WIDTH, HEIGHT)


def write_lagr(folder, name="frame_0001", **changes):
    arrays = {
        "im_rgb": FRAME.left[..., ::-1],
        "im_rgb_right": FRAME.right[..., ::-1],
        "manual_human_labeling_mask": lagr_labels(TRUTH),
        **changes,
    }
    write_mat(folder / f"{name}.mat", **{key: value for key, value in arrays.items() if value is not None})
    return folder


def test_lagr_files_are_read_with_the_default_fields(tmp_path):
    opened = open_set(write_lagr(tmp_path / "DS1A"), ReaderOptions())
    assert (opened.names, opened.unknown_rule) == (["frame_0001"], "not-traversable")
    labelled = next(opened.items(["frame_0001"])).read()
    assert np.array_equal(labelled.frame.left, FRAME.left)
    assert np.array_equal(labelled.frame.right, FRAME.right)
    assert np.array_equal(labelled.truth, TRUTH)
    assert labelled.frame.camera == dataclasses.replace(CAMERA, width=WIDTH, height=HEIGHT)


def test_mat_files_with_other_names_layout_types_and_disparity(tmp_path):
    disparity = rendered()[0].disparity
    stored = np.where(disparity > 0, disparity * 16, np.nan).astype(np.float64)
    folder = tmp_path / "set"
    write_mat(
        folder / "a.mat",
        columns=False,
        frame={"left": FRAME.left[..., ::-1] / 255.0, "disp": stored},
        labels=TRUTH.astype(np.float64),
    )
    fields = MatFields.parsed(
        [
            ("image", "frame.left"),
            ("disparity", "frame.disp"),
            ("truth", "labels"),
            ("layout", "rows"),
            ("disparity_scale", "16"),
        ]
    )
    labelled = next(open_set(folder, ReaderOptions(fields=fields, labels=Labels())).items(["a"])).read()
    assert np.array_equal(labelled.frame.left, FRAME.left)
    assert labelled.frame.disparity.dtype == np.float32
    assert labelled.frame.disparity == pytest.approx(disparity, abs=1e-4)
    assert np.array_equal(labelled.truth, TRUTH)


def test_depth_is_read_from_mat_files(tmp_path):
    depth_m = CAMERA.depth_m(rendered()[0].disparity)
    folder = write_lagr(tmp_path / "set", im_rgb_right=None, im_depth=depth_m)
    labelled = next(open_set(folder, ReaderOptions()).items(["frame_0001"])).read()
    assert labelled.frame.right is None
    assert np.array_equal(labelled.frame.depth_m, depth_m)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"im_rgb": None}, "has no array 'im_rgb', but im_rgb_right, manual_human_labeling_mask; say with --field"),
        ({"im_rgb_right": None}, "has none of right .*; say with --field what they are called"),
        (
            {"im_rgb_right": FRAME.right[:-1]},
            f"the right image is {WIDTH} x {HEIGHT - 1} pixels, but the left image is {WIDTH} x {HEIGHT}",
        ),
        ({"im_rgb": FRAME.left.astype(np.int32)}, "left image is int32 .*; give uint8 or uint16"),
        ({"manual_human_labeling_mask": TRUTH}, "ground truth has the value 128, but its labels are 0,1,2"),
    ],
)
def test_mat_files_that_do_not_fit_say_what_is_wrong(tmp_path, changes, message):
    folder = write_lagr(tmp_path / "set", **changes)
    (item,) = open_set(folder, ReaderOptions()).items(["frame_0001"])
    with pytest.raises(ValueError, match=f"frame_0001.mat: {message}"):
        item.read()


def test_mat_folder_needs_a_calibration_that_fits(tmp_path):
    folder = write_lagr(tmp_path / "set")
    calibration = json.loads((folder / "calib.json").read_text())
    (folder / "calib.json").write_text(json.dumps({**calibration, "width": 640}))
    (item,) = open_set(folder, ReaderOptions()).items(["frame_0001"])
    message = f"the calibration is for 640 x {HEIGHT} pixels, but the image is {WIDTH} x {HEIGHT}"
    with pytest.raises(ValueError, match=message):
        item.read()
    (folder / "calib.json").unlink()
    with pytest.raises(FileNotFoundError, match=r"calib\.json: there is no such calibration; write one with fx"):
        open_set(folder, ReaderOptions())


@pytest.mark.parametrize(
    "content", [b"", b"MATLAB 5.0 MAT-file" + bytes(109), b"\x00" * 200, b"\x89HDF\r\n\x1a\n" * 40]
)
def test_damaged_mat_files_are_refused(tmp_path, content):
    (tmp_path / "a.mat").write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.mat"):
        read_arrays(tmp_path / "a.mat")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ([("picture", "a")], "no field 'picture'; choose one of image, right"),
        ([("layout", "diagonal")], "layout is 'diagonal'"),
        ([("disparity_scale", "big")], "disparity_scale is 'big'; give a number"),
        ([("disparity_scale", "0")], "disparity_scale is 0.0"),
    ],
)
def test_bad_fields_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        MatFields.parsed(settings)


def test_inspect_lists_arrays_with_shapes_and_ranges(tmp_path, capsys):
    folder = write_lagr(tmp_path / "set", note=np.array([[1.5, np.nan, 3.25]]), im_rgb_right=None)
    assert run("evaluate", ["--inspect", str(folder / "frame_0001.mat")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["im_rgb", "manual_human_labeling_mask", "note"]
    image, labels, note = lines
    assert f"{WIDTH} x {HEIGHT} x 3" in image
    assert f"uint8    {FRAME.left.min()} .. {FRAME.left.max()}" in image
    assert labels.endswith("uint8    values " + ", ".join(map(str, np.unique(lagr_labels(TRUTH)))))
    assert note.endswith("float64  values 1.5, 3.25, 1 not finite")


def test_lagr_set_has_the_papers_row_beside_it(tmp_path, capsys):
    folder = write_lagr(tmp_path / "labeled_DS1A")
    assert run("evaluate", [str(folder), "--output", str(tmp_path / "out"), *FAST, "--methods", "proposed,robust"]) == 0
    summary = from_json(Summary, (tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert (summary.sets[0].unknown, summary.sets[0].errors) == ("not-traversable", ())
    assert [result.paper for result in summary.results] == [PaperScores(rmse=0.2521), None]
    out = capsys.readouterr().out
    assert "the paper" in out
    assert next(line for line in out.splitlines() if "proposed" in line).endswith("- - 0.2521")


def test_images_of_16_bits_are_read_as_they_are(tmp_path):
    left, right = FRAME.left.astype(np.uint16) * 16, FRAME.right.astype(np.uint16) * 32  # the right one is brighter
    folder = write_lagr(tmp_path / "set", im_rgb=left[..., ::-1], im_rgb_right=right[..., ::-1])
    frame = next(open_set(folder, ReaderOptions()).items(["frame_0001"])).read().frame
    assert np.array_equal(frame.left, left)
    assert np.array_equal(frame.right, right)
