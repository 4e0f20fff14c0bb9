"""Images, disparities, cameras, ground lines, superpixels and settings for Hypothesis to choose from.

What an image holds is drawn by kind and seed, which takes less time than by pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, Parameter, parameters
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN, GroundLine

Array = NDArray[Any]
Shape = tuple[int, int]

_MAX_COMPARED = 500  # superpixels, by another distance than correlation
_MAX_CELLS = 20_000  # of a grid: larger ones only take time
_TEXTS = ("source.depth_pose", "maps.frame")
_SEEDS = st.integers(0, 2**32 - 1)

SHAPES = st.tuples(st.integers(1, 48), st.integers(1, 64)).filter(lambda shape: shape[0] != shape[1] or shape < (4, 4))
SMALL_SHAPES = st.tuples(st.integers(1, 24), st.integers(1, 32)).filter(lambda shape: shape[0] != shape[1])


def _noise(rng: np.random.Generator, shape: Shape) -> Array:
    return rng.random(shape)


def _constant(rng: np.random.Generator, shape: Shape) -> Array:
    return np.full(shape, rng.choice([0, 1, rng.random()]))


def _gradient(rng: np.random.Generator, shape: Shape) -> Array:
    v, u = np.mgrid[: shape[0], : shape[1]]
    return (rng.uniform(-1, 1) * v + rng.uniform(-1, 1) * u) / 20 % 1


def _checker(rng: np.random.Generator, shape: Shape) -> Array:
    v, u = np.mgrid[: shape[0], : shape[1]] // rng.integers(1, 9)
    return (v + u) % 2 * rng.choice([1, rng.random()])


def _half_black(rng: np.random.Generator, shape: Shape) -> Array:
    image = rng.random(shape)
    image[:, : shape[1] // 2] = 0
    return image


def _extremes(rng: np.random.Generator, shape: Shape) -> Array:
    return rng.integers(0, 2, shape).astype(float)


def _blocks(rng: np.random.Generator, shape: Shape) -> Array:
    size = rng.integers(2, 17)
    few = rng.random((shape[0] // size + 1, shape[1] // size + 1))
    return few.repeat(size, axis=0).repeat(size, axis=1)[: shape[0], : shape[1]] + rng.random(shape) / 20


_PATTERNS = (_noise, _constant, _gradient, _checker, _half_black, _extremes, _blocks)


@st.composite
def images(
    draw: st.DrawFn, shape: Shape, *, channels: tuple[int, ...] = (1, 3), dtypes: tuple[type, ...] = (np.uint8,)
) -> Array:
    """Return a grey or BGR image."""
    pattern, n = draw(st.sampled_from(_PATTERNS)), draw(st.sampled_from(channels))
    dtype, rng = np.dtype(draw(st.sampled_from(dtypes))), np.random.default_rng(draw(_SEEDS))
    image = np.dstack([pattern(rng, shape) for _ in range(n)]).clip(0, 1)
    image = (image * np.iinfo(dtype).max).astype(dtype)
    return image[..., 0] if n == 1 else image


@st.composite
def disparities(draw: st.DrawFn, shape: Shape, *, wild: bool = True) -> Array:
    """Return the disparity of ground with things on it and holes in it; a wild one has values that are none."""
    rng, (height, width) = np.random.default_rng(draw(_SEEDS)), shape
    v, u = np.mgrid[:height, :width]
    slope, horizon = rng.choice([0.02, 0.2, 0.5, 2.0, 30.0]), rng.uniform(-0.5, 1) * height
    disparity = slope * (v - horizon) + rng.choice([0, rng.uniform(-0.2, 0.2)]) * u
    for _ in range(draw(st.integers(0, 3))):
        top, left = rng.integers(height), rng.integers(width)
        part = np.s_[top : top + rng.integers(1, 20), left : left + rng.integers(1, 20)]
        disparity[part] = disparity[part].max() * rng.choice([0, 0.5, 1, 1.5])
    disparity += rng.normal(0, 1, shape) * draw(st.sampled_from([0, 0.05, 0.5, 5, 500]))
    disparity = np.maximum(disparity, 0).astype(np.float32)
    disparity[rng.random(shape) < draw(st.sampled_from([0, 0.1, 0.5, 0.95, 1]))] = 0
    if wild and draw(st.booleans()):
        odd = np.array([np.nan, np.inf, -np.inf, -1, 1e-45, 1e-30, 1e-3, 2**15 - 1, 2**15, 3e38], np.float32)
        where = rng.random(shape) < draw(st.sampled_from([0.01, 0.3, 1]))
        disparity[where] = rng.choice(odd, np.count_nonzero(where))
    return disparity


def _sizes(low: float, high: float) -> st.SearchStrategy[float]:
    """Return positive numbers, as many small as large ones."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


