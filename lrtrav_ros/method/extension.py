"""Extension of the short-range ground over clusters of superpixels, to the horizon.

References
----------
.. [1] H. Lu et al., "Long Range Traversable Region Detection Based on Superpixels Clustering for Mobile Robots",
       IROS 2015.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lrtrav_ros.config import ExtensionConfig
from lrtrav_ros.method import _extension_kernels as kernels
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN
from lrtrav_ros.numerics.checks import check_array, check_count, check_labels, check_type

_MOST_SUPERPIXELS = 2**26  # no camera has as many pixels
_COLUMNS = np.full(256, 3, np.uint8)  # of the counts of each superpixel; the last is for what is no occupancy
_COLUMNS[[GROUND, OBSTACLE, UNKNOWN]] = [0, 1, 2]


def extend(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    clusters: NDArray[np.int32],
    config: ExtensionConfig | None = None,
) -> NDArray[np.uint8]:
    """Extend short-range ground over the clusters.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle, 255 unknown.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    clusters : (n,) ndarray of int32
        The cluster of each superpixel, a number from 0 to n - 1.
    config : ExtensionConfig, optional
        The rule, ``area`` or ``evidence`` (the default here), and the share of ground that makes a cluster traversable:
        raise it where the mask runs into obstacles.

    Returns
    -------
    (H, W) ndarray of uint8
        Long range: 0 traversable, 100 not, 255 where nothing tells (with the rule ``evidence``).

    Raises
    ------
    TypeError, ValueError
        If an argument is not such an array, the two images differ in size, or the rule takes no clusters.
    """
    config = ExtensionConfig(rule="evidence") if config is None else config
    check_type("config", config, ExtensionConfig)
    if config.rule not in RULES:
        raise ValueError(f"extension.rule {config.rule!r} takes no clusters; give one of {', '.join(RULES)}")
    check_array("superpixels", superpixels, np.int32, ("H", "W"))
    check_array("occupancy", occupancy, np.uint8, superpixels.shape)
    _check_clusters(clusters, superpixels)
    return RULES[config.rule](occupancy, superpixels, clusters, config.min_share)


def connected_regions(superpixels: NDArray[np.int32], clusters: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the connected region of each superpixel: neighbours of the same cluster are of one region.

    Parameters
    ----------
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    clusters : (n,) ndarray of int32
        The cluster of each superpixel, a number from 0 to n - 1.

    Returns
    -------
    (n,) ndarray of int32
        Numbers 0, 1, ... without gaps.

    Raises
    ------
    TypeError, ValueError
        If an argument is not such an array.
    """
    check_array("superpixels", superpixels, np.int32, ("H", "W"))
    _check_clusters(clusters, superpixels)
    layout = superpixel_layout(superpixels, len(clusters))
    first, second = layout.pairs
    same = clusters[first] == clusters[second]
    graph = coo_array((same[same], (first[same], second[same])), shape=(len(clusters), len(clusters)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """How n superpixels lie in an image.

    Parameters
    ----------
    area : (n,) ndarray of int64
        Number of pixels.
    middles : (n, 2) ndarray of float64
        Row and column of the middle, in pixels; 0 for labels that no pixel has.
    starts : (n + 1,) ndarray of int32
        Where the neighbours of each superpixel start in `others`, and where those of the last end.
    others : (p,) ndarray of int32
        The neighbours of each superpixel, those that meet it in a row or a column, in the order of their numbers.
    """

    area: NDArray[np.int64]
    middles: NDArray[np.float64]
    starts: NDArray[np.int32]
    others: NDArray[np.int32]

    @property
    def pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The pairs of neighbours, each of them both ways: the numbers of the one, (p,), and of the other."""
        return np.repeat(np.arange(len(self.area)), np.diff(self.starts)), self.others.astype(np.intp)


def superpixel_layout(superpixels: NDArray[np.int32], n: int) -> Layout:
    """Return where superpixels are, how large, and which are neighbours.

    Parameters
    ----------
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    n : int
        Number of superpixels.

    Raises
    ------
    TypeError, ValueError
        If `superpixels` is not such an array.
    """
    check_array("superpixels", superpixels, np.int32, ("H", "W"))
    n = check_count("n", n, most=_MOST_SUPERPIXELS)
    check_labels("superpixels", superpixels, n)
    sums = np.zeros((n, 3), np.int64)
    first, second = kernels.survey(np.ascontiguousarray(superpixels), sums)
    starts, others = kernels.neighbours(first, second, n)
    return Layout(sums[:, 0], sums[:, 1:] / np.maximum(sums[:, :1], 1), starts, others)


def count_evidence(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of ground pixels, of obstacle pixels and of all pixels in each superpixel.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle, 255 unknown.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    n : int
        Number of superpixels.

    Returns
    -------
    ground, obstacle, area : (n,) ndarray of int64

    Raises
    ------
    TypeError, ValueError
        If an argument is not such an array, or the two differ in size.
    """
    check_array("superpixels", superpixels, np.int32, ("H", "W"))
    check_array("occupancy", occupancy, np.uint8, superpixels.shape)
    n = check_count("n", n, most=_MOST_SUPERPIXELS)
    check_labels("superpixels", superpixels, n)
    counts = np.zeros((n, 4), np.uint32)
    kernels.count_values(np.ascontiguousarray(occupancy), np.ascontiguousarray(superpixels), _COLUMNS, counts)
    if counts[:, 3].any():
        raise ValueError("occupancy has other values than 0 ground, 100 obstacle and 255 unknown; give only these")
    ground, obstacle, unknown, _ = counts.T.astype(np.int64)
    return ground, obstacle, ground + obstacle + unknown


def _check_clusters(clusters: NDArray[np.int32], superpixels: NDArray[np.int32]) -> None:
    """Check that every superpixel has a cluster."""
    check_array("clusters", clusters, np.int32, ("n",))
    check_labels("clusters", clusters, len(clusters))
    check_labels("superpixels", superpixels, len(clusters))


def _extend_by_area(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], clusters: NDArray[np.int32], min_share: float
) -> NDArray[np.uint8]:
    """Take the clusters with enough short-range ground in their area, and that ground itself: the rule of [1]."""
    ground, _, area = count_evidence(occupancy, superpixels, len(clusters))
    traversable = np.bincount(clusters, ground) > min_share * np.bincount(clusters, area)
    result = np.where(traversable[clusters][superpixels], np.uint8(GROUND), np.uint8(OBSTACLE))
    result[occupancy == GROUND] = GROUND
    return result


def _extend_by_evidence(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], clusters: NDArray[np.int32], min_share: float
) -> NDArray[np.uint8]:
    """Judge connected regions of a cluster by their pixels with evidence; evidence itself always stands.

    A region without evidence is judged as its whole cluster is.
    """
    regions = connected_regions(superpixels, clusters)
    ground, obstacle, _ = count_evidence(occupancy, superpixels, len(clusters))
    verdict = _verdict(regions, ground, obstacle, min_share)
    verdict = np.where(verdict == UNKNOWN, _verdict(clusters, ground, obstacle, min_share), verdict)
    return np.where(occupancy == UNKNOWN, verdict[superpixels], occupancy)


RULES: dict[str, Callable[[NDArray[np.uint8], NDArray[np.int32], NDArray[np.int32], float], NDArray[np.uint8]]] = {
    "area": _extend_by_area,
    "evidence": _extend_by_evidence,
}
"""The rules, by the names that the setting ``extension.rule`` has for them."""


def _verdict(
    groups: NDArray[np.int32], ground: NDArray[np.int64], obstacle: NDArray[np.int64], min_share: float
) -> NDArray[np.uint8]:
    """Return the verdict of the evidence in each superpixel's group: ground, obstacle or, without any, unknown."""
    ground_pixels = np.bincount(groups, ground)
    evidence = ground_pixels + np.bincount(groups, obstacle)
    verdict = np.where(ground_pixels > min_share * evidence, np.uint8(GROUND), np.uint8(OBSTACLE))
    verdict[evidence == 0] = UNKNOWN
    return verdict[groups]
