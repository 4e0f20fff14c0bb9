"""Scores, distances on the ground, labels of the truth, and records as JSON."""

import math

import numpy as np
import pytest

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.scoring.ground_distances import MAX_REACH_M, GroundDistances
from lrtrav_ros.evaluation.scoring.score_records import (
    FrameRecord,
    FrameTimes,
    MethodRecord,
    MethodTimes,
    Summary,
    from_json,
    to_json,
)
from lrtrav_ros.evaluation.scoring.scores import (
    Counts,
    Scores,
    count,
    count_bands,
    mean_scores,
    score,
    spread_of_scores,
)
from lrtrav_ros.evaluation.truth.labels import Labels, apply_unknown_rule, decode_truth
from lrtrav_ros.method.ground import GroundLine

# One metre above flat ground, looking level: row 20 + n is 100 / n metres ahead.
CAMERA = StereoCamera(fx=100.0, cx=39.5, cy=20.0, baseline_m=0.5)
LEVEL = GroundLine(slope=0.5, intercept=-10.0)
SHAPE = (60, 80)


def reach_m(mask, truth):
    return GroundDistances(LEVEL, CAMERA, SHAPE).reach_m(mask, truth)


def image(*rows):
    return np.array(rows, np.uint8)


def test_scores_are_those_of_the_definition_and_leave_out_what_is_ignored():
    mask = image([255, 255, 255, 0, 255], [0, 0, 0, 0, 0])
    truth = image([255, 255, 0, 255, 128], [255, 0, 0, 0, 128])
    assert count(mask, truth) == Counts(n_pixels=8, n_found=3, n_traversable=4, n_hits=2)
    assert score(mask, truth) == Scores(precision=2 / 3, recall=0.5, rmse=math.sqrt(3 / 8))


def test_nothing_found_has_precision_0_and_nothing_to_find_recall_1():
    empty, full = np.zeros((2, 3), np.uint8), np.full((2, 3), 255, np.uint8)
    assert score(empty, full) == Scores(0.0, 0.0, 1.0)
    assert score(empty, empty) == Scores(0.0, 1.0, 0.0)
    assert score(full, np.full((2, 3), 128, np.uint8)) == Scores(0.0, 1.0, 0.0)


def test_mask_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"mask is \(2, 3\), ground truth \(3, 2\)"):
        score(np.zeros((2, 3), np.uint8), np.zeros((3, 2), np.uint8))


def test_counts_of_bands_add_up_and_leave_out_the_sky():
    distance_m = np.array([[np.inf, np.inf, 100.0], [40.0, 39.9, 10.0], [7.0, 5.0, 4.9]])
    mask = image([255, 0, 255], [255, 255, 0], [255, 255, 255])
    truth = image([0, 0, 0], [255, 128, 255], [255, 255, 0])
    assert count_bands(mask, truth, distance_m) == (
        Counts(1, 1, 0, 0),
        Counts(2, 2, 2, 2),
        Counts(1, 0, 1, 0),
        Counts(0, 0, 0, 0),
        Counts(2, 2, 1, 1),
    )


def test_mean_and_spread_of_scores():
    scores = [Scores(0.2, 0.5, 0.1), Scores(0.4, 0.5, 0.3)]
    mean, spread = mean_scores(scores), spread_of_scores(scores)
    assert (mean.precision, mean.recall, mean.rmse) == pytest.approx((0.3, 0.5, 0.2))
    assert (spread.precision, spread.recall, spread.rmse) == pytest.approx((0.1, 0.0, 0.1))
    for function in (mean_scores, spread_of_scores):
        with pytest.raises(ValueError, match="no scores"):
            function([])


def test_distance_on_the_ground_follows_the_line():
    distance_m = GroundDistances(LEVEL, CAMERA, SHAPE).distance_m
    assert distance_m.shape == SHAPE
    assert distance_m[21:, 5] == pytest.approx(100 / np.arange(1, 40))
    assert np.isinf(distance_m[:21]).all()


