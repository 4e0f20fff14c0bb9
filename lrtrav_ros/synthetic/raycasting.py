"""Ray casting of outdoor scenes: colour and exact depth of ground, upright solids and sky.

The world is right-handed: x to the right, y ahead, z up, in metres. The ground is a height field of a few waves; solids
are boxes, upright cylinders and ellipsoids. Textures are noise anchored in the world, so that every camera sees the
same surface; octaves that a pixel cannot resolve fade out. Colours are linear, in the order blue, green, red.
"""

from __future__ import annotations

import itertools
import math
from concurrent.futures import Executor, Future
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

BOX, CYLINDER, ELLIPSOID = 0, 1, 2
SKY, GROUND, SOLID = 0, 1, 2

_NOISE_PERIOD = 256
_TILE_PX = 16
_SHADOW_CELL_M = 1.0
_FAR_M = 400.0
_NEAR_M = 0.05
_PATCH_RAGGED = 0.1
_CORNERS = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], np.float64)


_kernel = numba.njit(cache=True, nogil=True, error_model="numpy")
# A call that hands over the scene counts references to each of its arrays, which takes longer than the work itself.
_inlined = numba.njit(nogil=True, error_model="numpy", inline="always")


class Bins(NamedTuple):
    """Which solids may be met in each cell of a grid of `shape` (rows, columns): members[starts[i]:starts[i + 1]]."""

    starts: NDArray[np.int32]
    members: NDArray[np.int32]
    rows: int
    columns: int


class Scene(NamedTuple):
    """Everything that rays can meet.

    Parameters
    ----------
    noise : (256, 256) float32
        Values 0 to 1 that the textures are made from; periodic.
    waves : (n, 4) float64
        Ground: wave numbers along x and y [rad/m], phase [rad], amplitude [m].
    path : (n, 3) float64
        Middle of the path, x as a function of y: wave number [rad/m], phase [rad], amplitude [m].
    layout : (4,) float64
        Half width of the path [m], half width of the strip in its middle [m; negative for none], share of patches
        beside the path (0 to 1), raggedness of its edges [m].
    solids : (n, 10) float64
        Kind, centre (x, y, z), half sizes (x, y, z) [m], cosine and sine of the yaw, index of the material.
    materials : (n, 10) float64
        Dark and light colour (b, g, r each), longest wavelength [m], contrast, height of courses [m] and size
        of leaves [m] (0 for none). The first three are those of the path, of what lies beside it and of the patches.
    sun : (3,) float64
        Unit vector to the sun.
    light : (2, 3) float64
        Radiance of the sun and of the sky.
    sky : (4, 3) float64
        Colours at the horizon, at the zenith, of the woods at the horizon and of the haze before them.
    weather : (3,) float64
        Cover of clouds (0 to 1), height of the woods at the horizon [rad], distance over which haze swallows 63 % [m].
    shadows : (4,) float64
        Origin (x, y) of the grid of shadows in the plane z = 0; slopes of sun rays, dx/dz and dy/dz.
    bins : Bins
        Solids by the cell of the plane z = 0 that their shadows may touch.
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


class View(NamedTuple):
    """A pinhole camera: its place, the rotation of its axes (right, down, ahead) into the world, and its intrinsics."""

    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    focal_px: float
    cx: float
    cy: float
    width: int
    height: int


class Picture(NamedTuple):
    """What a view sees: linear colour (H, W, 3), depth in metres (H, W; 0 for sky), and SKY, GROUND or SOLID (H, W)."""

    colour: NDArray[np.float32]
    depth_m: NDArray[np.float64]
    surface: NDArray[np.uint8]


def cast(scene: Scene, view: View, executor: Executor, n_parts: int) -> tuple[Picture, list[Future[None]]]:
    """Start to cast the rays of `view` in `n_parts` bands of columns; the picture is whole when all are done."""
    size = (view.height, view.width)
    colour, depth_m = np.empty((*size, 3), np.float32), np.empty(size, np.float64)
    surface = np.empty(size, np.uint8)
    tiles = _tiles(scene.solids, view)
    edges = [view.width * part // n_parts for part in range(n_parts + 1)]
    return Picture(colour, depth_m, surface), [
        executor.submit(_cast_columns, scene, view, tiles, first, last, colour, depth_m, surface)
        for first, last in itertools.pairwise(edges)
    ]


def with_shadows(scene: Scene) -> Scene:
    """Return `scene` with its solids sorted into the grid that finds what shades a point."""
    slopes = scene.sun[:2] / scene.sun[2]
    corners = _corners(scene.solids)
    touched = corners[..., :2] - corners[..., 2:] * slopes
    if not len(touched):
        return scene._replace(shadows=np.array([0.0, 0.0, *slopes]), bins=_binned(np.zeros((0, 2, 2)), 1, 1))
    origin = touched.min(axis=(0, 1))
    bounds = np.stack((touched.min(axis=1) - origin, touched.max(axis=1) - origin), axis=1) / _SHADOW_CELL_M
    columns, rows = (int(n) + 1 for n in bounds.max(axis=(0, 1)))
    return scene._replace(shadows=np.array([*origin, *slopes]), bins=_binned(bounds, rows, columns))


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
    rows, columns = -(-view.height // _TILE_PX), -(-view.width // _TILE_PX)
    depth = np.maximum(seen[..., 2:], _NEAR_M)
    pixels = (seen[..., :2] / depth * view.focal_px + (view.cx, view.cy)) / _TILE_PX
    bounds = np.stack((pixels.min(axis=1), pixels.max(axis=1)), axis=1) if len(solids) else np.zeros((0, 2, 2))
    # A box that reaches behind the camera has no sound outline: it may be seen anywhere.
    bounds[(seen[..., 2] < _NEAR_M).any(axis=1)] = ((0, 0), (columns, rows))
    bounds[(seen[..., 2] < _NEAR_M).all(axis=1)] = -1
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


def ground_height(waves: NDArray[np.float64], x: float, y: float) -> float:
    """Return the height of the ground [m] at (x, y)."""
    return float(np.sum(waves[:, 3] * np.sin(waves[:, 0] * x + waves[:, 1] * y + waves[:, 2])))


def path_middle(path: NDArray[np.float64], y: float) -> float:
    """Return the x of the path's middle [m] at y."""
    return float(np.sum(path[:, 2] * np.sin(path[:, 0] * y + path[:, 1])))


