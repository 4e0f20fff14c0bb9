"""Parts of the method on one thread, and others' programs for the same task."""

from __future__ import annotations

import dataclasses
import importlib.util
import warnings
from collections.abc import Iterator
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.benchmark.timing import Contender
from lrtrav_ros.benchmark.workload import Workload
from lrtrav_ros.frame import pair_as_8bit, to_grey
from lrtrav_ros.method.clustering import affinity, spectral_clusters
from lrtrav_ros.method.comparison import feature_distances
from lrtrav_ros.method.features import superpixel_features
from lrtrav_ros.method.matching import create_matcher
from lrtrav_ros.method.superpixels import preemptive_slic

REFERENCE = "OpenCV StereoSGBM"
"""All times are told as ratios to its."""

OPTIONAL = {"skimage": "scikit-image", "sklearn": "scikit-learn"}
"""Packages that rivals are of, by what is imported."""

_BLOCK_SIZE = 5


def installed() -> frozenset[str]:
    """Return the names, for imports, of those of `OPTIONAL` that are installed."""
    return frozenset(name for name in OPTIONAL if importlib.util.find_spec(name) is not None)


def reference(workload: Workload) -> Contender:
    """Return StereoSGBM along five directions; for frames without a right image, on the left one alone.

    It has as many disparities as the workload, but for a multiple of 16.
    """
    area = _BLOCK_SIZE**2
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=_range(workload), blockSize=_BLOCK_SIZE,
        P1=8 * area, P2=32 * area, disp12MaxDiff=1, uniquenessRatio=10,
        speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM,
    )  # fmt: skip
    return Contender(name=REFERENCE, calls=[partial(matcher.compute, *pair) for pair in _grey_pairs(workload)])


def contests(workload: Workload) -> Iterator[Contender]:
    """Yield each part of the method that others have a program for, alone on one thread, and those programs.

    Those of `OPTIONAL` are left out where they are not installed.
    """
    if workload.is_stereo:
        yield from _matchers(workload)
    images = [frame.image for frame in workload.frames]
    yield Contender(
        name="superpixels", calls=[partial(preemptive_slic, image, workload.config.superpixels) for image in images]
    )
    if "skimage" in installed():
        yield _slic_of_skimage(workload)
    distances = [_distances(image, workload) for image in images]
    clustering = workload.config.clustering
    yield Contender(name="clustering", calls=[partial(spectral_clusters, item, clustering) for item in distances])
    if "sklearn" in installed():
        n_clusters = [int(spectral_clusters(item, clustering).max()) + 1 for item in distances]
        yield Contender(
            name="scikit-learn SpectralClustering",
            calls=[partial(_clusters_of_sklearn, *pair) for pair in zip(distances, n_clusters, strict=True)],
        )


def _matchers(workload: Workload) -> Iterator[Contender]:
    """Yield the configured matcher and StereoBM."""
    config = workload.config
    for half in sorted({config.stereo.half_resolution, True}):
        matcher = create_matcher(dataclasses.replace(config.stereo, half_resolution=half), config.elas)
        calls = [partial(matcher.compute, *pair) for pair in _pairs(workload)]
        yield Contender(name=f"matching, {config.stereo.matcher}", calls=calls, half_resolution=half)
    block_matcher = cv2.StereoBM_create(numDisparities=_range(workload), blockSize=15)
    calls = [partial(block_matcher.compute, *pair) for pair in _grey_pairs(workload)]
    yield Contender(name="OpenCV StereoBM", calls=calls)


def _range(workload: Workload) -> int:
    """Return the workload's number of disparities as a multiple of 16, which OpenCV insists on.

    Raises ValueError where the images are too narrow for it.
    """
    n_disparities = -(-workload.config.stereo.n_disparities // 16) * 16
    if workload.width <= n_disparities:
        raise ValueError(
            f"images are {workload.width} pixels wide; {REFERENCE} needs more than its {n_disparities} disparities: "
            "give larger images, or a smaller stereo.n_disparities"
        )
    return n_disparities


def _pairs(workload: Workload) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Return the left and right images; the left one twice where there is no right one."""
    pairs = [
        (frame.image, frame.image) if frame.left is None or frame.right is None else (frame.left, frame.right)
        for frame in workload.frames
    ]
    return [pair_as_8bit(*pair) for pair in pairs]


def _grey_pairs(workload: Workload) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Return the left and right images in grey."""
    return [(to_grey(left), to_grey(right)) for left, right in _pairs(workload)]


def _slic_of_skimage(workload: Workload) -> Contender:
    """Return scikit-image's SLIC as it is by default."""
    from skimage.segmentation import slic

    rgb = [
        cv2.cvtColor(frame.image, cv2.COLOR_GRAY2RGB if frame.image.ndim == 2 else cv2.COLOR_BGR2RGB)
        for frame in workload.frames
    ]
    n_segments = workload.config.superpixels.n_superpixels
    return Contender(name="scikit-image SLIC", calls=[partial(slic, image, n_segments=n_segments) for image in rgb])


def _distances(image: NDArray[np.uint8], workload: Workload) -> NDArray[np.float64]:
    """Return the distances (n, n) of an image's superpixels."""
    config = workload.config
    superpixels = preemptive_slic(image, config.superpixels)
    return feature_distances(superpixel_features(image, superpixels, config.features), config.features)


def _clusters_of_sklearn(distances: NDArray[np.float64], n_clusters: int) -> Any:
    """Return the clusters that scikit-learn finds in the same affinity."""
    from sklearn.cluster import SpectralClustering

    clustering = SpectralClustering(n_clusters, affinity="precomputed", random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of superpixels that are like no other
        return clustering.fit_predict(affinity(distances))
