"""How far the rows of a pair are apart, on pairs of which that is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import ElasConfig, StereoConfig
from lrtrav_ros.method.matching import create_matcher
from lrtrav_ros.method.matching.row_offset import row_offset

HEIGHT, WIDTH = 200, 320
DISPARITY_PX = 12.25  # this and all offsets: whole 32nds of a pixel, as older versions of OpenCV round to those


def texture() -> NDArray[np.float32]:
    noise = np.random.default_rng(0).normal(0, 1, (HEIGHT, WIDTH)).astype(np.float32)
    coarse = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return 128 + 40 * coarse / coarse.std()


def pair(lower_px: float, gain: float = 1.0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return a pair at DISPARITY_PX, of which the right image is lower and brighter."""
    rng, left = np.random.default_rng(1), texture()
    move = np.array([[1, 0, -DISPARITY_PX], [0, 1, lower_px]])
    right = cv2.warpAffine(left, move, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    left, right = (image + rng.normal(0, 2, image.shape) for image in (left / gain, right))
    return np.clip(left, 0, 255).astype(np.uint8), np.clip(right, 0, 255).astype(np.uint8)


def known() -> NDArray[np.float32]:
    return np.full((HEIGHT, WIDTH), DISPARITY_PX, np.float32)


@pytest.mark.parametrize("lower_px", [0.0, 0.375, 1.0, 3.0, -0.75, -3.625])
@pytest.mark.parametrize("gain", [1.0, 1.5])
def test_offset_is_found_to_a_twentieth_of_a_pixel(lower_px: float, gain: float) -> None:
    assert row_offset(*pair(lower_px, gain), known()) == pytest.approx(lower_px, abs=0.05)


@pytest.mark.parametrize("matcher", ["elas", "sgbm"])
@pytest.mark.parametrize("lower_px", [0.0, 1.25, -2.5])
def test_offset_is_found_with_the_disparity_of_rows_that_do_not_match(matcher: str, lower_px: float) -> None:
    left, right = pair(lower_px)
    disparity = create_matcher(StereoConfig(matcher=matcher, n_disparities=32), ElasConfig()).compute(left, right)
    assert row_offset(left, right, disparity) == pytest.approx(lower_px, abs=0.1)


def test_wrong_disparities_do_not_count() -> None:
    disparity = known()
    disparity[:, ::3] = np.random.default_rng(2).uniform(1, 60, disparity[:, ::3].shape)
    disparity[::4] = np.nan
    assert row_offset(*pair(1.25), disparity) == pytest.approx(1.25, abs=0.05)


def test_16_bits_and_colour_are_as_good() -> None:
    left, right = pair(1.25)
    expected = row_offset(left, right, known())
    assert row_offset(*(image.astype(np.uint16) * np.uint16(16) for image in (left, right)), known()) == expected
    assert row_offset(*(np.repeat(image[..., None], 3, axis=2) for image in (left, right)), known()) == expected


def test_nothing_is_said_of_what_has_no_disparity_or_no_texture() -> None:
    left, right = pair(1.25)
    assert row_offset(left, right, np.zeros_like(known())) is None
    few = np.zeros_like(known())
    few[80:112, 100:164] = DISPARITY_PX  # 8 points
    assert row_offset(left, right, few) is None
    flat = np.full_like(left, 90)
    assert row_offset(flat, flat, known()) is None
    stripes = np.repeat(left[100:101], HEIGHT, axis=0)  # upright edges look the same in all rows
    assert row_offset(stripes, stripes, known()) is None


@pytest.mark.parametrize("shape", [(1, 1), (15, 40), (40, 15), (16, 16)])
def test_images_that_hold_no_point(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    assert row_offset(image, image, np.full(shape, 1.0, np.float32)) is None


def test_arguments_are_not_written_to() -> None:
    left, right, disparity = *pair(0.4), known()
    before = left.copy(), right.copy(), disparity.copy()
    row_offset(left, right, disparity)
    for array, copy in zip((left, right, disparity), before, strict=True):
        np.testing.assert_array_equal(array, copy)
