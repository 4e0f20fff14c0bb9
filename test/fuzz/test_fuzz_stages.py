"""Each stage of the method on whatever it may be given: the result is valid, and nothing is warned of."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse
from strategies import (
    SHAPES,
    SMALL_SHAPES,
    cameras,
    configs,
    disparities,
    ground_lines,
    images,
    occupancies,
    of_shapes,
    superpixels,
)

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, ExtensionConfig, FeaturesConfig
from lrtrav_ros.frame import as_8bit, valid_disparity
from lrtrav_ros.method import clustering, comparison, extension, ground, matching, propagation, textures
from lrtrav_ros.method.features import Features, superpixel_features
from lrtrav_ros.method.ground_memory import GroundMemory
from lrtrav_ros.method.memory import Memory
from lrtrav_ros.method.superpixels import preemptive_slic

Array = NDArray[Any]
OCCUPANCIES = {ground.GROUND, ground.OBSTACLE, ground.UNKNOWN}
BOUND_OF = {name: np.sqrt(2) if name == "euclidean" else 1.0 for name in comparison.DISTANCES}
TWO_IMAGES = SHAPES.flatmap(
    lambda shape: st.sampled_from((1, 3)).flatmap(
        lambda channels: st.sampled_from((np.uint8, np.uint16)).flatmap(
            lambda dtype: st.tuples(*2 * (images(shape, channels=(channels,), dtypes=(dtype,)),))
        )
    )
)


def assert_occupancy(occupancy: Array, shape: tuple[int, ...]) -> None:
    assert occupancy.dtype == np.uint8
    assert occupancy.shape == shape
    assert set(np.unique(occupancy)) <= OCCUPANCIES


def assert_shares(values: Array, shape: tuple[int, ...]) -> None:
    assert values.shape == shape
    assert values.size == 0 or (values.min() >= 0 and values.max() <= 1)


def n_pieces(labels: Array) -> int:
    """Return how many 4-connected pieces of one label an image has."""
    places = np.arange(labels.size).reshape(labels.shape)
    right, down = labels[:, 1:] == labels[:, :-1], labels[1:] == labels[:-1]
    one = np.concatenate([places[:, :-1][right], places[:-1][down]])
    other = np.concatenate([places[:, 1:][right], places[1:][down]])
    graph = sparse.coo_array((np.ones(len(one)), (one, other)), shape=(labels.size, labels.size))
    return int(sparse.csgraph.connected_components(graph, directed=False)[0])


@pytest.mark.parametrize("matcher", matching.MATCHERS)
@given(pair=TWO_IMAGES, shift=st.none() | st.integers(0, 20), config=configs("stereo", "elas"))
def test_matching(matcher: str, pair: tuple[Array, Array], shift: int | None, config: Config) -> None:
    config = config.updated({"stereo.matcher": matcher})
    left, right = pair if shift is None else (pair[0], np.roll(pair[0], -shift, axis=1))
    disparity = matching.create_matcher(config.stereo, config.elas).compute(left, right)
    assert disparity.dtype == np.float32
    assert disparity.shape == left.shape[:2]
    assert np.isfinite(disparity).all()
    assert disparity.min() >= 0
    assert disparity.max() <= 2 * (config.stereo.n_disparities + 16)


@given(scene=of_shapes(disparities, cameras, lambda shape: st.none() | ground_lines(shape)), config=configs("ground"))
def test_ground(scene: tuple[Array, StereoCamera, ground.GroundLine | None], config: Config) -> None:
    disparity, camera, before = scene
    found = ground.detect_ground(disparity, camera, config.ground, before=before)
    assert_occupancy(found.occupancy, disparity.shape)
    np.testing.assert_array_equal(found.disparity, valid_disparity(disparity))
    n_disparities, width = found.u_disparity.shape
    assert found.u_disparity.dtype == np.uint16
    assert found.u_disparity.sum() <= np.count_nonzero(found.disparity)
    assert (found.obstacle_cells.dtype, found.obstacle_cells.shape) == (np.bool_, (n_disparities, width))
    assert found.v_disparity.shape == (disparity.shape[0], n_disparities)
    assert found.v_disparity.sum() == found.u_disparity[~found.obstacle_cells].sum()
    assert found.is_line_remembered <= (found.line is before)
    if found.line is None:
        assert (found.occupancy == ground.UNKNOWN).all()
    elif not found.is_line_remembered:
        assert found.line.camera_height_m(camera) > 0
    assert set(np.unique(found.mask)) <= {0, 255}
    assert found.obstacle_disparity.shape == disparity.shape


@given(
    scenes=SHAPES.flatmap(
        lambda shape: st.tuples(cameras(shape), st.lists(disparities(shape), min_size=2, max_size=4))
    ),
    stamps=st.lists(st.none() | st.integers(-(2**62), 2**62) | st.integers(0, 10**10), min_size=4, max_size=4),
    config=configs("ground"),
)
def test_ground_memory(scenes: tuple[StereoCamera, list[Array]], stamps: list[int | None], config: Config) -> None:
    camera, images = scenes
    memory = GroundMemory(config.ground)
    for disparity, stamp_ns in zip(images, stamps, strict=False):
        before = memory.recall(camera, stamp_ns)
        assert before is None or config.ground.memory_s
        found = ground.detect_ground(disparity, camera, config.ground, before=before)
        assert_occupancy(found.occupancy, disparity.shape)
        if found.line is not None and not found.is_line_remembered:
            memory.remember(found.line, camera, stamp_ns)


@given(image=SHAPES.flatmap(images), config=configs("superpixels"))
def test_superpixels(image: Array, config: Config) -> None:
    labels = preemptive_slic(image, config.superpixels)
    assert labels.dtype == np.int32
    assert labels.shape == image.shape[:2]
    used, first = np.unique(labels, return_index=True)
    np.testing.assert_array_equal(used, np.arange(len(used)))
    assert (np.diff(first // labels.shape[1]) >= -1).all()  # numbered from the top, on every second row
    assert n_pieces(labels) == len(used)


@pytest.mark.parametrize("texture", textures.TEXTURES)
@given(scene=of_shapes(images, superpixels))
def test_features(texture: str, scene: tuple[Array, Array]) -> None:
    image, labels = scene
    features = superpixel_features(image, labels, FeaturesConfig(texture=texture))
    n = labels.max() + 1
    is_used = np.bincount(labels.ravel(), minlength=n) > 0
    for histograms in (features.colour, features.texture):
        assert_shares(histograms, (n, histograms.shape[1]))
        np.testing.assert_allclose(histograms.sum(axis=1), is_used, atol=1e-5)
    assert features.chromaticity.shape == (n, 2)
    assert np.isfinite(features.chromaticity).all()


@pytest.mark.parametrize("distance", comparison.DISTANCES)
@given(scene=of_shapes(images, superpixels), config=configs("features"))
def test_distances(distance: str, scene: tuple[Array, Array], config: Config) -> None:
    image, labels = scene
    settings = config.updated({"features.distance": distance}).features
    features = superpixel_features(image, labels, settings)
    features = features.chosen(np.unique(labels)[:200].astype(np.intp))
    distances = comparison.feature_distances(features, settings)
    assert distances.shape == (len(features), len(features))
    np.testing.assert_allclose(distances, distances.T, rtol=0, atol=1e-14)
    assert not distances.diagonal().any()
    assert distances.min() >= 0
    assert distances.max() <= BOUND_OF[distance] + 1e-5
    compared = comparison.compare(features, settings)
    np.testing.assert_allclose(compared.with_landmarks(), distances, atol=2e-3)
    assert compared.with_others(features.chosen(np.arange(1))).shape == (len(features), 1)


@st.composite
def distance_matrices(draw: st.DrawFn) -> Array:
    """Return distances between points, many of them the same, as small or large as numbers are."""
    n, rng = draw(st.integers(0, 60)), np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    points = rng.integers(0, draw(st.sampled_from([1, 2, 5, 10**6])), (n, 2)) * draw(
        st.sampled_from([1e-300, 1e-9, 1.0])
    )
    distances = np.hypot(*(points[:, None] - points).T)
    return np.minimum(distances * np.exp(rng.normal(0, 1) * draw(st.sampled_from([0, 1, 200]))), 1e300)


@given(distances=distance_matrices(), config=configs("clustering"))
def test_clustering(distances: Array, config: Config) -> None:
    similar = clustering.affinity(distances)
    assert_shares(similar, distances.shape)
    np.testing.assert_array_equal(similar, similar.T)
    assert not similar.diagonal().any()
    clusters = clustering.spectral_clusters(distances, config.clustering)
    assert clusters.dtype == np.int32
    assert clusters.shape == (len(distances),)
    np.testing.assert_array_equal(np.unique(clusters), np.arange(clusters.max(initial=-1) + 1))
    assert config.clustering.k == 0 or clusters.max(initial=-1) < config.clustering.k


@pytest.mark.parametrize("rule", extension.RULES)
@given(scene=of_shapes(occupancies, superpixels), n_clusters=st.integers(1, 20), share=st.floats(0, 1))
def test_extension(rule: str, scene: tuple[Array, Array], n_clusters: int, share: float) -> None:
    occupancy, labels = scene
    clusters = np.arange(labels.max() + 1, dtype=np.int32) % n_clusters
    extended = extension.extend(occupancy, labels, clusters, ExtensionConfig(rule=rule, min_share=share))
    assert_occupancy(extended, occupancy.shape)
    assert (extended[occupancy == ground.GROUND] == ground.GROUND).all()
    regions = extension.connected_regions(labels, clusters)
    np.testing.assert_array_equal(np.unique(regions), np.arange(regions.max() + 1))
    for region in np.unique(regions):
        assert len(np.unique(clusters[regions == region])) == 1


@st.composite
def strange_features(draw: st.DrawFn, n: int) -> Features:
    """Return features of n superpixels that no image need have."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    concentration = draw(st.sampled_from([0.01, 1.0, 100.0]))
    colour, texture = (rng.dirichlet(np.full(bins, concentration), n).astype(np.float32) for bins in (12, 7))
    if draw(st.booleans()):
        colour[:] = colour[0]
    return Features(colour, texture, rng.normal(0, draw(st.sampled_from([0, 0.1, 5, 100])), (n, 2)))


