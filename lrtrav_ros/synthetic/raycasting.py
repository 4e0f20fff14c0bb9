"""Ray casting of outdoor scenes: colour and exact depth of ground, upright solids and sky.

The world is right-handed: x to the right, y ahead, z up, in metres. The ground is a height field of a few waves; solids
are boxes, upright cylinders and ellipsoids. Textures are noise anchored in the world, so that every camera sees the
same surface; octaves that a pixel cannot resolve fade out. Colours are linear, in the order blue, green, red. Pits are
rectangles of the ground that lie lower: a ray that meets the ground there goes on to their bottom or their walls.
"""

from __future__ import annotations

import itertools
import math
from concurrent.futures import Executor, Future
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.checks import (
    Shape,
    check_array,
    check_count,
    check_finite,
    check_labels,
    check_number,
    check_range,
    check_type,
)
from lrtrav_ros.synthetic import _raycasting_kernels as kernels

BOX, CYLINDER, ELLIPSOID = kernels.BOX, kernels.CYLINDER, kernels.ELLIPSOID
"""Kinds of solids."""

SKY, GROUND, SOLID, PIT = kernels.SKY, kernels.GROUND, kernels.SOLID, kernels.PIT
"""Kinds of surfaces."""

_CORNERS = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], np.float64)
_N_GROUND_MATERIALS = 3
_MOST_PX = 2**13  # rows or columns of an image
_MOST_CELLS = 2**22  # of shadows
_FARTHEST_M = 1e9  # farther than anything on earth


class Bins(NamedTuple):
    """The solids that may be met in each cell of a grid.

    Parameters
    ----------
    starts : (rows * columns + 1,) ndarray of int32
        Cell i, counted row by row, holds the solids ``members[starts[i]:starts[i + 1]]``.
    members : (n,) ndarray of int32
        Indices of solids.
    rows, columns : int
        Size of the grid.
    """

    starts: NDArray[np.int32]
    members: NDArray[np.int32]
    rows: int
    columns: int


class Scene(NamedTuple):
    """Everything that rays can meet.

    Parameters
    ----------
    noise : (256, 256) ndarray of float32
        Values 0 to 1 that the textures are made from; periodic.
    waves : (n, 4) ndarray of float64
        Ground: wave numbers along x and y [rad/m], phase [rad], amplitude [m].
    path : (n, 3) ndarray of float64
        Middle of the path, x as a function of y: wave number [rad/m], phase [rad], amplitude [m].
    layout : (4,) ndarray of float64
        Half width of the path [m], half width of the strip in its middle [m; negative for none], share of patches
        beside the path (0 to 1), raggedness of its edges [m].
    solids : (n, 10) ndarray of float64
        Kind, centre (x, y, z), half sizes (x, y, z) [m], cosine and sine of the yaw, index of the material.
    materials : (n, 10) ndarray of float64
        Dark and light colour (b, g, r each), longest wavelength [m], contrast, height of courses [m] and size
        of leaves [m] (0 for none). The first three are those of the path, of what lies beside it and of the patches.
    sun : (3,) ndarray of float64
        Unit vector to the sun.
    light : (2, 3) ndarray of float64
        Radiance of the sun and of the sky.
    sky : (4, 3) ndarray of float64
        Colours at the horizon, at the zenith, of the woods at the horizon and of the haze before them.
    weather : (3,) ndarray of float64
        Cover of clouds (0 to 1), height of the woods at the horizon [rad], distance over which haze swallows 63 % [m].
    shadows : (4,) ndarray of float64
        Origin (x, y) of the grid of shadows in the plane z = 0; slopes of sun rays, dx/dz and dy/dz.
    bins : Bins
        Solids by the cell of the plane z = 0 that their shadows may touch.
    canopy : (3,) ndarray of float64
        Crowns that shade the scene and are not seen: their height [m; 0 for none], density of the leaves at which they
        begin (0 to 1), share of the sky's light that comes through them.
    pits : (n, 9) ndarray of float64
        Rectangles in which the ground lies lower, with upright walls; they do not overlap. Middle (x, y), half sizes
        [m], cosine and sine of the yaw, depth [m], materials of the walls and of the bottom (below 0: as the ground).
    """

    noise: NDArray[np.float32]
    waves: NDArray[np.float64]
    path: NDArray[np.float64]
    layout: NDArray[np.float64]
    solids: NDArray[np.float64]
    materials: NDArray[np.float64]
    sun: NDArray[np.float64]
    light: NDArray[np.float64]
    sky: NDArray[np.float64]
    weather: NDArray[np.float64]
    shadows: NDArray[np.float64]
    bins: Bins
    canopy: NDArray[np.float64]
    pits: NDArray[np.float64]


