"""The gallery of the report: which frames it shows, and their pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from recorded import frames, write_dataset
from sample_report import (
    METHODS,
    make_report,
    make_summary,
    method_record,
)

from lrtrav_ros.evaluation.report.gallery import (
    CALLED_FREE,
    called_free_picture,
    choose_called_free,
    choose_exhibits,
    make_gallery,
)
from lrtrav_ros.evaluation.scoring.frame_evaluation import make_setup
from lrtrav_ros.evaluation.scoring.methods import choose_methods
from lrtrav_ros.evaluation.scoring.obstacles import StandingObstacles
from lrtrav_ros.evaluation.scoring.score_records import (
    FrameRecord,
)
from lrtrav_ros.evaluation.scoring.scores import Counts
from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_sets
from lrtrav_ros.io import pictures


@pytest.fixture
def evaluated(tmp_path):
    """A set of four frames with truth, and records by which the last is the best."""
    path = write_dataset(tmp_path / "set", frames(), truth=True)
    sets = open_sets([path], ReaderOptions())
    values = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60}
    setup = make_setup(choose_methods(METHODS), values, n_seeds=1)
    records = [
        FrameRecord(
            "set", name, tuple(method_record(method, i, pixels=Counts(90, 50, 50, 40 - i)) for method in METHODS)
        )
        for i, name in enumerate(sets[0].frames.names)
    ]
    return sets, setup, records


@pytest.mark.parametrize(
    ("n", "expected"),
    [
        (0, []),
        (1, [("best", 0)]),
        (2, [("best", 1), ("worst", 0)]),
        (3, [("best", 2), ("median", 1), ("worst", 0)]),
        (6, [("best", 5), ("median", 3), ("worst", 0)]),
    ],
)
def test_best_median_and_worst_are_chosen(n, expected):
    records = [FrameRecord("s", str(i), (method_record("robust", i),)) for i in range(n)]
    records.insert(0, FrameRecord("s", "broken", (), error="no"))
    chosen = list(choose_exhibits(records, "robust"))
    assert [(item.rank, item.frame) for item in chosen] == [(rank, str(i)) for rank, i in expected]
    assert list(choose_exhibits(records, "other")) == []


def test_frames_with_most_obstacle_pixels_called_free_are_chosen():
    n_false = (0, 7, 40, 3, 9)
    records = [
        FrameRecord("s", str(i), (method_record("robust", 0, pixels=Counts(100, 60, 50, 60 - n)),))
        for i, n in enumerate(n_false)
    ]
    records.insert(0, FrameRecord("s", "broken", (), error="no"))
    chosen = [(item.rank, item.frame) for item in choose_called_free(records, "robust")]
    assert chosen == [(CALLED_FREE, frame) for frame in ("2", "4", "1")]
    assert list(choose_called_free(records[:2], "robust")) == []
    assert list(choose_called_free(records, "other")) == []


def test_obstacle_pixels_called_free_are_marked_though_the_picture_is_smaller():
    truth = np.full((240, 1120), 255, np.uint8)
    truth[40:80, 100:200], truth[40:80, 300:400] = 0, 0
    truth[200:, 1000:] = 128
    mask = np.where((truth == 0) & (np.arange(1120) >= 140), 0, 255).astype(np.uint8)
    mask[60, 351] = 255
    mask[40:80, 100:160] = 255
    picture = called_free_picture(np.full((240, 1120, 3), 100, np.uint8), mask, truth, StandingObstacles(truth))
    assert picture.shape == (120, 560, 3)
    marked = (picture == (0, 94, 213)).all(axis=2)
    assert marked[20:40, 50:80].all()  # called free
    assert marked[30, 175]  # a pixel of four
    assert marked[30, 99]  # outline of an obstacle that is missed
    assert (picture[30, 199] == (0, 230, 255)).all()  # and of one that is seen
    assert (picture[30, 90] == 50).all()
    assert np.count_nonzero(marked) < 700


def test_gallery_has_all_pictures_of_each_method(evaluated):
    exhibits = make_gallery(*evaluated)
    assert [(item.record.method, item.rank) for item in exhibits] == [
        (method, rank) for method in METHODS for rank in ("best", "median", "worst", *(CALLED_FREE,) * 3)
    ]
    few = ["image", "truth", "short range", "errors"]
    all_titles = ["image", "truth", "short range", "superpixels", "clusters", "long range", "errors"]
    for item in exhibits:
        titles = few if item.record.method == METHODS[0] else all_titles
        if item.rank == CALLED_FREE:
            titles = ["image", "short range", CALLED_FREE]
        assert [picture.title for picture in item.pictures] == titles
        for picture in item.pictures:
            image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
            assert image.shape == (128, 208, 3)
            assert (picture.width, picture.height) == (208, 128)
    assert make_gallery(*evaluated, jobs=2) == exhibits


def test_frame_that_is_gone_has_no_pictures(evaluated):
    sets, setup, records = evaluated
    (sets[0].frames.path / "right" / f"{records[-1].frame}.png").unlink()
    exhibits = make_gallery(sets, setup, records)
    assert [len(item.pictures) for item in exhibits] == [0, 4, 4, 0, 3, 3, 0, 7, 7, 0, 3, 3]
    assert "No pictures of this frame." in make_report(make_summary(sets=("set",)), records, exhibits)


def test_error_of_opencv_leaves_a_frame_without_pictures(evaluated, monkeypatch):
    real, n_calls = pictures.error_picture, []

    def failing(*args):
        n_calls.append(1)
        if len(n_calls) == 1:
            raise cv2.error("OpenCV: no memory")
        return real(*args)

    monkeypatch.setattr(pictures, "error_picture", failing)
    exhibits = make_gallery(*evaluated)
    assert [len(item.pictures) for item in exhibits] == [4, 4, 0, 3, 3, 3, 7, 7, 0, 3, 3, 3]


def test_large_pictures_are_made_smaller():
    from lrtrav_ros.evaluation.report import gallery

    picture = gallery._picture("image", np.zeros((600, 1120, 3), np.uint8))
    assert (picture.width, picture.height) == (560, 300)
