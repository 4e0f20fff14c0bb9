"""What holds of the method whatever the image: what a permutation of labels changes, and what is never free.

Exact where all is counted in whole numbers. Distances, votes and beliefs are sums of floating-point numbers in the
order of superpixels: another order rounds otherwise. Where more than eight are as much like one, propagation ties it to
those with the lowest numbers. Which clusters there are depends on which superpixel is the first centre, and so on their
order; only that they are a partition does not (`test_fuzz_stages.py`).
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from strategies import (
    SMALL_SHAPES,
    all_superpixels,
    cameras,
    configs,
    disparities,
    ground_lines,
    has_frame,
    images,
    occupancies,
    of_shapes,
)

from lrtrav_ros.config import Config, ExtensionConfig
from lrtrav_ros.detector import LongRangeDetector
from lrtrav_ros.frame import valid_disparity
from lrtrav_ros.mapping.grid import FREE, ground_grid
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.points import free_points
from lrtrav_ros.method import clustering, comparison, extension, propagation
from lrtrav_ros.method.features import superpixel_features
from lrtrav_ros.method.ground import GROUND, OBSTACLE, GroundLine

Array = NDArray[Any]
N_ALL_TIED = 9  # superpixels: each is tied to all others


def permutation(labels: Array, seed: int) -> Array:
    """Return the new label of each old one, from 0 to the highest."""
    return np.random.default_rng(seed).permutation(labels.max() + 1).astype(np.int32)


SEEDS = st.integers(0, 2**32 - 1)


@given(scene=of_shapes(images, all_superpixels), seed=SEEDS, config=configs("features"))
def test_features_are_permuted(scene: tuple[Array, Array], seed: int, config: Config) -> None:
    image, labels = scene
    new = permutation(labels, seed)
    features = superpixel_features(image, labels, config.features)
    permuted = superpixel_features(image, new[labels], config.features).chosen(new.astype(np.intp))
    for name in ("colour", "texture", "chromaticity"):
        np.testing.assert_array_equal(getattr(permuted, name), getattr(features, name))


@given(scene=of_shapes(images, all_superpixels), seed=SEEDS, config=configs("features"))
def test_distances_are_permuted_but_for_rounding(scene: tuple[Array, Array], seed: int, config: Config) -> None:
    image, labels = scene
    new = permutation(labels, seed)
    features, permuted = (superpixel_features(image, named, config.features) for named in (labels, new[labels]))
    distances, of_permuted = (comparison.feature_distances(some, config.features) for some in (features, permuted))
    np.testing.assert_allclose(of_permuted[np.ix_(new, new)], distances, atol=1e-6)


@given(scene=of_shapes(all_superpixels), seed=SEEDS)
def test_layout_is_permuted(scene: tuple[Array], seed: int) -> None:
    (labels,) = scene
    new, n = permutation(labels, seed), labels.max() + 1
    layout, permuted = (extension.superpixel_layout(named, n) for named in (labels, new[labels]))
    np.testing.assert_array_equal(permuted.area[new], layout.area)
    np.testing.assert_array_equal(permuted.middles[new], layout.middles)
    pairs, of_permuted = (
        set(zip(*(side.tolist() for side in found.pairs), strict=True)) for found in (layout, permuted)
    )
    assert of_permuted == {(new[one], new[other]) for one, other in pairs}


@pytest.mark.parametrize("rule", extension.RULES)
@given(scene=of_shapes(occupancies, all_superpixels), seed=SEEDS, n_clusters=st.integers(1, 9), share=st.floats(0, 1))
def test_extension_does_not_depend_on_the_order(
    rule: str, scene: tuple[Array, Array], seed: int, n_clusters: int, share: float
) -> None:
    occupancy, labels = scene
    new, settings = permutation(labels, seed), ExtensionConfig(rule=rule, min_share=share)
    clusters = (np.arange(labels.max() + 1) % n_clusters).astype(np.int32)
    renamed = permutation(clusters, seed)[clusters]
    expected = extension.extend(occupancy, labels, clusters, settings)
    permuted = np.empty_like(clusters)
    permuted[new] = renamed
    np.testing.assert_array_equal(extension.extend(occupancy, new[labels], permuted, settings), expected)


@given(n=st.integers(2, 12), groups=st.integers(2, 5), seed=SEEDS)
def test_groups_far_apart_are_the_clusters_in_every_order(n: int, groups: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    group = rng.permutation(np.arange(n * groups) % groups)
    places = 100.0 * group + rng.random(n * groups)
    distances = np.abs(places[:, None] - places)
    clusters = clustering.spectral_clusters(distances, Config().updated({"clustering.k": groups}).clustering)
    assert len({*zip(clusters.tolist(), group.tolist(), strict=True)}) == groups == clusters.max() + 1


@given(scene=of_shapes(images, occupancies, all_superpixels), seed=SEEDS, config=configs("features"))
def test_propagation_is_permuted_but_for_rounding(scene: tuple[Array, ...], seed: int, config: Config) -> None:
    image, occupancy, labels = scene
    labels = np.unique(labels % N_ALL_TIED, return_inverse=True)[1].reshape(labels.shape).astype(np.int32)
    new = permutation(labels, seed)
    found, permuted = (
        propagation.propagate(
            occupancy,
            propagation.superpixel_graph(named, superpixel_features(image, named, config.features), config.features),
        )
        for named in (labels, new[labels])
    )
    np.testing.assert_array_equal(permuted.evidence.share[new], found.evidence.share)
    np.testing.assert_array_equal(permuted.evidence.ground[new], found.evidence.ground)
    np.testing.assert_allclose(permuted.belief.traversable[new], found.belief.traversable, atol=1e-3)


@given(scene=of_shapes(occupancies, all_superpixels), n_clusters=st.integers(1, 20), share=st.floats(0, 1))
def test_evidence_stands(scene: tuple[Array, Array], n_clusters: int, share: float) -> None:
    occupancy, labels = scene
    clusters = np.arange(labels.max() + 1, dtype=np.int32) % n_clusters
    extended = extension.extend(occupancy, labels, clusters, ExtensionConfig(rule="evidence", min_share=share))
    known = occupancy != 255
    np.testing.assert_array_equal(extended[known], occupancy[known])


@given(
    scenes=of_shapes(
        lambda shape: st.lists(st.tuples(images(shape), occupancies(shape)), min_size=1, max_size=3),
        shapes=SMALL_SHAPES,
    ),
    config=configs(
        "features",
        "extension",
        "memory",
        **{"threads": st.just(1), "superpixels.n_superpixels": st.integers(1, 200)},
    ),
)
def test_propagation_frees_no_obstacle(scenes: tuple[list[tuple[Array, Array]]], config: Config) -> None:
    config = config.updated({"extension.rule": "propagation"})
    detector = LongRangeDetector(config)
    for image, occupancy in scenes[0]:
        appearance = detector.look(image)
        found = propagation.propagate(
            occupancy,
            appearance.graph,
            remembered=detector.memory.recall(),
            before=detector.memory.belief,
            min_share=config.extension.min_share,
        )
        detector.memory.remember(appearance.features, found.evidence, found.belief)
        assert (found.occupancy[occupancy == OBSTACLE] != GROUND).all()


class Near(NamedTuple):
    """What the grid takes of the short range."""

    occupancy: Array
    disparity: Array
    line: GroundLine | None


@given(scene=of_shapes(occupancies, occupancies, disparities, cameras, ground_lines), config=configs("maps"))
def test_cells_are_free_only_where_no_disparity_contradicts(scene: tuple[Any, ...], config: Config) -> None:
    occupancy, near, disparity, camera, line = scene
    line = dataclasses.replace(line, bend=0.0)
    assume(has_frame(line, camera))
    grid = ground_grid(occupancy, Near(near, disparity, line), camera, config.maps)
    row, column = np.nonzero(grid.cells == FREE)
    x, y = grid.resolution_m * (column + 0.5), grid.resolution_m * (row + 0.5) + grid.origin_m[1]
    points = GroundFrame.of(line, camera).to_camera(np.stack([x, y, np.zeros(len(x))], axis=1))
    assert (points[:, 2] > 0).all()
    u, v = ((camera.cx, camera.cy) + points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + 0.5).T
    for at_v, at_u in zip(v, u, strict=True):
        pixel = int(at_v), int(at_u)
        assert occupancy[pixel] == GROUND
        assert near[pixel] == GROUND or not valid_disparity(disparity)[pixel] > 0


@given(scene=of_shapes(occupancies, occupancies, disparities, cameras, ground_lines), config=configs("maps"))
def test_obstacles_alone_leave_no_cell_free(scene: tuple[Any, ...], config: Config) -> None:
    occupancy, near, disparity, camera, line = scene
    assume(has_frame(line, camera))
    nothing = np.where(occupancy == GROUND, np.uint8(OBSTACLE), occupancy)
    assert not (ground_grid(nothing, Near(near, disparity, line), camera, config.maps).cells == FREE).any()


@given(scene=of_shapes(occupancies, cameras, ground_lines), config=configs("maps"))
def test_free_points_are_on_free_pixels_alone(scene: tuple[Any, ...], config: Config) -> None:
    occupancy, camera, line = scene
    assume(has_frame(line, camera))
    nothing = np.where(occupancy == GROUND, np.uint8(OBSTACLE), occupancy)
    assert not len(free_points(nothing, line, camera, config.maps))
