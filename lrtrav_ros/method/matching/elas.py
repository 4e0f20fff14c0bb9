"""ELAS: efficient large-scale stereo matching.

Pixels that match without ambiguity, the support points, are triangulated; the planes of the triangles are a prior that
leaves few disparities to compare at all other pixels.

References
----------
.. [1] A. Geiger, M. Roser and R. Urtasun, "Efficient Large-Scale Stereo Matching", ACCV 2010.
       https://doi.org/10.1007/978-3-642-19315-6_3
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from lrtrav_ros.config import ElasConfig, StereoConfig
from lrtrav_ros.method.matching import _elas_kernels as kernels
from lrtrav_ros.method.matching._grey_pair import grey_pair

_T = TypeVar("_T")
_R = TypeVar("_R")

_LEFT, _RIGHT = 0, 1
# The paper does not state these; they were chosen to agree with published results.
_REACH_PX = 2  # from a support point to the corners of the window over which its cost is summed
_REDUNDANT_PX = 1  # support points that differ by no more are alike
_GAP_JUMP_PX = 3.0  # a gap whose ends differ by so much takes the farther one
_MEAN_RADIUS_PX = 4  # of the adaptive mean
_MEAN_WIDTH_PX = 4.0  # disparities that differ by so much have no part in it


@dataclass(frozen=True, slots=True)
class _Description:
    """An image's Sobel responses (H + 4, W + 4), of which descriptors are made, and their texture (H, W)."""

    horizontal: NDArray[np.uint8]
    vertical: NDArray[np.uint8]
    texture: NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class _Prior:
    """The prior of an image: a plane's disparity per pixel (-1: none), and candidates per cell (y, x, d)."""

    planes: NDArray[np.int16]
    candidates: NDArray[np.bool_]


