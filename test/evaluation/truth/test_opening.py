"""Sets with ground truth in every layout, all written by the tests."""

import json

import numpy as np
import pytest
from recorded import CAMERA, HEIGHT, WIDTH, frames, rendered, write_dataset
from scipy.io import savemat

from lrtrav_ros.commands import run
from lrtrav_ros.evaluation.truth.labels import Labels
from lrtrav_ros.evaluation.truth.mat_files import MatFields, read_arrays
from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_set, open_sets
from lrtrav_ros.io.bag_frames import write_stereo_bag
from lrtrav_ros.io.dataset_folder import write_calibration
from lrtrav_ros.io.encodings import write_image

FRAME, TRUTH = frames()[0], rendered()[0].truth
KITTI_CALIBRATION = (
    "P0: 1 0 0 0 0 1 0 0 0 0 1 0\n"
    "P2: 200 0 100 8 0 201 60 0 0 0 1 0.003\n"
    "P3: 200 0 100 -52 0 201 60 0 0 0 1 0.003\n\nTr: 1 2 3\n"
)


def read_all(opened):
    return {source.name: source.read() for source in opened.sources(opened.names)}


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


def test_dataset_folder_gives_its_frames_with_truth(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(), truth=True)
    (folder / "gt" / f"{frames()[1].name}.png").unlink()
    opened = open_set(folder, ReaderOptions())
    assert opened.names == [frame.name for i, frame in enumerate(frames()) if i != 1]
    assert (opened.n_without_truth, opened.unknown_rule) == (1, "ignore")
    labelled = read_all(opened)[FRAME.name]
    assert np.array_equal(labelled.frame.right, FRAME.right)
    assert np.array_equal(labelled.truth, TRUTH)
    assert {file.parent.name for file in opened.files(FRAME.name)} == {"left", "right", "gt", "set"}


def test_truth_without_its_image_fails_alone(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(), truth=True)
    (folder / "left" / f"{FRAME.name}.png").unlink()
    first, second = list(open_set(folder, ReaderOptions()).sources([frame.name for frame in frames()[:2]]))
    with pytest.raises(FileNotFoundError, match=FRAME.name):
        first.read()
    assert second.read().frame.name == frames()[1].name


def test_other_labels_and_sizes_of_the_truth(tmp_path):
    folder = write_dataset(tmp_path / "set", frames(n=1))
    write_image(folder / "gt" / f"{FRAME.name}.png", lagr_labels(TRUTH))
    (source,) = open_set(folder, ReaderOptions()).sources([FRAME.name])
    with pytest.raises(ValueError, match=f"gt/{FRAME.name}.png: ground truth has the value 1, .* see --labels"):
        source.read()
    (source,) = open_set(folder, ReaderOptions(labels=Labels(0, 1, 2))).sources([FRAME.name])
    assert np.array_equal(source.read().truth, TRUTH)
    write_image(folder / "gt" / f"{FRAME.name}.png", TRUTH.T)
    (source,) = open_set(folder, ReaderOptions()).sources([FRAME.name])
    with pytest.raises(
        ValueError, match=f"ground truth is {HEIGHT} x {WIDTH} pixels, the left image {WIDTH} x {HEIGHT}"
    ):
        source.read()


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
        labelled = read_all(opened)["um_000000"]
        camera = labelled.frame.camera
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == (200.0, 201.0, 100.0, 60.0)
        assert camera.baseline_m == pytest.approx(0.3)
        assert np.array_equal(labelled.frame.right, FRAME.right)
        assert [labelled.truth[v, 31] for v in (0, 50, 90)] == [128, 0, 255]
        assert labelled.truth[90, 29] == 0


@pytest.mark.parametrize(("text", "message"), [("P2: 1 2\n", "P2 is no matrix"), ("P0: 1\n", "has no P2 and P3")])
def test_bad_kitti_calibration_is_refused(tmp_path, text, message):
    write_image(tmp_path / "image_2" / "um_000000.png", FRAME.left)
    write_image(tmp_path / "image_3" / "um_000000.png", FRAME.right)
    write_image(tmp_path / "gt_image_2" / "um_road_000000.png", FRAME.left)
    (tmp_path / "calib").mkdir()
    (tmp_path / "calib" / "um_000000.txt").write_text(text)
    (source,) = open_set(tmp_path, ReaderOptions()).sources(["um_000000"])
    with pytest.raises(ValueError, match=message):
        source.read()


