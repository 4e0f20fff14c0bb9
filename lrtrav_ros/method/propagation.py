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

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.method import _propagation_kernels as kernels
from lrtrav_ros.method.comparison import Comparison, compare
from lrtrav_ros.method.extension import Layout, count_evidence, superpixel_layout
from lrtrav_ros.method.features import Features
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN
from lrtrav_ros.numerics.checks import check_array, check_labels, check_number, check_range, check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

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
_MOST = 1e3  # no logarithm of a ratio of colours, and no share of an image's height, is as large
_NO_VOTES = 1e-9
_REACH = 6.5  # in Gaussian standard deviations: farther away, a weight is below that
_TOLERANCE = 1e-5  # of the solution of the equations, relative
_LEAST_ROWS = 64  # of a matrix of weights, that are worth a thread
_LEAST_COLUMNS = 64  # of an image
_OVERRULED_GROUND = 0.25  # in superpixels that are less surely traversable: the feet of things, more often than not

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


@dataclass(frozen=True, slots=True, eq=False)
class Remembered:
    """What is known of m superpixels of other images, which vote and are not voted for.

    Parameters
    ----------
    features : Features
        What they look like.
    evidence : Evidence
        What is known of them.
    """

    features: Features
    evidence: Evidence


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


@dataclass(frozen=True, slots=True, eq=False)
class Ties:
    """Which of n superpixels are tied to which, and how strongly: a sparse matrix by rows, symmetric.

    Parameters
    ----------
    starts : (n + 1,) ndarray of int32
        Where the ties of each superpixel start in `others` and `weights`.
    ends : (n,) ndarray of int32
        Where those with its neighbours end; those with superpixels that look like it follow.
    others : (p,) ndarray of int32
        Superpixels.
    weights : (p,) ndarray of float64
        How strongly it is tied to each of them.
    """

    starts: NDArray[np.int32]
    ends: NDArray[np.int32]
    others: NDArray[np.int32]
    weights: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SuperpixelGraph:
    """All that propagation needs to know of an image before short range does: n superpixels, and how they are alike.

    Parameters
    ----------
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    features : Features
        What they look like.
    comparison : Comparison
        The distances between them.
    layout : Layout
        Where they are, and which are neighbours.
    votes : (n, m) ndarray of float32
        The weight that each has in the vote of m of them, the landmarks of `comparison`, for it.
    ties : Ties
        Those with neighbours, and with what looks alike.

    Raises
    ------
    TypeError, ValueError
        If an array has another type or shape, or numbers that are those of no superpixel.
    """

    superpixels: NDArray[np.int32]
    features: Features
    comparison: Comparison
    layout: Layout
    votes: NDArray[np.float32]
    ties: Ties

    def __post_init__(self) -> None:
        check_type("features", self.features, Features)
        _check_chromaticity(self.features)
        check_type("comparison", self.comparison, Comparison)
        check_type("layout", self.layout, Layout)
        check_type("ties", self.ties, Ties)
        n = len(self.features)
        check_array("superpixels", self.superpixels, np.int32, ("H", "W"))
        check_array("layout.area", self.layout.area, np.int64, (n,))
        check_array("layout.middles", self.layout.middles, np.float64, (n, 2))
        check_array("votes", self.votes, np.float32, (n, len(self.comparison.landmarks)))
        for name, rows in (("layout", self.layout), ("ties", self.ties)):
            check_array(f"{name}.others", rows.others, np.int32, ("p",), may_be_empty=True)
            check_array(f"{name}.starts", rows.starts, np.int32, (n + 1,))
            check_labels(f"{name}.starts", rows.starts, len(rows.others) + 1)
            if len(rows.others):
                check_labels(f"{name}.others", rows.others, n)
        check_array("ties.ends", self.ties.ends, np.int32, (n,))
        check_array("ties.weights", self.ties.weights, np.float64, self.ties.others.shape, may_be_empty=True)
        check_labels("ties.ends", self.ties.ends, len(self.ties.others) + 1)

    @property
    def places(self) -> NDArray[np.float64]:
        """Row and column of the superpixels' middles, as shares of the image's height, (n, 2)."""
        return self.layout.middles / self.superpixels.shape[0]


