"""Every public function of the method with arguments that it cannot have, and with all layouts that it can have.

A kernel does not look where it reads and writes: what is refused here would otherwise end the process.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest
from sample_arrays import (
    CAMERA,
    LINE,
    Array,
    NearGround,
    bgr,
    clusters,
    disparity,
    grey,
    labels,
    occupancy,
    rng,
)

from lrtrav_ros.config import ElasConfig, ExtensionConfig, StereoConfig
from lrtrav_ros.frame import to_grey
from lrtrav_ros.mapping import grid, ground_disparity, points, segmentation, slopes
from lrtrav_ros.method import (
    clustering,
    comparison,
    extension,
    features,
    ground,
    matching,
    memory,
    propagation,
    superpixels,
    textures,
)
from lrtrav_ros.method.matching.elas import Elas
from lrtrav_ros.method.matching.row_offset import row_offset
from lrtrav_ros.pose import Pose
from lrtrav_ros.registration import DepthRegistration

N_DISPARITIES = 8
DTYPES = [np.dtype(name) for name in ("?", *"bBhHiIlefdFO", ">i4", ">f4", ">f8", "M8[s]", "U1")]
SHAPES = [(1, 1), (1, 9), (9, 1), (2, 2), (12, 20)]


@dataclass(frozen=True)
class Case:
    """A function of one or more arrays: `make` returns those for an image of (height, width)."""

    function: Callable[..., object]
    make: Callable[[int, int], tuple[Array, ...]]
    other_types: str = ""  # that the arrays may have too, as characters
    other_dims: tuple[int, ...] = ()
    may_be_empty: bool = False


def distances(height: int, width: int) -> Array:
    points = rng().random(width)
    return np.abs(points[:, None] - points)


def histograms(height: int, width: int) -> Array:
    return rng().dirichlet(np.ones(height), width).astype(np.float32)


def looks(width: int) -> tuple[Array, Array, Array]:
    """Return colour, texture and chromaticity of the superpixels of `labels`."""
    n = (width + 1) // 2
    return histograms(9, n), histograms(7, n), rng().normal(0, 0.1, (n, 2))


def propagate_over(
    occupancy: Array, labels: Array, colour: Array, texture: Array, chromaticity: Array
) -> propagation.Propagation:
    graph = propagation.superpixel_graph(labels, features.Features(colour, texture, chromaticity))
    return propagation.propagate(occupancy, graph)


GREY = {
    name: Case(getattr(textures, name), lambda h, w: (grey(h, w),))
    for name in (
        "weber_descriptor",
        "local_binary_pattern",
        "centre_symmetric_pattern",
        "local_ternary_patterns",
        "local_homogeneity",
    )
}
PAIR = {
    name: Case(
        matching.create_matcher(StereoConfig(matcher=name, n_disparities=8), ElasConfig()).compute,
        lambda h, w: (grey(h, w), np.roll(grey(h, w), -1, axis=1)),
        other_types="H",
        other_dims=(3,),
    )
    for name in matching.MATCHERS
}
ROWS = {
    "row_offset": Case(
        row_offset,
        lambda h, w: (grey(h, w), np.roll(grey(h, w), -1, axis=1), disparity(h, w)),
        other_types="H",
        other_dims=(3,),
    )
}
DISPARITY = {
    "detect_ground": Case(partial(ground.detect_ground, camera=CAMERA), lambda h, w: (disparity(h, w),)),
    "u_disparity": Case(partial(ground.u_disparity, n_disparities=5), lambda h, w: (disparity(h, w),)),
    "v_disparity": Case(partial(ground.v_disparity, n_disparities=5), lambda h, w: (disparity(h, w),)),
    "select_cells": Case(ground.select_cells, lambda h, w: (disparity(h, w), rng().random((N_DISPARITIES, w)) < 0.5)),
    "back_project": Case(
        partial(ground.back_project, line=LINE, camera=CAMERA),
        lambda h, w: (disparity(h, w), np.where(rng().random((h, w)) < 0.2, disparity(h, w), np.float32(0))),
    ),
}
MAPS = {
    "obstacle_points": Case(
        partial(points.obstacle_points, line=LINE, camera=CAMERA), lambda h, w: (disparity(h, w), occupancy(h, w))
    ),
    "free_points": Case(partial(points.free_points, line=LINE, camera=CAMERA), lambda h, w: (occupancy(h, w),)),
    "with_slopes": Case(
        partial(slopes.with_slopes, line=LINE, camera=CAMERA), lambda h, w: (occupancy(h, w), disparity(h, w))
    ),
    "ground_line_of": Case(ground_disparity.ground_line_of, lambda h, w: (disparity(h, w),)),
    "ground_grid": Case(
        lambda occupancy, near, disparity: grid.ground_grid(occupancy, NearGround(near, disparity, LINE), CAMERA),
        lambda h, w: (occupancy(h, w), occupancy(h, w), disparity(h, w)),
    ),
    "segmentation_mask": Case(segmentation.segmentation_mask, lambda h, w: (occupancy(h, w),)),
    "segmentation_confidence": Case(segmentation.segmentation_confidence, lambda h, w: (occupancy(h, w),)),
    "segmentation_points": Case(
        partial(segmentation.segmentation_points, line=LINE, camera=CAMERA),
        lambda h, w: (occupancy(h, w), disparity(h, w)),
    ),
}
DEPTH = {
    "registered": Case(
        DepthRegistration(
            CAMERA, dataclasses.replace(CAMERA, width=30, height=14), Pose.parsed("0.1 0 0.02 0 0.01 0")
        ).registered,
        lambda h, w: (disparity(h, w),),
    )
}
IMAGE_AND_LABELS = {
    "colour_histograms": Case(features.colour_histograms, lambda h, w: (bgr(h, w), labels(h, w)), other_dims=(2,)),
    "colour_histograms of grey": Case(
        features.colour_histograms, lambda h, w: (grey(h, w), labels(h, w)), other_dims=(3,)
    ),
    "superpixel_features": Case(features.superpixel_features, lambda h, w: (bgr(h, w), labels(h, w)), other_dims=(2,)),
    "superpixel_features of grey": Case(
        features.superpixel_features, lambda h, w: (grey(h, w), labels(h, w)), other_dims=(3,)
    ),
    "log_chromaticity": Case(features.log_chromaticity, lambda h, w: (bgr(h, w), labels(h, w)), other_dims=(2,)),
    "log_chromaticity of grey": Case(
        features.log_chromaticity, lambda h, w: (grey(h, w), labels(h, w)), other_dims=(3,)
    ),
} | {
    f"texture_histograms {name}": Case(
        partial(features.texture_histograms, texture=name), lambda h, w: (bgr(h, w), labels(h, w)), other_dims=(2,)
    )
    for name in textures.TEXTURES
}
REGIONS = {
    "connected_regions": Case(extension.connected_regions, lambda h, w: (labels(h, w), clusters(w))),
} | {
    f"extend {rule}": Case(
        partial(extension.extend, config=ExtensionConfig(rule=rule)),
        lambda h, w: (occupancy(h, w), labels(h, w), clusters(w)),
    )
    for rule in extension.RULES
}
SUPERPIXELS = {
    "superpixel_layout": Case(partial(extension.superpixel_layout, n=10), lambda h, w: (labels(h, w),)),
    "count_evidence": Case(partial(extension.count_evidence, n=10), lambda h, w: (occupancy(h, w), labels(h, w))),
    "superpixel_graph": Case(
        lambda labels, *looks: propagate_over(
            np.zeros(labels.shape, np.uint8) if isinstance(labels, np.ndarray) else labels, labels, *looks
        ),
        lambda h, w: (labels(h, w), *looks(w)),
        other_types="d",
    ),
    "propagate": Case(
        lambda occupancy, labels: propagate_over(occupancy, labels, *looks(20)),
        lambda h, w: (occupancy(h, w), labels(h, w)),
    ),
}
FLOATS = {
    "spectral_clusters": Case(clustering.spectral_clusters, lambda h, w: (distances(h, w),), may_be_empty=True),
    "affinity": Case(clustering.affinity, lambda h, w: (distances(h, w),), may_be_empty=True),
    "automatic_k": Case(clustering.automatic_k, lambda h, w: (np.linspace(1, 0, w) ** 2,), other_types="f"),
    "weighted_sum": Case(
        comparison.weighted_sum, lambda h, w: (distances(h, w), distances(h, w) / 2), may_be_empty=True
    ),
    "feature_distances": Case(
        lambda colour, texture: comparison.feature_distances(features.Features(colour, texture, np.zeros((0, 2)))),
        lambda h, w: (histograms(h, w), histograms(h, w)[::-1]),
        other_types="d",
    ),
    "compare": Case(
        lambda *looks: comparison.compare(features.Features(*looks, np.zeros((0, 2)))).with_landmarks(),
        lambda h, w: (histograms(h, w), histograms(h, w)[::-1]),
        other_types="d",
    ),
} | {
    f"histogram_distances {name}": Case(
        partial(comparison.histogram_distances, distance=name), lambda h, w: (histograms(h, w),), other_types="d"
    )
    for name in comparison.DISTANCES
}
CASES = {
    **GREY,
    **PAIR,
    **ROWS,
    **DISPARITY,
    **MAPS,
    **DEPTH,
    **IMAGE_AND_LABELS,
    **REGIONS,
    **SUPERPIXELS,
    **FLOATS,
    "to_grey": Case(to_grey, lambda h, w: (bgr(h, w),), other_dims=(2,)),
    "pixel_bins": Case(features.pixel_bins, lambda h, w: (bgr(h, w),), other_dims=(2,)),
    "preemptive_slic": Case(superpixels.preemptive_slic, lambda h, w: (bgr(h, w),), other_dims=(2,)),
    "spread_clusters": Case(
        lambda of_landmarks: (
            clustering.spread_clusters(of_landmarks, features.Features(*looks(2 * len(of_landmarks))))
            if isinstance(of_landmarks, np.ndarray) and of_landmarks.ndim == 1
            else clustering.spread_clusters(of_landmarks, features.Features(*looks(20)))
        ),
        lambda h, w: (clusters(w),),
    ),
    "traversable_mask": Case(ground.traversable_mask, lambda h, w: (occupancy(h, w),)),
    "obstacle_cells": Case(
        partial(ground.obstacle_cells, camera=CAMERA, n_rows=12),
        lambda h, w: (rng().integers(0, 12, (N_DISPARITIES, w), np.uint16),),
    ),
    "find_ground_line": Case(
        partial(ground.find_ground_line, camera=CAMERA),
        lambda h, w: (rng().integers(0, 9, (h, N_DISPARITIES), np.int32),),
    ),
}
PLACES = [(name, place) for name, case in CASES.items() for place in range(len(case.make(12, 20)))]


def every_place(test: Callable[..., None]) -> Callable[..., None]:
    return pytest.mark.parametrize(("name", "place"), PLACES)(test)


def with_array(arrays: tuple[Array, ...], place: int, array: object) -> tuple[Any, ...]:
    return (*arrays[:place], array, *arrays[place + 1 :])


def assert_equal(found: object, expected: object) -> None:
    """Assert that two results, whatever they are made of, are the same."""
    if dataclasses.is_dataclass(expected):
        for field in dataclasses.fields(expected):
            assert_equal(getattr(found, field.name), getattr(expected, field.name))
    else:
        np.testing.assert_array_equal(found, expected)


def test_table_is_complete() -> None:
    tested = {name.split()[0] for name in CASES if name not in {*ROWS, *DEPTH}} | {*matching.MATCHERS}
    public = {
        name
        for module in (
            *(ground, superpixels, textures, features, comparison, clustering, extension, propagation, memory),
            *(grid, ground_disparity, points, segmentation, slopes),
        )
        for name, value in vars(module).items()
        if not name.startswith("_") and callable(value) and getattr(value, "__module__", "") == module.__name__
    }
    classes = {
        *("GroundLine", "ShortRange", "Texture", "Features", "PixelBins", "Comparison", "Layout", "Memory"),
        *("Evidence", "Remembered", "Belief", "Ties", "SuperpixelGraph", "Propagation", "Grid", "NearGround"),
    }
    without_arrays = {"joined", "landmarks"}  # landmarks looks at their sizes alone
    in_frame_py = {"to_grey"}
    assert tested == public - classes - without_arrays | {*matching.MATCHERS} | in_frame_py


@every_place
def test_other_types_are_refused(name: str, place: int) -> None:
    case, arrays = CASES[name], CASES[name].make(12, 20)
    allowed = {arrays[place].dtype, *map(np.dtype, case.other_types)}
    for dtype in DTYPES:
        if dtype not in allowed or not dtype.isnative:
            with pytest.raises(ValueError, match=f"is .*{arrays[place].shape[0]}.*; give"):
                case.function(*with_array(arrays, place, np.zeros(arrays[place].shape, dtype)))


@every_place
def test_other_numbers_of_axes_are_refused(name: str, place: int) -> None:
    case, arrays = CASES[name], CASES[name].make(12, 20)
    for ndim in {0, 1, 2, 3, 4} - {arrays[place].ndim, *(case.other_dims if place == 0 else ())}:
        with pytest.raises(ValueError, match=r"; give"):
            case.function(*with_array(arrays, place, np.zeros((12, 20, 3, 2)[:ndim], arrays[place].dtype)))


@every_place
def test_empty_arrays_are_refused(name: str, place: int) -> None:
    case, arrays = CASES[name], CASES[name].make(12, 20)
    for axis in range(arrays[place].ndim):
        empty = np.take(arrays[place], [], axis=axis)
        with pytest.raises(ValueError, match=r"; give"):
            case.function(*with_array(arrays, place, empty))
        if case.may_be_empty:
            nothing = np.zeros((0, 0))
            assert len(case.function(*(nothing for _ in arrays))) == 0


@every_place
@pytest.mark.parametrize("value", [None, 3, [[1, 2], [3, 4]], b"12"])
def test_what_is_no_array_is_refused(name: str, place: int, value: object) -> None:
    case, arrays = CASES[name], CASES[name].make(12, 20)
    with pytest.raises(TypeError, match=f"is of type {type(value).__name__}; give a NumPy array of"):
        case.function(*with_array(arrays, place, value))


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("shape", SHAPES)
def test_layout_does_not_matter(name: str, shape: tuple[int, int]) -> None:
    case, arrays = CASES[name], CASES[name].make(*shape)
    expected = case.function(*arrays)
    reversed_views = [np.flip(np.ascontiguousarray(np.flip(array))) for array in arrays]
    sparse = [np.repeat(array, 2, axis=-1)[..., ::2] for array in arrays]
    read_only = [np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape) for array in arrays]
    for variant in (reversed_views, sparse, [np.asfortranarray(array) for array in arrays], read_only):
        assert_equal(case.function(*variant), expected)
    for array, again in zip(arrays, case.make(*shape), strict=True):
        np.testing.assert_array_equal(array, again)  # no argument was written to


@pytest.mark.parametrize(
    "name",
    [
        *PAIR,
        *ROWS,
        "select_cells",
        "back_project",
        "obstacle_points",
        "with_slopes",
        "ground_grid",
        "segmentation_points",
        *IMAGE_AND_LABELS,
        "extend area",
        "extend evidence",
        "count_evidence",
        "propagate",
        "weighted_sum",
        "feature_distances",
        "compare",
    ],
)
def test_arrays_of_different_size_are_refused(name: str) -> None:
    case = CASES[name]
    for arrays, others in ((case.make(12, 20), case.make(12, 26)), (case.make(12, 26), case.make(12, 20))):
        with pytest.raises(ValueError, match=r"give "):
            case.function(*with_array(arrays, 0, others[0]))


@pytest.mark.parametrize("name", [*IMAGE_AND_LABELS, *REGIONS, *SUPERPIXELS])
@pytest.mark.parametrize("label", [-1, -(2**31), 2**31 - 1, 12 * 20])
def test_labels_out_of_range_are_refused(name: str, label: int) -> None:
    case, arrays = CASES[name], CASES[name].make(12, 20)
    for place, array in enumerate(arrays):
        if array.dtype == np.int32:
            changed = array.copy()
            changed.flat[7] = label
            with pytest.raises(ValueError, match=f"holds {label}; give labels from 0 to "):
                case.function(*with_array(arrays, place, changed))


@pytest.mark.parametrize("name", REGIONS)
def test_superpixels_without_a_cluster_are_refused(name: str) -> None:
    case, (*images, of_superpixel) = CASES[name], CASES[name].make(12, 20)
    with pytest.raises(ValueError, match="superpixels holds 9; give labels from 0 to 8"):
        case.function(*images, of_superpixel[:-1])


@pytest.mark.parametrize("name", [*DISPARITY, *(name for name in MAPS if name != "ground_line_of")])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -5.0, 1e38, 2.0**31, 2.0**15])
def test_no_disparity_counts_as_none(name: str, value: float) -> None:
    case, arrays = CASES[name], CASES[name].make(40, 60)
    holes = rng().random((40, 60)) < 0.1
    for place, array in enumerate(arrays):
        if array.dtype == np.float32:
            absurd, none = (np.where(holes, np.float32(x), array) for x in (value, 0.0))
            found = case.function(*with_array(arrays, place, absurd))
            assert_equal(found, case.function(*with_array(arrays, place, none)))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e38])
def test_only_absurd_disparities_leave_all_unknown(value: float) -> None:
    found = ground.detect_ground(np.full((40, 60), value, np.float32), CAMERA)
    assert found.line is None
    assert (found.occupancy == ground.UNKNOWN).all()
    assert found.u_disparity.shape == (2, 60)


@pytest.mark.parametrize("name", [*FLOATS, "superpixel_graph"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(name: str, value: float) -> None:
    case, arrays = CASES[name], CASES[name].make(12, 20)
    for place, array in enumerate(arrays):
        if array.dtype.kind == "f":
            changed = array.copy()
            changed.flat[1] = value
            with pytest.raises(ValueError, match=r"holds? values .*; give "):
                case.function(*with_array(arrays, place, changed))


@pytest.mark.parametrize(
    ("share", "ground", "message"),
    [
        (np.ones(2, np.float32), np.ones(2), r"remembered\.share is float32 \(2,\); give float64 \(2,\)"),
        (np.ones(2), np.ones(3), r"remembered\.ground is float64 \(3,\); give float64 \(2,\)"),
        (np.ones((2, 1)), np.ones(2), r"remembered\.share is float64 \(2, 1\); give float64 \(2,\)"),
        (np.array([0, 1.5]), np.ones(2), r"remembered\.share holds values from 0 to 1\.5; give 0 to 1"),
        (np.ones(2), np.array([-0.5, 1]), r"remembered\.ground holds values from -0\.5 to 1; give 0 to 1"),
        (np.ones(2), np.array([np.nan, 1]), r"remembered\.ground holds values from nan to nan; give 0 to 1"),
        (np.ones(1), np.ones(1), r"remembered\.share is float64 \(1,\); give float64 \(2,\)"),
    ],
)
def test_evidence_that_nobody_remembers_is_refused(share: Array, ground: Array, message: str) -> None:
    graph = propagation.superpixel_graph(labels(12, 20), features.Features(*looks(20)))
    remembered = propagation.Remembered(features.Features(*looks(4)), propagation.Evidence(share, ground))
    with pytest.raises(ValueError, match=message):
        propagation.propagate(occupancy(12, 20), graph, remembered=remembered)


def test_distances_of_all_magnitudes() -> None:
    points = np.array([0, 1e-300, 1.0, 2.0, 1e300])
    similar = clustering.affinity(np.abs(points[:, None] - points))
    assert np.isfinite(similar).all()
    tiny = np.array([[0, 1e-300, 1e300], [1e-300, 0, 1e300], [1e300, 1e300, 0]])
    assert np.isfinite(clustering.affinity(tiny)).all()
    assert clustering.spectral_clusters(tiny).shape == (3,)


@pytest.mark.parametrize("count", [0, -3, 2.0, True, None])
def test_numbers_of_things_are_whole_and_positive(count: object) -> None:
    image = disparity(12, 20)
    for call in (
        lambda: ground.u_disparity(image, n_disparities=count),
        lambda: ground.v_disparity(image, n_disparities=count),
        lambda: ground.obstacle_cells(np.zeros((8, 20), np.uint16), CAMERA, n_rows=count),
    ):
        with pytest.raises((TypeError, ValueError), match=r"(n_disparities|n_rows) is .*; give"):
            call()


@pytest.mark.parametrize(
    "values", [(0.0, 1.0), (-0.5, 1.0), (np.nan, 1.0), (0.5, np.inf), (0.5, 1.0, np.nan), (0.5, 1.0, 0.0, -np.inf)]
)
def test_lines_that_no_ground_has_are_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="; give"):
        ground.GroundLine(*values)


def test_both_images_of_elas_are_checked() -> None:
    with pytest.raises(ValueError, match=r"left image is uint8 \(4, 5\), right image uint8 \(5, 4\)"):
        Elas().compute_both(np.zeros((4, 5), np.uint8), np.zeros((5, 4), np.uint8))
    with pytest.raises(TypeError, match="right image is of type NoneType"):
        Elas().compute_both(np.zeros((4, 5), np.uint8), None)


def test_a_bright_right_image_is_not_clipped() -> None:
    texture = rng().integers(0, 1024, (60, 100)).astype(np.uint16)
    left, right = texture[:, :-6], texture[:, 6:] * np.uint16(4)  # 10 bits, and 12
    same = (left >> 4).astype(np.uint8), (right >> 4).astype(np.uint8)
    for matcher in (
        Elas(StereoConfig(n_disparities=16)),
        matching.create_matcher(StereoConfig(matcher="bm"), ElasConfig()),
    ):
        np.testing.assert_array_equal(matcher.compute(left, right), matcher.compute(*same))
