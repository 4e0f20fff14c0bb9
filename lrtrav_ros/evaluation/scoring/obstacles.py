"""Standing obstacles of a frame, and which of them a mask misses: a mean over pixels hides the small ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.evaluation.scoring.scores import DISTANCE_BANDS, sum_each
from lrtrav_ros.evaluation.truth.labels import NOT_TRAVERSABLE
from lrtrav_ros.numerics.checks import check_array, check_finite

HEIGHT_BANDS: tuple[tuple[float, float], ...] = ((0, 0.2), (0.2, 0.5), (0.5, 1), (1, math.inf))
"""Least (inclusive) and greatest (exclusive) height of the obstacles in each band, in metres."""

_MIN_SHARE = 0.001  # of the image
_MAX_FREE = 0.5  # of an obstacle that is seen
_HEIGHT_PERCENTILE = 95


@dataclass(frozen=True, slots=True)
class ObstacleCounts:
    """Numbers of obstacles.

    Attributes
    ----------
    n_obstacles : int
        All of them.
    n_missed : float
        Those of which more than half is called free; a mean over the seeds for a method that is run with several.
    """

    n_obstacles: int = 0
    n_missed: float = 0.0

    def __add__(self, other: ObstacleCounts) -> ObstacleCounts:
        return ObstacleCounts(self.n_obstacles + other.n_obstacles, self.n_missed + other.n_missed)


@dataclass(frozen=True, slots=True)
class ObstacleScores:
    """Standing obstacles, and how many of them were missed.

    Attributes
    ----------
    total : ObstacleCounts
        All of them; 0 of 0 where none stands in sight.
    by_distance : tuple of ObstacleCounts
        Those with their feet in each of `scores.DISTANCE_BANDS`; empty where no ground line gives distances. One whose
        foot is above the horizon is in no band.
    by_height : tuple of ObstacleCounts
        Those of a height in each of `HEIGHT_BANDS`; empty where heights are not known.
    """

    total: ObstacleCounts = ObstacleCounts()
    by_distance: tuple[ObstacleCounts, ...] = ()
    by_height: tuple[ObstacleCounts, ...] = ()

    def __add__(self, other: ObstacleScores) -> ObstacleScores:
        return ObstacleScores(
            self.total + other.total,
            sum_each([self.by_distance, other.by_distance]),
            sum_each([self.by_height, other.by_height]),
        )


class StandingObstacles:
    """The standing obstacles of a frame: what is not traversable, of at least 0.1 % of the image, below its top row.

    Parameters
    ----------
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 unknown. An obstacle is a region of 0 that is connected over sides and corners.
    distance_m : (H, W) ndarray of float64, optional
        Distance of each pixel's ground in metres, infinite above the horizon. An obstacle is as far away as the nearest
        ground that it hides: that at its foot.
    height_m : (H, W) ndarray of float32, optional
        Height above the ground of what each pixel shows, in metres. The height of an obstacle is the 95th percentile of
        its pixels: a few that are wrong do not change it. What goes down, such as a ditch, has height 0.

    Attributes
    ----------
    n : int
        Number of obstacles.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """

    def __init__(
        self,
        truth: NDArray[np.uint8],
        *,
        distance_m: NDArray[np.float64] | None = None,
        height_m: NDArray[np.float32] | None = None,
    ) -> None:
        check_array("ground truth", truth, np.uint8, ("H", "W"))
        if distance_m is not None:
            check_array("distance_m", distance_m, np.float64, truth.shape)
        if height_m is not None:
            check_array("height_m", height_m, np.float32, truth.shape)
            check_finite("height_m", height_m)
        self._shape = truth.shape
        self._pixels, self._labels = _label(truth)
        self._areas = np.bincount(self._labels)
        self.n = self._areas.size
        self._distance_bands = self._height_bands = None
        if distance_m is not None:
            self._distance_bands = _band_of([float(values.min()) for values in self._each(distance_m)], DISTANCE_BANDS)
        if height_m is not None:
            heights_m = [float(np.percentile(values, _HEIGHT_PERCENTILE)) for values in self._each(height_m)]
            self._height_bands = _band_of(heights_m, HEIGHT_BANDS)

    def _each(self, image: NDArray[np.floating]) -> list[NDArray[np.floating]]:
        """Return the values of an image in each obstacle."""
        order = np.argsort(self._labels, kind="stable")
        return np.split(image.ravel()[self._pixels[order]], np.cumsum(self._areas)[:-1]) if self.n else []

    def missed(self, mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return of each obstacle whether more than half of it is called free.

        Parameters
        ----------
        mask : (H, W) ndarray of uint8
            255 traversable, 0 not.

        Returns
        -------
        (n,) ndarray of bool

        Raises
        ------
        ValueError
            If the mask has another size than the truth.
        """
        check_array("mask", mask, np.uint8, ("H", "W"))
        if mask.shape != self._shape:
            raise ValueError(f"mask is {mask.shape}, ground truth {self._shape}; give images of one size")
        free = np.bincount(self._labels[mask.ravel()[self._pixels] > 127], minlength=self.n)
        return free > _MAX_FREE * self._areas

    def scores(self, masks: Sequence[NDArray[np.uint8]]) -> ObstacleScores:
        """Return how many obstacles the masks of a method miss.

        Parameters
        ----------
        masks : sequence of (H, W) ndarray of uint8
            One for each seed, at least one: 255 traversable, 0 not.

        Raises
        ------
        ValueError
            If a mask has another size than the truth.
        """
        missed = np.mean([self.missed(mask) for mask in masks], axis=0)
        return ObstacleScores(
            ObstacleCounts(self.n, float(missed.sum())),
            _counts(self._distance_bands, missed, len(DISTANCE_BANDS)),
            _counts(self._height_bands, missed, len(HEIGHT_BANDS)),
        )

    def outlines(self) -> list[NDArray[np.int32]]:
        """Return the outline of each obstacle, (m, 1, 2) ndarrays of int32 with (u, v), as OpenCV draws them."""
        outlines = []
        for index in range(self.n):
            region = np.zeros(self._shape, np.uint8)
            region.ravel()[self._pixels[self._labels == index]] = 1
            outlines.append(cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0][0])
        return outlines


