"""The ground line that an image of the ground's disparity shows."""

import numpy as np
import pytest

from lrtrav_ros.mapping.ground_disparity import ground_line_of
from lrtrav_ros.method.ground import GroundLine

HEIGHT, WIDTH = 96, 160


@pytest.mark.parametrize(
    "line",
    [
        GroundLine(0.3, -9.0),
        GroundLine(0.3, -9.0, tilt=0.02),
        GroundLine(0.25, -10.0, tilt=-0.01, bend=3.0),
        GroundLine(0.25, -2.0, tilt=0.005, bend=-1.5),
    ],
)
def test_the_line_comes_back(line):
    found = ground_line_of(line.disparity(HEIGHT, WIDTH))
    values, expected = ([each.slope, each.intercept, each.tilt, each.bend] for each in (found, line))
    np.testing.assert_allclose(values, expected, atol=1e-3)
    np.testing.assert_allclose(found.disparity(HEIGHT, WIDTH)[60:], line.disparity(HEIGHT, WIDTH)[60:], atol=1e-4)


def test_without_ground_there_is_no_line():
    assert ground_line_of(np.zeros((HEIGHT, WIDTH), np.float32)) is None


def test_a_single_row_is_too_little():
    disparity = np.zeros((HEIGHT, WIDTH), np.float32)
    disparity[-1] = 5.0
    assert ground_line_of(disparity) is None


def test_what_is_no_disparity_image_is_refused():
    with pytest.raises(ValueError, match="disparity"):
        ground_line_of(np.zeros((4, 5), np.float64))
