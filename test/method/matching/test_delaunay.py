"""Delaunay triangulation against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.spatial
from numpy.typing import NDArray

from lrtrav_ros.method.matching.delaunay import delaunay

Points = NDArray[np.float64]


def as_set(triangles: NDArray[np.int32]) -> set[tuple[int, ...]]:
    return {tuple(sorted(triangle)) for triangle in triangles.tolist()}


@pytest.mark.parametrize("n", [3, 4, 5, 17, 400])
@pytest.mark.parametrize("seed", range(5))
def test_triangles_are_those_of_scipy(n: int, seed: int) -> None:
    points = np.random.default_rng(seed).random((n, 2)) * (640, 480)
    triangles = delaunay(points)
    assert triangles.dtype == np.int32
    assert as_set(triangles) == as_set(scipy.spatial.Delaunay(points).simplices)


@pytest.mark.parametrize("move", [0.0, 0.02])
def test_grids_are_covered_once(move: float) -> None:
    v, u = np.mgrid[:12, :17] * 5.0
    points = np.stack([u.ravel(), v.ravel()], axis=1)
    points += move * np.random.default_rng(1).uniform(-1, 1, points.shape)
    a, b, c = points[delaunay(points)].transpose(1, 0, 2)
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert np.all(areas > 0)
    hull = scipy.spatial.ConvexHull(points).volume
    assert areas.sum() == pytest.approx(hull, abs=0.1)


def test_repeated_points_count_once() -> None:
    corners = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 5.0], [0.0, 5.0], [4.0, 2.0]])
    assert len(delaunay(np.repeat(corners, 3, axis=0))) == len(delaunay(corners)) == 4


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 2)),
        np.array([[1.0, 2.0], [3.0, 4.0]]),
        np.full((5, 2), 3.0),
        np.arange(14.0).reshape(7, 2),
        np.array([[0.0, 3.0], [5.0, 3.0], [10.0, 3.0], [20.0, 3.0]]),
    ],
)
def test_points_on_a_line_have_no_triangle(points: Points) -> None:
    assert delaunay(points).shape == (0, 3)


def test_wrong_points_are_refused() -> None:
    with pytest.raises(ValueError, match=r"points is float64 \(4, 3\)"):
        delaunay(np.zeros((4, 3)))
    for value in (np.nan, np.inf, -1.8e308, 1.1e15):
        with pytest.raises(ValueError, match=r"points holds values from .*; give -1e\+15 to 1e\+15"):
            delaunay(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, value], [1.0, 1.0]]))
