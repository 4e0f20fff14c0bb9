"""Extension by propagation: superpixels vote by how alike they look, and votes settle over their neighbourhood.

Each superpixel has evidence, the share of its pixels that short range judges, and what it says: the share of ground
among those. Two systems of linear equations spread it. In both a superpixel is held by its evidence and, lightly, by a
vote: that of all superpixels with evidence, those of remembered frames included, weighted by how much they look alike.
In the first it is tied to its neighbours in the image, in the second also to those that look most alike at about the
same height in the image, where the same ground looks the same. The result is the mean of both: what neighbours and
looks agree on.

References
----------
.. [1] X. Zhu, Z. Ghahramani and J. Lafferty, "Semi-Supervised Learning Using Gaussian Fields and Harmonic Functions",
       ICML 2003.
.. [2] H. Lu et al., IROS 2015, for the distance by colour and texture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array, diags
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import cg

from lrtrav_ros.method import _propagation_kernels as kernels
from lrtrav_ros.method.extension import survey_superpixels, touching_superpixels
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN
from lrtrav_ros.numerics.blas import one_blas_thread
from lrtrav_ros.numerics.checks import check_array, check_distances, check_finite, check_labels

# Chosen on KITTI Road and synthetic scenes; what each does to the scores is in docs/ablation.md.
_VOTE_DISTANCE = 0.1  # by colour and texture, of superpixels that vote for each other
_VOTE_CHROMATICITY = 0.05
_TIE_DISTANCE = 0.2  # the same for those that are tied
_TIE_CHROMATICITY = 0.03
_TIE_ROWS = 0.2  # of the image's height
_N_TIES = 8
_TIE_WEIGHT = 3.0
_NEIGHBOUR_SCALE = 1.2  # times the median distance of neighbours
_EVIDENCE_WEIGHT = 10.0
_VOTE_WEIGHT = 0.2
_STRANGER = 0.3  # what looks like nothing that is known is rather none to drive on
_STRANGER_WEIGHT = 0.01
_UNANIMITY_WEIGHT = 0.4  # more of a vote that all are of one mind in
_BELIEF_WEIGHT = 0.5  # at most, of the frame before
_SAME_PLACE = 0.03  # of the image's height
_UNDECIDED = 0.5
_NO_VOTES = 1e-9
_OVERRULED_GROUND = 0.25  # in superpixels that are less surely traversable: the feet of things, more often than not
_OVERRULED_OBSTACLE = 0.9  # in superpixels that are more surely traversable: what matching adds around things

# How often labels were right on KITTI Road and synthetic scenes, with all disparity and to 10 m: by how surely a
# superpixel is what the label says, for ground and obstacles of the short range and for what it leaves unknown.
_SURENESS = np.linspace(0.05, 0.95, 10)
_RIGHT_GROUND = np.array([0.27, 0.40, 0.57, 0.78, 0.86, 0.94, 0.97, 0.98, 0.994, 1.0])
_RIGHT_OBSTACLE = np.array([0.20, 0.28, 0.40, 0.52, 0.66, 0.78, 0.86, 0.92, 0.97, 1.0])
_RIGHT_UNKNOWN = np.array([0.40, 0.40, 0.40, 0.40, 0.40, 0.59, 0.67, 0.78, 0.88, 0.985])


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What is known of superpixels from short range.

    Parameters
    ----------
    share : (n,) ndarray of float64
        Share of a superpixel's pixels that are judged, 0 .. 1; of remembered ones a part of it, for they weigh less.
    ground : (n,) ndarray of float64
        Share of ground among those; 0.5 where there are none.
    """

    share: NDArray[np.float64]
    ground: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.share)


@dataclass(frozen=True, slots=True, eq=False)
class _Hold:
    """What holds each superpixel lightly: how strongly, and at what."""

    weight: NDArray[np.float64]
    target: NDArray[np.float64]