def _either(usual: st.SearchStrategy[Any], absurd: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Return the usual three times of four."""
    return st.integers(0, 3).flatmap(lambda which: usual if which else absurd)


@st.composite
def cameras(draw: st.DrawFn, shape: Shape, *, has_size: bool = False) -> StereoCamera:
    """Return a calibration for images of a shape, at times one that is barely allowed."""
    height, width = shape
    least, most = min(shape) / 99, 99.0 * max(shape)
    focal_lengths, centre = _either(_sizes(5, 500), _sizes(least, most)), st.floats(-most, most)
    focal_lengths = focal_lengths.map(lambda focal: min(max(focal, least), most))
    return StereoCamera(
        fx=draw(focal_lengths),
        fy=draw(st.none() | focal_lengths),
        cx=draw(_either(st.floats(0, width), centre)),
        cy=draw(_either(st.floats(0, height), centre)),
        baseline_m=draw(_either(_sizes(0.02, 2), _sizes(1.1e-6, 999))),
        width=width if has_size else None,
        height=height if has_size else None,
    )


@st.composite
def ground_lines(draw: st.DrawFn, shape: Shape) -> GroundLine:
    """Return a ground line, an absurd one at times."""
    slope = draw(_either(_sizes(0.01, 5), _sizes(1e-9, 1e9)))
    return GroundLine(
        slope=slope,
        intercept=draw(_either(st.floats(-1, 0.5).map(lambda rows: rows * slope * shape[0]), st.floats(-1e9, 1e9))),
        tilt=draw(_either(st.floats(-0.1, 0.1), st.floats(-1e6, 1e6))),
        bend=draw(st.just(0.0) | _either(st.floats(-20, 20), st.floats(-1e9, 1e9))),
    )


def has_frame(line: GroundLine, camera: StereoCamera) -> bool:
    """Return whether a camera can see a ground line: for one that looks straight down nothing is ahead."""
    try:
        GroundFrame.of(line, camera)
    except ValueError:
        return False
    return True


@st.composite
def occupancies(draw: st.DrawFn, shape: Shape) -> Array:
    """Return an occupancy image: of ground below obstacles, of blocks, or noise, with more or less that is unknown."""
    rng = np.random.default_rng(draw(_SEEDS))
    pattern = draw(st.sampled_from((_noise, _blocks, _gradient, _constant)))
    if draw(st.booleans()):
        values = (np.arange(shape[0])[:, None] + 9 * pattern(rng, shape)) / (shape[0] + 9)
    else:
        values = pattern(rng, shape)
    ground, obstacle = sorted(draw(st.tuples(st.floats(0, 1.2), st.floats(0, 1.2))), reverse=True)
    below = np.where(values >= ground, np.uint8(GROUND), np.uint8(UNKNOWN))
    return np.where(values < obstacle, np.uint8(OBSTACLE), below)


@st.composite
def superpixels(draw: st.DrawFn, shape: Shape, *, are_all_used: bool = False) -> Array:
    """Return labels from 0 to n - 1 of pixels, connected or not; some of them may be of no pixel."""
    rng, n_pixels = np.random.default_rng(draw(_SEEDS)), shape[0] * shape[1]
    n = draw(_either(st.integers(1, min(n_pixels, 50)), st.integers(1, n_pixels)))
    values = draw(st.sampled_from((_noise, _blocks, _gradient, _checker)))(rng, shape)
    labels = (values.clip(0, 0.999) * n).astype(np.int32)
    return np.unique(labels, return_inverse=True)[1].reshape(shape).astype(np.int32) if are_all_used else labels


def all_superpixels(shape: Shape) -> st.SearchStrategy[Array]:
    """Return labels from 0 to n - 1 of pixels, each of them used."""
    return superpixels(shape, are_all_used=True)


def configs(*stages: str, **given: Any) -> st.SearchStrategy[Config]:
    """Return settings of some stages: each is its default, or any value in its range."""
    fields = {
        parameter.name: st.just(parameter.default) | _values(parameter)
        for parameter in parameters()
        if parameter.stage in stages and parameter.name not in _TEXTS
    }
    return (
        st.fixed_dictionaries({**fields, **given}).map(_with_coarse_cells).map(_with_few_compared).map(Config().updated)
    )


def _values(parameter: Parameter) -> st.SearchStrategy[Any]:
    """Return all values of a setting."""
    if parameter.choices:
        return st.sampled_from(parameter.choices)
    if parameter.type is bool:
        return st.booleans()
    assert parameter.minimum is not None, parameter
    assert parameter.maximum is not None, parameter
    if parameter.type is int:
        return st.integers(int(parameter.minimum), int(parameter.maximum))
    return st.floats(parameter.minimum, parameter.maximum)


def _with_coarse_cells(values: dict[str, Any]) -> dict[str, Any]:
    """Return settings with cells that are as large as it takes for a small grid."""
    if "maps.cell_m" not in values:
        return values
    least = math.sqrt(values["maps.length_m"] * values["maps.width_m"] / _MAX_CELLS)
    return {**values, "maps.cell_m": max(values["maps.cell_m"], least)}


def _with_few_compared(values: dict[str, Any]) -> dict[str, Any]:
    """Return settings with no more superpixels than the distance between them takes."""
    if values.get("features.distance", "correlation") == "correlation" or "superpixels.n_superpixels" not in values:
        return values
    return {**values, "superpixels.n_superpixels": min(values["superpixels.n_superpixels"], _MAX_COMPARED)}


def of_shapes(
    *makers: Callable[..., st.SearchStrategy[Any]], shapes: st.SearchStrategy[Shape] = SHAPES
) -> st.SearchStrategy[tuple[Any, ...]]:
    """Return one of each of several things that are made for one shape."""
    return shapes.flatmap(lambda shape: st.tuples(*(make(shape) for make in makers)))
