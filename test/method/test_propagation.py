"""Tests of propagation, on grids and strips of superpixels whose looks are given, and on rendered textures."""

from __future__ import annotations

from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import FeaturesConfig
from lrtrav_ros.method import comparison, propagation
from lrtrav_ros.method.features import Features, superpixel_features
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN
from lrtrav_ros.method.propagation import (
    Belief,
    Evidence,
    Propagation,
    Remembered,
    SuperpixelGraph,
    Ties,
    propagate,
    superpixel_graph,
)
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

CELL = (6, 8)  # rows and columns of a superpixel
WAY, GRASS = 0.0, 0.6  # looks: positions on a line, whose differences are distances


def grid(rows: int, columns: int) -> NDArray[np.int32]:
    """Return superpixels of CELL pixels in a grid, numbered row by row."""
    labels = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    return labels.repeat(CELL[0], axis=0).repeat(CELL[1], axis=1)


def short_range(*rows: str) -> NDArray[np.uint8]:
    """Return an occupancy image with a superpixel a letter: g ground, o obstacle, anything else unknown."""
    values = np.array([[{"g": GROUND, "o": OBSTACLE}.get(letter, UNKNOWN) for letter in row] for row in rows], np.uint8)
    return values.repeat(CELL[0], axis=0).repeat(CELL[1], axis=1)


def looks(*rows: str, spread: float = 0.02) -> NDArray[np.float64]:
    """Return the look of each superpixel: w is way, b grass, m in the middle of both, each a little different."""
    positions = np.array([{"w": WAY, "b": GRASS, "m": (WAY + GRASS) / 2}[letter] for row in rows for letter in row])
    return positions + np.random.default_rng(0).uniform(-spread, spread, len(positions))


