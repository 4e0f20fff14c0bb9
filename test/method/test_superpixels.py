"""Preemptive SLIC: the segmentation, the connectivity of its superpixels, and when it stops."""

from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import SuperpixelsConfig
from lrtrav_ros.method import superpixels
from lrtrav_ros.method.superpixels import preemptive_slic
from lrtrav_ros.numerics.thread_team import ThreadTeam

QUADRANTS = [[0, 1], [2, 3]]


def quadrants(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a 20 x 21 image of four parts, as `QUADRANTS` numbers them, with a little noise."""
    image = colours[np.array(QUADRANTS)].repeat(10, axis=0).repeat([10, 11], axis=1)
    noise = np.random.default_rng(0).integers(-2, 3, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def pieces(labels: NDArray[np.int32]) -> int:
    """Return the number of 4-connected pieces of equal label."""
    return sum(
        cv2.connectedComponents((labels == label).astype(np.uint8), connectivity=4)[0] - 1
        for label in np.unique(labels)
    )


def check(labels: NDArray[np.int32], shape: tuple[int, ...]) -> None:
    assert labels.shape == shape[:2]
    assert labels.dtype == np.int32
    names, first = np.unique(labels, return_index=True)
    assert names.tolist() == list(range(names.size))
    assert (np.diff(first // shape[1]) >= -1).all()
    assert pieces(labels) == names.size


@pytest.fixture
def noise() -> NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 256, (48, 90, 3), np.uint8)


@pytest.fixture
def scene() -> NDArray[np.uint8]:
    """A smooth 120 x 200 colour image, with some noise."""
    rng = np.random.default_rng(2)
    small = rng.integers(0, 256, (6, 10, 3), np.uint8)
    image = cv2.resize(small, (200, 120), interpolation=cv2.INTER_CUBIC)
    return np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8)


def test_colour_quadrants() -> None:
    image = quadrants(np.array([[0, 0, 0], [0, 0, 255], [0, 255, 0], [255, 255, 255]], np.uint8))
    labels = preemptive_slic(image, SuperpixelsConfig(n_superpixels=4))
    np.testing.assert_array_equal(labels, np.array(QUADRANTS).repeat(10, axis=0).repeat([10, 11], axis=1))


def test_grey_quadrants() -> None:
    image = quadrants(np.array([20, 90, 160, 230], np.uint8))
    labels = preemptive_slic(image, SuperpixelsConfig(n_superpixels=4))
    np.testing.assert_array_equal(labels, np.array(QUADRANTS).repeat(10, axis=0).repeat([10, 11], axis=1))


def test_edge_off_the_grid_is_found() -> None:
    image = np.full((40, 60), 60, np.uint8)
    image[:, 23:] = 120
    labels = preemptive_slic(image, SuperpixelsConfig(n_superpixels=24))
    assert np.intersect1d(labels[:, :23], labels[:, 23:]).size == 0


def test_constant_image_gives_regular_grid() -> None:
    labels = preemptive_slic(np.full((60, 90, 3), 77, np.uint8), SuperpixelsConfig(n_superpixels=24))
    check(labels, (60, 90))
    assert labels.max() + 1 == 24
    assert np.bincount(labels.ravel()) == pytest.approx(225, rel=0.3)


@pytest.mark.parametrize("compactness", [0.1, 20.0, 1000.0])
def test_superpixels_of_noise_are_connected(noise: NDArray[np.uint8], compactness: float) -> None:
    labels = preemptive_slic(noise, SuperpixelsConfig(n_superpixels=60, compactness=compactness))
    check(labels, noise.shape)
    size = np.bincount(labels[::2, ::2].ravel())
    assert size.min() >= 0.3 * 24 * 45 / 60


@pytest.mark.parametrize(("n_superpixels", "slack"), [(30, 0.35), (60, 0.1), (200, 0.1), (2000, 0.1)])
def test_number_is_about_what_was_asked(scene: NDArray[np.uint8], n_superpixels: int, slack: float) -> None:
    labels = preemptive_slic(scene, SuperpixelsConfig(n_superpixels=n_superpixels, max_iterations=10))
    check(labels, scene.shape)
    assert labels.max() + 1 == pytest.approx(n_superpixels, rel=slack)


def test_higher_compactness_gives_shorter_outlines(scene: NDArray[np.uint8]) -> None:
    def outline(compactness: float) -> int:
        labels = preemptive_slic(scene, SuperpixelsConfig(n_superpixels=60, compactness=compactness))
        return int(np.count_nonzero(np.diff(labels, axis=0)) + np.count_nonzero(np.diff(labels, axis=1)))

    assert outline(60.0) < 0.8 * outline(5.0)


def test_same_input_same_output(noise: NDArray[np.uint8]) -> None:
    before = noise.copy()
    np.testing.assert_array_equal(preemptive_slic(noise), preemptive_slic(noise))
    np.testing.assert_array_equal(noise, before)


@pytest.mark.parametrize("n_superpixels", [3, 60, 1500])
@pytest.mark.parametrize("n_threads", [2, 5])
def test_number_of_threads_does_not_matter(noise: NDArray[np.uint8], n_superpixels: int, n_threads: int) -> None:
    config = SuperpixelsConfig(n_superpixels=n_superpixels)
    image = np.tile(noise, (4, 2, 1))[:-1]
    labels = preemptive_slic(image, config, team=ThreadTeam(n_threads))
    np.testing.assert_array_equal(labels, preemptive_slic(image, config))


@pytest.mark.parametrize("line", [22, 23])
def test_borders_are_found_to_the_pixel(line: int) -> None:
    image = np.full((48, 61, 3), (60, 80, 100), np.uint8)
    image[line:] = (90, 120, 70)
    image[:, line + 9 :] = (20, 30, 200)
    labels = preemptive_slic(image, SuperpixelsConfig(n_superpixels=20))
    check(labels, image.shape)
    assert np.intersect1d(labels[:line, : line + 9], labels[line:, : line + 9]).size == 0
    assert np.intersect1d(labels[:, : line + 9], labels[:, line + 9 :]).size == 0


def test_layout_does_not_matter(noise: NDArray[np.uint8]) -> None:
    for view in (noise[::2, 1::3], noise[::-1, ::-1], noise.transpose(1, 0, 2), np.asfortranarray(noise)):
        np.testing.assert_array_equal(preemptive_slic(view), preemptive_slic(view.copy(order="C")))


def test_grey_equals_its_bgr(noise: NDArray[np.uint8]) -> None:
    grey = noise[..., 0]
    np.testing.assert_array_equal(preemptive_slic(grey), preemptive_slic(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)))


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (1, 300), (300, 1), (2, 70), (16, 16), (3, 17), (33, 5)])
@pytest.mark.parametrize("n_superpixels", [1, 2, 7, 200, 20000])
def test_small_images(shape: tuple[int, int], n_superpixels: int) -> None:
    image = np.random.default_rng(3).integers(0, 256, (*shape, 3), np.uint8)
    labels = preemptive_slic(image, SuperpixelsConfig(n_superpixels=n_superpixels))
    check(labels, shape)
    assert labels.max() < max(2 * n_superpixels, 2)


def test_more_superpixels_than_pixels() -> None:
    labels = preemptive_slic(np.zeros((16, 12), np.uint8), SuperpixelsConfig(n_superpixels=1000))
    np.testing.assert_array_equal(labels, np.arange(16 * 12).reshape(16, 12))


def test_as_many_superpixels_as_there_can_be() -> None:
    labels = preemptive_slic(np.zeros((1, 20000), np.uint8), SuperpixelsConfig(n_superpixels=20000))
    np.testing.assert_array_equal(labels, np.arange(20000).reshape(1, 20000))


def test_one_superpixel() -> None:
    np.testing.assert_array_equal(
        preemptive_slic(np.zeros((9, 14), np.uint8), SuperpixelsConfig(n_superpixels=1)), np.zeros((9, 14))
    )


def test_stops_when_few_pixels_change(scene: NDArray[np.uint8]) -> None:
    def labels(threshold: float, iterations: int) -> NDArray[np.int32]:
        return preemptive_slic(
            scene,
            SuperpixelsConfig(n_superpixels=60, preemption_threshold=threshold, max_iterations=iterations),
        )

    # All pixels get a label in the first iteration; to get all of them changed again is not possible.
    np.testing.assert_array_equal(labels(1.0, 2), labels(1.0, 100))
    assert (labels(0.0, 2) != labels(0.0, 10)).any()


def test_settled_clusters_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.full((80, 160, 3), 128, np.uint8)
    image[:, 120:] = np.random.default_rng(4).integers(0, 256, (80, 40, 3), np.uint8)
    visits: list[NDArray[np.bool_]] = []
    assign = superpixels.kernels.assign

    def record(lab: object, centres: object, moved: NDArray[np.bool_], *rest: object) -> None:
        visits.append(moved.copy())
        assign(lab, centres, moved, *rest)

    monkeypatch.setattr(superpixels.kernels, "assign", record)
    preemptive_slic(image, SuperpixelsConfig(n_superpixels=32, max_iterations=10))
    inside = [visit[1:-1, 1:-1] for visit in visits]
    assert inside[0].shape == (4, 8)
    assert inside[0].all()
    assert not inside[-1][:, :4].any()
    assert inside[-1][:, 6].any()
    for visit, of_grid in zip(visits, inside, strict=True):
        assert visit.sum() == of_grid.sum()  # the cells around the grid are never a reason to look again


def test_preemption_changes_little(scene: NDArray[np.uint8]) -> None:
    first = preemptive_slic(scene, SuperpixelsConfig(n_superpixels=60))
    full = preemptive_slic(scene, SuperpixelsConfig(n_superpixels=60, preemption_threshold=0.0))
    overlap = np.zeros((first.max() + 1, full.max() + 1), np.int64)
    np.add.at(overlap, (first, full), 1)
    assert overlap.max(axis=1).sum() > 0.9 * first.size


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((8, 9), np.uint16),
        np.zeros((8, 9, 3), np.float32),
        np.zeros((8, 9, 4), np.uint8),
        np.zeros((8, 9, 1), np.uint8),
        np.zeros(8, np.uint8),
        np.zeros((0, 9), np.uint8),
        np.zeros((8, 0, 3), np.uint8),
    ],
)
def test_refuses_other_images(image: NDArray[np.uint8]) -> None:
    got = re.escape(f"image is {image.dtype} {image.shape}; give uint8 (H, W) or (H, W, 3), not empty")
    with pytest.raises(ValueError, match=got):
        preemptive_slic(image)
