"""Tests of the extension over clusters, on a strip of six superpixels."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import ExtensionConfig
from lrtrav_ros.method.extension import connected_regions, count_evidence, extend, superpixel_layout
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN

EVIDENCE = ExtensionConfig(rule="evidence")
SUPERPIXELS = np.repeat(np.arange(6, dtype=np.int32), 10)[None].repeat(4, axis=0)  # 4 x 60, each 4 x 10


def occupancy(**columns: int) -> NDArray[np.uint8]:
    """Return unknown, but for ``c12_20=GROUND``: columns 12 to 19."""
    image = np.full(SUPERPIXELS.shape, UNKNOWN, np.uint8)
    for name, value in columns.items():
        first, last = map(int, name[1:].split("_"))
        image[:, first:last] = value
    return image


def by_superpixel(image: NDArray[np.uint8]) -> list[int]:
    """Return the value of each superpixel; all its pixels have to agree."""
    values = image.reshape(4, 6, 10).transpose(1, 0, 2).reshape(6, -1)
    assert (values == values[:, :1]).all()
    return values[:, 0].tolist()


def test_superpixels_touch_in_rows_and_columns_but_not_across_corners() -> None:
    superpixels = np.array([[0, 0, 1], [2, 3, 3]], np.int32)
    layout = superpixel_layout(superpixels, 5)  # no pixel is of the last
    pairs = [(0, 1), (0, 2), (0, 3), (1, 0), (1, 3), (2, 0), (2, 3), (3, 0), (3, 1), (3, 2)]  # not 1 and 2
    assert list(zip(*map(np.ndarray.tolist, layout.pairs), strict=True)) == pairs
    assert layout.starts.tolist() == [0, 3, 5, 7, 10, 10]


@pytest.mark.parametrize("n_labels", [1, 2, 9, 300])
@pytest.mark.parametrize("shape", [(1, 1), (1, 13), (13, 1), (17, 40), (60, 9)])
def test_neighbours_of_superpixels_in_pieces(n_labels: int, shape: tuple[int, int]) -> None:
    superpixels = np.random.default_rng(n_labels).integers(0, n_labels, shape).astype(np.int32)
    touching = np.zeros((n_labels, n_labels), np.bool_)
    touching[superpixels[:, :-1], superpixels[:, 1:]] = touching[superpixels[:-1], superpixels[1:]] = True
    touching |= touching.T
    np.fill_diagonal(touching, False)
    np.testing.assert_array_equal(superpixel_layout(superpixels, n_labels).pairs, np.nonzero(touching))


def test_area_and_middle_of_superpixels() -> None:
    superpixels = np.array([[0, 0, 1, 1, 1], [0, 0, 1, 3, 1]], np.int32)
    layout = superpixel_layout(superpixels, 4)
    assert layout.area.tolist() == [4, 5, 0, 1]
    np.testing.assert_allclose(layout.middles, [[0.5, 0.5], [0.4, 3], [0, 0], [1, 3]])


def test_evidence_is_counted_for_each_superpixel() -> None:
    ground, obstacle, area = count_evidence(occupancy(c0_3=GROUND, c5_12=OBSTACLE, c59_60=GROUND), SUPERPIXELS, 7)
    assert ground.tolist() == [12, 0, 0, 0, 0, 4, 0]
    assert obstacle.tolist() == [20, 8, 0, 0, 0, 0, 0]
    assert area.tolist() == [40] * 6 + [0]


def test_connected_regions_split_a_cluster() -> None:
    regions = connected_regions(SUPERPIXELS, np.array([0, 0, 1, 0, 0, 0], np.int32))
    assert regions[0] == regions[1] != regions[3] == regions[4] == regions[5]
    assert regions[2] not in (regions[0], regions[3])


def test_area_takes_clusters_with_more_than_half_of_their_area() -> None:
    clusters = np.array([0, 0, 1, 1, 0, 2], np.int32)
    found = extend(occupancy(c0_16=GROUND, c20_30=GROUND), SUPERPIXELS, clusters, ExtensionConfig(rule="area"))
    # cluster 0 has 16 of 30 columns: more than half; cluster 1 has 10 of 20: not more
    assert by_superpixel(found) == [GROUND, GROUND, GROUND, OBSTACLE, GROUND, OBSTACLE]


def test_area_keeps_short_range_ground_of_other_clusters() -> None:
    found = extend(occupancy(c0_2=GROUND), SUPERPIXELS, np.zeros(6, np.int32), ExtensionConfig(rule="area"))
    assert (found[:, :2] == GROUND).all()
    assert (found[:, 2:] == OBSTACLE).all()


def test_evidence_counts_only_pixels_that_tell() -> None:
    clusters = np.array([0, 0, 1, 1, 2, 0], np.int32)
    short = occupancy(c0_3=GROUND, c20_22=GROUND, c22_25=OBSTACLE)
    found = extend(short, SUPERPIXELS, clusters, EVIDENCE)
    assert by_superpixel(found[:, :20].repeat(3, axis=1)[:, :60])[:2] == [GROUND, GROUND]
    assert (found[:, 20:22] == GROUND).all()  # evidence itself stands
    assert (found[:, 22:40] == OBSTACLE).all()
    assert (found[:, 40:50] == UNKNOWN).all()  # nothing tells
    assert (found[:, 50:] == GROUND).all()  # lies apart, without evidence, and is as the rest of its cluster


def test_evidence_of_a_region_counts_more_than_that_of_its_cluster() -> None:
    clusters = np.array([0, 0, 1, 0, 0, 1], np.int32)
    found = extend(occupancy(c0_20=GROUND, c30_31=OBSTACLE), SUPERPIXELS, clusters, EVIDENCE)
    assert (found[:, 31:50] == OBSTACLE).all()


def test_evidence_never_makes_an_obstacle_traversable() -> None:
    found = extend(occupancy(c0_40=GROUND, c40_45=OBSTACLE), SUPERPIXELS, np.zeros(6, np.int32), EVIDENCE)
    assert (found[:, 40:45] == OBSTACLE).all()
    assert (found[:, 45:] == GROUND).all()


@pytest.mark.parametrize(("min_share", "expected"), [(0.3, GROUND), (0.5, OBSTACLE)])
def test_share_that_makes_a_region_traversable(min_share: float, expected: int) -> None:
    config = ExtensionConfig(rule="evidence", min_share=min_share)
    found = extend(occupancy(c0_4=GROUND, c4_10=OBSTACLE), SUPERPIXELS, np.zeros(6, np.int32), config)
    assert (found[:, 10:] == expected).all()


def test_images_of_different_size_are_refused() -> None:
    with pytest.raises(ValueError, match=r"occupancy is uint8 \(4, 59\); give uint8 \(4, 60\)"):
        extend(occupancy()[:, :59], SUPERPIXELS, np.zeros(6, np.int32), EVIDENCE)


def test_other_values_than_those_of_an_occupancy_are_refused() -> None:
    with pytest.raises(ValueError, match="occupancy has other values than 0 ground, 100 obstacle and 255 unknown"):
        extend(occupancy(c0_20=7), SUPERPIXELS, np.zeros(6, np.int32), EVIDENCE)


def test_the_rule_without_clusters_is_refused() -> None:
    clusters = np.zeros(6, np.int32)
    with pytest.raises(
        ValueError, match=r"extension\.rule 'propagation' takes no clusters; give one of area, evidence"
    ):
        extend(occupancy(c0_20=GROUND), SUPERPIXELS, clusters, ExtensionConfig(rule="propagation"))
    np.testing.assert_array_equal(
        extend(occupancy(c0_20=GROUND), SUPERPIXELS, clusters),
        extend(occupancy(c0_20=GROUND), SUPERPIXELS, clusters, EVIDENCE),
    )