def superpixel_graph(
    superpixels: NDArray[np.int32],
    features: Features,
    config: FeaturesConfig | None = None,
    *,
    team: ThreadTeam = ALONE,
) -> SuperpixelGraph:
    """Return how the superpixels of an image are alike, and which are neighbours.

    Parameters
    ----------
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    features : Features
        Of the n superpixels.
    config : FeaturesConfig, optional
        By what they are compared; the defaults are the best of [2].
    team : ThreadTeam, optional
        The threads that share the work; the result does not depend on it.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    check_type("features", features, Features)
    _check_chromaticity(features)
    with team.start(superpixel_layout, superpixels, len(features)) as started:
        comparison = compare(features, config)
        distances = comparison.with_landmarks(team)
        layout = started.result()
    superpixels = np.ascontiguousarray(superpixels)
    ties = _ties(layout, superpixels.shape[0], comparison, distances, features.chromaticity, team)
    looks = _vote_looks(features)
    _weigh(distances, looks, np.take(looks, comparison.landmarks, axis=1), team)
    return SuperpixelGraph(superpixels, features, comparison, layout, distances, ties)


def propagate(
    occupancy: NDArray[np.uint8],
    graph: SuperpixelGraph,
    *,
    remembered: Remembered | None = None,
    before: Belief | None = None,
    min_share: float = 0.5,
    team: ThreadTeam = ALONE,
) -> Propagation:
    """Extend short-range ground over superpixels that look like it and are near it.

    What short range takes for an obstacle stays one, and what it takes for ground stays ground unless its superpixel
    surely is none. Every other pixel is as its superpixel. Superpixels that are traversable, but that no traversable
    ones connect with ground of the short range, are unknown.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Short range: 0 ground, 100 obstacle, 255 unknown.
    graph : SuperpixelGraph
        Of the same image.
    remembered : Remembered, optional
        Superpixels of the frames before.
    before : Belief, optional
        What was found in the frame before: superpixels are held lightly by it where they look alike at the same place.
    min_share : float
        What is surer than this is traversable: raise it to claim less ground.
    team : ThreadTeam, optional
        The threads that share the work; the result does not depend on it.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    check_type("graph", graph, SuperpixelGraph)
    check_array("occupancy", occupancy, np.uint8, graph.superpixels.shape)
    check_number("min_share", min_share)
    check_type("remembered", remembered, Remembered, may_be_none=True)
    check_type("before", before, Belief, may_be_none=True)
    if before is not None:
        _check_belief(before)
    occupancy = np.ascontiguousarray(occupancy)
    evidence = _evidence(occupancy, graph)
    vote = _votes(graph, evidence, remembered, team)
    light = _held(vote, before, graph.places, graph.features.chromaticity)
    traversable = np.clip(_settled(graph.ties, evidence, light), 0, 1)
    if not np.isfinite(traversable).all():
        raise ValueError("graph holds votes or ties that are not finite; give one of superpixel_graph")
    labels = _labels(traversable, evidence, graph.layout, min_share)
    extended, confidence = _labelled(occupancy, graph.superpixels, labels, _confidences(labels, traversable), team)
    belief = Belief(graph.places, graph.features.chromaticity, traversable)
    return Propagation(extended, confidence, evidence, belief)


def _check_chromaticity(features: Features) -> None:
    """Check the part of features that `compare` does not, and that there are features."""
    check_array("colour", features.colour, (np.float32, np.float64), ("n", "bins"))
    check_array("chromaticity", features.chromaticity, np.float64, (len(features), 2))
    check_range("chromaticity", features.chromaticity, -_MOST, _MOST)


def _check_remembered(remembered: Remembered) -> int:
    """Check what is remembered, but for its histograms, and return of how many superpixels it is."""
    check_type("remembered.features", remembered.features, Features)
    check_type("remembered.evidence", remembered.evidence, Evidence)
    colour = remembered.features.colour
    check_array("remembered.colour", colour, (np.float32, np.float64), ("n", "bins"), may_be_empty=True)
    evidence, n = remembered.evidence, len(colour)
    if not n:
        return 0
    _check_chromaticity(remembered.features)
    for name, values in (("remembered.share", evidence.share), ("remembered.ground", evidence.ground)):
        check_array(name, values, np.float64, (n,))
        check_range(name, values, 0, 1)
    return n


