"""Every public function and class of the package that takes arrays, with arguments that it can have.

`test_public_calls.py` changes one argument at a time, and `fuzz/test_call_attack.py` several at random.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import re
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
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
    n_labels,
    occupancy,
    rng,
)

import lrtrav_ros
from lrtrav_ros import config, detector, frame, rectification
from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.evaluation.report import gallery
from lrtrav_ros.evaluation.scoring import flicker, ground_distances, near_to_far, obstacles, reliability, scores
from lrtrav_ros.evaluation.truth import labelled_sets
from lrtrav_ros.evaluation.truth import labels as truth_labels
from lrtrav_ros.io import (
    bag_messages,
    dataset_folder,
    encodings,
    image_files,
    message_frames,
    pictures,
    point_clouds,
)
from lrtrav_ros.mapping import grid, ground_disparity, ground_frame, points, segmentation, slopes
from lrtrav_ros.method import (
    clustering,
    comparison,
    extension,
    features,
    ground,
    matching,
    propagation,
    superpixels,
    textures,
)
from lrtrav_ros.method.matching import delaunay, elas, opencv, refinement, row_offset
from lrtrav_ros.pose import Pose
from lrtrav_ros.registration import DepthRegistration
from lrtrav_ros.synthetic import drops, raycasting, rendering
from lrtrav_ros.synthetic.landscape import make_scene
from lrtrav_ros.synthetic.rendering import camera_view
from lrtrav_ros.synthetic.scene_config import SceneConfig

Arguments = dict[str, Any]

ELSEWHERE = {
    "evaluation.scoring.scores.check_same_size",  # a check itself, as those of numerics/checks.py
    "io.encodings.decode_compressed",  # of bytes
    "method.comparison.compare",  # see what it returns
    "method.features.joined",  # of what was checked
    "method.matching.Matcher.compute",  # a protocol
    "method.memory.Memory.remember",  # of what was checked
}
"""Public names that take arrays and are not in the table."""

ROOMS_WITHOUT = ("nodes", "commands", "benchmark")  # these only hand arrays on


@dataclass(frozen=True)
class PublicCall:
    """A public function of `module`, by its name there, and arguments of images of (height, width)."""

    module: str
    name: str
    make: Callable[[int, int], Arguments]
    function: Callable[..., object]
    variant: str = ""

    def __str__(self) -> str:
        return f"{self.module}.{self.name}{self.variant and ' '}{self.variant}"

    def answer(self, arguments: Arguments) -> Exception | None:
        """Return how the function refuses arguments, None where it takes them; assert that it does one of the two.

        A refusal is a TypeError or ValueError that says what is wrong and, after a semicolon, what to give.
        """
        error: Exception | None = None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                self.function(**arguments)
        except Exception as err:  # of whatever kind, to say which call it was
            error = err
        if error is None or (isinstance(error, (TypeError, ValueError)) and ";" in str(error)):
            return error
        shown = ", ".join(f"{name}={value!r:.200}" for name, value in arguments.items())
        raise AssertionError(f"{self} with {shown} raises {error!r}") from error


def other(image: Array) -> Array:
    """Return the right image of a left one."""
    return np.roll(image, -1, axis=1)


def mask(height: int, width: int) -> Array:
    return rng().choice(np.array([0, 255], np.uint8), (height, width))


def truth(height: int, width: int) -> Array:
    return rng().choice(np.array([0, 128, 255], np.uint8), (height, width))


def distances(n: int) -> Array:
    points = rng().random(n)
    return np.abs(points[:, None] - points)


def histograms(n: int, bins: int) -> Array:
    return rng().dirichlet(np.ones(bins), n).astype(np.float32)


def some_features(n: int) -> features.Features:
    return features.Features(histograms(n, 9), histograms(n, 7), rng().normal(0, 0.1, (n, 2)))


def remembered() -> propagation.Remembered:
    return propagation.Remembered(some_features(4), propagation.Evidence(np.full(4, 0.2), np.full(4, 0.5)))


def belief(width: int) -> propagation.Belief:
    n = n_labels(width)
    return propagation.Belief(rng().random((n, 2)), rng().normal(0, 0.1, (n, 2)), rng().random(n))


def graph(height: int, width: int) -> propagation.SuperpixelGraph:
    return propagation.superpixel_graph(labels(height, width), some_features(n_labels(width)))


def a_grid() -> grid.Grid:
    return grid.Grid(rng().choice(np.array([0, 100, -1], np.int8), (6, 9)), 0.5, (0.0, -1.5))


@cache
def scene() -> raycasting.Scene:
    return raycasting.with_shadows(make_scene(SceneConfig(width=32, height=32, n_obstacles=1)))


def view(height: int, width: int) -> raycasting.View:
    return camera_view(SceneConfig(width=32, height=32), scene(), 0)._replace(height=height, width=width)


def cast(scene: raycasting.Scene, view: raycasting.View, n_parts: int) -> object:
    """Cast the rays of a view, and wait."""
    with ThreadPoolExecutor(1) as executor:
        picture, parts = raycasting.cast(scene, view, executor, n_parts)
        return picture, [part.result() for part in parts]


def raw_pair(height: int, width: int) -> rectification.RawPair:
    """Return the calibration of images of 20 x 12 pixels, or more: those of one row or column would show nothing."""
    height, width = max(height, 12), max(width, 20)
    lens = rectification.Lens(width=width, height=height, fx=20.0, fy=20.0, cx=width / 2, cy=height / 2)
    return rectification.raw_pair(lens, lens, rotation=np.eye(3).reshape(-1).tolist(), translation_m=(-0.3, 0.0, 0.0))


def header() -> Any:
    return bag_messages.header_message(1, "camera")


def small(**values: Any) -> config.Config:
    return config.Config().updated({"threads": 1, "stereo.n_disparities": 8, **values})


def case(
    module: Any,
    name: str,
    make: Callable[[int, int], Arguments],
    function: Callable[..., object] | None = None,
    *,
    variant: str = "",
) -> PublicCall:
    """Return a call of what a module has under a name, or of a function that comes to the same."""
    where = module.__name__.removeprefix("lrtrav_ros.")
    return PublicCall(where, name, make, function or getattr(module, name), variant)


def public_calls() -> list[PublicCall]:
    """Return all of them."""
    return [
        *_calls_at_the_top(),
        *_calls_of_matching(),
        *_calls_of_ground(),
        *_calls_of_looks(),
        *_calls_of_extension(),
        *_calls_of_maps(),
        *_calls_of_files(),
        *_calls_of_evaluation(),
        *_calls_of_scenes(),
    ]


def _calls_at_the_top() -> Iterator[PublicCall]:
    yield case(frame, "as_8bit", lambda h, w: {"image": bgr(h, w)})
    yield case(frame, "as_8bit", lambda h, w: {"image": grey(h, w).astype(np.uint16)}, variant="uint16")
    yield case(frame, "pair_as_8bit", lambda h, w: {"left": grey(h, w), "right": grey(h, w)})
    yield case(frame, "to_grey", lambda h, w: {"image": bgr(h, w)})
    yield case(frame, "valid_disparity", lambda h, w: {"disparity": disparity(h, w)})
    yield case(frame, "valid_depth", lambda h, w: {"depth_m": disparity(h, w)})
    yield case(frame, "Frame", lambda h, w: {"camera": CAMERA, "left": bgr(h, w), "right": bgr(h, w)}, variant="stereo")
    yield case(
        frame,
        "Frame",
        lambda h, w: {
            "camera": CAMERA,
            "left": bgr(h, w),
            "disparity": disparity(h, w),
            "unseen": mask(h, w) > 0,
            "stamp_ns": 1,
        },
        variant="disparity",
    )
    yield case(
        frame, "Frame", lambda h, w: {"camera": CAMERA, "left": grey(h, w), "depth_m": disparity(h, w)}, variant="depth"
    )
    camera = inspect.getmodule(StereoCamera)
    values = {"fx": 20.0, "cx": 9.5, "cy": 2.0, "baseline_m": 0.3, "fy": 20.0, "width": 20, "height": 12}
    yield case(camera, "StereoCamera", lambda h, w: dict(values))
    yield case(
        rectification,
        "Lens",
        lambda h, w: {
            **{name: values[name] for name in ("fx", "fy", "cx", "cy", "width", "height")},
            "distortion_model": "plumb_bob",
            "distortion": (0.1, 0.0, 0.0, 0.0),
        },
    )
    yield case(ground, "GroundLine", lambda h, w: {"slope": 0.5, "intercept": -1.0, "tilt": 0.1, "bend": 0.1})
    yield case(camera, "StereoCamera.depth_m", lambda h, w: {"disparity": disparity(h, w)}, CAMERA.depth_m)
    yield case(camera, "StereoCamera.disparity", lambda h, w: {"depth_m": disparity(h, w)}, CAMERA.disparity)
    pose = inspect.getmodule(Pose)
    yield case(pose, "Pose", lambda h, w: {"rotation": np.eye(3), "translation_m": np.zeros(3)})
    yield case(
        inspect.getmodule(DepthRegistration),
        "DepthRegistration.registered",
        lambda h, w: {"depth_m": disparity(h, w)},
        DepthRegistration(
            CAMERA, dataclasses.replace(CAMERA, width=30, height=14), Pose.parsed("0.1 0 0.02 0 0.01 0")
        ).registered,
    )
    yield case(
        rectification,
        "Rectification.rectify",
        lambda h, w: {
            "pair": raw_pair(h, w),
            "left": bgr(max(h, 12), max(w, 20)),
            "right": bgr(max(h, 12), max(w, 20)),
        },
        lambda pair, left, right: rectification.Rectification(pair).rectify(left, right),
    )
    yield from _calls_of_detector()


def _calls_of_detector() -> Iterator[PublicCall]:
    def detect(left: Array, **others: Array) -> object:
        return detector.Detector(small(), CAMERA).detect(left, **others)

    yield case(
        detector, "Detector.detect", lambda h, w: {"left": bgr(h, w), "right": bgr(h, w)}, detect, variant="stereo"
    )
    yield case(
        detector,
        "Detector.detect",
        lambda h, w: {"left": bgr(h, w), "disparity": disparity(h, w)},
        detect,
        variant="disp",
    )
    yield case(
        detector,
        "Detector.detect",
        lambda h, w: {"left": grey(h, w), "depth_m": disparity(h, w)},
        detect,
        variant="depth",
    )
    for rule in ("propagation", "evidence"):
        long = detector.LongRangeDetector(small(**{"extension.rule": rule}))
        yield case(
            detector,
            "LongRangeDetector.detect",
            lambda h, w: {"image": bgr(h, w), "occupancy": occupancy(h, w), "stamp_ns": 1},
            long.detect,
            variant=rule,
        )
        yield case(detector, "LongRangeDetector.look", lambda h, w: {"image": bgr(h, w)}, long.look, variant=rule)
        yield case(
            detector,
            "LongRangeDetector.extend",
            lambda h, w, long=long: {"appearance": long.look(bgr(h, w)), "occupancy": occupancy(h, w)},
            long.extend,
            variant=rule,
        )
    yield case(
        detector,
        "LongRange.without",
        lambda h, w: {"occupancy": occupancy(h, w), "unseen": mask(h, w) > 0},
        lambda occupancy, unseen=None: detector.LongRange(occupancy, occupancy, list).without(unseen),
    )
    yield case(detector, "within_reach", lambda h, w: {"disparity": disparity(h, w), "camera": CAMERA, "limit_m": 3.0})


def _calls_of_matching() -> Iterator[PublicCall]:
    for name in matching.MATCHERS:
        for half in (False, True):
            matcher = matching.create_matcher(
                config.StereoConfig(matcher=name, n_disparities=8, half_resolution=half), config.ElasConfig()
            )
            module, kind = (elas, "Elas") if name == "elas" else (opencv, "OpenCVMatcher")
            variant = f"{name}{' half' if half else ''}"
            pair = lambda h, w: {"left": grey(h, w), "right": other(grey(h, w))}  # noqa: E731
            yield case(module, f"{kind}.compute", pair, matcher.compute, variant=variant)
            if isinstance(matcher, elas.Elas):
                yield case(elas, "Elas.compute_both", pair, matcher.compute_both, variant=variant)
    yield case(
        row_offset,
        "row_offset",
        lambda h, w: {"left": grey(h, w), "right": other(grey(h, w)), "disparity": disparity(h, w)},
    )
    yield case(
        refinement,
        "refine",
        lambda h, w: {
            "found": rng().integers(-1, 8, (h, w)).astype(np.int16),
            "elas": config.ElasConfig(),
            "halvings": 1,
        },
    )
    yield case(delaunay, "delaunay", lambda h, w: {"points": rng().uniform(0, 20, (w, 2))})


def _calls_of_ground() -> Iterator[PublicCall]:
    yield case(
        ground,
        "detect_ground",
        lambda h, w: {"disparity": disparity(h, w), "camera": CAMERA, "config": config.GroundConfig(), "before": LINE},
    )
    yield case(ground, "u_disparity", lambda h, w: {"disparity": disparity(h, w), "n_disparities": 8})
    yield case(ground, "v_disparity", lambda h, w: {"disparity": disparity(h, w), "n_disparities": 8})
    yield case(
        ground,
        "obstacle_cells",
        lambda h, w: {
            "histogram": rng().integers(0, 12, (8, w), np.uint16),
            "camera": CAMERA,
            "config": config.GroundConfig(),
            "n_rows": h,
        },
    )
    yield case(
        ground,
        "find_ground_line",
        lambda h, w: {
            "histogram": rng().integers(0, 9, (h, 8), np.int32),
            "camera": CAMERA,
            "config": config.GroundConfig(),
        },
    )
    yield case(ground, "select_cells", lambda h, w: {"disparity": disparity(h, w), "cells": rng().random((8, w)) < 0.5})
    for least_m in (0.35, 0.0):
        yield case(
            ground,
            "back_project",
            lambda h, w, least_m=least_m: {
                "disparity": disparity(h, w),
                "obstacles": np.where(rng().random((h, w)) < 0.2, disparity(h, w), np.float32(0)),
                "line": LINE,
                "camera": CAMERA,
                "config": config.GroundConfig(min_obstacle_m=least_m),
            },
            variant=f"min_obstacle_m={least_m}",
        )
    yield case(ground, "traversable_mask", lambda h, w: {"occupancy": occupancy(h, w)})
    yield case(
        ground,
        "GroundLine.distance_m",
        lambda h, w: {"row": np.arange(h, dtype=np.float64), "camera": CAMERA},
        LINE.distance_m,
    )


def _calls_of_looks() -> Iterator[PublicCall]:
    for name in (
        "weber_descriptor",
        "local_binary_pattern",
        "centre_symmetric_pattern",
        "local_ternary_patterns",
        "local_homogeneity",
    ):
        yield case(textures, name, lambda h, w: {"grey": grey(h, w)})
    slic = config.SuperpixelsConfig(n_superpixels=10)
    yield case(superpixels, "preemptive_slic", lambda h, w: {"image": bgr(h, w), "config": slic})
    yield case(superpixels, "preemptive_slic", lambda h, w: {"image": grey(h, w), "config": slic}, variant="grey")
    yield case(features, "pixel_bins", lambda h, w: {"image": bgr(h, w), "config": config.FeaturesConfig()})
    pair: Callable[[int, int], Arguments] = lambda h, w: {"image": bgr(h, w), "superpixels": labels(h, w)}  # noqa: E731
    for name in ("colour_histograms", "log_chromaticity", "superpixel_features", "texture_histograms"):
        yield case(features, name, pair)
    yield case(
        features,
        "superpixel_features",
        lambda h, w: {
            "image": bgr(h, w),
            "superpixels": labels(h, w),
            "config": config.FeaturesConfig(texture="ltp"),
            "bins": features.pixel_bins(bgr(h, w), config.FeaturesConfig(texture="ltp")),
        },
        variant="bins",
    )
    yield case(features, "texture_histograms", lambda h, w: {**pair(h, w), "texture": "ltp"}, variant="ltp")
    yield case(
        features,
        "Features.chosen",
        lambda h, w: {"features": some_features(w), "which": np.arange(w)[::2]},
        lambda features, which: features.chosen(which),
    )
    yield case(comparison, "weighted_sum", lambda h, w: {"colour": distances(w), "texture": distances(w)})
    yield case(comparison, "landmarks", lambda h, w: {"features": some_features(w), "config": config.FeaturesConfig()})
    for name in comparison.DISTANCES:
        settings = config.FeaturesConfig(distance=name)
        yield case(
            comparison,
            "histogram_distances",
            lambda h, w, name=name: {"histograms": histograms(h, w), "distance": name},
            variant=name,
        )
        yield case(
            comparison,
            "feature_distances",
            lambda h, w, settings=settings: {"features": some_features(w), "config": settings},
            variant=name,
        )
        yield case(
            comparison,
            "Comparison.of_pairs",
            lambda h, w, settings=settings: {
                "features": some_features(w),
                "config": settings,
                "first": np.arange(w),
                "second": np.arange(w)[::-1],
            },
            lambda features, config, first, second: comparison.compare(features, config).of_pairs(first, second),
            variant=name,
        )
        yield case(
            comparison,
            "Comparison.with_others",
            lambda h, w, settings=settings: {
                "features": some_features(w),
                "config": settings,
                "others": some_features(h),
            },
            lambda features, config, others: comparison.compare(features, config).with_others(others),
            variant=name,
        )
    yield case(
        clustering, "spectral_clusters", lambda h, w: {"distances": distances(w), "config": config.ClusteringConfig()}
    )
    yield case(clustering, "affinity", lambda h, w: {"distances": distances(w)})
    yield case(clustering, "automatic_k", lambda h, w: {"eigenvalues": np.linspace(1, 0, w) ** 2})
    yield case(
        clustering, "spread_clusters", lambda h, w: {"clusters": clusters(w), "features": some_features(n_labels(w))}
    )


def _calls_of_extension() -> Iterator[PublicCall]:
    for rule in extension.RULES:
        yield case(
            extension,
            "extend",
            lambda h, w, rule=rule: {
                "occupancy": occupancy(h, w),
                "superpixels": labels(h, w),
                "clusters": clusters(w),
                "config": config.ExtensionConfig(rule=rule),
            },
            variant=rule,
        )
    yield case(extension, "connected_regions", lambda h, w: {"superpixels": labels(h, w), "clusters": clusters(w)})
    yield case(extension, "superpixel_layout", lambda h, w: {"superpixels": labels(h, w), "n": n_labels(w)})
    yield case(
        extension,
        "count_evidence",
        lambda h, w: {"occupancy": occupancy(h, w), "superpixels": labels(h, w), "n": n_labels(w)},
    )
    yield case(
        propagation,
        "superpixel_graph",
        lambda h, w: {
            "superpixels": labels(h, w),
            "features": some_features(n_labels(w)),
            "config": config.FeaturesConfig(),
        },
    )
    yield case(
        propagation,
        "SuperpixelGraph",
        lambda h, w: {item.name: getattr(graph(h, w), item.name) for item in dataclasses.fields(graph(h, w))},
    )
    yield case(
        propagation,
        "propagate",
        lambda h, w: {
            "occupancy": occupancy(h, w),
            "graph": graph(h, w),
            "remembered": remembered(),
            "before": belief(w),
            "min_share": 0.5,
        },
    )


def _calls_of_maps() -> Iterator[PublicCall]:
    maps = config.MapsConfig(length_m=8.0, width_m=6.0, cell_m=0.5)
    ground_of: Arguments = {"line": LINE, "camera": CAMERA, "config": maps}
    yield case(
        points,
        "obstacle_points",
        lambda h, w: {"disparity": disparity(h, w), "occupancy": occupancy(h, w), **ground_of, "least_height_m": 0.08},
    )
    yield case(points, "free_points", lambda h, w: {"occupancy": occupancy(h, w), **ground_of})
    yield case(
        slopes, "with_slopes", lambda h, w: {"occupancy": occupancy(h, w), "disparity": disparity(h, w), **ground_of}
    )
    yield case(ground_disparity, "ground_line_of", lambda h, w: {"disparity": disparity(h, w)})
    yield case(
        grid,
        "ground_grid",
        lambda h, w: {
            "occupancy": occupancy(h, w),
            "near": NearGround(occupancy(h, w), disparity(h, w), LINE),
            "camera": CAMERA,
            "config": maps,
        },
    )
    cells = lambda h, w: {"cells": a_grid().cells, "resolution_m": 0.5, "origin_m": (0.0, -1.5)}  # noqa: E731
    yield case(grid, "Grid", cells)
    yield case(
        grid,
        "Grid.in_frame",
        lambda h, w: {**cells(h, w), "x_m": 1.0, "y_m": 2.0, "yaw_rad": 0.3},
        lambda x_m, y_m, yaw_rad, **grid_values: grid.Grid(**grid_values).in_frame(x_m, y_m, yaw_rad),
    )
    yield case(segmentation, "segmentation_mask", lambda h, w: {"occupancy": occupancy(h, w)})
    yield case(
        segmentation, "segmentation_confidence", lambda h, w: {"occupancy": occupancy(h, w), "confidence": grey(h, w)}
    )
    yield case(
        segmentation,
        "segmentation_points",
        lambda h, w: {"occupancy": occupancy(h, w), "disparity": disparity(h, w), **ground_of},
    )
    over = ground_frame.GroundFrame.of(LINE, CAMERA)
    yield case(ground_frame, "GroundFrame", lambda h, w: {"rotation": over.rotation.copy(), "height_m": 1.0})
    yield case(
        ground_frame,
        "GroundFrame.from_up",
        lambda h, w: {"up": np.array([0.0, -1.0, 0.1]), "height_m": 1.0},
        ground_frame.GroundFrame.from_up,
    )
    for name in ("from_camera", "to_camera"):
        yield case(
            ground_frame, f"GroundFrame.{name}", lambda h, w: {"points": rng().random((w, 3))}, getattr(over, name)
        )


def _calls_of_files() -> Iterator[PublicCall]:
    yield case(encodings, "encode_image", lambda h, w: {"image": bgr(h, w)})
    yield case(encodings, "encode_image", lambda h, w: {"image": disparity(h, w)}, variant="float32")
    yield case(
        encodings,
        "decode_image",
        lambda h, w: {"data": bgr(h, w).reshape(-1), "encoding": "rgb8", "height": h, "width": w, "step": 3 * w},
    )
    yield case(point_clouds, "encode_points", lambda h, w: {"points": rng().random((h, w, 3), np.float32)})
    for path in ("a.png", "a.jpg"):
        yield case(
            image_files,
            "encode_file",
            lambda h, w: {"image": bgr(h, w)},
            partial(image_files.encode_file, path),
            variant=path,
        )
    yield case(
        image_files,
        "write_image",
        lambda h, w: {"image": bgr(h, w)},
        _written(partial(image_files.write_image, "/dev/null/a/b.png")),
    )
    yield case(
        image_files,
        "write_disparity",
        lambda h, w: {"disparity": disparity(h, w)},
        _written(partial(image_files.write_disparity, "/dev/null/a/b.png")),
    )
    yield case(image_files, "scaled_disparity", lambda h, w: {"disparity": disparity(h, w)})
    yield case(
        dataset_folder,
        "write_frame",
        lambda h, w: {"truth": truth(h, w), "disparity": disparity(h, w), "height_m": disparity(h, w)},
        _written(
            partial(
                dataset_folder.write_frame,
                "/dev/null/a",
                frame.Frame(camera=CAMERA, disparity=np.ones((12, 20), np.float32), name="1"),
            )
        ),
    )
    yield case(message_frames, "depth_in_metres", lambda h, w: {"image": disparity(h, w)})
    yield case(
        dataset_folder,
        "frame_files",
        lambda h, w: {
            "frame": frame.Frame(camera=CAMERA, disparity=disparity(h, w), name="1"),
            "truth": truth(h, w),
            "disparity": disparity(h, w),
            "height_m": disparity(h, w),
        },
    )
    yield from _calls_of_pictures()
    yield case(bag_messages, "image_message", lambda h, w: {"header": header(), "image": bgr(h, w)})
    yield case(
        bag_messages,
        "disparity_message",
        lambda h, w: {"header": header(), "disparity": disparity(h, w), "camera": CAMERA},
    )
    yield case(
        bag_messages, "points_message", lambda h, w: {"header": header(), "points": rng().random((w, 3), np.float32)}
    )


def _written(write: Callable[..., object]) -> Callable[..., object]:
    """Return a function that writes nowhere: that the folder cannot be is what it comes to with good arguments."""

    def written(**arguments: Any) -> None:
        try:
            write(**arguments)
        except (NotADirectoryError, FileExistsError):
            return

    written.__signature__ = inspect.signature(write)  # type: ignore[attr-defined]
    return written


def _calls_of_pictures() -> Iterator[PublicCall]:
    yield case(
        pictures,
        "overlay",
        lambda h, w: {"left": bgr(h, w), "short_range": occupancy(h, w), "long_range": occupancy(h, w)},
    )
    yield case(pictures, "colour_image", lambda h, w: {"image": grey(h, w)})
    yield case(pictures, "superpixel_picture", lambda h, w: {"left": grey(h, w), "superpixels": labels(h, w)})
    yield case(pictures, "label_picture", lambda h, w: {"labels": labels(h, w)})
    yield case(pictures, "disparity_picture", lambda h, w: {"disparity": disparity(h, w)})
    yield case(pictures, "histogram_picture", lambda h, w: {"histogram": labels(h, w)})
    yield case(pictures, "grid_picture", lambda h, w: {"grid": a_grid()})
    yield case(pictures, "overlay_beside_grid", lambda h, w: {"overlay_picture": bgr(h, w), "grid": a_grid()})
    yield case(pictures, "truth_picture", lambda h, w: {"left": bgr(h, w), "truth": truth(h, w)})
    yield case(pictures, "error_picture", lambda h, w: {"left": bgr(h, w), "mask": mask(h, w), "truth": truth(h, w)})
    yield case(
        pictures,
        "stages_picture",
        lambda h, w: {
            "left": bgr(h, w),
            "short_range": occupancy(h, w),
            "superpixels": labels(h, w),
            "clusters": labels(h, w),
            "long_range": occupancy(h, w),
            "truth": truth(h, w),
        },
    )


def _calls_of_evaluation() -> Iterator[PublicCall]:
    images: Callable[[int, int], Arguments] = lambda h, w: {"mask": mask(h, w), "truth": truth(h, w)}  # noqa: E731
    yield case(scores, "count", lambda h, w: {**images(h, w), "where": mask(h, w) > 0})
    yield case(scores, "score", images)
    yield case(scores, "count_bands", lambda h, w: {**images(h, w), "distance_m": disparity(h, w).astype(np.float64)})
    yield case(reliability, "count_confidence", lambda h, w: {"confidence": grey(h, w), **images(h, w)})
    yield case(
        near_to_far,
        "classify_superpixels",
        lambda h, w: {
            "histograms": histograms(n_labels(w), 9),
            "superpixels": labels(h, w),
            "occupancy": occupancy(h, w),
        },
    )
    yield case(
        obstacles,
        "StandingObstacles",
        lambda h, w: {
            "truth": truth(h, w),
            "distance_m": disparity(h, w).astype(np.float64),
            "height_m": disparity(h, w),
        },
    )
    yield case(
        obstacles,
        "StandingObstacles.missed",
        images,
        lambda mask, truth: obstacles.StandingObstacles(truth).missed(mask),
    )
    yield case(
        obstacles,
        "StandingObstacles.scores",
        images,
        lambda mask, truth: obstacles.StandingObstacles(truth).scores([mask]),
    )
    yield case(
        ground_distances,
        "GroundDistances.reach_m",
        lambda h, w: {**images(h, w), "shape": (h, w)},
        lambda mask, truth, shape: ground_distances.GroundDistances(LINE, CAMERA, shape).reach_m(mask, truth),
    )
    yield case(
        flicker,
        "mean_flicker",
        lambda h, w: {"before": mask(h, w), "after": mask(h, w)},
        lambda before=None, after=None: flicker.mean_flicker([before, after]),
    )
    yield case(
        labelled_sets,
        "LabelledFrame",
        lambda h, w: {
            "frame": frame.Frame(camera=CAMERA, disparity=disparity(h, w)),
            "truth": truth(h, w),
            "height_m": disparity(h, w),
        },
    )
    labelled = truth_labels.Labels()
    yield case(truth_labels, "decode_truth", lambda h, w: {"image": truth(h, w), "labels": labelled})
    yield case(truth_labels, "apply_unknown_rule", lambda h, w: {"truth": truth(h, w), "rule": "not-traversable"})
    yield case(
        gallery,
        "called_free_picture",
        lambda h, w: {"image": bgr(h, w), **images(h, w), "obstacles": obstacles.StandingObstacles(truth(h, w))},
    )


def _calls_of_scenes() -> Iterator[PublicCall]:
    yield case(raycasting, "cast", lambda h, w: {"scene": scene(), "view": view(h, w), "n_parts": 2}, cast)
    yield case(
        rendering, "camera_view", lambda h, w: {"config": SceneConfig(), "scene": scene(), "index": 1, "side": 1}
    )
    yield case(raycasting, "with_shadows", lambda h, w: {"scene": scene()})
    yield case(
        raycasting,
        "with_canopy",
        lambda h, w: {
            "scene": scene(),
            "places": rng().random((w, 2)),
            "share": 0.5,
            "height_m": 5.0,
            "sky_share": 0.3,
        },
    )
    yield case(raycasting, "ground_height", lambda h, w: {"waves": rng().random((w, 4)), "x": 1.0, "y": 2.0})
    for name in ("path_middle", "path_heading"):
        yield case(raycasting, name, lambda h, w: {"path": rng().random((w, 3)), "y": 2.0})
    yield case(
        drops,
        "make_pits",
        lambda h, w: {
            "config": SceneConfig(drops="ditch"),
            "path": rng().random((3, 3)),
            "half_width": 1.0,
            "materials": drops.PitMaterials(soil=0, masonry=1, ballast=2),
        },
    )
    yield case(
        drops,
        "settled",
        lambda h, w: {"thing": rng().random((w, 10)), "pits": rng().random((3, 9))},
        lambda thing, pits: drops.settled([thing], pits),
    )


def names_that_take_arrays() -> set[str]:
    """Return the name of every public function, method and checked class of the package that takes an array."""
    found = set()
    for info in pkgutil.walk_packages(lrtrav_ros.__path__, "lrtrav_ros."):
        parts = info.name.split(".")[1:]
        if parts[0] in ROOMS_WITHOUT or any(part.startswith("_") for part in parts):
            continue
        module = importlib.import_module(info.name)
        for name, value in vars(module).items():
            if name.startswith("_") or getattr(value, "__module__", None) != module.__name__:
                continue
            found |= {f"{'.'.join(parts)}.{found_name}" for found_name in _taking_arrays(name, value)}
    return found


def _taking_arrays(name: str, value: Any) -> Iterator[str]:
    """Yield the names of a function, or of a class and its methods, that take arrays."""
    if inspect.isfunction(value):
        if _takes_array(value):
            yield name
    elif inspect.isclass(value):
        has_check = "__post_init__" in vars(value) or not dataclasses.is_dataclass(value)
        if has_check and not issubclass(value, tuple) and _takes_array(value.__init__):
            yield name
        for method_name, method in vars(value).items():
            method = getattr(method, "__func__", method)  # of a class method
            if not method_name.startswith("_") and inspect.isfunction(method) and _takes_array(method):
                yield f"{name}.{method_name}"


def _takes_array(function: Any) -> bool:
    annotations = getattr(function, "__annotations__", {})
    return any(
        re.search(r"\b(NDArray|Image|Buffer|Features|Scene)\b", str(annotation))
        for name, annotation in annotations.items()
        if name != "return"
    )