def between(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.abs(positions[:, None] - positions)


@dataclass
class Given:
    """Distances that are given, those of the image's superpixels first, then those of m remembered ones."""

    distances: NDArray[np.float64]
    m: int

    @property
    def landmarks(self) -> NDArray[np.intp]:
        return np.arange(len(self.distances) - self.m)

    def with_landmarks(self, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        n = len(self.landmarks)
        return self.distances[:n, :n].astype(np.float32)

    def with_others(self, others: Features, team: ThreadTeam = ALONE) -> NDArray[np.float32]:
        n = len(self.landmarks)
        return self.distances[:n, n:].astype(np.float32)

    def of_pairs(self, first: NDArray[np.intp], second: NDArray[np.intp]) -> NDArray[np.float32]:
        return self.distances[first, second].astype(np.float32)


def of_chromaticity(chromaticity: NDArray[np.float64]) -> Features:
    flat = np.full((len(chromaticity), 2), 0.5, np.float32)
    return Features(flat, flat, chromaticity)


def given_graph(
    superpixels: NDArray[np.int32], distances: NDArray[np.float64], chromaticity: NDArray[np.float64], m: int = 0
) -> SuperpixelGraph:
    """Return the graph of superpixels with these distances, of which the last m are remembered ones."""
    n = len(distances) - m
    with patch.object(propagation, "compare", return_value=Given(distances, m)):
        return superpixel_graph(superpixels, of_chromaticity(chromaticity[:n]))


def propagated(
    occupancy: NDArray[np.uint8],
    positions: NDArray[np.float64],
    *,
    remembered: Evidence | None = None,
    before: Belief | None = None,
    min_share: float = 0.5,
) -> Propagation:
    """Propagate over a grid of superpixels of these looks, the remembered ones last, all of the same chromaticity."""
    m = 0 if remembered is None else len(remembered)
    superpixels = grid(occupancy.shape[0] // CELL[0], occupancy.shape[1] // CELL[1])
    graph = given_graph(superpixels, between(positions), np.zeros((len(positions), 2)), m)
    return propagate(
        occupancy,
        graph,
        remembered=remembered and Remembered(of_chromaticity(np.zeros((m, 2))), remembered),
        before=before,
        min_share=min_share,
    )


def letters(found: NDArray[np.uint8]) -> list[str]:
    """Return an occupancy image as `short_range` takes it; all pixels of a superpixel have to agree."""
    cells = found.reshape(found.shape[0] // CELL[0], CELL[0], -1, CELL[1]).transpose(0, 2, 1, 3)
    assert (cells == cells[:, :, :1, :1]).all()
    names = {GROUND: "g", OBSTACLE: "o", UNKNOWN: "."}
    return ["".join(names[value] for value in row) for row in cells[:, :, 0, 0].tolist()]


SCENE = ("wwwbb", "wwwbb", "wwwbb", "wwwbb")
KNOWN = (".....", ".....", ".....", "gggoo")  # near


def test_far_superpixels_are_as_near_ones_that_look_like_them() -> None:
    found = propagated(short_range(*KNOWN), looks(*SCENE))
    assert letters(found.occupancy) == ["gggoo"] * 4
    sure = found.belief.traversable.reshape(4, 5)
    assert sure[:, :3].min() > 0.9
    assert sure[:, 3:].max() < 0.1


def test_superpixels_of_one_texture_are_told_apart_by_their_chromaticity() -> None:
    superpixels = grid(4, 5)
    positions = looks(*SCENE) / 3
    chromaticity = np.stack([positions, -positions], axis=1)
    alike = between(looks("wwwww", "wwwww", "wwwww", "wwwww"))
    found = propagate(short_range(*KNOWN), given_graph(superpixels, alike, chromaticity))
    assert letters(found.occupancy) == ["gggoo"] * 4


def test_result_does_not_depend_on_the_numbers_of_the_superpixels() -> None:
    superpixels, positions = grid(4, 5), looks(*SCENE)
    numbers = np.random.default_rng(1).permutation(20).astype(np.int32)
    renumbered = np.empty(20)
    renumbered[numbers] = positions
    found = propagated(short_range(*KNOWN), positions)
    graph = given_graph(numbers[superpixels], between(renumbered), np.zeros((20, 2)))
    other = propagate(short_range(*KNOWN), graph)
    np.testing.assert_array_equal(other.occupancy, found.occupancy)
    np.testing.assert_allclose(other.belief.traversable[numbers], found.belief.traversable, atol=1e-4)


def test_evidence_of_a_superpixel_is_counted() -> None:
    occupancy = short_range(*KNOWN)
    occupancy[-6:-3, :8] = UNKNOWN  # half of the first superpixel of the last row
    occupancy[-3, :8] = OBSTACLE  # a third of what is left
    evidence = propagated(occupancy, looks(*SCENE)).evidence
    assert len(evidence) == 20
    np.testing.assert_array_equal(evidence.share, [0] * 15 + [0.5, 1, 1, 1, 1])
    np.testing.assert_allclose(evidence.ground, [0.5] * 15 + [2 / 3, 1, 1, 0, 0])


def test_evidence_stands_in_superpixels_that_are_of_both_kinds() -> None:
    occupancy = short_range(*KNOWN)
    occupancy[-6:, 16:20], occupancy[-6:, 20:22] = OBSTACLE, UNKNOWN  # of the third superpixel of the last row
    found = propagated(occupancy, looks(*SCENE))
    known = occupancy != UNKNOWN
    np.testing.assert_array_equal(found.occupancy[known], occupancy[known])
    assert 0.3 < found.belief.traversable[17] < 0.7
    assert len(np.unique(found.occupancy[-6:, 20:22])) == 1


def test_single_pixels_of_ground_are_overruled_by_an_obstacle_all_around() -> None:
    occupancy = short_range("....", "oooo", "gggg")
    occupancy[8, 10] = GROUND
    found = propagated(occupancy, looks("bbbb", "bbbb", "wwww"))
    assert found.belief.traversable[5] < 0.05
    assert found.occupancy[8, 10] == OBSTACLE
    assert letters(found.occupancy) == ["oooo", "oooo", "gggg"]


def test_without_evidence_nothing_is_known() -> None:
    found = propagated(short_range(".....", ".....", ".....", "....."), looks(*SCENE))
    assert letters(found.occupancy) == ["....."] * 4
    np.testing.assert_allclose(found.belief.traversable, 0.3, atol=1e-6)  # strangers are rather not traversable
    assert not found.confidence.any()


@pytest.mark.parametrize(("letter", "expected"), [("g", 1.0), ("o", 0.0)])
def test_evidence_of_one_kind_decides_all(letter: str, expected: float) -> None:
    found = propagated(short_range(".....", ".....", ".....", letter * 5), looks(*SCENE))
    np.testing.assert_allclose(found.belief.traversable, expected, atol=3e-3)
    assert letters(found.occupancy) == [letter * 5] * 4


def test_what_looks_free_but_is_cut_off_from_near_ground_is_unknown() -> None:
    near = short_range("......", "......", "ggo...")
    apart = propagated(near, looks("wwbbww", "wwbbww", "wwbbww"))
    assert apart.belief.traversable.reshape(3, 6)[:, 4:].min() > 0.8
    assert letters(apart.occupancy) == ["ggoo..", "ggoo..", "ggoo.."]
    joined = propagated(near, looks("wwwwww", "wwbbww", "wwbbww"))
    assert letters(joined.occupancy) == ["gggggg", "ggoogg", "ggoogg"]


def test_corners_do_not_connect() -> None:
    found = propagated(short_range("....", "gg.o", "gg.o"), looks("bbww", "wwbb", "wwbb"))
    assert letters(found.occupancy)[0] == "oo.."


UNDECIDED = ("g.o", looks("wmb", spread=0))  # what is in the middle looks as much like the one as like the other


def test_what_is_in_the_middle_is_undecided() -> None:
    row, positions = UNDECIDED
    middle = propagated(short_range(row), positions).belief.traversable[1]
    assert 0.48 < middle <= 0.5  # a little below, for what looks like little known is rather none to drive on


@pytest.mark.parametrize(("ground", "expected"), [(1.0, "ggo"), (0.0, "goo")])
def test_remembered_evidence_decides_what_is_undecided(ground: float, expected: str) -> None:
    row, positions = UNDECIDED
    remembered = Evidence(np.ones(3), np.full(3, ground))
    found = propagated(short_range(row), np.append(positions, [positions[1]] * 3), remembered=remembered)
    assert letters(found.occupancy) == [expected]
    assert abs(found.belief.traversable[1] - 0.5) > 0.03
    assert (len(found.belief.traversable), len(found.evidence)) == (3, 3)
    np.testing.assert_array_equal(found.evidence.share, [1, 0, 1])  # of the image alone


def test_remembered_evidence_of_other_looks_changes_nothing() -> None:
    row, positions = UNDECIDED
    remembered = Evidence(np.ones(3), np.zeros(3))
    found = propagated(short_range(row), np.append(positions, [5.0] * 3), remembered=remembered)
    np.testing.assert_allclose(
        found.belief.traversable, propagated(short_range(row), positions).belief.traversable, atol=1e-6
    )


@pytest.mark.parametrize(("apart", "decides"), [(0.0, True), (0.5, False)])
def test_what_looks_alike_but_for_its_chromaticity_does_not_vote(apart: float, decides: bool) -> None:
    row, positions = UNDECIDED
    distances = between(np.append(positions, positions[1]))
    chromaticity = np.array([[0, 0], [0, 0], [0, 0], [apart, 0]])
    remembered = Remembered(of_chromaticity(chromaticity[3:]), Evidence(np.ones(1), np.ones(1)))
    found = propagate(short_range(row), given_graph(grid(1, 3), distances, chromaticity, 1), remembered=remembered)
    assert (found.belief.traversable[1] > 0.52) == decides


@pytest.mark.parametrize(("near", "far"), ["go", "og"])
def test_what_looks_alike_counts_more_at_the_same_height(near: str, far: str) -> None:
    positions = looks("bbm", *["bbb"] * 10, "mbm")
    found = propagated(short_range(f"..{far}", *["..."] * 10, f"{near}.."), positions)
    sure = found.belief.traversable[-1]  # as much like the one with evidence far above as like the one in its own row
    assert (sure > 0.6) if near == "g" else (sure < 0.4)


def test_weak_evidence_counts_less() -> None:
    row, positions = UNDECIDED
    weak = short_range(row)
    weak[:, 2 * CELL[1] + 2 :] = UNKNOWN  # a quarter of the obstacle is left
    assert propagated(weak, positions).belief.traversable[1] > 0.55


@pytest.mark.parametrize(("min_share", "expected"), [(0.4, "ggo"), (0.6, "goo")])
def test_share_that_makes_a_superpixel_traversable(min_share: float, expected: str) -> None:
    row, positions = UNDECIDED
    assert letters(propagated(short_range(row), positions, min_share=min_share).occupancy) == [expected]


@pytest.mark.parametrize(("sure", "expected"), [(1.0, "ggo"), (0.0, "goo")])
def test_what_was_found_before_decides_what_is_undecided(sure: float, expected: str) -> None:
    row, positions = UNDECIDED
    first = propagated(short_range(row), positions)
    before = Belief(first.belief.places, first.belief.chromaticity, np.full(3, sure))
    found = propagated(short_range(row), positions, before=before)
    assert letters(found.occupancy) == [expected]
    assert abs(found.belief.traversable[1] - 0.5) > 0.03


@pytest.mark.parametrize(("moved", "tinted"), [(1.0, 0.0), (0.0, 1.0)])
def test_what_was_found_elsewhere_or_of_another_colour_changes_nothing(moved: float, tinted: float) -> None:
    row, positions = UNDECIDED
    first = propagated(short_range(row), positions).belief
    before = Belief(first.places + np.array([10 * moved, 0]), first.chromaticity + tinted, np.ones(3))
    found = propagated(short_range(row), positions, before=before)
    np.testing.assert_allclose(found.belief.traversable, first.traversable, atol=1e-6)


def test_evidence_outweighs_what_was_found_before() -> None:
    first = propagated(short_range(*KNOWN), looks(*SCENE)).belief
    before = Belief(first.places, first.chromaticity, 1 - first.traversable)
    found = propagated(short_range(*KNOWN), looks(*SCENE), before=before)
    assert letters(found.occupancy)[-1] == KNOWN[-1]


def test_places_are_the_middles_of_superpixels_in_heights_of_the_image() -> None:
    found = propagated(short_range(*KNOWN), looks(*SCENE)).belief
    rows, columns = np.divmod(np.arange(20), 5)
    middles = np.stack([rows * CELL[0] + (CELL[0] - 1) / 2, columns * CELL[1] + (CELL[1] - 1) / 2], axis=1)
    np.testing.assert_allclose(found.places, middles / (4 * CELL[0]))


@pytest.mark.parametrize(("letter", "expected"), [("g", GROUND), ("o", OBSTACLE), (".", UNKNOWN)])
def test_one_superpixel_only(letter: str, expected: int) -> None:
    occupancy = short_range(letter)
    occupancy[2:, :] = UNKNOWN
    found = propagated(occupancy, np.zeros(1))
    np.testing.assert_array_equal(found.occupancy, np.full(CELL, expected))
    assert (found.confidence[3, 3] == 0) == (expected == UNKNOWN)


def test_confidence_is_zero_exactly_where_nothing_is_known_and_grows_with_sureness() -> None:
    found = propagated(short_range("......", "......", "ggo..."), looks("wwbbww", "wwbbww", "wwbmww"))
    assert found.confidence.dtype == np.uint8
    np.testing.assert_array_equal(found.confidence == 0, found.occupancy == UNKNOWN)
    row, positions = UNDECIDED
    strip = propagated(short_range(row), positions)
    assert strip.confidence[0, 0] > strip.confidence[0, CELL[1]]
    assert strip.confidence[0, -1] > strip.confidence[0, CELL[1]]


def test_settled_votes_solve_the_system_of_equations() -> None:
    rng = np.random.default_rng(2)
    n = 9
    ties = np.triu(rng.uniform(0, 1, (n, n)) * (rng.random((n, n)) < 0.5), 1)
    ties += ties.T
    evidence = Evidence(rng.uniform(0, 1, n) * (np.arange(n) % 3 == 0), rng.uniform(0, 1, n))
    light = propagation._Hold(rng.uniform(0.1, 0.5, n), rng.uniform(0, 1, n))
    held = propagation._EVIDENCE_WEIGHT * evidence.share
    system = np.diag(held) + np.diag(light.weight) + np.diag(ties.sum(axis=1)) - ties
    expected = np.linalg.solve(system, held * evidence.ground + light.weight * light.target)
    first, second = np.nonzero(ties)
    starts = np.searchsorted(first, np.arange(n + 1)).astype(np.int32)
    alone = Ties(starts, starts[1:], second.astype(np.int32), ties[first, second])
    np.testing.assert_allclose(propagation._settled(alone, evidence, light), expected, atol=1e-4)
    untied = np.divide(held * evidence.ground + light.weight * light.target, held + light.weight)
    none_with_neighbours = Ties(starts, starts[:-1], second.astype(np.int32), ties[first, second])
    found = propagation._settled(none_with_neighbours, evidence, light)
    np.testing.assert_allclose(found, (untied + expected) / 2, atol=1e-4)


def test_grey_images_are_told_apart_by_texture_and_brightness() -> None:
    rng = np.random.default_rng(0)
    superpixels = grid(4, 5)
    way = superpixels % 5 < 3
    image = np.where(way, rng.normal(120, 3, way.shape), rng.normal(80, 25, way.shape)).clip(0, 255).astype(np.uint8)
    features = superpixel_features(image, superpixels)
    found = propagate(short_range(*KNOWN), superpixel_graph(superpixels, features))
    assert letters(found.occupancy) == ["gggoo"] * 4


def test_belief_that_is_none_is_refused() -> None:
    places, looks, traversable = np.zeros((2, 2)), np.zeros((2, 2)), np.array([0.5, np.nan])
    with pytest.raises(ValueError, match=r"before\.traversable holds values from nan to nan; give "):
        propagation._check_belief(propagation.Belief(places, looks, traversable))
    with pytest.raises(ValueError, match=r"before\.places is float64 \(1, 2\)"):
        propagation._check_belief(propagation.Belief(places[:1], looks, np.zeros(2)))


def test_confidence_is_of_the_label_whatever_the_threshold() -> None:
    traversable = np.array([0.74, 0.26])
    labels = np.array([[0, 0], [100, 100], [100, 0]], np.uint8)  # those of thresholds far from 0.5
    assert (propagation._confidences(labels, traversable)[2] < 128).all()


def test_a_vote_of_nothing_alike_is_rather_against() -> None:
    evidence = Evidence(np.array([1.0, 1.0, 0.0]), np.array([1.0, 1.0, 0.5]))
    distances = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0]])  # the last is like neither
    graph = given_graph(grid(1, 3), distances, np.zeros((3, 2)))
    vote = propagation._votes(graph, evidence, None, ALONE)
    assert vote[2] == pytest.approx(0.3, abs=0.01)
    assert vote[0] > 0.99


def test_votes_are_weighted_by_distance_and_chromaticity() -> None:
    rng = np.random.default_rng(3)
    positions, chromaticity = rng.uniform(0, 0.3, 50), rng.normal(0, 0.05, (50, 2))
    evidence = Evidence(rng.uniform(0, 1, 50), rng.uniform(0, 1, 50))
    distances = between(positions)
    tint = np.linalg.norm(chromaticity[:, None] - chromaticity, axis=2)
    weights = np.exp(-((distances / 0.1) ** 2 + (tint / 0.05) ** 2) / 2)
    ground, total = weights @ (evidence.share * evidence.ground), weights @ evidence.share
    graph = given_graph(grid(5, 10), distances, chromaticity)
    found = propagation._votes(graph, evidence, None, ALONE)
    np.testing.assert_allclose(found, (ground + 0.01 * 0.3) / (total + 0.01), rtol=2e-5)


def test_ties_are_with_the_eight_most_alike_at_the_same_height() -> None:
    rng = np.random.default_rng(4)
    n = 60
    positions, chromaticity = rng.uniform(0, 0.5, n), rng.normal(0, 0.05, (n, 2))
    graph = given_graph(grid(6, 10), between(positions), chromaticity)
    tint = np.linalg.norm(chromaticity[:, None] - chromaticity, axis=2)
    rows = graph.places[:, 0]
    squared = (between(positions) / 0.2) ** 2 + (tint / 0.03) ** 2 + (between(rows) / 0.2) ** 2
    np.fill_diagonal(squared, np.inf)
    expected = np.zeros((n, n))
    for i, others in enumerate(np.argsort(squared, axis=1)[:, :8]):
        expected[i, others] += 1.5 * np.exp(squared[i, others] / -2)
        expected[others, i] += 1.5 * np.exp(squared[i, others] / -2)
    found = np.zeros((n, n))
    for i in range(n):
        those = slice(graph.ties.ends[i], graph.ties.starts[i + 1])
        np.add.at(found[i], graph.ties.others[those], graph.ties.weights[those])
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-6)


