"""Superpixels: Preemptive SLIC.

The image is cut into about equally large, connected regions of similar colour. SLIC finds them with a k-means that
searches only around each centre; Preemptive SLIC leaves the clusters alone whose neighbourhood has settled.

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
from lrtrav_ros.numerics.checks import check_image

# Connected pieces smaller than this share of a grid cell are fragments, which join a neighbour. With 0.3, about as many
# superpixels come out as were asked for: fragments that go make up for larger pieces that become superpixels.
_FRAGMENT = 0.3


def preemptive_slic(image: NDArray[np.uint8], config: SuperpixelsConfig | None = None) -> NDArray[np.int32]:
    """Segment an image into superpixels with Preemptive SLIC.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Grey or BGR.
    config : SuperpixelsConfig, optional
        The number of superpixels, their compactness, and when to stop. More superpixels follow outlines of small things
        but tell less of colour and texture each; 200 to 500 suit images of up to a megapixel.

    Returns
    -------
    (H, W) ndarray of int32
        Label of each pixel: 0 .. n - 1, numbered in the order in which rows, top to bottom, meet them.
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
    config = config or SuperpixelsConfig()
    lab = _lab(image)
    grid = _Grid.fit(lab.shape[1], lab.shape[2], config.n_superpixels)
    labels = _cluster(lab, grid, config)
    return _connect(lab, labels, _FRAGMENT * grid.step_px**2)


def _lab(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the (3, H, W) planes L, a, b, each on OpenCV's scale of 8 bit, on which compactness is measured too."""
    check_image("image", image)
    if image.ndim == 2:
        image = np.repeat(image[..., np.newaxis], 3, axis=2)
    planes = np.empty((3, *image.shape[:2]), np.uint8)
    cv2.split(cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2LAB), list(planes))
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
    def reach_px(self) -> float:
        """Half the side of a cluster's window: S, or what covers an oblong cell from its middle, rounded."""
        return max(self.step_px, self.height / self.rows / 2 + 2, self.width / self.cols / 2 + 2)

    def cells(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return what each row (H,) and each column (W,) of the image add to the index of a pixel's cell."""
        return (
            np.arange(self.height) * self.rows // self.height * self.cols,
            np.arange(self.width) * self.cols // self.width,
        )

    def centres(self, lab: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return L, a, b, x, y of the pixel in the middle of each cell; (cells, 5)."""
        y, x = np.indices((self.rows, self.cols)).reshape(2, -1)
        y = (2 * y + 1) * self.height // (2 * self.rows)
        x = (2 * x + 1) * self.width // (2 * self.cols)
        return np.stack([*lab[:, y, x], x, y], axis=-1).astype(np.float32)

    def around(self, changes: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the changes in the 3 x 3 cells around each cell; (cells,)."""
        counts = changes.reshape(self.rows, self.cols).astype(np.float64)
        total = cv2.boxFilter(counts, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(total, np.float64).ravel()


def _cluster(lab: NDArray[np.uint8], grid: _Grid, config: SuperpixelsConfig) -> NDArray[np.int16]:
    """Return the cluster of each pixel: SLIC with the preemption of [1]. Clusters need not be connected yet."""
    labels = np.full(lab.shape[1:], -1, np.int16)
    distance = np.full(labels.shape, np.inf, np.float32)
    centres = grid.centres(lab)
    sums = np.zeros((len(centres), 6), np.int64)
    active: NDArray[np.bool_] = np.ones(len(centres), np.bool_)
    weight = np.float32((config.compactness / grid.step_px) ** 2)
    reach, cells = np.float32(grid.reach_px), grid.cells()
    for _ in range(config.max_iterations):
        visited = np.flatnonzero(active)
        visited = visited[np.argsort(centres[visited, 4], kind="stable")]
        changes = kernels.sweep(lab, centres, visited.astype(np.int16), weight, reach, *cells, distance, labels, sums)
        if changes.sum() < config.preemption_threshold * labels.size:
            break
        active = grid.around(changes) >= config.preemption_threshold * 9 * grid.step_px**2
        active &= sums[:, 5] > 0
        centres[active] = sums[active, :5] / sums[active, 5:]
    return labels


def _connect(lab: NDArray[np.uint8], labels: NDArray[np.int16], min_size: float) -> NDArray[np.int32]:
    """Make each superpixel one connected piece: fragments join the adjacent piece of the most similar colour."""
    runs, rows = kernels.cut(lab, labels)
    piece, edges = kernels.link(labels, runs, rows)
    owner = kernels.merge(runs, piece, edges, min_size)
    connected = np.empty(labels.shape, np.int32)
    kernels.paint(runs, owner[piece], connected.ravel())
    return connected