def _check_belief(belief: Belief) -> None:
    """Check what was found in the frame before."""
    check_array("before.traversable", belief.traversable, np.float64, ("n",), may_be_empty=True)
    n = len(belief.traversable)
    shapes = (("places", belief.places, (n, 2)), ("chromaticity", belief.chromaticity, (n, 2)))
    for name, values, shape in (*shapes, ("traversable", belief.traversable, (n,))):
        check_array(f"before.{name}", values, np.float64, shape, may_be_empty=True)
        check_range(f"before.{name}", values, -_MOST, _MOST)


def _evidence(occupancy: NDArray[np.uint8], graph: SuperpixelGraph) -> Evidence:
    """Return the evidence in each superpixel."""
    ground, obstacle, area = count_evidence(occupancy, graph.superpixels, len(graph.features))
    judged = ground + obstacle
    says = np.divide(ground, judged, out=np.full(len(area), _UNDECIDED), where=judged > 0)
    return Evidence(judged / np.maximum(area, 1), says)


def _votes(
    graph: SuperpixelGraph, evidence: Evidence, remembered: Remembered | None, team: ThreadTeam
) -> NDArray[np.float64]:
    """Return the share of ground among superpixels with evidence, weighted by how much they look alike."""
    total, ground = np.full((2, len(evidence)), _STRANGER_WEIGHT)
    ground *= _STRANGER
    marks = graph.comparison.landmarks
    voters = [(graph.votes, Evidence(evidence.share[marks], evidence.ground[marks]))]
    if remembered is not None and _check_remembered(remembered):
        weights = graph.comparison.with_others(remembered.features, team)
        _weigh(weights, _vote_looks(graph.features), _vote_looks(remembered.features), team)
        voters.append((weights, remembered.evidence))
    for weights, known in voters:
        share = known.share.astype(np.float32)
        kernels.add_votes(weights, share, (known.share * known.ground).astype(np.float32), total, ground)
    with np.errstate(invalid="ignore"):  # what is not finite is refused in the end
        return ground / total


def _vote_looks(features: Features) -> NDArray[np.float32]:
    """Return chromaticity in units of that which makes votes count less, (2, n)."""
    return np.ascontiguousarray(features.chromaticity.T / _VOTE_CHROMATICITY, np.float32)


def _weigh(
    distances: NDArray[np.float32], looks: NDArray[np.float32], others: NDArray[np.float32], team: ThreadTeam
) -> None:
    """Replace distances by the weights of votes, in place."""
    scale = np.float32(1 / _VOTE_DISTANCE)

    def weigh(first: int, last: int) -> None:
        kernels.weigh(distances, scale, looks, others, first, last)

    team.for_bands(weigh, len(distances), least_rows=_LEAST_ROWS)


def _ties(
    layout: Layout,
    height: int,
    comparison: Comparison,
    distances: NDArray[np.float32],
    chromaticity: NDArray[np.float64],
    team: ThreadTeam,
) -> Ties:
    """Return the ties between superpixels that touch, and between those that look alike."""
    weights = _neighbour_weights(layout, comparison, distances)
    looks = np.stack([*(chromaticity.T / _TIE_CHROMATICITY), layout.middles[:, 0] / height / _TIE_ROWS])
    n_ties = min(_N_TIES, len(comparison.landmarks) - 1)
    tied, squared = np.zeros((len(distances), n_ties), np.int64), np.zeros((len(distances), n_ties), np.float32)
    scale, places = np.float32(1 / _TIE_DISTANCE), looks.astype(np.float32)

    def find(first: int, last: int) -> None:
        kernels.nearest(distances, scale, places, comparison.landmarks, first, last, tied, squared)

    if n_ties:
        team.for_bands(find, len(distances), least_rows=_LEAST_ROWS)
    tie_weights = np.float32(_TIE_WEIGHT / 2) * np.exp(squared / -2)
    return Ties(*kernels.join_ties(layout.starts, layout.others, weights, comparison.landmarks[tied], tie_weights))