def test_ties_with_neighbours_are_scaled_by_the_median_distance() -> None:
    ties = given_graph(grid(1, 4), between(np.array([0, 0.1, 0.3, 0.4])), np.zeros((4, 2))).ties
    near, apart = np.exp(-((0.1 / 0.12) ** 2) / 2), np.exp(-((0.2 / 0.12) ** 2) / 2)
    found = [
        dict(zip(ties.others[start:end].tolist(), ties.weights[start:end].tolist(), strict=True))
        for start, end in zip(ties.starts[:-1], ties.ends, strict=True)
    ]
    expected = [{1: near}, {0: near, 2: apart}, {1: apart, 3: near}, {2: near}]
    for of_superpixel, those in zip(found, expected, strict=True):
        assert of_superpixel == pytest.approx(those, rel=1e-5)


def test_belief_is_weighted_by_place_and_chromaticity() -> None:
    rng = np.random.default_rng(5)
    vote, places, tints = rng.uniform(0, 1, 30), rng.uniform(0, 1, (30, 2)), rng.normal(0, 0.05, (30, 2))
    before = Belief(rng.uniform(0, 1, (40, 2)), rng.normal(0, 0.05, (40, 2)), rng.uniform(0, 1, 40))
    apart = np.linalg.norm(places[:, None] - before.places, axis=2) / 0.03
    tint = np.linalg.norm(tints[:, None] - before.chromaticity, axis=2) / 0.05
    alike = np.exp(-(apart**2 + tint**2) / 2)
    held, weight = 0.2 + 0.4 * (2 * vote - 1) ** 2, 0.5 * alike.max(axis=1)
    said = alike @ before.traversable / alike.sum(axis=1)
    found = propagation._held(vote, before, places, tints)
    np.testing.assert_allclose(found.weight, held + weight, rtol=1e-4)
    np.testing.assert_allclose(found.target, (held * vote + weight * said) / (held + weight), rtol=1e-4)


