"""Superpixels: Preemptive SLIC.

The image is cut into about equally large, connected regions of similar colour. SLIC finds them with a k-means that
searches only around each centre; Preemptive SLIC leaves the clusters alone whose neighbourhood has settled.

A pixel belongs to the nearest of nine clusters, those that began in its cell of the grid and in the eight around it, so
that the cost does not depend on the number of superpixels. Clusters are found on every second pixel of every second
row, a quarter of all. A pixel between two of these takes the label of one of them: so superpixels that are connected
on the coarse image are connected on the whole one, and their borders are still placed to the pixel.

References
----------
.. [1] P. Neubert and P. Protzel, "Compact Watershed and Preemptive SLIC: On improving trade-offs of superpixel
       segmentation algorithms", ICPR 2014. https://doi.org/10.1109/ICPR.2014.181
.. [2] R. Achanta, A. Shaji, K. Smith, A. Lucchi, P. Fua and S. Suesstrunk, "SLIC superpixels compared to
       state-of-the-art superpixel methods", IEEE PAMI 34(11), 2012. https://doi.org/10.1109/TPAMI.2012.120
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import SuperpixelsConfig
from lrtrav_ros.method import _superpixels_kernels as kernels
from lrtrav_ros.numerics.checks import check_image, check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

# Connected pieces smaller than this share of a grid cell are fragments, which join a neighbour. With 0.3, about as many
# superpixels come out as were asked for: fragments that go make up for larger pieces that become superpixels.
_FRAGMENT = 0.3
# Cells at least so wide and high have enough of the pixels when every second one of every second row is taken.
_COARSE_PX = 3
_FAR_PX = 1e12  # from any image
_LEAST_ROWS = 16  # of a band that is worth a thread


def preemptive_slic(
    image: NDArray[np.uint8], config: SuperpixelsConfig | None = None, *, team: ThreadTeam = ALONE
) -> NDArray[np.int32]:
    """Segment an image into superpixels with Preemptive SLIC.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR.
    config : SuperpixelsConfig, optional
        The number of superpixels, their compactness, and when to stop. More superpixels follow outlines of small things
        but tell less of colour and texture each; 200 to 500 suit images of up to a megapixel.
    team : ThreadTeam, optional
        The threads that share the work; the result does not depend on their number.

    Returns
    -------
    (H, W) ndarray of int32
        Label of each pixel: 0 .. n - 1, numbered from the top of the image to its bottom.
        Each label's pixels are 4-connected. n is about `config.n_superpixels`, never more than pixels.

    Raises
    ------
    TypeError, ValueError
        If the image is not such an array, or empty.

    Examples
    --------
    >>> image = np.zeros((20, 30), np.uint8)
    >>> image[:, 15:] = 255
    >>> preemptive_slic(image, SuperpixelsConfig(n_superpixels=2))[0, ::10]
    array([0, 0, 1], dtype=int32)
    """
    config = SuperpixelsConfig() if config is None else config
    check_type("config", config, SuperpixelsConfig)
    check_image("image", image)
    if image.ndim == 2:
        image = np.repeat(image[..., np.newaxis], 3, axis=2)
    image = np.ascontiguousarray(image)
    grid = _Grid.fit(image.shape[0], image.shape[1], config.n_superpixels)
    if not grid.is_coarse:
        return _segment(image, grid, config, team)
    half = _thin(image, team)
    labels = _segment(half, _Grid(half.shape[0], half.shape[1], grid.rows, grid.cols), config, team)
    return _refine(image, half, labels, team)


def _thin(image: NDArray[np.uint8], team: ThreadTeam) -> NDArray[np.uint8]:
    """Return every second pixel of every second row."""
    half = np.empty(((image.shape[0] + 1) // 2, (image.shape[1] + 1) // 2, 3), np.uint8)
    team.for_bands(lambda first, last: kernels.thin(image, first, last, half), len(half), least_rows=_LEAST_ROWS)
    return half


def _refine(
    image: NDArray[np.uint8], half: NDArray[np.uint8], labels: NDArray[np.int32], team: ThreadTeam
) -> NDArray[np.int32]:
    """Return labels of all pixels: one between pixels of `half` joins that whose superpixel looks more like it."""
    colours = kernels.mean_colours(half, labels, int(labels.max()) + 1)
    refined = np.empty(image.shape[:2], np.int32)

    def refine(first: int, last: int) -> None:
        kernels.refine(image, labels, colours, first, last, refined)

    team.for_bands(refine, len(half), least_rows=_LEAST_ROWS)
    return refined


def _segment(image: NDArray[np.uint8], grid: _Grid, config: SuperpixelsConfig, team: ThreadTeam) -> NDArray[np.int32]:
    """Return the superpixels of a BGR image, which clusters begin on a grid."""
    lab = _lab(image, team)
    labels = _cluster(lab, grid, config, team)
    return _connect(lab, labels, _FRAGMENT * grid.step_px**2, team)


def _lab(image: NDArray[np.uint8], team: ThreadTeam) -> NDArray[np.uint8]:
    """Return the (3, H, W) planes L, a, b, each on OpenCV's scale of 8 bit, on which compactness is measured too."""
    planes = np.empty((3, *image.shape[:2]), np.uint8)

    def convert(first: int, last: int) -> None:
        lab = cv2.cvtColor(image[first:last], cv2.COLOR_BGR2LAB)
        cv2.split(lab, list(planes[:, first:last]))

    team.for_bands(convert, len(image), least_rows=_LEAST_ROWS)
    return planes