def _neighbour_weights(layout: Layout, comparison: Comparison, distances: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return how strongly each superpixel is tied to each neighbour: more where they look alike."""
    first, second = layout.pairs
    has_all = distances.shape[1] == len(distances)
    apart = distances[first, second] if has_all else comparison.of_pairs(first, second)
    scale = np.float32(_NEIGHBOUR_SCALE) * np.median(apart) if apart.size else np.float32(0)
    return np.exp((apart / scale) ** 2 / -2) if scale > 0 else (apart == 0).astype(np.float32)


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
    now = _looks_at_places(places, chromaticity)
    then = _looks_at_places(before.places, before.chromaticity)
    in_order = np.argsort(then[0], kind="stable")
    values = before.traversable[in_order].astype(np.float32)
    alike, total, found = np.empty((3, len(vote)))
    kernels.recognise(now, np.take(then, in_order, axis=1), values, np.float32(_REACH), alike, total, found)
    weight = _BELIEF_WEIGHT * alike
    found = np.divide(found, total, out=vote.copy(), where=total > _NO_VOTES)
    return _Hold(held + weight, (held * vote + weight * found) / (held + weight))


def _looks_at_places(places: NDArray[np.float64], chromaticity: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return places and chromaticity, (4, n), in units of what tells superpixels from those of the frame before."""
    return np.concatenate([places.T / _SAME_PLACE, chromaticity.T / _VOTE_CHROMATICITY]).astype(np.float32)


def _settled(ties: Ties, evidence: Evidence, light: _Hold) -> NDArray[np.float64]:
    """Return the mean of the x of ``(E + a I + L) x = E y + a u``, L the Laplacian of the ties, a and u the light hold.

    In the first solution superpixels are tied to their neighbours, in the second to those that look alike too.
    """
    firm = _EVIDENCE_WEIGHT * evidence.share
    held, right = firm + light.weight, firm * evidence.ground + light.weight * light.target
    first = np.where(firm > 0, evidence.ground, light.target)
    kernels.settle(ties.starts, ties.ends, ties.others, ties.weights, held, right, _TOLERANCE, first)
    second = first.copy()
    kernels.settle(ties.starts, ties.starts[1:], ties.others, ties.weights, held, right, _TOLERANCE, second)
    return (first + second) / 2


def _labels(
    traversable: NDArray[np.float64], evidence: Evidence, layout: Layout, min_share: float
) -> NDArray[np.uint8]:
    """Return the label in each superpixel of what is ground, obstacle and unknown in short range, (3, n)."""
    if not evidence.share.any():
        return np.full((3, len(traversable)), UNKNOWN, np.uint8)
    labels = np.full((3, len(traversable)), OBSTACLE, np.uint8)  # obstacles of the short range stay
    labels[0, traversable > _OVERRULED_GROUND] = GROUND
    labels[2, traversable > min_share] = GROUND
    free = labels[2] == GROUND
    reached = free & (evidence.share * evidence.ground > 0)
    kernels.spread(layout.starts, layout.others, free, reached)
    labels[2, free & ~reached] = UNKNOWN
    return labels


def _confidences(labels: NDArray[np.uint8], traversable: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the confidence in each of the labels (3, n), a probability times 255."""
    ground = np.interp(traversable, _SURENESS, _RIGHT_GROUND)
    obstacle = np.interp(1 - traversable, _SURENESS, _RIGHT_OBSTACLE)
    right = np.stack(
        [
            np.where(labels[0] == GROUND, ground, 1 - ground),
            obstacle,
            np.interp(np.where(labels[2] == GROUND, traversable, 1 - traversable), _SURENESS, _RIGHT_UNKNOWN),
        ]
    )
    right[labels == UNKNOWN] = 0
    return np.rint(255 * right).astype(np.uint8)


def _labelled(
    occupancy: NDArray[np.uint8],
    superpixels: NDArray[np.int32],
    labels: NDArray[np.uint8],
    confidences: NDArray[np.uint8],
    team: ThreadTeam,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the label and the confidence of each pixel."""
    table = (labels + np.uint16(256) * confidences).T.ravel()
    extended, confidence = np.empty_like(occupancy), np.empty_like(occupancy)

    def label(first: int, last: int) -> None:
        kernels.label_pixels(occupancy, superpixels, table, GROUND, OBSTACLE, first, last, extended, confidence)

    team.for_bands(label, occupancy.shape[1], least_rows=_LEAST_COLUMNS)
    return extended, confidence
