"""The ground's disparity as an image, which tells one node what ground another has fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.frame import valid_disparity
from lrtrav_ros.method.ground import LEAST_SLOPE, MOST_COEFFICIENT, GroundLine

_N_SAMPLES = 40  # rows and columns of pixels that are looked at


def ground_line_of(disparity: NDArray[np.float32]) -> GroundLine | None:
    """Return the ground line that an image of the ground's disparity shows: the inverse of `GroundLine.disparity`.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels; 0 from the horizon up, or everywhere where no ground was found. What is no number counts as none.

    Returns
    -------
    GroundLine or None
        None where no line fits: the image shows no ground, or too little of it.

    Raises
    ------
    TypeError, ValueError
        If `disparity` is not such an array.
    """
    disparity = valid_disparity(disparity)
    v, u = (np.unique(np.linspace(0, size - 1, _N_SAMPLES).round().astype(int)) for size in disparity.shape)
    v, u = (grid.reshape(-1) for grid in np.meshgrid(v, u, indexing="ij"))
    d = disparity[v, u].astype(np.float64)
    v, u, d = v[d > 0], u[d > 0], d[d > 0]
    # d + bend / d = slope v + intercept + tilt u
    terms = np.stack([v, np.ones(len(d)), u, -1 / d], axis=1)
    if len(d) < 3 or np.linalg.matrix_rank(terms[:, :3]) < 3:
        return None
    scale = np.abs(terms).max(axis=0)
    slope, intercept, tilt, bend = np.linalg.lstsq(terms / scale, d, rcond=None)[0] / scale
    if not (slope >= LEAST_SLOPE and max(map(abs, (slope, intercept, tilt, bend))) <= MOST_COEFFICIENT):
        return None
    return GroundLine(float(slope), float(intercept), float(tilt), float(bend))
