"""The last step of ELAS: small segments are removed, gaps filled, and disparities smoothed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import ElasConfig
from lrtrav_ros.method.matching import _refinement_kernels as kernels
from lrtrav_ros.numerics.checks import check_array, check_count, check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

# The paper does not state these; they were chosen to agree with published results.
_GAP_JUMP_PX = 3.0  # a gap whose ends differ by so much takes the farther one
_MEAN_WIDTH_PX = np.float32(4.0)  # disparities that differ by so much have no part in the mean
_LEAST_ROWS = 16
_MOST_HALVINGS = 15  # nothing is left of any image
_MARGIN = kernels.MEAN_RADIUS_PX


def refine(
    found: NDArray[np.int16], elas: ElasConfig, *, halvings: int = 0, team: ThreadTeam = ALONE
) -> NDArray[np.float32]:
    """Return disparities without small segments, with gaps filled and smoothed.

    Parameters
    ----------
    found : (H, W) ndarray of int16
        Disparity in pixels, -1 for none.
    elas : ElasConfig
        `speckle_size_px`, `speckle_similarity_px`, `gap_width_px` and `adaptive_mean` are used.
    halvings : int
        How often rows and columns were halved; sizes in `elas` are those of the full image.
    team : ThreadTeam
        Shares the work; the result does not depend on its number of threads.

    Returns
    -------
    (H, W) ndarray of float32
        Disparity in pixels, 0 for none.

    Raises
    ------
    ValueError
        If `found` has another type or shape.
    """
    check_array("found", found, np.int16, ("H", "W"))
    check_type("elas", elas, ElasConfig)
    halvings = check_count("halvings", halvings, least=0, most=_MOST_HALVINGS)
    height, width = found.shape
    runs, first_runs = np.empty((found.size, 4), np.int32), np.empty(height + 1, np.int32)
    kernels.find_runs(found, int(elas.speckle_similarity_px), runs, first_runs)
    least, gap = elas.speckle_size_px >> 2 * halvings, elas.gap_width_px >> halvings
    disparity = np.empty((height, width + 2 * _MARGIN), np.float32)
    team.for_bands(
        lambda first, last: kernels.fill_rows(
            found, runs, first_runs, least, gap, _GAP_JUMP_PX, first, last, disparity
        ),
        height,
        least_rows=_LEAST_ROWS,
    )
    team.for_bands(
        lambda first, last: kernels.fill_columns(disparity, gap, _GAP_JUMP_PX, first + _MARGIN, last + _MARGIN),
        width,
        least_rows=_LEAST_ROWS,
    )
    if not elas.adaptive_mean:
        return np.maximum(disparity[:, _MARGIN:-_MARGIN], 0)
    return _smoothed(disparity, team)


def _smoothed(disparity: NDArray[np.float32], team: ThreadTeam) -> NDArray[np.float32]:
    """Return the adaptive mean along rows, then along columns, of disparities with a margin at both sides."""
    height, width = disparity.shape[0], disparity.shape[1] - 2 * _MARGIN
    along = np.empty((height + 2 * _MARGIN, width), np.float32)
    along[:_MARGIN] = along[-_MARGIN:] = -1
    smooth = np.empty((height, width), np.float32)
    team.for_bands(
        lambda first, last: kernels.smooth_rows(disparity, _MEAN_WIDTH_PX, first, last, along),
        height,
        least_rows=_LEAST_ROWS,
    )
    team.for_bands(
        lambda first, last: kernels.smooth_columns(along, _MEAN_WIDTH_PX, first, last, smooth),
        height,
        least_rows=_LEAST_ROWS,
    )
    return smooth
