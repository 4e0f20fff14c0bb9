"""OpenCV's matchers, and what is checked of the images of every matcher."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import ElasConfig, StereoConfig
from lrtrav_ros.method.matching import MATCHERS, Matcher, create_matcher
from lrtrav_ros.method.matching.opencv import OpenCVMatcher

DISPARITY = 12


@pytest.fixture
def pair() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return images (90, 160) of a random texture at DISPARITY px."""
    texture = np.random.default_rng(0).integers(0, 256, (90, 160 + DISPARITY), dtype=np.uint8)
    return texture[:, :160], texture[:, DISPARITY:]


def matcher(name: str, **settings: int | bool) -> Matcher:
    return create_matcher(StereoConfig(matcher=name, **{"n_disparities": 32, **settings}), ElasConfig())


@pytest.mark.parametrize("name", ["sgbm", "bm"])
@pytest.mark.parametrize("half", [False, True])
def test_known_disparity(name: str, half: bool, pair: tuple[NDArray[np.uint8], ...]) -> None:
    disparity = matcher(name, half_resolution=half, block_size=9).compute(*pair)
    assert disparity.shape == (90, 160)
    assert disparity.dtype == np.float32
    inside = disparity[8:-8, 24:-8]
    assert np.mean(inside > 0) > 0.95
    assert np.abs(inside[inside > 0] - DISPARITY).max() < 0.5


@pytest.mark.parametrize("name", MATCHERS)
def test_threads_may_share_a_matcher(name: str) -> None:
    texture = np.random.default_rng(0).integers(0, 256, (400, 240), dtype=np.uint8)
    pairs = [(texture[:, :200], texture[:, shift : 200 + shift]) for shift in range(1, 25, 2)]
    shared = matcher(name)
    expected = [shared.compute(*pair) for pair in pairs]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda pair: shared.compute(*pair), pairs * 2))
    np.testing.assert_array_equal(found, expected * 2)


def test_left_margin_is_matched(pair: tuple[NDArray[np.uint8], ...]) -> None:
    disparity = matcher("sgbm", n_disparities=128).compute(*pair)
    assert np.mean(np.abs(disparity[:, 20:60] - DISPARITY) < 0.5) > 0.9
    assert np.all(disparity <= np.arange(160))


@pytest.mark.parametrize("name", MATCHERS)
@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (50, 1), (4, 7), (16, 16), (33, 41)])
def test_small_images(name: str, half: bool, shape: tuple[int, int]) -> None:
    image = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    disparity = matcher(name, half_resolution=half, n_disparities=64).compute(image, image)
    assert disparity.shape == shape
    assert np.all((disparity >= 0) & (disparity <= np.arange(shape[1])))


@pytest.mark.parametrize("name", ["sgbm", "bm"])
@pytest.mark.parametrize("half", [False, True])
def test_disparities_beyond_the_range_are_dropped(name: str, half: bool, pair: tuple[NDArray[np.uint8], ...]) -> None:
    assert matcher(name, half_resolution=half, n_disparities=10).compute(*pair).max() <= 9
    assert matcher(name, half_resolution=half, n_disparities=14).compute(*pair).max() == pytest.approx(12, abs=0.5)


@pytest.mark.parametrize("name", MATCHERS)
def test_no_texture_gives_no_disparity(name: str) -> None:
    grey = np.full((60, 90), 77, np.uint8)
    assert not matcher(name).compute(grey, grey).any()


@pytest.mark.parametrize("name", MATCHERS)
def test_dtypes_channels_and_strides_agree(name: str, pair: tuple[NDArray[np.uint8], ...]) -> None:
    match = matcher(name).compute
    expected = match(*pair)
    assert expected.any()
    variants = {
        "BGR": [np.repeat(image[..., None], 3, axis=2) for image in pair],
        "one channel": [image[..., None] for image in pair],
        "not contiguous": [np.asfortranarray(image) for image in pair],
        "read only": [np.frombuffer(image.tobytes(), np.uint8).reshape(image.shape) for image in pair],
        "16 bit": [image.astype(np.uint16) * 257 for image in pair],
        "12 bit": [image.astype(np.uint16) << 4 for image in pair],
        "8 bit in words": [image.astype(np.uint16) for image in pair],
        "16 bit BGR": [np.repeat(image.astype(np.uint16)[..., None] << 8, 3, axis=2) for image in pair],
    }
    for name_of_variant, images in variants.items():
        np.testing.assert_array_equal(match(*images), expected, err_msg=name_of_variant)


@pytest.mark.parametrize("name", MATCHERS)
@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (np.zeros((8, 9), np.uint8), np.zeros((9, 8), np.uint8), r"\(8, 9\).*\(9, 8\)"),
        (np.zeros((8, 9), np.uint8), np.zeros((8, 9), np.uint16), "uint16"),
        (np.zeros((8, 9), np.float32), np.zeros((8, 9), np.float32), "left.*float32"),
        (np.zeros((8, 9), np.uint8), np.zeros((8, 9, 4), np.uint8), r"right.*\(8, 9, 4\)"),
        (np.zeros(8, np.uint8), np.zeros(8, np.uint8), r"\(8,\)"),
        (np.zeros((0, 9), np.uint8), np.zeros((0, 9), np.uint8), "not empty"),
    ],
)
def test_bad_images(name: str, left: NDArray[np.generic], right: NDArray[np.generic], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        matcher(name).compute(left, right)


def test_opencv_has_no_elas() -> None:
    with pytest.raises(ValueError, match="elas"):
        OpenCVMatcher(StereoConfig(matcher="elas"))