@_kernel
def _clipped(value, low, high):  # type: ignore[no-untyped-def]
    return min(max(value, low), high)


@_kernel
def _noise2(table, x, y):  # type: ignore[no-untyped-def]
    """Smooth noise 0 to 1 with one random value per unit square."""
    column, row = math.floor(x), math.floor(y)
    a, b = x - column, y - row
    a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
    i, j = int(row) & (_NOISE_PERIOD - 1), int(column) & (_NOISE_PERIOD - 1)
    k, m = (i + 1) & (_NOISE_PERIOD - 1), (j + 1) & (_NOISE_PERIOD - 1)
    top = table[i, j] + a * (table[i, m] - table[i, j])
    return top + b * (table[k, j] + a * (table[k, m] - table[k, j]) - top)


@_kernel
def _noise3(table, x, y, z):  # type: ignore[no-untyped-def]
    """Smooth noise 0 to 1 in space: slices of plane noise, blended."""
    layer = math.floor(z)
    c = z - layer
    low = _noise2(table, x + 37.2 * layer, y + 17.7 * layer)
    return low + c * c * (3 - 2 * c) * (_noise2(table, x + 37.2 * (layer + 1), y + 17.7 * (layer + 1)) - low)


@_kernel
def _fractal(table, x, y, wavelength, across, along):  # type: ignore[no-untyped-def]
    """Noise of many octaves around 0; those that a pixel of `across` x `along` metres cannot resolve fade."""
    total = 0.0
    x, y = x / wavelength, y / wavelength
    for _ in range(8):
        resolved = _clipped(2.0 * wavelength / across - 1.0, 0.0, 1.0)
        if resolved == 0.0:
            break
        # A mean over n random values keeps 1 / sqrt(n) of their spread.
        averaged = min(1.0, math.sqrt(2.0 * wavelength / along))
        total += resolved * averaged * (_noise2(table, x, y) - 0.5)
        # The turn between octaves hides the grid.
        x, y = 1.6 * x - 1.2 * y + 5.3, 1.2 * x + 1.6 * y + 9.1
        wavelength *= 0.5
    return total


