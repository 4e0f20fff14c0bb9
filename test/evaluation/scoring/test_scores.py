"""Scores of masks."""

import dataclasses
import math

import numpy as np
import pytest

from lrtrav_ros.evaluation.scoring.scores import (
    Counts,
    Scores,
    count,
    count_bands,
    mean_scores,
    score,
    spread_of_scores,
    sum_each,
)


def image(*rows):
    return np.array(rows, np.uint8)


def test_scores_are_those_of_the_definition_and_leave_out_what_is_ignored():
    mask = image([255, 255, 255, 0, 255], [0, 0, 0, 0, 0])
    truth = image([255, 255, 0, 255, 128], [255, 0, 0, 0, 128])
    assert count(mask, truth) == Counts(n_pixels=8, n_found=3, n_traversable=4, n_hits=2)
    expected = Scores(precision=2 / 3, recall=0.5, rmse=math.sqrt(3 / 8), false_positive_rate=1 / 4)
    assert score(mask, truth) == expected
    assert count(mask, truth).n_false_positives == 1


def test_nothing_found_has_precision_0_nothing_to_find_recall_1_and_nothing_to_avoid_no_false_positives():
    empty, full = np.zeros((2, 3), np.uint8), np.full((2, 3), 255, np.uint8)
    assert score(empty, full) == Scores(0.0, 0.0, 1.0, 0.0)
    assert score(empty, empty) == Scores(0.0, 1.0, 0.0, 0.0)
    assert score(full, empty) == Scores(0.0, 1.0, 1.0, 1.0)
    assert score(full, np.full((2, 3), 128, np.uint8)) == Scores(0.0, 1.0, 0.0, 0.0)


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
    scores = [Scores(0.2, 0.5, 0.1, 0.02), Scores(0.4, 0.5, 0.3, 0.08)]
    mean, spread = mean_scores(scores), spread_of_scores(scores)
    assert dataclasses.astuple(mean) == pytest.approx((0.3, 0.5, 0.2, 0.05))
    assert dataclasses.astuple(spread) == pytest.approx((0.1, 0.0, 0.1, 0.03))
    for function in (mean_scores, spread_of_scores):
        with pytest.raises(ValueError, match="no scores"):
            function([])


def test_counts_are_summed_each_with_its_own_and_without_those_that_are_not_there():
    one, two = Counts(1, 2, 3, 4), Counts(10, 20, 30, 40)
    assert sum_each([(one, two), (), (two, two)]) == (Counts(11, 22, 33, 44), Counts(20, 40, 60, 80))
    assert sum_each([(), ()]) == ()
