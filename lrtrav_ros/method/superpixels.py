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
import numba
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import SuperpixelsConfig

# Connected pieces smaller than this share of a grid cell are fragments, which join a neighbour. With 0.3, about as many
# superpixels come out as were asked for: fragments that go make up for larger pieces that become superpixels.
_FRAGMENT = 0.3

_kernel = numba.njit(cache=True, nogil=True)


def preemptive_slic(image: NDArray[np.uint8], config: SuperpixelsConfig | None = None) -> NDArray[np.int32]:
    """Segment an image into superpixels with Preemptive SLIC.

    Parameters
    ----------
    image : (H, W, 3) or (H, W) uint8 array
        Colour image in BGR order, or grey image.
    config : SuperpixelsConfig, optional
        How many superpixels, how compact, and when to stop.

    Returns
    -------
    (H, W) int32 array
        Label of each pixel: 0 .. n - 1, numbered in the order in which rows, top to bottom, meet them.
        Each label's pixels are 4-connected. n is about `config.n_superpixels`, never more than pixels.

    Raises
    ------
    ValueError
        If the image is not 8 bit, is neither grey nor BGR, or is empty.

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
    if image.dtype != np.uint8:
        raise ValueError(f"image has dtype {image.dtype}; give 8-bit values (uint8)")
    if image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
        raise ValueError(f"image has shape {image.shape}; give (H, W) for grey or (H, W, 3) for BGR")
    if image.size == 0:
        raise ValueError(f"image has shape {image.shape}; give one with at least one pixel")
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
        visited = visited[np.argsort(centres[visited, 4], kind="stable")].astype(labels.dtype)
        changes = _sweep(lab, centres, visited, weight, reach, *cells, distance, labels, sums)
        if changes.sum() < config.preemption_threshold * labels.size:
            break
        active = grid.around(changes) >= config.preemption_threshold * 9 * grid.step_px**2
        active &= sums[:, 5] > 0
        centres[active] = sums[active, :5] / sums[active, 5:]
    return labels


@_kernel
def _sweep(lab, centres, visited, weight, reach, cell_row, cell_col, distance, labels, sums):  # type: ignore[no-untyped-def]
    """Visit the active clusters, which `visited` holds from top to bottom, row by row of the image.

    Updates `distance`, `labels` and the clusters' `sums`; returns how many pixels changed label in each cell.
    """
    height, width = labels.shape
    changes = np.zeros(len(sums), np.int64)
    before = np.empty(width, labels.dtype)
    columns = np.arange(width).astype(np.float32)
    # Whole SIMD vectors of 16 pixels: leftovers would take longer than the few pixels that the window gains.
    count = min(width, 16 * math.ceil(2 * reach / 16))
    first = last = 0
    for y in range(height):
        while last < len(visited) and centres[visited[last], 4] - reach <= y:
            last += 1
        while first < last and centres[visited[first], 4] + reach < y:
            first += 1
        for x in range(width):
            before[x] = labels[y, x]
        for k in visited[first:last]:
            cl, ca, cb, cx, cy = centres[k, 0], centres[k, 1], centres[k, 2], centres[k, 3], centres[k, 4]
            left = min(max(0, int(cx) - count // 2), width - count)
            right = left + count
            row_l, row_a, row_b = lab[0, y, left:right], lab[1, y, left:right], lab[2, y, left:right]
            across, nearest, owner = columns[left:right], distance[y, left:right], labels[y, left:right]
            dy = np.float32(y) - cy
            for x in range(count):
                dl, da, db = np.float32(row_l[x]) - cl, np.float32(row_a[x]) - ca, np.float32(row_b[x]) - cb
                dx = across[x] - cx
                d = dl * dl + da * da + db * db + weight * (dx * dx + dy * dy)
                # Its own pixels are at a stale distance, since the centre moved. Selects, not branches: they vectorise.
                take = (d < nearest[x]) | (owner[x] == k)
                nearest[x] = d if take else nearest[x]
                owner[x] = k if take else owner[x]
        for x in range(width):
            if labels[y, x] != before[x]:
                _add(sums, labels[y, x], lab, y, x, 1)
                if before[x] >= 0:
                    _add(sums, before[x], lab, y, x, -1)
                changes[cell_row[y] + cell_col[x]] += 1
    return changes


@_kernel
def _add(sums, k, lab, y, x, sign):  # type: ignore[no-untyped-def]
    """Add a pixel to cluster `k`'s sums of L, a, b, x, y and pixels, or take it away."""
    sums[k, 0] += sign * lab[0, y, x]
    sums[k, 1] += sign * lab[1, y, x]
    sums[k, 2] += sign * lab[2, y, x]
    sums[k, 3] += sign * x
    sums[k, 4] += sign * y
    sums[k, 5] += sign


def _connect(lab: NDArray[np.uint8], labels: NDArray[np.int16], min_size: float) -> NDArray[np.int32]:
    """Make each superpixel one connected piece: fragments join the adjacent piece of the most similar colour."""
    runs, rows = _cut(lab, labels)
    piece, edges = _link(labels, runs, rows)
    owner = _merge(runs, piece, edges, min_size)
    connected = np.empty(labels.shape, np.int32)
    _paint(runs, owner[piece], connected.ravel())
    return connected


@_kernel
def _paint(runs, values, flat):  # type: ignore[no-untyped-def]
    """Write each run's value to its pixels."""
    for run in range(len(values)):
        flat[runs[run, 0] : runs[run + 1, 0]] = values[run]