def test_distance_follows_a_camera_that_rolls():
    tilted = GroundLine(slope=0.5, intercept=-10.0 - 0.05 * 39.5, tilt=0.05)
    distance_m = GroundDistances(tilted, CAMERA, SHAPE).distance_m
    assert distance_m[40, 0] == pytest.approx(depth_at(tilted, 40, 0), rel=0.02)
    assert distance_m[40, 79] == pytest.approx(depth_at(tilted, 40, 79), rel=0.02)


def depth_at(line, v, u):
    """Depth of the ground in a pixel, in metres."""
    return CAMERA.fx * CAMERA.baseline_m / line.disparity(*SHAPE)[v, u]


@pytest.mark.parametrize(("first_row", "expected_m"), [(40, 5.0), (25, 20.0), (21, 100.0), (0, 100.0)])
def test_reach_is_the_distance_of_the_farthest_row(first_row, expected_m):
    truth = np.zeros(SHAPE, np.uint8)
    truth[21:, 20:60] = 255
    mask = np.zeros(SHAPE, np.uint8)
    mask[first_row:] = 255
    assert reach_m(mask, truth) == pytest.approx(expected_m)
    assert MAX_REACH_M == 100.0


def test_reach_ends_at_an_interruption_but_not_at_noise_or_where_nothing_is_traversable():
    truth = np.zeros(SHAPE, np.uint8)
    truth[21:] = 255
    mask = truth.copy()
    mask[30] = 0  # one row
    mask[::2, ::5] = 0  # grains
    assert reach_m(mask, truth) == pytest.approx(100.0)
    gap = truth.copy()
    gap[30:38] = 0
    assert reach_m(gap, truth) == pytest.approx(100 / (38 - 20))
    assert reach_m(gap, gap) == pytest.approx(100.0)


def test_reach_starts_at_the_first_row_that_is_found():
    truth = np.zeros(SHAPE, np.uint8)
    truth[21:] = 255
    mask = truth.copy()
    mask[50:] = 0
    assert reach_m(mask, truth) == pytest.approx(100.0)
    assert reach_m(np.zeros(SHAPE, np.uint8), truth) == 0.0
    assert reach_m(truth, np.zeros(SHAPE, np.uint8)) == 0.0


def test_labels_are_decoded_and_unknown_follows_the_rule():
    raw = np.array([[0, 1, 2], [1, 0, 0]], np.int16)
    truth = decode_truth(raw, Labels(traversable=0, not_traversable=1, unknown=2))
    assert truth.tolist() == [[255, 0, 128], [0, 255, 255]]
    assert apply_unknown_rule(truth, "ignore").tolist() == truth.tolist()
    assert apply_unknown_rule(truth, "not-traversable").tolist() == [[255, 0, 0], [0, 255, 255]]
    assert decode_truth(truth, Labels()).tolist() == truth.tolist()


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda: Labels(1, 1, 2), "labels are 1,1,2; give three different values"),
        (lambda: decode_truth(image([0, 7]), Labels()), "value 7, but its labels are 255,0,128"),
        (lambda: decode_truth(np.zeros((2, 3, 3), np.uint8), Labels()), r"shape \(2, 3, 3\)"),
    ],
)
def test_bad_truth_is_refused(function, message):
    with pytest.raises(ValueError, match=message):
        function()


def test_records_are_the_same_after_json():
    scored = MethodRecord(
        "proposed",
        Scores(0.1, 0.2, 0.3),
        spread=Scores(0.0, 0.0, 0.01),
        bands=(Counts(1, 2, 3, 4), Counts(0, 0, 0, 0)),
        reach_m=12.5,
        problem="no ground line found",
        seeds=(Scores(0.1, 0.2, 0.3),),
    )
    record = FrameRecord("DS1A", "frame ü", (scored, MethodRecord("robust", Scores(1.0, 1.0, 0.0))), inputs="12ab")
    times = FrameTimes("DS1A", "frame ü", (MethodTimes("proposed", StageTimes(matching_ms=1.25)),))
    assert from_json(FrameRecord, to_json(record)) == record
    assert from_json(FrameTimes, to_json(times)) == times


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"set": "a", "frame": "b", "methods": 3}', "null"])
def test_text_that_is_no_record_is_refused(text):
    for kind in (FrameRecord, Summary):
        with pytest.raises(ValueError, match=r"is no|Expecting value"):
            from_json(kind, text)
