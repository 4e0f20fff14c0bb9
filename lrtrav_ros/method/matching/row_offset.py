"""How far the rows of a rectified pair are apart: what drifts when a camera's mounting or calibration does."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.method.matching._grey_pair import grey_pair
from lrtrav_ros.numerics.checks import check_array

_CELL = 8  # rows and columns of the halved image that give one point at most
_MAX_POINTS = 200
_LEAST_POINTS = 30
_LEAST_TEXTURE = 1e-4  # the lesser eigenvalue of the gradients' matrix, in OpenCV's scale: a corner, not an edge
_WINDOW_PX = 13
_BORDER_PX = 8  # half of a window, and some rows for it to move
_PYRAMID_LEVELS = 2  # above the image: rows may be some 8 px apart
_MAX_STRAY_PX = 2.0  # along the row, from where the disparity says: what strays farther is a mismatch


def row_offset(left: NDArray[np.generic], right: NDArray[np.generic], disparity: NDArray[np.float32]) -> float | None:
    """Return how much lower things are in the right image than in the left one.

    Corners with a disparity are followed from the left image to the right one [1]_, from where the disparity says in
    whatever direction; of those that end near their disparity, the median of how far they came down is taken. The
    disparity may be one that was found on rows that do not match, as long as a part of it is right.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) ndarray of uint8 or uint16
        Rectified images, grey or BGR, of one shape and one type.
    disparity : (H, W) ndarray of float32
        Of the left image, in pixels; 0 for none.

    Returns
    -------
    float or None
        Rows in pixels, to about 0.1; above 0 where the right image is lower. None where fewer than 30 points tell.

    Raises
    ------
    TypeError, ValueError
        If the images are not such a pair, or the disparity is not such an array.

    References
    ----------
    .. [1] J.-Y. Bouguet, "Pyramidal implementation of the Lucas Kanade feature tracker", Intel, 2000.
    """
    left, right = grey_pair(left, right)
    check_array("disparity", disparity, np.float32, left.shape)
    points = _corners(left, disparity)
    if len(points) < _LEAST_POINTS:
        return None
    u, v = points.T
    start = np.stack([u - disparity[v, u], v], axis=1).astype(np.float32)
    right = _as_bright(right, start, float(left[v, u].mean()))
    moves, found = _followed(left, right, points.astype(np.float32), start)
    good = found & (np.abs(moves[:, 0]) <= _MAX_STRAY_PX)
    return float(np.median(moves[good, 1])) if np.count_nonzero(good) >= _LEAST_POINTS else None


def _corners(image: NDArray[np.uint8], disparity: NDArray[np.float32]) -> NDArray[np.intp]:
    """Return columns and rows (n, 2) of the best corners, one a cell, that have a disparity and are in both images."""
    height, width = image.shape
    rows, columns = height // (2 * _CELL), width // (2 * _CELL)
    if not rows or not columns:
        return np.zeros((0, 2), np.intp)
    texture = cv2.cornerMinEigenVal(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA), 3)
    cells = texture[: rows * _CELL, : columns * _CELL].reshape(rows, _CELL, columns, _CELL)
    cells = cells.transpose(0, 2, 1, 3).reshape(rows * columns, _CELL * _CELL)
    best = cells.argmax(axis=1)
    cell = np.arange(len(best))
    v = 2 * (cell // columns * _CELL + best // _CELL)
    u = 2 * (cell % columns * _CELL + best % _CELL)
    sought = disparity[v, u]
    inside = (v >= _BORDER_PX) & (v < height - _BORDER_PX) & (u - sought >= _BORDER_PX) & (u < width - _BORDER_PX)
    score = np.where(inside & (sought > 0), cells[cell, best], 0)
    chosen = np.argsort(-score, kind="stable")[:_MAX_POINTS]
    chosen = chosen[score[chosen] > _LEAST_TEXTURE]
    return np.stack([u[chosen], v[chosen]], axis=1)


def _as_bright(image: NDArray[np.uint8], points: NDArray[np.float32], level: float) -> NDArray[np.uint8]:
    """Return an image that is as bright as `level` at points; a difference in exposure would pass for motion."""
    u, v = np.rint(points).astype(np.intp).T
    return cv2.convertScaleAbs(image, alpha=level / max(float(image[v, u].mean()), 1.0))


def _followed(
    left: NDArray[np.uint8], right: NDArray[np.uint8], points: NDArray[np.float32], start: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return how far points of the left image are from `start` in the right one, (n, 2), and which were found (n,)."""
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        left,
        right,
        points,
        start.copy(),
        winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=_PYRAMID_LEVELS,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.02),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return ends - start, found[:, 0] > 0