class Elas:
    """The matcher ELAS, with the interface of `Matcher`.

    Support points, and so planes, end a few pixels from the images' borders; beyond the hull of the points, and where
    the right image does not confirm a disparity, there is none. It needs about 35 bytes per pixel (25 at half
    resolution) and, for each thread, 6 bytes per column and disparity.

    Parameters
    ----------
    stereo : StereoConfig, optional
        `n_disparities` and `half_resolution` are used: as many disparities as the nearest ground has, and half
        resolution where time is short.
    elas : ElasConfig, optional
        The method's own settings; the defaults are those for robotics of [1].
    threads : int
        Threads to use; the result does not depend on their number.

    Raises
    ------
    ValueError
        If `threads` is below 1.

    Examples
    --------
    >>> left = np.random.default_rng(0).integers(0, 256, (40, 120), dtype=np.uint8)
    >>> disparity = Elas(StereoConfig(n_disparities=16)).compute(left, np.roll(left, -7, axis=1))
    >>> float(disparity[20, 60])
    7.0
    """

    def __init__(self, stereo: StereoConfig | None = None, elas: ElasConfig | None = None, *, threads: int = 1) -> None:
        if threads < 1:
            raise ValueError(f"threads is {threads}; give at least 1")
        self._stereo = stereo or StereoConfig()
        self._elas = elas or ElasConfig()
        self._step = 2 if self._stereo.half_resolution else 1
        self._prior_gain = _prior_gain(self._elas)
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads, "elas") if threads > 1 else None

    def compute(self, left: NDArray[np.generic], right: NDArray[np.generic]) -> NDArray[np.float32]:
        """Return the disparity of the left image; takes, returns and raises what `Matcher.compute` does."""
        return self._compute(left, right, 1)[0]

    def compute_both(
        self, left: NDArray[np.generic], right: NDArray[np.generic]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the disparities of the left and of the right image; takes, returns and raises what `compute` does."""
        of_left, of_right = self._compute(left, right, 2)
        return of_left, of_right

    def _compute(
        self, left: NDArray[np.generic], right: NDArray[np.generic], n_images: int
    ) -> list[NDArray[np.float32]]:
        """Return the disparities of the first `n_images` images: the method's five steps."""
        pair = grey_pair(left, right)
        shape = pair[0].shape
        left_description, right_description = self._map(_describe, pair)
        points = self._support_points(left_description, right_description)
        if not len(points):
            return [np.zeros(shape, np.float32) for _ in range(n_images)]
        left_prior, right_prior = self._map(lambda side: self._prior(points, shape, side), (_LEFT, _RIGHT))
        found = self._match(left_description, right_description, left_prior, right_prior)
        return [self._full_size(self._refine(disparity), shape) for disparity in found[:n_images]]

    def _support_points(self, left: _Description, right: _Description) -> NDArray[np.int64]:
        """Return the support points (n, 3): u, v and disparity in the left image (section 3.1)."""
        step = self._elas.grid_step_px
        rows, columns = ((size - 1 - _REACH_PX) // step + 1 for size in left.texture.shape)
        edge = max(1, -(-_REACH_PX // step))
        grid: NDArray[np.int16] = np.full((max(rows, 0), max(columns, 0)), -1, np.int16)
        # The uppermost rows, which have no room for a window, count as infinitely far, so that far points below them
        # need less support: chosen to agree with published results. With it, 97.7 % of the disparities of 38 KITTI Road
        # frames are within 1 px of those of the authors' program, without it 96.1 %; the masks' scores stay the same.
        # On synthetic scenes it lessens false disparities in the sky a little or not at all, depending on the scenes.
        # The same for the columns on the left gains nothing anywhere.
        grid[:edge] = 0
        textured_l, textured_r = (side.texture >= self._elas.support_texture for side in (left, right))

        def match(first: int, last: int) -> None:
            kernels.match_support(
                left.horizontal, left.vertical, right.horizontal, right.vertical, textured_l, textured_r,
                first + edge, last + edge, edge, step, _REACH_PX, self._stereo.n_disparities,
                self._elas.support_uniqueness, self._elas.consistency_px, grid,
            )  # fmt: skip

        self._for_bands(match, len(grid) - edge)
        grid = self._reliable(grid)
        grid[:edge] = -1
        i, j = np.nonzero(grid >= 0)
        return np.stack([j * step, i * step, grid[i, j]], axis=1)

    def _reliable(self, grid: NDArray[np.int16]) -> NDArray[np.int16]:
        """Return the grid of support points without isolated and without redundant ones."""
        elas = self._elas
        kept = np.empty_like(grid)
        kernels.drop_isolated(grid, elas.support_window, elas.support_similarity_px, elas.min_support, kept)
        for _ in range(2):  # along columns, then along rows
            kept = np.ascontiguousarray(kept.T)
            kernels.drop_redundant(kept, elas.redundancy_window, _REDUNDANT_PX)
        return kept

    def _prior(self, points: NDArray[np.int64], shape: tuple[int, ...], side: int) -> _Prior:
        """Return the prior that the support points give for the image on `side` (section 3.2).

        There are no planes outside of the convex hull of the points, but candidates up to a cell beyond.
        """
        located = points.astype(np.float64)
        located[:, 0] -= side * located[:, 2]
        height, width = shape
        planes = np.full((-(-height // self._step), -(-width // self._step)), -1, np.int16)
        kernels.draw_planes(located, _triangles(located), 1 - 2 * side, self._step, planes)
        size = self._elas.cell_size_px
        cells = (-(-height // size), -(-width // size), self._stereo.n_disparities)
        candidates: NDArray[np.bool_] = np.zeros(cells, np.bool_)
        x, y, disparity = located.astype(np.int64).T
        candidates[y // size, x // size, disparity] = True
        for axis in range(3):  # neighbour cells, and disparities next to the rounded ones of support points
            candidates = _widened(candidates, axis)
        return _Prior(planes, candidates)

    def _match(
        self, left: _Description, right: _Description, left_prior: _Prior, right_prior: _Prior
    ) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return the disparities, -1 for none, of both images that confirm each other (section 3.3)."""
        textured_l, textured_r = (side.texture >= self._elas.match_texture for side in (left, right))
        found = np.empty_like(left_prior.planes), np.empty_like(left_prior.planes)

        def match(first: int, last: int) -> None:
            kernels.match_rows(
                left.horizontal, left.vertical, right.horizontal, right.vertical, textured_l, textured_r,
                left_prior.planes, right_prior.planes, left_prior.candidates, right_prior.candidates,
                self._prior_gain, first, last, self._step, self._elas.cell_size_px, self._elas.consistency_px, *found,
            )  # fmt: skip

        self._for_bands(match, len(left_prior.candidates))
        return found

    def _refine(self, found: NDArray[np.int16]) -> NDArray[np.float32]:
        """Return the disparity, 0 for none, without small segments, with gaps filled and smoothed."""
        elas = self._elas
        scaled = found * np.int16(16)
        speckle_size = elas.speckle_size_px // self._step**2
        cv2.filterSpeckles(scaled, -16, max(speckle_size - 1, 0), round(16 * elas.speckle_similarity_px))
        disparity = scaled.astype(np.float32) / np.float32(16)
        for _ in range(2):  # along rows, then along columns
            kernels.fill_gaps(disparity, elas.gap_width_px // self._step, _GAP_JUMP_PX)
            disparity = np.ascontiguousarray(disparity.T)
        if elas.adaptive_mean:
            disparity = self._smooth(self._smooth(disparity, along=True), along=False)
        return np.maximum(disparity, 0)

    def _smooth(self, disparity: NDArray[np.float32], *, along: bool) -> NDArray[np.float32]:
        """Return the adaptive mean along or across rows."""
        smooth = np.empty_like(disparity)
        self._for_bands(
            lambda first, last: kernels.smooth_rows(
                disparity, _MEAN_RADIUS_PX, _MEAN_WIDTH_PX, along, first, last, smooth
            ),
            len(disparity),
        )
        return smooth

    def _full_size(self, disparity: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Return the disparity in an image's full size."""
        if self._step == 1:
            return disparity
        full = np.empty(shape, np.float32)
        kernels.double(disparity, self._elas.speckle_similarity_px, full)
        return full

    def _map(self, function: Callable[[_T], _R], items: Iterable[_T]) -> list[_R]:
        """Apply `function` to each item, in the thread pool if there is one."""
        return list(map(function, items) if self._pool is None else self._pool.map(function, items))

    def _for_bands(self, function: Callable[[int, int], None], n_rows: int) -> None:
        """Call `function` with the first and last + 1 row of each band; more bands than threads, to share evenly."""
        n_bands = 1 if self._pool is None else min(4 * self._threads, n_rows)
        edges = [n_rows * band // n_bands for band in range(n_bands + 1)] if n_rows > 0 else []
        self._map(lambda band: function(*band), pairwise(edges))


def _describe(image: NDArray[np.uint8]) -> _Description:
    """Return the responses of an image and its texture."""
    padded = cv2.copyMakeBorder(image, 2, 2, 2, 2, cv2.BORDER_REPLICATE)
    # A quarter of the response, rounded up: chosen to agree with published results.
    horizontal, vertical = (
        cv2.Sobel(padded, cv2.CV_8U, *order, ksize=3, scale=0.25, delta=128 + 0.375) for order in ((1, 0), (0, 1))
    )
    texture = np.empty(image.shape, np.uint16)
    kernels.texture(horizontal, vertical, 0, len(texture), texture)
    return _Description(horizontal, vertical, texture)


def _triangles(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return the Delaunay triangles (n, 3) of the points, as indices."""
    if len(points) < 3:
        return np.empty((0, 3), np.int32)
    # Four points of a grid lie on one circle, which takes Qhull twice the time: each is moved by up to 1/50 px.
    moved = points[:, :2] + 0.02 * np.sin(np.arange(2.0 * len(points)) ** 2).reshape(-1, 2)
    try:
        return np.ascontiguousarray(Delaunay(moved).simplices, np.int32)
    except QhullError:  # all on one line
        return np.empty((0, 3), np.int32)


def _widened(mask: NDArray[np.bool_], axis: int) -> NDArray[np.bool_]:
    """Return `mask` with the neighbours along an axis set, too."""
    widened = mask.copy()
    target, source = np.moveaxis(widened, axis, 0), np.moveaxis(mask, axis, 0)
    target[1:] |= source[:-1]
    target[:-1] |= source[1:]
    return widened


def _prior_gain(elas: ElasConfig) -> NDArray[np.int32]:
    """Return how much the prior favours disparities 0, 1, ... px from the plane, in the units of the kernels' costs.

    Equation 6, divided by beta, less its value far from the plane, where the exponential is taken as zero.
    """
    distance = np.arange(elas.plane_radius_px + 1)
    gain = np.log1p(np.exp(-(distance**2) / (2 * elas.sigma_px**2)) / elas.gamma) / elas.beta
    return np.round(gain * 2**kernels.COST_BITS).astype(np.int32) << np.int32(kernels.DISPARITY_BITS)