@_kernel
def _cut(lab, labels):  # type: ignore[no-untyped-def]
    """Cut the rows into runs of one label.

    Returns, for each run, its first pixel and the sums of L, a, b over all pixels before it, with a last entry for
    the end of the image; and the first run of each row, with a last entry too.
    """
    height, width = labels.shape
    runs = np.empty((height * width + 1, 4), np.int64)
    rows = np.empty(height + 1, np.int64)
    n = sum_l = sum_a = sum_b = 0
    for y in range(height):
        rows[y] = n
        for x in range(width):
            if x == 0 or labels[y, x] != labels[y, x - 1]:
                runs[n, 0], runs[n, 1], runs[n, 2], runs[n, 3] = y * width + x, sum_l, sum_a, sum_b
                n += 1
            sum_l += lab[0, y, x]
            sum_a += lab[1, y, x]
            sum_b += lab[2, y, x]
    rows[height] = n
    runs[n, 0], runs[n, 1], runs[n, 2], runs[n, 3] = height * width, sum_l, sum_a, sum_b
    return runs[: n + 1], rows


@_kernel
def _link(labels, runs, rows):  # type: ignore[no-untyped-def]
    """Join the runs of one label that touch to pieces.

    Returns the piece of each run, numbered by their first pixels, and the (E, 2) pairs of pieces that touch.
    """
    height, width = labels.shape
    flat = labels.ravel()
    n_runs = rows[height]
    parent = np.arange(n_runs).astype(np.int32)
    edges = np.empty((3 * n_runs, 2), np.int32)
    n_edges = 0
    for y in range(height):
        for run in range(rows[y] + 1, rows[y + 1]):
            edges[n_edges, 0], edges[n_edges, 1] = run - 1, run
            n_edges += 1
        above, run = rows[max(y - 1, 0)], rows[y]
        while above < rows[y] and run < rows[y + 1]:
            if flat[runs[above, 0]] == flat[runs[run, 0]]:
                _join(parent, above, run)
            else:
                edges[n_edges, 0], edges[n_edges, 1] = above, run
                n_edges += 1
            overhang = runs[above + 1, 0] + width - runs[run + 1, 0]
            above += overhang <= 0
            run += overhang >= 0
    _number(parent)
    for i in range(n_edges):
        edges[i, 0], edges[i, 1] = parent[edges[i, 0]], parent[edges[i, 1]]
    return parent, edges[:n_edges]


@_kernel
def _find(parent, i):  # type: ignore[no-untyped-def]
    """Return the root of the tree that `i` is in: its smallest member."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@_kernel
def _join(parent, i, j):  # type: ignore[no-untyped-def]
    """Make one tree of those of `i` and `j`; return its root and the root that is none any more."""
    i, j = _find(parent, i), _find(parent, j)
    parent[max(i, j)] = min(i, j)
    return min(i, j), max(i, j)


@_kernel
def _number(parent):  # type: ignore[no-untyped-def]
    """Replace each entry of a forest by the number of its tree, 0 .. n - 1 in the order of the roots."""
    n = 0
    for i in range(len(parent)):
        if parent[i] == i:
            parent[i] = n
            n += 1
        else:
            parent[i] = parent[parent[i]]


@_kernel
def _merge(runs, piece, edges, min_size):  # type: ignore[no-untyped-def]
    """Return the superpixel of each piece, numbered by their first pixels.

    In each round every piece below `min_size` chooses the adjacent piece of the most similar mean colour, and all
    that chose are joined; it ends when no piece is too small or none has a neighbour left.
    """
    sums = _sums(runs, piece)
    n_pieces, n_edges = len(sums), len(edges)
    owner = np.arange(n_pieces).astype(np.int32)
    while n_edges > 0:
        n_edges, partner = _choose(sums, owner, edges[:n_edges], min_size)
        for p in range(n_pieces):
            if partner[p] >= 0 and _find(owner, p) != _find(owner, partner[p]):
                root, child = _join(owner, p, partner[p])
                for c in range(4):
                    sums[root, c] += sums[child, c]
        for p in range(n_pieces):
            owner[p] = _find(owner, p)
    _number(owner)
    return owner


@_kernel
def _sums(runs, piece):  # type: ignore[no-untyped-def]
    """Return the number of pixels of each piece and the sums of their L, a, b."""
    sums = np.zeros((piece.max() + 1, 4), np.int64)
    for run in range(len(piece)):
        for c in range(4):
            sums[piece[run], c] += runs[run + 1, c] - runs[run, c]
    return sums


@_kernel
def _choose(sums, owner, edges, min_size):  # type: ignore[no-untyped-def]
    """Return the number of edges that matter, moved to the front, and each small piece's choice, else -1.

    `latest` keeps out most of the pairs that come again and again along a border.
    """
    n_pieces = len(sums)
    mean = np.empty((n_pieces, 3), np.float32)
    small = np.empty(n_pieces, np.bool_)
    for p in range(n_pieces):
        small[p] = sums[p, 0] < min_size
        for c in range(3):
            mean[p, c] = sums[p, c + 1] / sums[p, 0]
    nearest = np.full(n_pieces, np.inf, np.float32)
    partner = np.full(n_pieces, -1, np.int32)
    latest = np.full(n_pieces, -1, np.int32)
    kept = 0
    for i in range(len(edges)):
        a, b = owner[edges[i, 0]], owner[edges[i, 1]]
        if a == b or latest[a] == b or latest[b] == a or not (small[a] or small[b]):
            continue
        latest[a], latest[b] = b, a
        edges[kept, 0], edges[kept, 1] = a, b
        kept += 1
        d = (mean[a, 0] - mean[b, 0]) ** 2 + (mean[a, 1] - mean[b, 1]) ** 2 + (mean[a, 2] - mean[b, 2]) ** 2
        if small[a] and d < nearest[a]:
            nearest[a], partner[a] = d, b
        if small[b] and d < nearest[b]:
            nearest[b], partner[b] = d, a
    return kept, partner
