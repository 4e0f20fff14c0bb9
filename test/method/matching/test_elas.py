"""ELAS on images of known disparity."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import ElasConfig, StereoConfig
from lrtrav_ros.method.matching import _elas_kernels as kernels
from lrtrav_ros.method.matching.elas import Elas
from lrtrav_ros.numerics.thread_team import ThreadTeam

Image = NDArray[np.uint8]


def texture(height: int, width: int, seed: int = 0) -> NDArray[np.float32]:
    """Return noise of two scales about 128."""
    rng = np.random.default_rng(seed)
    fine = rng.normal(0, 40, (height, width)).astype(np.float32)
    coarse = rng.normal(0, 30, (height // 4 + 1, width // 4 + 1)).astype(np.float32)
    return np.asarray(128 + cv2.GaussianBlur(fine, (0, 0), 0.7) + cv2.resize(coarse, (width, height)), np.float32)


def pair_of(disparity: NDArray[np.float32], seed: int = 0) -> tuple[Image, Image]:
    """Return the pair that sees a random texture at `disparity` (H, W), without occlusions."""
    height, width = disparity.shape
    right = texture(height, width, seed)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    left = cv2.remap(right, u - disparity, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    first, second = (np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in (left, right))
    return first, second


def elas(n_disparities: int = 32, *, half: bool = False, threads: int = 1, config: ElasConfig | None = None) -> Elas:
    return Elas(StereoConfig(n_disparities=n_disparities, half_resolution=half), config, team=ThreadTeam(threads))


@pytest.mark.parametrize("half", [False, True])
def test_shifted_texture_is_exact(half: bool) -> None:
    image = np.random.default_rng(0).integers(0, 256, (90, 160), dtype=np.uint8)
    left, right = elas(half=half).compute_both(image[:, :-11], image[:, 11:])
    assert left.shape == right.shape == (90, 149)
    assert left.dtype == right.dtype == np.float32
    np.testing.assert_array_equal(left[10:-10, 24:-10], 11)
    np.testing.assert_array_equal(right[10:-10, 10:-24], 11)
    assert not left[:, :9].any()
    assert not right[:, -9:].any()


@pytest.mark.parametrize("half", [False, True])
def test_slanted_planes(half: bool) -> None:
    v, u = np.mgrid[:120, :200].astype(np.float32)
    for truth in (3 + 0.2 * v, 8 + 0.08 * u, 25 - 0.05 * u - 0.05 * v):
        disparity = elas(half=half).compute(*pair_of(truth.astype(np.float32)))
        inside = np.s_[8:-8, 40:-8]
        error = np.abs(disparity - truth)[inside]
        found = disparity[inside] > 0
        assert np.mean(found) > 0.98
        assert np.mean(error[found] > 1) < 0.005
        assert np.mean(error[found]) < 0.3


def test_fewer_errors_than_sgbm_on_the_ground() -> None:
    v, u = np.mgrid[:180, :240].astype(np.float32)
    truth = np.maximum(0.2 * (v - 60), 1).astype(np.float32)
    left, right = pair_of(truth)
    noise = np.random.default_rng(3)
    left, right = (
        np.clip(image + noise.normal(0, 18, image.shape), 0, 255).astype(np.uint8) for image in (left, right)
    )
    sgbm = cv2.StereoSGBM_create(0, 32, 5, 200, 800, 1, 63, 10, 200, 1).compute(left, right) / 16
    ground = (v > 70) & (u > 40)

    def bad(disparity: NDArray[np.float32]) -> float:
        found = ground & (disparity > 0)
        return float(np.mean(np.abs(disparity - truth)[found] > 1))

    found = elas().compute(left, right)
    assert bad(found) < 0.05
    assert bad(found) < bad(sgbm)


def test_only_textured_parts_have_disparity() -> None:
    image = np.full((100, 200), 128, np.uint8)
    image[30:80, 60:160] = np.random.default_rng(2).integers(0, 256, (50, 100))
    disparity = elas().compute(image[:, :-9], image[:, 9:])
    np.testing.assert_array_equal(disparity[34:76, 90:140], 9)
    assert not disparity[:20].any()
    assert not disparity[90:].any()


def test_repeated_texture_supports_nothing() -> None:
    tile = np.random.default_rng(4).integers(0, 256, (80, 8), dtype=np.uint8)
    image = np.tile(tile, 25)
    assert not elas(64).compute(image[:, :-3], image[:, 3:]).any()


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("shape", [(5, 5), (6, 40), (7, 200), (200, 7), (31, 61), (64, 33)])
def test_odd_and_small_sizes(half: bool, shape: tuple[int, int]) -> None:
    image = texture(*shape).astype(np.uint8)
    for disparity in elas(128, half=half).compute_both(image, np.roll(image, -2, axis=1)):
        assert disparity.shape == shape
        assert disparity.flags.c_contiguous
        assert np.all((disparity >= 0) & (disparity < shape[1]))


@pytest.mark.parametrize("n_disparities", [1, 2, 5])
def test_short_ranges(n_disparities: int) -> None:
    image = texture(60, 90).astype(np.uint8)
    disparity = elas(n_disparities).compute(image[:, :-1], image[:, 1:])
    assert disparity.max() <= n_disparities - 1
    assert (np.mean(disparity == 1) > 0.8) == (n_disparities > 1)


@pytest.mark.parametrize("half", [False, True])
def test_result_does_not_depend_on_threads_or_earlier_calls(half: bool) -> None:
    v = np.mgrid[:150, :210][0].astype(np.float32)
    pair = pair_of(2 + 0.15 * v)
    matcher = elas(half=half)
    expected = matcher.compute_both(*pair)
    assert expected[0].any()
    matcher.compute(pair[1], pair[0])
    for other in (matcher, elas(half=half, threads=2), elas(half=half, threads=5)):
        for disparity, reference in zip(other.compute_both(*pair), expected, strict=True):
            np.testing.assert_array_equal(disparity, reference)
    np.testing.assert_array_equal(matcher.compute(*pair), expected[0])


def test_images_are_not_changed() -> None:
    left, right = pair_of(np.full((60, 90), 7, np.float32))
    copies = left.copy(), right.copy()
    elas().compute(left, right)
    np.testing.assert_array_equal(left, copies[0])
    np.testing.assert_array_equal(right, copies[1])


@pytest.mark.parametrize(
    "config",
    [
        ElasConfig(grid_step_px=1),
        ElasConfig(grid_step_px=20, min_support=0),
        ElasConfig(redundancy_window=0),
        ElasConfig(speckle_size_px=0, gap_width_px=0, adaptive_mean=False),
        ElasConfig(plane_radius_px=0),
        ElasConfig(plane_radius_px=20, sigma_px=20.0, beta=0.001, gamma=0.01),
        ElasConfig(cell_size_px=200),
        ElasConfig(cell_size_px=4),
    ],
)
def test_extreme_settings(config: ElasConfig) -> None:
    disparity = elas(config=config).compute(*pair_of(np.full((120, 160), 7, np.float32)))
    found = disparity[25:-25, 60:-60]
    assert np.mean(np.abs(found - 7) < 0.5) > 0.95


def test_small_segments_are_removed() -> None:
    image = np.full((100, 200), 128, np.uint8)
    image[40:64, 90:114] = np.random.default_rng(2).integers(0, 256, (24, 24))
    pair = image[:, :-9], image[:, 9:]
    assert elas(config=ElasConfig(speckle_size_px=50)).compute(*pair).any()
    assert not elas(config=ElasConfig(speckle_size_px=5000)).compute(*pair).any()


@pytest.mark.parametrize(("row", "column", "found"), [(2, 70, True), (40, 70, False), (40, 6, False)])
def test_far_points_along_the_upper_edge_need_less_support(row: int, column: int, found: bool) -> None:
    image = np.full((90, 160), 128, np.uint8)
    image[row : row + 14, column : column + 14] = np.random.default_rng(2).integers(0, 256, (14, 14))
    config = ElasConfig(speckle_size_px=0, min_support=17)  # the patch has room for 4 x 4 points
    assert elas(16, config=config).compute(image[:, :-3], image[:, 3:]).any() == found


def test_isolated_and_redundant_support_points() -> None:
    grid = np.full((3, 12), -1, np.int16)
    grid[1, 1:8] = [9, 9, 10, 9, 9, 30, 9]
    kept = np.empty_like(grid)
    kernels.drop_isolated(grid, 5, 5, 5, kept)
    assert kept[1, 1:8].tolist() == [9, 9, 10, 9, 9, -1, 9]
    kernels.drop_redundant(kept, 5, 1)
    assert kept[1, 1:8].tolist() == [9, -1, -1, -1, -1, -1, 9]


def test_texture_is_the_sum_of_a_descriptor() -> None:
    height, width = 3, 40
    shape = height + 4, width + 4 + kernels.PADDING
    h, v = np.random.default_rng(5).integers(0, 256, (2, *shape), dtype=np.uint8)
    sums = np.zeros((height, width + kernels.PADDING), np.uint16)
    kernels.texture(h, v, width, 1, 3, sums)

    def total(responses: Image, offsets: list[tuple[int, int]]) -> int:
        return sum(int(responses[2 + 1 + dv, 2 + 20 + du]) for dv, du in offsets)

    horizontal = [(-2, 0), (2, 0), (0, -1), (0, 0), (0, 0), (0, 1)]
    horizontal += [(dv, du) for dv in (-1, 1) for du in (-2, 0, 2)]
    assert sums[1, 20] == total(h, horizontal) + total(v, [(-1, 0), (0, -1), (0, 1), (1, 0)])
    assert not sums[0].any()


def test_support_is_the_least_of_the_sums_over_a_window() -> None:
    rng = np.random.default_rng(6)
    height, width, n_disparities, u, v = 9, 60, 20, 35, 4
    shape = height + 4, width + 4 + kernels.PADDING
    hl, vl, hr, vr = rng.integers(0, 256, (4, *shape), dtype=np.uint8)
    hl[:, 20:60], vl[:, 20:60] = hr[:, 13:53], vr[:, 13:53]  # seven pixels apart, with noise of 1
    hl[:, 20:60] ^= rng.integers(0, 2, (height + 4, 40), dtype=np.uint8)
    textured = np.full((height, width), 100, np.uint16)
    grid = np.full((2, 13), -1, np.int16)

    def support(uniqueness: float, least_texture: int) -> int:
        kernels.match_support(
            hl, vl, hr, vr, textured, textured, least_texture, 1, 2, 1, 4, n_disparities, uniqueness, 2, grid
        )
        return int(grid[v // 4, u // 4])

    assert support(0.85, 100) == 7
    assert support(0.85, 101) == -1
    assert support(0.0, 100) == -1


def test_planes_are_drawn_rounded_down() -> None:
    points = np.array([[1, 1, 3], [11, 1, 5], [1, 9, 7]], np.float64)
    planes = np.full((12, 14 + kernels.PADDING), kernels.NO_PLANE, np.int16)
    kernels.draw_planes(points, np.array([[2, 0, 1]], np.int32), 1, 1, planes)
    v, u = np.mgrid[:12, :14]
    inside = (u >= 1) & (v >= 1) & (8 * (u - 1) + 10 * (v - 1) <= 80)
    expected = np.where(inside, (3 * 10 + 2 * (u - 1) + 5 * (v - 1)) // 10, kernels.NO_PLANE)
    np.testing.assert_array_equal(planes[:, :14], expected)
    assert np.all(planes[:, 14:] == kernels.NO_PLANE)


def test_candidates_are_those_of_next_cells_and_disparities() -> None:
    candidates = np.zeros((3, 4, 8), np.bool_)
    kernels.mark_candidates(np.array([[25, 9, 7]], np.float64), 10, candidates)
    expected = np.zeros_like(candidates)
    expected[:2, 1:, 6:] = True
    np.testing.assert_array_equal(candidates, expected)