NOTHING_REMEMBERED = Evidence(np.zeros(0), np.zeros(0))
"""The evidence of no superpixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What was found of the n superpixels of a frame.

    Parameters
    ----------
    places : (n, 2) ndarray of float64
        Row and column of their middles, as shares of the image's height.
    chromaticity : (n, 2) ndarray of float64
        `features.log_chromaticity`.
    traversable : (n,) ndarray of float64
        How sure it is that each is traversable, from 0 for not to 1.
    """

    places: NDArray[np.float64]
    chromaticity: NDArray[np.float64]
    traversable: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Propagation:
    """What propagation finds, in an image of (H, W) pixels and n superpixels.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        0 traversable, 100 not, 255 where nothing tells.
    confidence : (H, W) ndarray of uint8
        Probability that a pixel's label, traversable or not, is right, times 255; 0 where nothing tells.
    evidence : Evidence
        What short range says of each superpixel.
    belief : Belief
        How sure it is that each superpixel is traversable; 0.3 for all without any evidence.
    """

    occupancy: NDArray[np.uint8]
    confidence: NDArray[np.uint8]
    evidence: Evidence
    belief: Belief


def propagate(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    distances: NDArray[np.float64],
    chromaticity: NDArray[np.float64],
    *,
    remembered: Evidence = NOTHING_REMEMBERED,
    before: Belief | None = None,
    min_share: float = 0.5,
) -> Propagation:
    """Extend short-range ground over superpixels that look like it and are near it.

    What short range judges stands, unless its superpixel surely is the opposite, and it is not above all ground of its
    column. Every other pixel is as its superpixel. Superpixels that are traversable, but that no traversable ones
    connect with ground of the short range, are unknown.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle, 255 unknown.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    distances : (n + m, n + m) ndarray of float64
        How unlike superpixels look, by colour and texture, those of the image first, then m remembered ones: symmetric,
        zero on the diagonal.
    chromaticity : (n + m, 2) ndarray of float64
        `features.log_chromaticity` of the same.
    remembered : Evidence
        Of the m remembered superpixels, which vote and are not voted for.
    before : Belief, optional
        What was found in the frame before: superpixels are held lightly by it where they look alike at the same place.
    min_share : float
        What is surer than this is traversable: raise it to claim less ground.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    n = _checked(superpixels, distances, chromaticity, remembered)
    if before is not None:
        _check_belief(before)
    distances = np.ascontiguousarray(distances)  # sums in another order would not be equal bit for bit
    evidence, places = _surveyed(occupancy, superpixels, n)
    vote = _votes(_appended(evidence, remembered), distances, chromaticity)[:n]
    light = _held(vote, before, places, chromaticity[:n])
    pairs = np.nonzero(touching_superpixels(superpixels, n))
    near = _neighbours(pairs, distances[:n, :n])
    alike = _most_alike(distances[:n, :n], chromaticity[:n], places)
    settled = (_settled(near, evidence, light) + _settled(near + alike, evidence, light)) / 2
    traversable = np.clip(settled, 0, 1)
    labels = _labels(traversable, evidence, pairs, min_share)
    extended, confidence = np.empty_like(occupancy), np.empty_like(occupancy)
    kernels.label_pixels(
        np.ascontiguousarray(occupancy),
        np.ascontiguousarray(superpixels),
        labels,
        _confidences(labels, traversable),
        GROUND,
        OBSTACLE,
        extended,
        confidence,
    )
    return Propagation(extended, confidence, evidence, Belief(places, chromaticity[:n], traversable))


def _checked(
    superpixels: NDArray[np.int32],
    distances: NDArray[np.float64],
    chromaticity: NDArray[np.float64],
    remembered: Evidence,
) -> int:
    """Check the arguments of `propagate`, and return the number of the image's superpixels."""
    check_array("superpixels", superpixels, np.int32, ("H", "W"))
    check_distances("distances", distances)
    total = len(distances)
    check_array("chromaticity", chromaticity, np.float64, (total, 2))
    check_finite("chromaticity", chromaticity)
    m = len(remembered)
    for name, values in (("remembered.share", remembered.share), ("remembered.ground", remembered.ground)):
        check_array(name, values, np.float64, (m,), may_be_empty=True)
        if m and not (values.min() >= 0 and values.max() <= 1):
            raise ValueError(f"{name} holds values from {values.min():g} to {values.max():g}; give shares, 0 to 1")
    check_labels("superpixels", superpixels, total - m)
    return total - m