@dataclass(frozen=True, slots=True)
class _Grid:
    """The regular grid on which the clusters start; its cells count the pixels that change label."""

    height: int
    width: int
    rows: int
    cols: int

    @classmethod
    def fit(cls, height: int, width: int, n_cells: int) -> _Grid:
        """Return the grid of about `n_cells` nearly square cells."""
        rows = min(max(round(math.sqrt(n_cells * height / width)), 1), height, n_cells)
        cols = min(max(round(n_cells / rows), 1), width)
        return cls(height, width, rows, cols)

    @property
    def step_px(self) -> float:
        """S of the papers: the side of a square as large as a cell."""
        return math.sqrt(self.height * self.width / (self.rows * self.cols))

    @property
    def is_coarse(self) -> bool:
        """Whether every second pixel of every second row is enough to find the clusters."""
        return self.height >= _COARSE_PX * self.rows and self.width >= _COARSE_PX * self.cols

    def cells(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the row of cells of each row (H,) of the image, and the column of each column (W,), from 1."""
        return (
            (1 + np.arange(self.height) * self.rows // self.height).astype(np.int32),
            (1 + np.arange(self.width) * self.cols // self.width).astype(np.int32),
        )

    def centres(self, lab: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return L, a, b, x, y of the pixel in the middle of each cell; (rows + 2, cols + 2, 5).

        Those of the cells around the grid are too far away to be the nearest of any pixel.
        """
        y = (2 * np.arange(self.rows) + 1) * self.height // (2 * self.rows)
        x = (2 * np.arange(self.cols) + 1) * self.width // (2 * self.cols)
        centres = np.full((self.rows + 2, self.cols + 2, 5), _FAR_PX, np.float32)
        centres[..., :3] = 0
        inside = centres[1:-1, 1:-1]
        for c in range(3):
            inside[..., c] = lab[c][np.ix_(y, x)]
        inside[..., 3], inside[..., 4] = x, y[:, np.newaxis]
        return centres


def _cluster(lab: NDArray[np.uint8], grid: _Grid, config: SuperpixelsConfig, team: ThreadTeam) -> NDArray[np.uint16]:
    """Return the cluster of each pixel: SLIC with the preemption of [1]. Clusters need not be connected yet."""
    bands = _bands(grid.height, team)
    centres = grid.centres(lab)
    n_rows, n_cols = centres.shape[:2]
    moved: NDArray[np.bool_] = np.zeros((n_rows, n_cols), np.bool_)
    moved[1:-1, 1:-1] = True  # not those around the grid: no pixel is ever nearest to them
    changes = np.empty((len(bands), n_rows, n_cols), np.int32)
    sums = np.zeros((len(bands), n_rows * n_cols, 6), np.int64)
    labels = np.empty(lab.shape[1:], np.uint16)
    before = np.zeros_like(labels)  # the label of a cell around the grid, whose sums do not matter
    scale, cells = np.float32(config.compactness / grid.step_px), grid.cells()

    def sweep(band: int) -> None:
        kernels.assign(lab, centres, moved, *cells, scale, *bands[band], labels)
        kernels.count(lab, *cells, *bands[band], labels, before, sums[band], changes[band])

    for _ in range(config.max_iterations):
        team.map(sweep, range(len(bands)))
        n_changes = changes[0] if len(bands) == 1 else changes.sum(axis=0, dtype=np.int32)
        if n_changes.sum() < config.preemption_threshold * labels.size:
            break
        kernels.move(sums, n_changes, config.preemption_threshold * 9 * grid.step_px**2, centres, moved)
    return labels


def _connect(
    lab: NDArray[np.uint8], labels: NDArray[np.uint16], min_size: float, team: ThreadTeam
) -> NDArray[np.int32]:
    """Make each superpixel one connected piece: fragments join the adjacent piece of the most similar colour."""
    bands = _bands(len(labels), team)
    row_lengths = np.empty(len(labels), np.int32)
    runs = np.concatenate([*team.map(lambda band: kernels.cut(labels, *band, row_lengths), bands), [labels.size]])
    rows = np.concatenate([[0], np.cumsum(row_lengths)])
    piece = np.arange(len(runs) - 1, dtype=np.int32)
    team.map(lambda band: kernels.link(labels, runs, rows, band[0] + 1, band[1], piece), bands)
    for first, _ in bands[1:]:
        kernels.link(labels, runs, rows, first, first + 1, piece)
    kernels.merge(lab, runs, rows, piece, min_size)
    connected = np.empty(labels.shape, np.int32)
    team.map(lambda band: kernels.paint(runs, piece, rows[band[0]], rows[band[1]], connected.ravel()), bands)
    return connected


def _bands(n_rows: int, team: ThreadTeam) -> list[tuple[int, int]]:
    """Return the first row and the last + 1 of each of a few bands for the team, which keep sums of their own."""
    n_bands = min(2 * team.n_threads if team.n_threads > 1 else 1, max(n_rows // _LEAST_ROWS, 1))
    return [(n_rows * band // n_bands, n_rows * (band + 1) // n_bands) for band in range(n_bands)]
