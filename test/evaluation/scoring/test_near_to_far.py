"""Near-to-far learning."""

import numpy as np
import pytest
from recorded import frames, rendered

from lrtrav_ros.evaluation.scoring.near_to_far import classify_superpixels

VALUES = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60, "threads": 1}
FRAME, TRUTH = frames()[0], rendered()[0].truth


def two_kinds():
    """Eight superpixels in a row, the even ones of one kind and the odd ones of another, each 4 x 6 pixels."""
    superpixels = np.repeat(np.repeat(np.arange(8, dtype=np.int32)[None], 6, axis=1), 4, axis=0)
    superpixels = np.sort(superpixels, axis=1)
    histograms = np.zeros((8, 5), np.float32)
    histograms[::2, :2], histograms[1::2, 2:4] = 0.5, 0.5
    return histograms, superpixels


def test_learning_carries_over_to_superpixels_without_evidence():
    histograms, superpixels = two_kinds()
    occupancy = np.full(superpixels.shape, 255, np.uint8)
    occupancy[:, :6] = 0  # the first is ground
    occupancy[2:, 6:9] = 100  # some of the second is not
    assert classify_superpixels(histograms, superpixels, occupancy).tolist() == [True, False] * 4


def test_learning_weighs_examples_by_their_evidence():
    histograms, superpixels = two_kinds()
    occupancy = np.full(superpixels.shape, 100, np.uint8)
    occupancy[:, :6] = 0
    occupancy[:, 12:] = 255
    occupancy[0, 12] = 100  # one pixel says that this kind is not ground, 24 that it is
    assert classify_superpixels(histograms, superpixels, occupancy).tolist() == [True, False] * 4


@pytest.mark.parametrize(("value", "expected"), [(0, True), (100, False), (255, False)])
def test_learning_from_one_class_or_none(value, expected):
    histograms, superpixels = two_kinds()
    occupancy = np.full(superpixels.shape, 255, np.uint8)
    occupancy[1, 3:8] = value
    assert classify_superpixels(histograms, superpixels, occupancy).tolist() == [expected] * 8
