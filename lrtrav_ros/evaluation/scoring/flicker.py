"""Flicker: how much of a mask changes from a frame to the next."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.checks import check_array


def mean_flicker(masks: Iterable[NDArray[np.uint8] | None]) -> float | None:
    """Return the mean share of the pixels that differ between neighbouring masks.

    For a camera that stands this is what flickers; for one that drives, what moves counts as well.

    Parameters
    ----------
    masks : iterable of ((H, W) ndarray of uint8 or None)
        Those of consecutive frames, 255 traversable and 0 not; None for one that is missing.

    Returns
    -------
    float or None
        None where no two neighbours are there and of one size.

    Raises
    ------
    TypeError, ValueError
        If a mask is not as above.
    """
    shares = [
        np.count_nonzero(before != after) / after.size
        for before, after in pairwise(map(_checked, masks))
        if before is not None and after is not None and before.shape == after.shape
    ]
    return float(np.mean(shares)) if shares else None


def _checked(mask: NDArray[np.uint8] | None) -> NDArray[np.uint8] | None:
    """Return a mask, or None for one that is missing; raises TypeError or ValueError where it is something else."""
    if mask is not None:
        check_array("mask", mask, np.uint8, ("H", "W"))
    return mask