def _check_belief(belief: Belief) -> None:
    """Check what was found in the frame before."""
    n = len(belief.traversable)
    shapes = (("places", belief.places, (n, 2)), ("chromaticity", belief.chromaticity, (n, 2)))
    for name, values, shape in (*shapes, ("traversable", belief.traversable, (n,))):
        check_array(f"before.{name}", values, np.float64, shape, may_be_empty=True)
        check_finite(f"before.{name}", values)


def _surveyed(
    occupancy: NDArray[np.uint8], superpixels: NDArray[np.int32], n: int
) -> tuple[Evidence, NDArray[np.float64]]:
    """Return the evidence in each superpixel, and row and column of its middle, as shares of the image's height."""
    sums = survey_superpixels(occupancy, superpixels, n)
    ground, area = sums[:, 0], np.maximum(sums[:, 3], 1)
    judged = ground + sums[:, 1]
    says = np.divide(ground, judged, out=np.full(n, _UNDECIDED), where=judged > 0)
    return Evidence(judged / area, says), sums[:, 4:] / area[:, None] / superpixels.shape[0]


def _appended(evidence: Evidence, remembered: Evidence) -> Evidence:
    """Return the evidence of the image, followed by what is remembered."""
    return Evidence(
        np.concatenate([evidence.share, remembered.share]), np.concatenate([evidence.ground, remembered.ground])
    )


