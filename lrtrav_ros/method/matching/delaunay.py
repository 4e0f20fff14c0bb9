"""Delaunay triangulation of points in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method.matching import _delaunay_kernels as kernels
from lrtrav_ros.numerics.checks import check_array, check_range

_FARTHEST = 1e15  # from the origin: fourth powers of coordinates stay finite


def delaunay(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return the Delaunay triangles of points: no circle through the corners of one has another point inside.

    Parameters
    ----------
    points : (n, 2) ndarray of float64
        Coordinates, each from -1e15 to 1e15. Of points in one place, only one is used.

    Returns
    -------
    (m, 3) ndarray of int32
        Indices of the corners; none if all points are on one line.

    Raises
    ------
    TypeError, ValueError
        If `points` is not such an array.

    Notes
    -----
    Points are added from the middle outwards [1]_, so that each is joined to a part of the hull of those before it,
    and edges are flipped until they are Delaunay's. It takes about a fifth of the time of Qhull.

    References
    ----------
    .. [1] D. Sinclair, "S-hull: a fast radial sweep-hull routine for Delaunay triangulation", 2010.
           https://arxiv.org/abs/1604.01428

    Examples
    --------
    >>> delaunay(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]])).tolist()
    [[0, 1, 2]]
    """
    check_array("points", points, np.float64, ("n", 2), may_be_empty=True)
    check_range("points", points, -_FARTHEST, _FARTHEST)
    points = np.require(points, requirements=("C", "W"))  # kernels would be compiled anew for read-only arrays
    if len(points) < 3:
        return np.empty((0, 3), np.int32)
    seed = kernels.first_triangle(points)
    if min(seed) < 0:
        return np.empty((0, 3), np.int32)
    u, v, _ = kernels.centre_of(points, *seed)
    order = np.argsort((points[:, 0] - u) ** 2 + (points[:, 1] - v) ** 2, kind="stable")
    corners = np.empty(3 * (2 * len(points) - 5), np.int32)
    return corners[: kernels.triangulate(points, seed, order, u, v, corners)].reshape(-1, 3)
