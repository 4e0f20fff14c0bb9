"""Precision, recall and RMSE of a traversable mask; Lu et al., IROS 2015, section V."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TRAVERSABLE = 255
IGNORED = 128


@dataclass(frozen=True, slots=True)
class Scores:
    """How well a mask agrees with the truth.

    Attributes
    ----------
    precision
        Share of what was found that is traversable; 0 where nothing was found, so that this is never rewarded.
    recall
        Share of what is traversable that was found; 1 where nothing is.
    rmse
        Root of the share of pixels that differ.
    """

    precision: float
    recall: float
    rmse: float


def score(mask: NDArray[np.uint8], truth: NDArray[np.uint8]) -> Scores:
    """Score a mask (255 traversable, 0 not) on the pixels that the truth does not ignore.

    Parameters
    ----------
    truth
        uint8 (H, W): 255 traversable, 0 not, 128 ignored.

    Raises
    ------
    ValueError
        If the two differ in size.
    """
    if mask.shape != truth.shape:
        raise ValueError(f"mask is {mask.shape}, ground truth {truth.shape}; give images of one size")
    counted = truth != IGNORED
    found, traversable = mask[counted] > 127, truth[counted] == TRAVERSABLE
    hits = np.count_nonzero(found & traversable)
    return Scores(
        precision=hits / np.count_nonzero(found) if found.any() else 0.0,
        recall=hits / np.count_nonzero(traversable) if traversable.any() else 1.0,
        rmse=math.sqrt(np.count_nonzero(found != traversable) / max(found.size, 1)),
    )


def mean_scores(scores: list[Scores]) -> Scores:
    """Return the means of each score; ValueError where there are none."""
    if not scores:
        raise ValueError("there are no scores to take the mean of")
    return Scores(
        precision=float(np.mean([item.precision for item in scores])),
        recall=float(np.mean([item.recall for item in scores])),
        rmse=float(np.mean([item.rmse for item in scores])),
    )