def noisy_scene(
    n_rows: int, n_columns: int, noise: float = 12
) -> tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.uint8]]:
    """Return an image of way and grass, its superpixels, and a short range that knows the last two rows of them."""
    rng = np.random.default_rng(6)
    superpixels = grid(n_rows, n_columns)
    way = superpixels % n_columns < n_columns // 2
    colours = np.where(way[..., None], [110, 115, 120], [50, 130, 80])
    image = (colours + rng.normal(0, noise, colours.shape)).clip(0, 255).astype(np.uint8)
    known = np.where(way, np.uint8(GROUND), np.uint8(OBSTACLE))
    known[: -2 * CELL[0]] = UNKNOWN
    return image, superpixels, known


@pytest.mark.parametrize("bound", [640, 40])
def test_result_does_not_depend_on_the_number_of_threads(bound: int) -> None:
    image, superpixels, known = noisy_scene(12, 16)
    found = []
    with patch.object(comparison, "MAX_LANDMARKS", bound):
        for team in (ALONE, ThreadTeam(2), ThreadTeam(3)):
            features = superpixel_features(image, superpixels, team=team)
            graph = superpixel_graph(superpixels, features, team=team)
            remembered = Remembered(features.chosen(np.arange(0, 192, 5)), Evidence(np.full(39, 0.2), np.full(39, 0.5)))
            found.append(propagate(known, graph, remembered=remembered, team=team))
    for other in found[1:]:
        np.testing.assert_array_equal(other.belief.traversable, found[0].belief.traversable)
        np.testing.assert_array_equal(other.occupancy, found[0].occupancy)
        np.testing.assert_array_equal(other.confidence, found[0].confidence)