class View(NamedTuple):
    """A pinhole camera.

    Parameters
    ----------
    origin : (3,) ndarray of float64
        Its place in the world [m].
    rotation : (3, 3) ndarray of float64
        Its axes right, down and ahead, as columns, in the world.
    focal_px : float
        Focal length [px].
    cx, cy : float
        Principal point [px].
    width, height : int
        Size of its images [px].
    """

    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    focal_px: float
    cx: float
    cy: float
    width: int
    height: int


class RenderedView(NamedTuple):
    """An image with its exact depth.

    Parameters
    ----------
    colour : (H, W, 3) ndarray of float32
        Linear colour (b, g, r).
    depth_m : (H, W) ndarray of float64
        Depth in metres; 0 for the sky.
    surface : (H, W) ndarray of uint8
        `SKY`, `GROUND`, `SOLID`, or `PIT` for the walls and bottoms of pits.
    height_m : (H, W) ndarray of float32
        Height of solids over the ground or the pit's bottom below, in metres; 0 for ground, pits and sky.
    """

    colour: NDArray[np.float32]
    depth_m: NDArray[np.float64]
    surface: NDArray[np.uint8]
    height_m: NDArray[np.float32]


def cast(scene: Scene, view: View, executor: Executor, n_parts: int) -> tuple[RenderedView, list[Future[None]]]:
    """Start to cast the rays of a view.

    Parameters
    ----------
    scene : Scene
        The world.
    view : View
        The camera.
    executor : Executor
        Runs the parts; threads are enough.
    n_parts : int
        Number of bands of columns that the image is cut into; it does not change the picture.

    Returns
    -------
    picture : RenderedView
        Whole when all parts are done.
    parts : list of Future
        One for each band.

    Raises
    ------
    TypeError
        If an array of the scene or the view is none.
    ValueError
        If one has another type or shape or holds a value that is not finite, or an index is out of range.
    """
    _check_scene(scene)
    _check_view(view)
    n_parts = check_count("n_parts", n_parts, most=_MOST_PX)
    # Other types of numbers would have the kernels compiled anew.
    view = view._replace(focal_px=float(view.focal_px), cx=float(view.cx), cy=float(view.cy))
    size = (view.height, view.width)
    colour, depth_m = np.empty((*size, 3), np.float32), np.empty(size, np.float64)
    surface, height_m = np.empty(size, np.uint8), np.empty(size, np.float32)
    picture = RenderedView(colour, depth_m, surface, height_m)
    tiles = _tiles(scene.solids, view)
    edges = [view.width * part // n_parts for part in range(n_parts + 1)]
    return picture, [
        executor.submit(kernels.cast_columns, scene, view, tiles, first, last, picture)
        for first, last in itertools.pairwise(edges)
    ]


def with_shadows(scene: Scene) -> Scene:
    """Return a scene with its solids sorted into the grid that finds the shade of a point.

    Parameters
    ----------
    scene : Scene
        The world; its `shadows` and `bins` do not matter.

    Raises
    ------
    TypeError
        If an array of the scene is none.
    ValueError
        If one has another type or shape or holds a value that is not finite, or the sun is not above the horizon.
    """
    _check_arrays(scene)
    _check_sun(scene.sun)
    slopes = scene.sun[:2] / scene.sun[2]
    corners = _corners(scene.solids)
    touched = corners[..., :2] - corners[..., 2:] * slopes
    if not len(touched):
        return scene._replace(shadows=np.array([0.0, 0.0, *slopes]), bins=_binned(np.zeros((0, 2, 2)), 1, 1))
    origin = touched.min(axis=(0, 1))
    bounds = np.stack((touched.min(axis=1) - origin, touched.max(axis=1) - origin), axis=1) / kernels.SHADOW_CELL_M
    columns, rows = (float(n) + 1 for n in bounds.max(axis=(0, 1)))
    if not columns * rows <= _MOST_CELLS:
        raise ValueError(
            f"shadows reach over {columns:.0f} x {rows:.0f} cells of {kernels.SHADOW_CELL_M} m; "
            "give solids that are nearer to each other, or a sun that is higher"
        )
    columns, rows = int(columns), int(rows)
    return scene._replace(shadows=np.array([*origin, *slopes]), bins=_binned(bounds, rows, columns))


def with_canopy(scene: Scene, places: NDArray[np.float64], share: float, *, height_m: float, sky_share: float) -> Scene:
    """Return a scene under crowns that are not seen themselves, with the leaves' dappled shade.

    Parameters
    ----------
    scene : Scene
        The world; its `canopy` does not matter.
    places : (n, 2) ndarray of float64
        Places on the ground (x, y) [m].
    share : float
        How many of the places the crowns shade, 0 to 1.
    height_m : float
        How high the crowns are, above 0.
    sky_share : float
        Share of the sky's light that comes through them, 0 to 1.

    Raises
    ------
    TypeError
        If an array is none.
    ValueError
        If one has another type or shape or holds a value that is not finite, `share` is out of range, or the sun is
        not above the horizon.
    """
    _check_arrays(scene)
    _check_sun(scene.sun)
    check_array("places", places, np.float64, ("n", 2))
    check_range("places", places, -_FARTHEST_M, _FARTHEST_M)
    share = check_number("share", share)
    height_m = check_number("height_m", height_m, above=0, most=_FARTHEST_M)
    sky_share = check_number("sky_share", sky_share)
    for name, value in (("share", share), ("sky_share", sky_share)):
        if not 0 <= value <= 1:
            raise ValueError(f"{name} is {value}; give 0 to 1")
    above = places + height_m * scene.sun[:2] / scene.sun[2]
    level = np.quantile(kernels.crown_densities(scene.noise, above), 1 - share)
    return scene._replace(canopy=np.array([height_m, level, sky_share]))


def ground_height(waves: NDArray[np.float64], x: float, y: float) -> float:
    """Return the height of the ground [m] at (x, y).

    Parameters
    ----------
    waves : (n, 4) ndarray of float64
        `Scene.waves`.
    x, y : float
        Place [m].
    """
    check_array("waves", waves, np.float64, ("n", 4), may_be_empty=True)
    check_range("waves", waves, -_FARTHEST_M, _FARTHEST_M)
    x = check_number("x", x, most=_FARTHEST_M)
    y = check_number("y", y, most=_FARTHEST_M)
    return float(np.sum(waves[:, 3] * np.sin(waves[:, 0] * x + waves[:, 1] * y + waves[:, 2])))


def path_middle(path: NDArray[np.float64], y: float) -> float:
    """Return the x of the path's middle [m] at y.

    Parameters
    ----------
    path : (n, 3) ndarray of float64
        `Scene.path`.
    y : float
        Way ahead [m].
    """
    check_array("path", path, np.float64, ("n", 3), may_be_empty=True)
    check_range("path", path, -_FARTHEST_M, _FARTHEST_M)
    y = check_number("y", y, most=_FARTHEST_M)
    return float(np.sum(path[:, 2] * np.sin(path[:, 0] * y + path[:, 1])))


def path_heading(path: NDArray[np.float64], y: float) -> float:
    """Return the direction of the path at y, to the right of straight ahead [rad].

    Parameters
    ----------
    path : (n, 3) ndarray of float64
        `Scene.path`.
    y : float
        Way ahead [m].
    """
    y = check_number("y", y, most=_FARTHEST_M / 2)
    return math.atan(path_middle(path, y + 0.5) - path_middle(path, y - 0.5))


def _check_scene(scene: Scene) -> None:
    """Raise TypeError or ValueError where an array of a scene does not fit, or an index is out of range."""
    _check_arrays(scene)
    bins = scene.bins
    check_type("scene.bins", bins, Bins)
    check_count("scene.bins.rows", bins.rows)
    check_count("scene.bins.columns", bins.columns)
    check_array("scene.bins.starts", bins.starts, np.int32, (bins.rows * bins.columns + 1,))
    check_array("scene.bins.members", bins.members, np.int32, ("n",), may_be_empty=True)
    check_labels("scene.bins.starts", bins.starts, len(bins.members) + 1)
    if len(bins.members):
        check_labels("scene.bins.members", bins.members, len(scene.solids))


def _check_arrays(scene: Scene) -> None:
    """Check the arrays of a scene, and that its solids are of materials that it has."""
    check_type("scene", scene, Scene)
    check_array("scene.noise", scene.noise, np.float32, (kernels.NOISE_PERIOD, kernels.NOISE_PERIOD))
    check_finite("scene.noise", scene.noise)
    shapes: list[tuple[str, NDArray[np.float64], Shape]] = [
        ("waves", scene.waves, ("n", 4)),
        ("path", scene.path, ("n", 3)),
        ("layout", scene.layout, (4,)),
        ("solids", scene.solids, ("n", 10)),
        ("materials", scene.materials, ("n", 10)),
        ("sun", scene.sun, (3,)),
        ("light", scene.light, (2, 3)),
        ("sky", scene.sky, (4, 3)),
        ("weather", scene.weather, (3,)),
        ("shadows", scene.shadows, (4,)),
        ("canopy", scene.canopy, (3,)),
        ("pits", scene.pits, ("n", 9)),
    ]
    for name, array, shape in shapes:
        check_array(f"scene.{name}", array, np.float64, shape, may_be_empty=True)
        check_range(f"scene.{name}", array, -_FARTHEST_M, _FARTHEST_M)
    if len(scene.materials) < _N_GROUND_MATERIALS:
        raise ValueError(f"scene has {len(scene.materials)} materials; the ground alone needs {_N_GROUND_MATERIALS}")
    if len(scene.solids):
        check_labels("scene.solids[:, 9]", scene.solids[:, 9], len(scene.materials))
    if len(scene.pits):
        check_labels("scene.pits[:, 7]", scene.pits[:, 7], len(scene.materials))
        check_labels("scene.pits[:, 8]", np.maximum(scene.pits[:, 8], 0), len(scene.materials))


def _check_sun(sun: NDArray[np.float64]) -> None:
    """Raise ValueError where the sun is not above the horizon."""
    if sun[2] <= 0:
        raise ValueError(f"sun is {sun.tolist()}; give a vector that points up, with the last number above 0")


def _check_view(view: View) -> None:
    """Raise TypeError or ValueError where a camera cannot be."""
    check_type("view", view, View)
    check_array("view.origin", view.origin, np.float64, (3,))
    check_array("view.rotation", view.rotation, np.float64, (3, 3))
    check_range("view", np.array([*view.origin, *view.rotation.ravel()]), -_FARTHEST_M, _FARTHEST_M)
    check_number("view.focal_px", view.focal_px, above=0, most=_FARTHEST_M)
    check_number("view.cx", view.cx, most=_FARTHEST_M)
    check_number("view.cy", view.cy, most=_FARTHEST_M)
    check_count("view.width", view.width, most=_MOST_PX)
    check_count("view.height", view.height, most=_MOST_PX)


def _corners(solids: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of the box around each solid, (n, 8, 3)."""
    local = _CORNERS * solids[:, None, 4:7]
    cos, sin = solids[:, None, 7], solids[:, None, 8]
    x = cos * local[..., 0] - sin * local[..., 1]
    y = sin * local[..., 0] + cos * local[..., 1]
    return np.stack((x, y, local[..., 2]), axis=-1) + solids[:, None, 1:4]


def _tiles(solids: NDArray[np.float64], view: View) -> Bins:
    """Return the solids that may be seen in each tile of the image."""
    seen = (_corners(solids) - view.origin) @ view.rotation
    rows, columns = -(-view.height // kernels.TILE_PX), -(-view.width // kernels.TILE_PX)
    depth = np.maximum(seen[..., 2:], kernels.NEAR_M)
    pixels = (seen[..., :2] / depth * view.focal_px + (view.cx, view.cy)) / kernels.TILE_PX
    bounds = np.stack((pixels.min(axis=1), pixels.max(axis=1)), axis=1) if len(solids) else np.zeros((0, 2, 2))
    # A box that reaches behind the camera has no sound outline: it may be seen anywhere.
    bounds[(seen[..., 2] < kernels.NEAR_M).any(axis=1)] = ((0, 0), (columns, rows))
    bounds[(seen[..., 2] < kernels.NEAR_M).all(axis=1)] = -1
    return _binned(bounds, rows, columns)


def _binned(bounds: NDArray[np.float64], rows: int, columns: int) -> Bins:
    """Sort solids into cells by their bounds, (n, 2, 2): lowest and highest (column, row)."""
    low = np.clip(np.floor(bounds[:, 0]), 0, (columns, rows)).astype(int)
    high = np.clip(np.floor(bounds[:, 1]) + 1, 0, (columns, rows)).astype(int)
    grid = np.arange(rows * columns).reshape(rows, columns)
    cells = [grid[a[1] : b[1], a[0] : b[0]].ravel() for a, b in zip(low, high, strict=True)]
    cell = np.concatenate([*cells, np.zeros(0, int)])
    member = np.repeat(np.arange(len(cells)), [len(c) for c in cells])
    starts = np.searchsorted(np.sort(cell), np.arange(rows * columns + 1))
    return Bins(starts.astype(np.int32), member[np.argsort(cell, kind="stable")].astype(np.int32), rows, columns)