@one_blas_thread()
def _votes(
    evidence: Evidence, distances: NDArray[np.float64], chromaticity: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the share of ground among superpixels with evidence, weighted by how much they look alike."""
    exponent = (distances / _VOTE_DISTANCE).astype(np.float32) ** 2
    looks = (chromaticity / _VOTE_CHROMATICITY).astype(np.float32)
    _add_squared_differences(exponent, looks, looks)
    exponent /= -2
    weights = np.exp(exponent, out=exponent)
    total = (weights @ evidence.share.astype(np.float32)).astype(np.float64)
    says = (weights @ (evidence.share * evidence.ground).astype(np.float32)).astype(np.float64)
    return (says + _STRANGER_WEIGHT * _STRANGER) / (total + _STRANGER_WEIGHT)


def _add_squared_differences(
    sums: NDArray[np.floating[Any]], first: NDArray[np.floating[Any]], second: NDArray[np.floating[Any]]
) -> None:
    """Add the squared Euclidean distance of each first point to each second one, in place."""
    for a, b in zip(first.T, second.T, strict=True):
        sums += (a[:, None] - b) ** 2


def _neighbours(pairs: tuple[NDArray[np.intp], ...], distances: NDArray[np.float64]) -> csr_array:
    """Return the ties between superpixels that touch, stronger where they look alike."""
    apart = distances[pairs]
    scale = _NEIGHBOUR_SCALE * float(np.median(apart)) if apart.size else 0.0
    weights = np.exp((apart / scale) ** 2 / -2) if scale > 0 else (apart == 0).astype(np.float64)
    return csr_array(coo_array((weights, pairs), shape=distances.shape))


def _held(
    vote: NDArray[np.float64],
    before: Belief | None,
    places: NDArray[np.float64],
    chromaticity: NDArray[np.float64],
) -> _Hold:
    """Return how strongly vote and the frame before hold each superpixel, and at what."""
    held = _VOTE_WEIGHT + _UNANIMITY_WEIGHT * (2 * vote - 1) ** 2
    if before is None or not len(before.traversable):
        return _Hold(held, vote)
    now = np.column_stack([places / _SAME_PLACE, chromaticity / _VOTE_CHROMATICITY])
    then = np.column_stack([before.places / _SAME_PLACE, before.chromaticity / _VOTE_CHROMATICITY])
    exponent = np.zeros((len(now), len(then)))
    _add_squared_differences(exponent, now, then)
    alike = np.exp(exponent / -2)
    total = alike.sum(axis=1)
    weight = _BELIEF_WEIGHT * alike.max(axis=1)
    found = np.divide(alike @ before.traversable, total, out=vote.copy(), where=total > _NO_VOTES)
    return _Hold(held + weight, (held * vote + weight * found) / (held + weight))


def _most_alike(
    distances: NDArray[np.float64], chromaticity: NDArray[np.float64], places: NDArray[np.float64]
) -> csr_array:
    """Return the ties of each superpixel with the few that look most like it, at about the same height."""
    n = len(distances)
    looks = np.column_stack([chromaticity / _TIE_CHROMATICITY, places[:, :1] / _TIE_ROWS])
    n_ties = min(_N_TIES, n - 1)
    others, exponents = kernels.nearest(np.ascontiguousarray(distances), 1 / _TIE_DISTANCE, looks, n_ties)
    first, second = np.repeat(np.arange(n), n_ties), others.ravel()
    weights = np.tile(_TIE_WEIGHT / 2 * np.exp(exponents.ravel() / -2), 2)
    both_ways = np.concatenate([first, second]), np.concatenate([second, first])
    return csr_array(coo_array((weights, both_ways), shape=distances.shape))


@one_blas_thread()
def _settled(ties: csr_array, evidence: Evidence, light: _Hold) -> NDArray[np.float64]:
    """Return the x of ``(E + a I + L) x = E y + a u``, with L the Laplacian of the ties and a, u what holds lightly."""
    held = _EVIDENCE_WEIGHT * evidence.share
    diagonal = held + light.weight + np.asarray(ties.sum(axis=1)).ravel()
    solution, _ = cg(
        diags(diagonal) - ties,
        held * evidence.ground + light.weight * light.target,
        x0=np.where(held > 0, evidence.ground, light.target),
        M=diags(1 / diagonal),
        atol=0.0,
    )
    return np.asarray(solution)


def _labels(
    traversable: NDArray[np.float64], evidence: Evidence, pairs: tuple[NDArray[np.intp], ...], min_share: float
) -> NDArray[np.uint8]:
    """Return the label in each superpixel of what is ground, obstacle and unknown in short range, (3, n)."""
    if not evidence.share.any():
        return np.full((3, len(traversable)), UNKNOWN, np.uint8)
    bounds = np.array([[_OVERRULED_GROUND], [_OVERRULED_OBSTACLE], [min_share]])
    labels = np.where(traversable > bounds, np.uint8(GROUND), np.uint8(OBSTACLE))
    free = labels[2] == GROUND
    labels[2, free & ~_reached(free, evidence, pairs)] = UNKNOWN
    return labels


def _reached(free: NDArray[np.bool_], evidence: Evidence, pairs: tuple[NDArray[np.intp], ...]) -> NDArray[np.bool_]:
    """Return which free superpixels others that are free connect with ground of the short range."""
    first, second = pairs
    both = free[first] & free[second]
    graph = coo_array((both[both], (first[both], second[both])), shape=(len(free), len(free)))
    component = connected_components(graph, directed=False)[1]
    return np.isin(component, component[free & (evidence.share * evidence.ground > 0)])


def _confidences(labels: NDArray[np.uint8], traversable: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the confidence in each of the labels (3, n), a probability times 255."""
    ground = np.interp(traversable, _SURENESS, _RIGHT_GROUND)
    obstacle = np.interp(1 - traversable, _SURENESS, _RIGHT_OBSTACLE)
    right = np.stack(
        [
            np.where(labels[0] == GROUND, ground, 1 - ground),
            np.where(labels[1] == OBSTACLE, obstacle, 1 - obstacle),
            np.interp(np.where(labels[2] == GROUND, traversable, 1 - traversable), _SURENESS, _RIGHT_UNKNOWN),
        ]
    )
    right[labels == UNKNOWN] = 0
    return np.rint(255 * right).astype(np.uint8)