def test_few_landmarks_find_what_all_superpixels_find() -> None:
    image, superpixels, known = noisy_scene(12, 16, noise=4)
    features = superpixel_features(image, superpixels)
    everything = propagate(known, superpixel_graph(superpixels, features))
    with patch.object(comparison, "MAX_LANDMARKS", 40):
        graph = superpixel_graph(superpixels, features)
    assert graph.votes.shape == (192, 40)
    found = propagate(known, graph)
    np.testing.assert_array_equal(found.occupancy, everything.occupancy)
    np.testing.assert_allclose(found.belief.traversable, everything.belief.traversable, atol=0.1)
    assert (everything.occupancy[:, :64] == GROUND).all()
    assert (everything.occupancy[:, 64:] == OBSTACLE).all()


def test_remembered_superpixels_have_the_same_histograms() -> None:
    image, superpixels, known = noisy_scene(3, 4)
    features = superpixel_features(image, superpixels)
    other = superpixel_features(image, superpixels, FeaturesConfig(texture="cs_lbp"))
    for distance in ("correlation", "chi_square"):
        graph = superpixel_graph(superpixels, features, FeaturesConfig(distance=distance))
        with pytest.raises(ValueError, match=r"texture of the others is float32 \(12, 16\); give .* \(12, 256\)"):
            propagate(known, graph, remembered=Remembered(other, Evidence(np.ones(12), np.ones(12))))


def test_remembered_superpixels_of_the_image_itself_vote_as_its_own() -> None:
    image, superpixels, _ = noisy_scene(3, 4)
    features = superpixel_features(image, superpixels)
    graph = superpixel_graph(superpixels, features)
    evidence = Evidence(np.linspace(0, 1, 12), np.linspace(1, 0, 12))
    nothing = Evidence(np.zeros(12), np.full(12, 0.5))
    remembered = propagation._votes(graph, nothing, Remembered(features, evidence), ALONE)
    np.testing.assert_allclose(remembered, propagation._votes(graph, evidence, None, ALONE), rtol=1e-4)