def _label(truth: NDArray[np.uint8]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the flat indices of the pixels of standing obstacles, and the number of each pixel's obstacle."""
    regions = (truth == NOT_TRAVERSABLE).astype(np.uint8)
    n_labels, labels, stats, _ = cv2.connectedComponentsWithStats(regions, connectivity=8)
    stands = (stats[:, cv2.CC_STAT_AREA] >= _MIN_SHARE * truth.size) & (stats[:, cv2.CC_STAT_TOP] > 0)
    stands[0] = False  # all that is no obstacle
    number = np.full(n_labels, -1, np.intp)
    number[stands] = np.arange(np.count_nonzero(stands))
    numbers = number[labels.ravel()]
    pixels = np.flatnonzero(numbers >= 0)
    return pixels, numbers[pixels]


def _band_of(values: Sequence[float], bands: Sequence[tuple[float, float]]) -> NDArray[np.intp]:
    """Return the band that each value is in; the number of bands for one that is infinite."""
    return np.searchsorted([near for near, _ in bands] + [math.inf], values, side="right") - 1


def _counts(bands: NDArray[np.intp] | None, missed: NDArray[np.float64], n_bands: int) -> tuple[ObstacleCounts, ...]:
    """Return the obstacles in each band, and how many of them are missed; nothing where bands are not known."""
    if bands is None:
        return ()
    return tuple(
        ObstacleCounts(int(np.count_nonzero(bands == band)), float(missed[bands == band].sum()))
        for band in range(n_bands)
    )