@_kernel
def _tinted(material, amount):  # type: ignore[no-untyped-def]
    """Mix the material's dark and light colour."""
    share = _clipped(0.45 + material[7] * amount, 0.0, 1.2)
    return (
        material[0] + share * (material[3] - material[0]),
        material[1] + share * (material[4] - material[1]),
        material[2] + share * (material[5] - material[2]),
    )


@_kernel
def _relief(waves, x, y):  # type: ignore[no-untyped-def]
    """Height of the ground and its slopes along x and y."""
    height, along_x, along_y = 0.0, 0.0, 0.0
    for k in range(waves.shape[0]):
        angle = waves[k, 0] * x + waves[k, 1] * y + waves[k, 2]
        height += waves[k, 3] * math.sin(angle)
        slope = waves[k, 3] * math.cos(angle)
        along_x += slope * waves[k, 0]
        along_y += slope * waves[k, 1]
    return height, along_x, along_y


@_kernel
def _clearance(waves, origin, ray, t):  # type: ignore[no-untyped-def]
    """Height of a ray's point over the ground."""
    height = 0.0
    x, y = origin[0] + t * ray[0], origin[1] + t * ray[1]
    for k in range(waves.shape[0]):
        height += waves[k, 3] * math.sin(waves[k, 0] * x + waves[k, 1] * y + waves[k, 2])
    return origin[2] + t * ray[2] - height


@_kernel
def _root(waves, origin, ray, low, high):  # type: ignore[no-untyped-def]
    """The ground between two points of a ray, one over it and one below: false position (Illinois)."""
    over, below = _clearance(waves, origin, ray, low), _clearance(waves, origin, ray, high)
    t = high
    for _ in range(40):
        t = (low * below - high * over) / (below - over)
        value = _clearance(waves, origin, ray, t)
        if abs(value) < 1e-7 or high - low < 1e-9 * high:
            break
        if value > 0:
            low, over, below = t, value, below / 2
        else:
            high, below, over = t, value, over / 2
    return t


@_kernel
def _ground_depth(waves, bound, steepness, origin, ray, start):  # type: ignore[no-untyped-def]
    """Depth at which a ray meets the ground, no nearer than `start`; infinite where it never does."""
    flat = -origin[2] / ray[2] if ray[2] < 0 else math.inf
    if bound == 0.0:
        return flat
    fall = steepness * math.hypot(ray[0], ray[1]) - ray[2]
    if fall <= 0:
        return math.inf
    t = start
    if ray[2] < 0:
        t = max(t, (bound - origin[2]) / ray[2])
    before = start
    while t < _FAR_M:
        clearance = _clearance(waves, origin, ray, t)
        if clearance <= 0:
            return _root(waves, origin, ray, before, t) if before < t else t
        if ray[2] >= 0 and origin[2] + t * ray[2] > bound:
            return math.inf
        before = t
        # No ground rises faster than `fall`; the factor saves steps and can miss but the tip of a crest.
        t += max(1.3 * clearance / fall, 1e-4 * t)
    return max(flat, _FAR_M) if ray[2] < 0 else math.inf


@_kernel
def _slab(position, speed):  # type: ignore[no-untyped-def]
    """Where a ray enters and leaves -1 .. 1 along one axis."""
    if speed == 0.0:
        return (-math.inf, math.inf) if abs(position) < 1 else (math.inf, -math.inf)
    a, b = (-1 - position) / speed, (1 - position) / speed
    return min(a, b), max(a, b)


@_kernel
def _ball(a, b, c):  # type: ignore[no-untyped-def]
    """The two roots of a t^2 + 2 b t + c."""
    root = b * b - a * c
    if root < 0 or a == 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root)
    return (-b - root) / a, (-b + root) / a


@_kernel
def _local(solid, x, y, z):  # type: ignore[no-untyped-def]
    """A vector in the axes of a solid, where it is of unit size."""
    return (
        (solid[7] * x + solid[8] * y) / solid[4],
        (solid[7] * y - solid[8] * x) / solid[5],
        z / solid[6],
    )