def test_lagr_files_are_read_with_the_default_fields(tmp_path):
    opened = open_set(write_lagr(tmp_path / "DS1A"), ReaderOptions())
    assert (opened.names, opened.unknown_rule) == (["frame_0001"], "not-traversable")
    labelled = read_all(opened)["frame_0001"]
    assert np.array_equal(labelled.frame.left, FRAME.left)
    assert np.array_equal(labelled.frame.right, FRAME.right)
    assert np.array_equal(labelled.truth, TRUTH)
    assert labelled.frame.camera == CAMERA


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
    labelled = read_all(open_set(folder, ReaderOptions(fields=fields, labels=Labels())))["a"]
    assert np.array_equal(labelled.frame.left, FRAME.left)
    assert labelled.frame.disparity.dtype == np.float32
    assert labelled.frame.disparity == pytest.approx(disparity, abs=1e-4)
    assert np.array_equal(labelled.truth, TRUTH)


def test_depth_is_read_from_mat_files(tmp_path):
    depth_m = CAMERA.depth_m(rendered()[0].disparity)
    folder = write_lagr(tmp_path / "set", im_rgb_right=None, im_depth=depth_m)
    labelled = read_all(open_set(folder, ReaderOptions()))["frame_0001"]
    assert labelled.frame.right is None
    assert np.array_equal(labelled.frame.depth_m, depth_m)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"im_rgb": None}, "has no array 'im_rgb', but im_rgb_right, manual_human_labeling_mask; say with --field"),
        ({"im_rgb_right": None}, "has none of right .*; say with --field what they are called"),
        ({"im_rgb_right": FRAME.right[:-1]}, "stereo is"),
        ({"im_rgb": FRAME.left.astype(np.int32)}, "im_rgb has shape .* and type int32; give a grey or an RGB image"),
        ({"manual_human_labeling_mask": TRUTH}, "ground truth has the value 128, but its labels are 0,1,2"),
    ],
)
def test_mat_files_that_do_not_fit_say_what_is_wrong(tmp_path, changes, message):
    folder = write_lagr(tmp_path / "set", **changes)
    (source,) = open_set(folder, ReaderOptions()).sources(["frame_0001"])
    with pytest.raises(ValueError, match=f"frame_0001.mat: {message}"):
        source.read()


def test_mat_folder_needs_a_calibration_that_fits(tmp_path):
    folder = write_lagr(tmp_path / "set")
    calibration = json.loads((folder / "calib.json").read_text())
    (folder / "calib.json").write_text(json.dumps({**calibration, "width": 640}))
    (source,) = open_set(folder, ReaderOptions()).sources(["frame_0001"])
    with pytest.raises(ValueError, match="width is 640"):
        source.read()
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


def test_cut_mat_file_is_refused(tmp_path):
    folder = write_lagr(tmp_path / "set")
    whole = (folder / "frame_0001.mat").read_bytes()
    (folder / "frame_0001.mat").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="cannot be read as a MATLAB file"):
        read_arrays(folder / "frame_0001.mat")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ([("picture", "a")], "no field 'picture'; choose out of image, right"),
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


def test_bag_with_a_folder_of_truth(tmp_path):
    bag = tmp_path / "drive"
    write_stereo_bag(bag, frames())
    stamps = [str(frame.stamp_ns) for frame in frames()]
    for stamp, item in zip(stamps[:2], rendered(), strict=False):
        write_image(tmp_path / "labels" / f"{stamp}.png", item.truth)
    write_image(tmp_path / "labels" / "123.png", TRUTH)
    opened = open_set(bag, ReaderOptions(truth=tmp_path / "labels"))
    assert opened.names == sorted(["123", *stamps[:2]])
    *read, missing = opened.sources(opened.names)
    assert [source.name for source in read] == stamps[:2]
    assert np.array_equal(read[1].read().frame.left, frames()[1].left)
    assert np.array_equal(read[1].read().truth, rendered()[1].truth)
    with pytest.raises(ValueError, match="drive has no such frame"):
        missing.read()


def test_sets_are_named_by_their_folders(tmp_path):
    paths = [write_dataset(tmp_path / name, frames(n=1), truth=True) for name in ("a/DS1A", "b/DS1A", "b/other")]
    assert [item.name for item in open_sets(paths[1:], ReaderOptions())] == ["DS1A", "other"]
    assert [item.name for item in open_sets(paths, ReaderOptions())] == ["a_DS1A", "b_DS1A", "b_other"]
    with pytest.raises(ValueError, match="named twice"):
        open_sets([paths[0], tmp_path / "b" / ".." / "a" / "DS1A"], ReaderOptions())


def test_what_is_no_set_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        open_set(tmp_path / "nowhere", ReaderOptions())
    folder = write_dataset(tmp_path / "unlabelled", frames(n=1))
    with pytest.raises(ValueError, match="no frame has ground truth"):
        open_set(folder, ReaderOptions())
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="holds no ground truth"):
        open_set(tmp_path / "empty", ReaderOptions())
