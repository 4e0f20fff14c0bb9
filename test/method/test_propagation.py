"""Tests of propagation, on grids and strips of superpixels whose looks are given, and on rendered textures."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_array

from lrtrav_ros.method import propagation
from lrtrav_ros.method.features import feature_distances, superpixel_features
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN
from lrtrav_ros.method.propagation import Belief, Evidence, Propagation, propagate

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


def propagated(
    occupancy: NDArray[np.uint8],
    positions: NDArray[np.float64],
    *,
    remembered: Evidence = propagation.NOTHING_REMEMBERED,
    before: Belief | None = None,
    min_share: float = 0.5,
) -> Propagation:
    """Propagate over a grid of superpixels of these looks, the remembered ones last, all of the same chromaticity."""
    superpixels = grid(occupancy.shape[0] // CELL[0], occupancy.shape[1] // CELL[1])
    chromaticity = np.zeros((len(positions), 2))
    return propagate(
        occupancy,
        superpixels,
        between(positions),
        chromaticity,
        remembered=remembered,
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
    found = propagate(short_range(*KNOWN), superpixels, alike, chromaticity)
    assert letters(found.occupancy) == ["gggoo"] * 4


def test_result_does_not_depend_on_the_numbers_of_the_superpixels() -> None:
    superpixels, positions = grid(4, 5), looks(*SCENE)
    numbers = np.random.default_rng(1).permutation(20).astype(np.int32)
    renumbered = np.empty(20)
    renumbered[numbers] = positions
    found = propagated(short_range(*KNOWN), positions)
    other = propagate(short_range(*KNOWN), numbers[superpixels], between(renumbered), np.zeros((20, 2)))
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
    remembered = Evidence(np.ones(1), np.ones(1))
    found = propagate(short_range(row), grid(1, 3), distances, chromaticity, remembered=remembered)
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
    found = propagation._settled(csr_array(ties), evidence, light)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_grey_images_are_told_apart_by_texture_and_brightness() -> None:
    rng = np.random.default_rng(0)
    superpixels = grid(4, 5)
    way = superpixels % 5 < 3
    image = np.where(way, rng.normal(120, 3, way.shape), rng.normal(80, 25, way.shape)).clip(0, 255).astype(np.uint8)
    features = superpixel_features(image, superpixels)
    found = propagate(short_range(*KNOWN), superpixels, feature_distances(features), features.chromaticity)
    assert letters(found.occupancy) == ["gggoo"] * 4


def test_belief_that_is_none_is_refused() -> None:
    places, looks, traversable = np.zeros((2, 2)), np.zeros((2, 2)), np.array([0.5, np.nan])
    with pytest.raises(ValueError, match=r"before\.traversable holds values that are not finite"):
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
    vote = propagation._votes(evidence, distances, np.zeros((3, 2)))
    assert vote[2] == pytest.approx(0.3, abs=0.01)
    assert vote[0] > 0.99