@_kernel
def _span(solid, point, ray):  # type: ignore[no-untyped-def]
    """Where a ray enters and leaves a solid."""
    px, py, pz = _local(solid, point[0] - solid[1], point[1] - solid[2], point[2] - solid[3])
    rx, ry, rz = _local(solid, ray[0], ray[1], ray[2])
    if solid[0] == ELLIPSOID:
        return _ball(rx * rx + ry * ry + rz * rz, px * rx + py * ry + pz * rz, px * px + py * py + pz * pz - 1)
    enter, leave = _slab(pz, rz)
    if solid[0] == CYLINDER:
        a, b = _ball(rx * rx + ry * ry, px * rx + py * ry, px * px + py * py - 1)
        return max(enter, a), min(leave, b)
    a, b = _slab(px, rx)
    c, d = _slab(py, ry)
    return max(enter, a, c), min(leave, b, d)


@_kernel
def _is_leaf(table, size, footprint, point, ray, t):  # type: ignore[no-untyped-def]
    """Whether foliage, which has holes, is there at a ray's point; holes too small for a pixel close."""
    x, y, z = (point[0] + t * ray[0]) / size, (point[1] + t * ray[1]) / size, (point[2] + t * ray[2]) / size
    density = _noise3(table, x, y, z) + 0.8 * _noise3(table, 0.4 * x, 0.4 * y, 0.4 * z)
    return density < 0.84 + 0.5 * _clipped(footprint / size - 0.3, 0.0, 1.0)


@_inlined
def _meets(scene, index, point, ray, footprint):  # type: ignore[no-untyped-def]
    """Depth at which a ray meets a solid ahead; infinite where it does not. `footprint` is a pixel's at unit depth."""
    solid = scene.solids[index]
    enter, leave = _span(solid, point, ray)
    if enter >= leave or leave <= 1e-6:
        return math.inf
    leaf = scene.materials[int(solid[9]), 9]
    for t in (enter, leave):
        if t > 1e-6 and (leaf == 0.0 or _is_leaf(scene.noise, leaf, footprint * t, point, ray, t)):
            return t
    return math.inf


@_inlined
def _first_solid(scene, tiles, tile, point, ray, footprint):  # type: ignore[no-untyped-def]
    """Depth and index of the first solid of a tile that a ray meets; infinite and -1 for none."""
    nearest, which = math.inf, -1
    for i in range(tiles.starts[tile], tiles.starts[tile + 1]):
        index = tiles.members[i]
        t = _meets(scene, index, point, ray, footprint)
        if t < nearest:
            nearest, which = t, index
    return nearest, which


@_inlined
def _in_shadow(scene, point):  # type: ignore[no-untyped-def]
    """Whether a solid hides the sun."""
    column = math.floor((point[0] - point[2] * scene.shadows[2] - scene.shadows[0]) / _SHADOW_CELL_M)
    row = math.floor((point[1] - point[2] * scene.shadows[3] - scene.shadows[1]) / _SHADOW_CELL_M)
    if column < 0 or row < 0 or column >= scene.bins.columns or row >= scene.bins.rows:
        return False
    cell = int(row) * scene.bins.columns + int(column)
    sun = (scene.sun[0], scene.sun[1], scene.sun[2])
    for i in range(scene.bins.starts[cell], scene.bins.starts[cell + 1]):
        if _meets(scene, scene.bins.members[i], point, sun, 0.0) < math.inf:
            return True
    return False


@_inlined
def _lit(scene, colour, point, normal):  # type: ignore[no-untyped-def]
    """A surface's colour in the light of sun and sky."""
    facing = normal[0] * scene.sun[0] + normal[1] * scene.sun[1] + normal[2] * scene.sun[2]
    above = (
        point[0] + 2e-3 * normal[0],
        point[1] + 2e-3 * normal[1],
        point[2] + 2e-3 * normal[2],
    )
    sun = facing if facing > 0 and not _in_shadow(scene, above) else 0.0
    sky = 0.6 + 0.4 * normal[2]
    return (
        colour[0] * (sun * scene.light[0, 0] + sky * scene.light[1, 0]),
        colour[1] * (sun * scene.light[0, 1] + sky * scene.light[1, 1]),
        colour[2] * (sun * scene.light[0, 2] + sky * scene.light[1, 2]),
    )