@given(
    scenes=SMALL_SHAPES.flatmap(
        lambda shape: st.lists(st.tuples(images(shape), occupancies(shape), superpixels(shape)), min_size=1, max_size=3)
    ),
    stamps=st.lists(st.none() | st.integers(-(2**62), 2**62) | st.integers(0, 10**10), min_size=3, max_size=3),
    config=configs("features", "extension", "memory"),
    data=st.data(),
)
def test_propagation_and_memory(
    scenes: list[tuple[Array, Array, Array]], stamps: list[int | None], config: Config, data: st.DataObject
) -> None:
    memory, are_strange = Memory(config.memory), data.draw(st.booleans())
    for (image, occupancy, labels), stamp_ns in zip(scenes, stamps, strict=False):
        n = labels.max() + 1
        if are_strange:
            features = data.draw(strange_features(n))
        else:
            features = superpixel_features(image, labels, config.features)
        graph = propagation.superpixel_graph(labels, features, config.features)
        memory.at(stamp_ns)
        extend = partial(propagation.propagate, occupancy, graph, min_share=config.extension.min_share)
        found = extend(remembered=memory.recall(), before=memory.belief)
        memory.remember(features, found.evidence, found.belief)
        assert_occupancy(found.occupancy, occupancy.shape)
        assert (found.confidence.dtype, found.confidence.shape) == (np.uint8, occupancy.shape)
        for values in (found.evidence.share, found.evidence.ground, found.belief.traversable):
            assert_shares(values, (n,))
        assert not (found.confidence[found.occupancy == ground.UNKNOWN]).any()
        assert len(memory) <= 120
    assert config.memory.frames or not len(memory)


@given(distances=distance_matrices(), factor=st.sampled_from([0, 1e-3, 1.0, 1e3]))
def test_weighted_sum(distances: Array, factor: float) -> None:
    distances = np.minimum(distances, 1e97)
    total = comparison.weighted_sum(distances, distances * factor)
    assert total.shape == distances.shape
    assert np.isfinite(total).all()
    assert (total >= 0).all()


@given(image=SHAPES.flatmap(partial(images, dtypes=(np.uint8, np.uint16))))
def test_8_bits(image: Array) -> None:
    found = as_8bit(image)
    assert found.dtype == np.uint8
    assert found.shape == image.shape
    np.testing.assert_array_equal(found, image >> max(int(image.max()).bit_length() - 8, 0))
