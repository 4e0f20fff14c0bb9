"""Refinement of disparities against OpenCV and against plain loops."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import ElasConfig
from lrtrav_ros.method.matching.refinement import refine
from lrtrav_ros.numerics.thread_team import ThreadTeam

Found = NDArray[np.int16]
PLAIN = ElasConfig(speckle_size_px=0, gap_width_px=0, adaptive_mean=False)


def patches(seed: int, height: int = 60, width: int = 83) -> Found:
    """Return steps of disparity with holes."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 9, (height // 6 + 1, width // 6 + 1)).repeat(6, 0).repeat(6, 1)[:height, :width]
    found = (coarse + rng.integers(0, 2, (height, width))).astype(np.int16)
    found[rng.random((height, width)) < 0.3] = -1
    return found


def mean_of_close(line: NDArray[np.float32], at: int) -> float:
    """Return the adaptive mean at one place of a line."""
    near = line[max(at - 4, 0) : at + 5].astype(float)
    weights = np.where(near >= 0, np.maximum(4 - np.abs(near - line[at]), 0), 0)
    return float((weights * near).sum() / weights.sum())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("size", "similarity"), [(5, 1.0), (40, 1.0), (40, 2.5)])
def test_small_segments_are_those_of_opencv(seed: int, size: int, similarity: float) -> None:
    found = patches(seed)
    expected = found.copy()
    cv2.filterSpeckles(expected, -1, size - 1, int(similarity))
    assert np.any(expected != found)
    config = ElasConfig(speckle_size_px=size, speckle_similarity_px=similarity, gap_width_px=0, adaptive_mean=False)
    np.testing.assert_array_equal(refine(found, config), np.maximum(expected, 0))


@pytest.mark.parametrize("along_columns", [False, True])
def test_gaps(along_columns: bool) -> None:
    row = np.array([[-1, 5, -1, -1, 7, -1, 20, -1, -1, -1, -1, 20, -1]], np.int16)
    config = ElasConfig(speckle_size_px=0, gap_width_px=3, adaptive_mean=False)
    filled = refine(np.ascontiguousarray(row.T) if along_columns else row, config)
    assert filled.ravel().tolist() == [0, 5, 6, 6, 7, 7, 20, 0, 0, 0, 0, 20, 0]
    assert refine(row, config, halvings=1).ravel().tolist() == [0, 5, 0, 0, 7, 7, 20, 0, 0, 0, 0, 20, 0]


def test_gaps_are_those_without_small_segments() -> None:
    row = np.array([[5, 5, 5, -1, 30, 5, 5]], np.int16)
    config = ElasConfig(speckle_size_px=2, gap_width_px=2, adaptive_mean=False)
    assert refine(row, config).ravel().tolist() == [5] * 7


def test_mean_of_close_disparities() -> None:
    found = patches(4, 20, 31)
    smooth = refine(found, ElasConfig(speckle_size_px=0, gap_width_px=0))
    values = found.astype(np.float32)
    along = values.copy()
    for v, u in np.argwhere(found >= 0):
        along[v, u] = mean_of_close(values[v], u)
    for v, u in np.argwhere(found >= 0):
        assert smooth[v, u] == pytest.approx(mean_of_close(along[:, u], v), abs=1e-4)
    assert not smooth[found < 0].any()


@pytest.mark.parametrize("config", [ElasConfig(), ElasConfig(speckle_size_px=12, gap_width_px=5), PLAIN])
def test_result_does_not_depend_on_threads(config: ElasConfig) -> None:
    found = patches(5, 130, 91)
    copy = found.copy()
    expected = refine(found, config)
    assert expected.any() or config.speckle_size_px == 200
    for n_threads in (2, 5):
        np.testing.assert_array_equal(refine(found, config, team=ThreadTeam(n_threads)), expected)
    np.testing.assert_array_equal(found, copy)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 4)])
def test_small_sizes(shape: tuple[int, int]) -> None:
    found = np.full(shape, 6, np.int16)
    np.testing.assert_array_equal(refine(found, ElasConfig(speckle_size_px=0)), 6)


def test_wrong_disparities_are_refused() -> None:
    with pytest.raises(ValueError, match=r"found is float32 \(3, 4\); give int16"):
        refine(np.zeros((3, 4), np.float32), PLAIN)
