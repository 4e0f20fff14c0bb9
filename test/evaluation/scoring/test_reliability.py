"""Reliability of a confidence."""

import numpy as np
import pytest

from lrtrav_ros.evaluation.scoring.reliability import (
    CONFIDENCE_BINS,
    ConfidenceBin,
    calibration_error,
    count_confidence,
)

NONE = ConfidenceBin(0, 0, 0)


def image(*rows):
    return np.array(rows, np.uint8)


def test_bins_go_from_a_guess_to_certainty():
    assert len(CONFIDENCE_BINS) == 10
    assert CONFIDENCE_BINS[0] == (0.5, 0.55)
    assert CONFIDENCE_BINS[-1] == (0.95, 1.0)


def test_pixels_that_the_truth_judges_are_counted_by_their_confidence():
    confidence = image([255, 243, 242, 250], [127, 140, 141, 255], [0, 0, 204, 200])
    mask = image([255, 255, 0, 0], [255, 0, 0, 255], [255, 0, 0, 0])
    truth = image([255, 0, 0, 0], [0, 0, 255, 128], [255, 255, 0, 128])
    bins = count_confidence(confidence, mask, truth)
    assert bins[-1] == ConfidenceBin(3, 2, 255 + 243 + 250)
    assert bins[-2] == ConfidenceBin(1, 1, 242)
    assert bins[6] == ConfidenceBin(1, 1, 204)  # exactly 0.8
    assert bins[1] == ConfidenceBin(1, 0, 141)
    assert bins[0] == ConfidenceBin(2, 1, 127 + 140)
    assert sum(item.n_pixels for item in bins) == 8
    assert bins[-1].share_right == pytest.approx(2 / 3)
    assert bins[-1].confidence == pytest.approx(748 / 3 / 255)
    assert (NONE.share_right, NONE.confidence) == (None, None)


def test_bins_add_up():
    assert ConfidenceBin(1, 2, 3) + ConfidenceBin(10, 20, 30) == ConfidenceBin(11, 22, 33)


def test_calibration_error_is_the_mean_over_pixels():
    perfect = (ConfidenceBin(100, 80, 80 * 255), NONE)
    assert calibration_error(perfect) == pytest.approx(0.0)
    both = (ConfidenceBin(100, 50, 60 * 255), ConfidenceBin(300, 300, 270 * 255))
    assert calibration_error(both) == pytest.approx((10 + 30) / 400)
    assert calibration_error((NONE, NONE)) is None
    assert calibration_error(()) is None


def test_confidence_that_is_drawn_is_found_to_be_calibrated():
    rng = np.random.default_rng(0)
    confidence = rng.integers(128, 256, (200, 300)).astype(np.uint8)
    truth = np.where(rng.random(confidence.shape) < 0.5, 255, 0).astype(np.uint8)
    right = rng.random(confidence.shape) < confidence / 255
    mask = np.where(right, truth, 255 - truth).astype(np.uint8)
    bins = count_confidence(confidence, mask, truth)
    assert calibration_error(bins) < 0.01
    assert all(low <= item.confidence <= high for item, (low, high) in zip(bins, CONFIDENCE_BINS, strict=True))
    too_sure = count_confidence(np.full_like(confidence, 255), mask, truth)
    assert calibration_error(too_sure) == pytest.approx(np.mean(~right), abs=1e-9)


def test_other_sizes_are_refused():
    with pytest.raises(ValueError, match=r"confidence is \(2, 3\), ground truth \(3, 2\); give images of one size"):
        count_confidence(np.zeros((2, 3), np.uint8), np.zeros((2, 3), np.uint8), np.zeros((3, 2), np.uint8))
