"""Scores of a traversable mask, all over and by distance.

Precision, recall and RMSE are those of Lu et al., IROS 2015, section V; the rate of false positives stands beside them.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.evaluation.truth.labels import IGNORED, TRAVERSABLE
from lrtrav_ros.numerics.checks import check_array

DISTANCE_BANDS: tuple[tuple[float, float], ...] = ((0, 5), (5, 10), (10, 20), (20, 40), (40, math.inf))
"""Nearest (inclusive) and farthest (exclusive) distance on the ground of each band, in metres."""

_Item = TypeVar("_Item")


@dataclass(frozen=True, slots=True)
class Scores:
    """Scores of how well a mask agrees with the truth.

    Attributes
    ----------
    precision : float
        Share of what was found that is traversable; 0 where nothing was found, so that this is never rewarded.
    recall : float
        Share of what is traversable that was found; 1 where nothing is.
    rmse : float
        Root of the share of pixels that differ.
    false_positive_rate : float
        Share of what is not traversable that was found all the same; 0 where everything is traversable.
    """

    precision: float
    recall: float
    rmse: float
    false_positive_rate: float


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of pixels.

    Attributes
    ----------
    n_pixels : int
        All that count.
    n_found, n_traversable, n_hits : int
        Those that the mask has, those that are traversable, and those that are both.
    """

    n_pixels: int
    n_found: int
    n_traversable: int
    n_hits: int

    @property
    def n_false_positives(self) -> int:
        """Pixels that the mask has and that are not traversable."""
        return self.n_found - self.n_hits

    @property
    def scores(self) -> Scores:
        """The scores of these pixels."""
        n_wrong = self.n_false_positives + self.n_traversable - self.n_hits
        return Scores(
            precision=self.n_hits / self.n_found if self.n_found else 0.0,
            recall=self.n_hits / self.n_traversable if self.n_traversable else 1.0,
            rmse=math.sqrt(n_wrong / max(self.n_pixels, 1)),
            false_positive_rate=self.n_false_positives / max(self.n_pixels - self.n_traversable, 1),
        )

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.n_pixels + other.n_pixels,
            self.n_found + other.n_found,
            self.n_traversable + other.n_traversable,
            self.n_hits + other.n_hits,
        )


def check_same_size(truth: NDArray[np.uint8], **images: NDArray[np.uint8]) -> None:
    """Check the truth, (H, W) ndarray of uint8, and other such images of its size, by their names."""
    check_array("ground truth", truth, np.uint8, ("H", "W"))
    for name, image in images.items():
        check_array(name, image, np.uint8, ("H", "W"))
        if image.shape != truth.shape:
            raise ValueError(f"{name} is {image.shape}, ground truth {truth.shape}; give images of one size")


def count(mask: NDArray[np.uint8], truth: NDArray[np.uint8], where: NDArray[np.bool_] | None = None) -> Counts:
    """Count the pixels of a mask that the truth does not ignore.

    Parameters
    ----------
    mask : (H, W) ndarray of uint8
        255 traversable, 0 not.
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 ignored.
    where : (H, W) ndarray of bool, optional
        Pixels that are counted; all where it is not given.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    check_same_size(truth, mask=mask)
    if where is not None:
        check_array("where", where, np.bool_, truth.shape)
    counted = truth != IGNORED if where is None else (truth != IGNORED) & where
    found, traversable = mask[counted] > 127, truth[counted] == TRAVERSABLE
    return Counts(
        n_pixels=found.size,
        n_found=int(np.count_nonzero(found)),
        n_traversable=int(np.count_nonzero(traversable)),
        n_hits=int(np.count_nonzero(found & traversable)),
    )


def count_bands(
    mask: NDArray[np.uint8], truth: NDArray[np.uint8], distance_m: NDArray[np.float64]
) -> tuple[Counts, ...]:
    """Count the pixels of a mask in each of `DISTANCE_BANDS`.

    Parameters
    ----------
    mask, truth : (H, W) ndarray of uint8
        As `count` takes them.
    distance_m : (H, W) ndarray of float64
        Distance of each pixel's ground in metres; infinite above the horizon, which is in no band.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    check_same_size(truth, mask=mask)
    check_array("distance_m", distance_m, np.float64, truth.shape)
    return tuple(count(mask, truth, (near <= distance_m) & (distance_m < far)) for near, far in DISTANCE_BANDS)


def score(mask: NDArray[np.uint8], truth: NDArray[np.uint8]) -> Scores:
    """Score a mask on the pixels that the truth does not ignore.

    Parameters
    ----------
    mask : (H, W) ndarray of uint8
        255 traversable, 0 not.
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 ignored.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, or the two differ in size.
    """
    return count(mask, truth).scores


def sum_each(counts: Iterable[tuple[_Item, ...]]) -> tuple[_Item, ...]:
    """Return the sums of the first items, of the second, and so on; nothing where there is nothing to add.

    Parameters
    ----------
    counts : iterable of tuple
        All of the same length, or empty, and then left out.
    """
    return tuple(functools.reduce(operator.add, items) for items in zip(*filter(None, counts), strict=True))


def mean_scores(scores: Sequence[Scores]) -> Scores:
    """Return the means of each score; ValueError where there are none."""
    return _each_score(scores, np.mean)


def spread_of_scores(scores: Sequence[Scores]) -> Scores:
    """Return the standard deviations of each score; ValueError where there are none."""
    return _each_score(scores, np.std)


def _each_score(scores: Sequence[Scores], statistic: Callable[[list[float]], np.floating[Any]]) -> Scores:
    if not scores:
        raise ValueError(f"there are no scores to take the {statistic.__name__} of")
    return Scores(
        precision=float(statistic([item.precision for item in scores])),
        recall=float(statistic([item.recall for item in scores])),
        rmse=float(statistic([item.rmse for item in scores])),
        false_positive_rate=float(statistic([item.false_positive_rate for item in scores])),
    )
