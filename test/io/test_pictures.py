"""Pictures of results: colours that tell right from wrong."""

from __future__ import annotations

import numpy as np

from lrtrav_ros.io import pictures


def test_errors_are_told_by_colour():
    left = np.full((1, 5, 3), 100, np.uint8)
    mask = np.array([[255, 255, 0, 0, 255]], np.uint8)
    truth = np.array([[255, 0, 255, 0, 128]], np.uint8)
    right, wrong, missed, empty, ignored = pictures.error_picture(left, mask, truth)[0].astype(int)
    assert right[1] > right[2]  # green
    assert wrong[2] > wrong[1] > wrong[0]  # vermilion
    assert missed[0] > missed[1] > missed[2]  # blue
    assert len(set(empty)) == 1
    assert len(set(ignored)) == 1
    assert abs(ignored[0] - 128) < abs(empty[0] - 128)
    grey = pictures.error_picture(left[..., 0], mask, truth)[0].astype(int)
    assert np.array_equal(grey[1], wrong)


def test_truth_is_told_by_colour():
    left = np.full((1, 3, 3), 100, np.uint8)
    traversable, not_traversable, ignored = pictures.truth_picture(left, np.array([[255, 0, 128]], np.uint8))[0]
    assert traversable[1] > traversable[2]
    assert list(not_traversable) == [100, 100, 100]
    assert ignored[0] == ignored[1] == ignored[2] > 100