@_inlined
def _ground_material(scene, x, y, across, along):  # type: ignore[no-untyped-def]
    """Index of the material at a point of the ground: 0 path, 1 beside it, 2 patch."""
    middle = 0.0
    for k in range(scene.path.shape[0]):
        middle += scene.path[k, 2] * math.sin(scene.path[k, 0] * y + scene.path[k, 1])
    aside = abs(x - middle)
    patch = 0.75 * _noise2(scene.noise, x / 9.0 + 71.0, y / 9.0 + 29.0) + 0.25 * _noise2(scene.noise, x / 2.3, y / 2.3)
    # Far from every edge its raggedness need not be known: noise of these octaves stays within 1.5.
    edge = min(abs(aside - scene.layout[0]), abs(aside - scene.layout[1])) < 1.5 * scene.layout[3]
    if edge or abs(patch - scene.layout[2]) < 1.5 * _PATCH_RAGGED:
        ragged = _fractal(scene.noise, x + 51.0, y + 13.0, 1.5, across, along)
        aside += scene.layout[3] * ragged
        patch += _PATCH_RAGGED * ragged
    if scene.layout[1] < aside < scene.layout[0]:
        return 0
    return 2 if patch < scene.layout[2] else 1


@_inlined
def _ground_colour(scene, point, t, focal):  # type: ignore[no-untyped-def]
    """Colour of the ground in its light, seen from depth `t` over a camera's height of about a metre."""
    across = t / focal
    along = max(across, t * across)
    x, y = point[0], point[1]
    material = scene.materials[_ground_material(scene, x, y, across, along)]
    amount = _fractal(scene.noise, x, y, material[6], across, along)
    amount += 0.5 * (_noise2(scene.noise, x / 6.1 + 3.0, y / 6.1 + 87.0) - 0.5)
    _, along_x, along_y = _relief(scene.waves, x, y)
    length = math.sqrt(1 + along_x * along_x + along_y * along_y)
    return _lit(scene, _tinted(material, amount), point, (-along_x / length, -along_y / length, 1 / length))


@_kernel
def _normal(solid, local):  # type: ignore[no-untyped-def]
    """Outer normal of a solid at a point of its surface, given in its axes and unit size."""
    x, y, z = local
    if solid[0] == BOX:
        largest = max(abs(x), abs(y), abs(z))
        x, y, z = (
            (x if abs(x) == largest else 0.0),
            (y if abs(y) == largest else 0.0),
            (z if abs(z) == largest else 0.0),
        )
    elif solid[0] == CYLINDER:
        if abs(z) > 1 - 1e-9:
            x, y = 0.0, 0.0
        else:
            z = 0.0
    x, y, z = x / solid[4], y / solid[5], z / solid[6]
    length = math.sqrt(x * x + y * y + z * z)
    return (solid[7] * x - solid[8] * y) / length, (solid[8] * x + solid[7] * y) / length, z / length


@_kernel
def _joint(material, normal, point):  # type: ignore[no-untyped-def]
    """Factor that darkens the joints of a wall laid in courses."""
    if material[8] == 0.0 or abs(normal[2]) > 0.5:
        return 1.0
    course = point[2] / material[8]
    aside = (point[1] * normal[0] - point[0] * normal[1]) / (2.4 * material[8]) + 0.5 * (math.floor(course) % 2)
    return 0.55 if course - math.floor(course) < 0.12 or aside - math.floor(aside) < 0.05 else 1.0


@_inlined
def _solid_colour(scene, index, point, ray, t, focal):  # type: ignore[no-untyped-def]
    """Colour of a solid in its light, seen from depth `t`."""
    solid = scene.solids[index]
    material = scene.materials[int(solid[9])]
    normal = _normal(solid, _local(solid, point[0] - solid[1], point[1] - solid[2], point[2] - solid[3]))
    if normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2] > 0:
        normal = (-normal[0], -normal[1], -normal[2])
    # Unrolls the surface: metres around it and metres up, so that bark and walls have their grain upright.
    around = math.atan2(normal[1], normal[0]) * solid[4] if solid[0] == CYLINDER else point[0] + 0.7 * point[1]
    stretch = 0.3 if solid[0] == CYLINDER else 1.0
    across = t / focal
    shift = 7.3 * index
    up = point[2] * stretch - (0.4 * point[1] if solid[0] == ELLIPSOID else 0.0)
    amount = _fractal(scene.noise, around + shift, up, material[6], across, across)
    colour = _tinted(material, amount)
    joint = _joint(material, normal, point)
    return _lit(scene, (colour[0] * joint, colour[1] * joint, colour[2] * joint), point, normal)


