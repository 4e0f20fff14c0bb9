"""How much masks change from frame to frame."""

import numpy as np
import pytest

from lrtrav_ros.evaluation.scoring.flicker import mean_flicker


def mask(n_free):
    """4 x 5 pixels of which the first are free."""
    return np.where(np.arange(20).reshape(4, 5) < n_free, 255, 0).astype(np.uint8)


def test_flicker_is_the_mean_share_of_pixels_that_change():
    assert mean_flicker([mask(10), mask(10), mask(4), mask(5)]) == pytest.approx((0 + 6 + 1) / 3 / 20)


def test_only_neighbours_count():
    assert mean_flicker([mask(10), None, mask(0), mask(2), mask(2).T.copy()]) == pytest.approx(2 / 20)


@pytest.mark.parametrize("masks", [[], [mask(3)], [mask(3), None, mask(4)]])
def test_without_neighbours_there_is_no_flicker(masks):
    assert mean_flicker(masks) is None
