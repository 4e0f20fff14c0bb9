"""Extension of the short-range ground over clusters of superpixels, to the horizon."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lrtrav_ros.config import ExtensionConfig
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN


def extend(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    clusters: NDArray[np.int32],
    config: ExtensionConfig = ExtensionConfig(),  # noqa: B008 - frozen
) -> NDArray[np.uint8]:
    """Extend short-range ground over the clusters.

    Parameters
    ----------
    occupancy
        Short range, uint8 (H, W): 0 ground, 100 obstacle, 255 unknown.
    superpixels
        Labels 0 .. n - 1, int32 (H, W).
    clusters
        The cluster of each superpixel, int32 (n,).

    Returns
    -------
    NDArray[np.uint8]
        Long range, uint8 (H, W): 0 traversable, 100 not, 255 where nothing tells (with the rule ``evidence``).

    Raises
    ------
    ValueError
        If the two images differ in size.
    """
    if occupancy.shape != superpixels.shape:
        raise ValueError(f"occupancy is {occupancy.shape}, superpixels {superpixels.shape}; give images of one size")
    if config.rule == "area":
        return _extend_by_area(occupancy, superpixels, clusters, config.min_share)
    return _extend_by_evidence(occupancy, superpixels, clusters, config.min_share)


def _extend_by_area(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], clusters: NDArray[np.int32], min_share: float
) -> NDArray[np.uint8]:
    """The paper's rule: clusters with enough short-range ground in their area, and that ground itself."""
    ground, _ = _evidence(occupancy, superpixels, len(clusters))
    inside = np.bincount(clusters, ground)
    area = np.bincount(clusters, np.bincount(superpixels.ravel(), minlength=len(clusters)))
    traversable = inside > min_share * area
    result = np.where(traversable[clusters][superpixels], np.uint8(GROUND), np.uint8(OBSTACLE))
    result[occupancy == GROUND] = GROUND
    return result


def _extend_by_evidence(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], clusters: NDArray[np.int32], min_share: float
) -> NDArray[np.uint8]:
    """Connected regions of a cluster are judged by their pixels with evidence; evidence itself always stands.

    A region without evidence is judged as its whole cluster is.
    """
    regions = connected_regions(superpixels, clusters)
    ground, obstacle = _evidence(occupancy, superpixels, len(clusters))
    verdict = _verdict(regions, ground, obstacle, min_share)
    verdict = np.where(verdict == UNKNOWN, _verdict(clusters, ground, obstacle, min_share), verdict)
    return np.where(occupancy == UNKNOWN, verdict[superpixels], occupancy)


def _verdict(
    groups: NDArray[np.int32], ground: NDArray[np.int64], obstacle: NDArray[np.int64], min_share: float
) -> NDArray[np.uint8]:
    """Return for each superpixel what the evidence in its group says: ground, obstacle or, without any, unknown."""
    for_it = np.bincount(groups, ground)
    evidence = for_it + np.bincount(groups, obstacle)
    verdict = np.where(for_it > min_share * evidence, np.uint8(GROUND), np.uint8(OBSTACLE))
    verdict[evidence == 0] = UNKNOWN
    return verdict[groups]


def connected_regions(superpixels: NDArray[np.int32], clusters: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return for each superpixel its connected region (n,): neighbours of the same cluster are of one region."""
    n = len(clusters)
    touching = np.zeros((n, n), np.bool_)
    _mark_neighbours(superpixels, touching)
    first, second = np.nonzero(touching & (clusters[:, None] == clusters))
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def _evidence(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of ground and of obstacle pixels in each of n superpixels."""
    counts = np.zeros((n, 256), np.int64)
    _count_values(occupancy, superpixels, counts)
    return counts[:, GROUND], counts[:, OBSTACLE]


@numba.njit(cache=True, nogil=True)
def _count_values(image, superpixels, counts):  # type: ignore[no-untyped-def]
    """Add each pixel of an 8-bit image to its value's count (n, 256) in its superpixel."""
    for v in range(image.shape[0]):
        for u in range(image.shape[1]):
            counts[superpixels[v, u], image[v, u]] += 1


@numba.njit(cache=True, nogil=True)
def _mark_neighbours(superpixels, touching):  # type: ignore[no-untyped-def]
    """Mark each pair of labels that meet in a row or a column."""
    height, width = superpixels.shape
    for v in range(height):
        for u in range(width):
            if u + 1 < width:
                touching[superpixels[v, u], superpixels[v, u + 1]] = True
            if v + 1 < height:
                touching[superpixels[v, u], superpixels[v + 1, u]] = True