@_kernel
def _mixed(a, b, share):  # type: ignore[no-untyped-def]
    """Mix two colours."""
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@_inlined
def _sky_colour(scene, ray, focal):  # type: ignore[no-untyped-def]
    """Colour of what is infinitely far: sky, clouds, woods at the horizon."""
    level = math.hypot(ray[0], ray[1])
    rise, bearing = ray[2] / level, math.atan2(ray[0], ray[1])
    pixel = 1 / focal
    crest = 0.55 + 0.6 * _noise2(scene.noise, 4 * bearing, 0.5)
    crest += 0.7 * _fractal(scene.noise, bearing, 2.7, 0.06, 2 * pixel, 2 * pixel)
    if rise < scene.weather[1] * crest:
        shade = _clipped(1 + 0.7 * _fractal(scene.noise, bearing, rise, 0.03, 2 * pixel, 2 * pixel), 0.3, 2.0)
        return scene.sky[2, 0] * shade, scene.sky[2, 1] * shade, scene.sky[2, 2] * shade
    clear = _mixed(scene.sky[0], scene.sky[1], _clipped(1 - math.exp(-3.0 * max(rise, 0.0)), 0.0, 1.0))
    distance = 1 / max(rise + 0.06, 0.03)
    density = _fractal(scene.noise, distance * math.sin(bearing), distance * math.cos(bearing), 3.0, 0.1, 0.1)
    cover = _clipped((density + 1.3 * scene.weather[0] - 0.75) * 1.6, 0.0, 1.0)
    return _mixed(clear, (0.95, 0.92, 0.90), 0.85 * cover * _clipped(8 * rise, 0.0, 1.0))


@_kernel
def _cast_columns(scene, view, tiles, first, last, colour, depth_m, surface):  # type: ignore[no-untyped-def]
    """Fill the columns first .. last - 1 of a picture."""
    bound, steepness = 0.0, 0.0
    for k in range(scene.waves.shape[0]):
        bound += abs(scene.waves[k, 3])
        steepness += abs(scene.waves[k, 3]) * math.hypot(scene.waves[k, 0], scene.waves[k, 1])
    origin = (view.origin[0], view.origin[1], view.origin[2])
    turn, focal = view.rotation, view.focal_px
    for u in range(first, last):
        start = _NEAR_M
        for v in range(view.height - 1, -1, -1):
            a, b = (u - view.cx) / focal, (v - view.cy) / focal
            ray = (
                turn[0, 0] * a + turn[0, 1] * b + turn[0, 2],
                turn[1, 0] * a + turn[1, 1] * b + turn[1, 2],
                turn[2, 0] * a + turn[2, 1] * b + turn[2, 2],
            )
            t = _ground_depth(scene.waves, bound, steepness, origin, ray, start)
            if t < _FAR_M:
                # The ground recedes from row to row, so the next search need not begin at the camera.
                start = 0.99 * t
            tile = (v // _TILE_PX) * tiles.columns + u // _TILE_PX
            solid_t, index = _first_solid(scene, tiles, tile, origin, ray, 1 / focal)
            colour[v, u, 0], colour[v, u, 1], colour[v, u, 2] = _seen(scene, origin, ray, t, solid_t, index, focal)
            nearest = min(t, solid_t)
            surface[v, u] = SKY if nearest == math.inf else (GROUND if t <= solid_t else SOLID)
            depth_m[v, u] = 0.0 if nearest == math.inf else nearest


@_inlined
def _seen(scene, origin, ray, ground_t, solid_t, index, focal):  # type: ignore[no-untyped-def]
    """Colour that a ray brings to the camera."""
    t = min(ground_t, solid_t)
    if t == math.inf:
        return _sky_colour(scene, ray, focal)
    point = (origin[0] + t * ray[0], origin[1] + t * ray[1], origin[2] + t * ray[2])
    if ground_t <= solid_t:
        colour = _ground_colour(scene, point, t, focal)
    else:
        colour = _solid_colour(scene, index, point, ray, t, focal)
    return _mixed(colour, scene.sky[3], 1 - math.exp(-t / scene.weather[2]))
