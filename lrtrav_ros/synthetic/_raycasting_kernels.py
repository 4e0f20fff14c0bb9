"""Compiled parts of ray casting. The arguments are checked, and the world explained, in `raycasting`.

Vectors are tuples, which cost nothing; points and rays are (x, y, z), colours (blue, green, red). What takes the scene
is inlined: a call that hands it over counts references to each of its arrays, which takes longer than the work itself.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.kernels import inlined_kernel, kernel

if TYPE_CHECKING:
    from lrtrav_ros.synthetic.raycasting import Bins, RenderedView, Scene, View

BOX, CYLINDER, ELLIPSOID = 0, 1, 2
SKY, GROUND, SOLID, PIT = 0, 1, 2, 3

NOISE_PERIOD = 256
TILE_PX = 16
SHADOW_CELL_M = 1.0
NEAR_M = 0.05
_FAR_M = 400.0
_PATCH_RAGGED = 0.1

Vector: TypeAlias = tuple[float, float, float]
Span: TypeAlias = tuple[float, float]


@kernel
def _clipped(value: float, low: float, high: float) -> float:
    """Limit a value to low .. high."""
    return min(max(value, low), high)


@kernel
def _noise2(table: NDArray[np.float32], x: float, y: float) -> float:
    """Smooth noise 0 to 1 with one random value per unit square."""
    column, row = math.floor(x), math.floor(y)
    a, b = x - column, y - row
    a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
    i, j = int(row) & (NOISE_PERIOD - 1), int(column) & (NOISE_PERIOD - 1)
    k, m = (i + 1) & (NOISE_PERIOD - 1), (j + 1) & (NOISE_PERIOD - 1)
    top = table[i, j] + a * (table[i, m] - table[i, j])
    return top + b * (table[k, j] + a * (table[k, m] - table[k, j]) - top)


@kernel
def _noise3(table: NDArray[np.float32], x: float, y: float, z: float) -> float:
    """Smooth noise 0 to 1 in space: slices of plane noise, blended."""
    layer = math.floor(z)
    c = z - layer
    low = _noise2(table, x + 37.2 * layer, y + 17.7 * layer)
    return low + c * c * (3 - 2 * c) * (_noise2(table, x + 37.2 * (layer + 1), y + 17.7 * (layer + 1)) - low)


@kernel
def _fractal(table: NDArray[np.float32], x: float, y: float, wavelength: float, across: float, along: float) -> float:
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


@kernel
def _tinted(material: NDArray[np.float64], amount: float) -> Vector:
    """Mix the material's dark and light colour."""
    share = _clipped(0.45 + material[7] * amount, 0.0, 1.2)
    return (
        material[0] + share * (material[3] - material[0]),
        material[1] + share * (material[4] - material[1]),
        material[2] + share * (material[5] - material[2]),
    )


@kernel
def _relief(waves: NDArray[np.float64], x: float, y: float) -> tuple[float, float, float]:
    """Height of the ground and its slopes along x and y."""
    height, along_x, along_y = 0.0, 0.0, 0.0
    for k in range(waves.shape[0]):
        angle = waves[k, 0] * x + waves[k, 1] * y + waves[k, 2]
        height += waves[k, 3] * math.sin(angle)
        slope = waves[k, 3] * math.cos(angle)
        along_x += slope * waves[k, 0]
        along_y += slope * waves[k, 1]
    return height, along_x, along_y


@kernel
def _clearance(waves: NDArray[np.float64], origin: Vector, ray: Vector, t: float) -> float:
    """Height of a ray's point over the ground."""
    height = 0.0
    x, y = origin[0] + t * ray[0], origin[1] + t * ray[1]
    for k in range(waves.shape[0]):
        height += waves[k, 3] * math.sin(waves[k, 0] * x + waves[k, 1] * y + waves[k, 2])
    return origin[2] + t * ray[2] - height


@kernel
def _root(waves: NDArray[np.float64], origin: Vector, ray: Vector, low: float, high: float) -> float:
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


@kernel
def _ground_depth(
    waves: NDArray[np.float64], bound: float, steepness: float, origin: Vector, ray: Vector, start: float
) -> float:
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


@kernel
def _slab(position: float, speed: float) -> Span:
    """Depths at which a ray enters and leaves -1 .. 1 along one axis."""
    if speed == 0.0:
        return (-math.inf, math.inf) if abs(position) < 1 else (math.inf, -math.inf)
    a, b = (-1 - position) / speed, (1 - position) / speed
    return min(a, b), max(a, b)


@kernel
def _ball(a: float, b: float, c: float) -> Span:
    """The two roots of a t^2 + 2 b t + c."""
    root = b * b - a * c
    if root < 0 or a == 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root)
    return (-b - root) / a, (-b + root) / a


@kernel
def _pit_at(pits: NDArray[np.float64], x: float, y: float) -> int:
    """Index of the pit that a place lies in; -1 for none."""
    for k in range(pits.shape[0]):
        a, b = x - pits[k, 0], y - pits[k, 1]
        if abs(pits[k, 4] * a + pits[k, 5] * b) < pits[k, 2] and abs(pits[k, 4] * b - pits[k, 5] * a) < pits[k, 3]:
            return k
    return -1


@kernel
def _way_out(pit: NDArray[np.float64], point: Vector, ray: Vector) -> float:
    """Depth at which a ray that is over a pit, or in it, leaves its rectangle."""
    a, b = point[0] - pit[0], point[1] - pit[1]
    _, along = _slab((pit[4] * a + pit[5] * b) / pit[2], (pit[4] * ray[0] + pit[5] * ray[1]) / pit[2])
    _, across = _slab((pit[4] * b - pit[5] * a) / pit[3], (pit[4] * ray[1] - pit[5] * ray[0]) / pit[3])
    return min(along, across)


@kernel
def _into_pits(
    pits: NDArray[np.float64],
    waves: NDArray[np.float64],
    bound: float,
    steepness: float,
    origin: Vector,
    ray: Vector,
    t: float,
) -> tuple[float, int, bool]:
    """Follow a ray, which meets the level ground at depth `t`, into pits: true depth, pit or -1, whether its wall."""
    for _ in range(64):
        pit = _pit_at(pits, origin[0] + t * ray[0], origin[1] + t * ray[1]) if t < math.inf else -1
        if pit < 0:
            break
        out = _way_out(pits[pit], origin, ray)
        bottom = _ground_depth(waves, bound, steepness, (origin[0], origin[1], origin[2] + pits[pit, 6]), ray, t)
        if bottom <= out:
            return bottom, pit, False
        if _clearance(waves, origin, ray, out) <= 0:
            return out, pit, True
        # It grazed a dip of the ground's level and is above it again.
        t = _ground_depth(waves, bound, steepness, origin, ray, out)
    return t, -1, False


@kernel
def _in_pit(pits: NDArray[np.float64], waves: NDArray[np.float64], point: Vector, sun: Vector) -> tuple[bool, float]:
    """Return whether the rim of the pit that a point is in hides the sun, and the share of the sky that it leaves."""
    pit = _pit_at(pits, point[0], point[1])
    below = -_clearance(waves, point, sun, 0.0)
    if pit < 0 or below <= 0:
        return False, 1.0
    half = min(pits[pit, 2], pits[pit, 3])
    return _clearance(waves, point, sun, _way_out(pits[pit], point, sun)) < 0, half / (half + below)


@kernel
def _local(solid: NDArray[np.float64], x: float, y: float, z: float) -> Vector:
    """A vector in the axes of a solid, where it is of unit size."""
    return (
        (solid[7] * x + solid[8] * y) / solid[4],
        (solid[7] * y - solid[8] * x) / solid[5],
        z / solid[6],
    )


@kernel
def _span(solid: NDArray[np.float64], point: Vector, ray: Vector) -> Span:
    """Depths at which a ray enters and leaves a solid."""
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


@kernel
def _is_leaf(table: NDArray[np.float32], size: float, footprint: float, point: Vector, ray: Vector, t: float) -> bool:
    """Return whether foliage, which has holes, is there at a ray's point; holes too small for a pixel close."""
    x, y, z = (point[0] + t * ray[0]) / size, (point[1] + t * ray[1]) / size, (point[2] + t * ray[2]) / size
    density = _noise3(table, x, y, z) + 0.8 * _noise3(table, 0.4 * x, 0.4 * y, 0.4 * z)
    return density < 0.84 + 0.5 * _clipped(footprint / size - 0.3, 0.0, 1.0)


@inlined_kernel
def _meets(scene: Scene, index: int, point: Vector, ray: Vector, footprint: float) -> float:
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


@inlined_kernel
def _first_solid(
    scene: Scene, tiles: Bins, tile: int, point: Vector, ray: Vector, footprint: float
) -> tuple[float, int]:
    """Depth and index of the first solid of a tile that a ray meets; infinite and -1 for none."""
    nearest, which = math.inf, -1
    for i in range(tiles.starts[tile], tiles.starts[tile + 1]):
        index = tiles.members[i]
        t = _meets(scene, index, point, ray, footprint)
        if t < nearest:
            nearest, which = t, index
    return nearest, which


@inlined_kernel
def _in_shadow(scene: Scene, point: Vector) -> bool:
    """Return whether a solid hides the sun."""
    column = math.floor((point[0] - point[2] * scene.shadows[2] - scene.shadows[0]) / SHADOW_CELL_M)
    row = math.floor((point[1] - point[2] * scene.shadows[3] - scene.shadows[1]) / SHADOW_CELL_M)
    if column < 0 or row < 0 or column >= scene.bins.columns or row >= scene.bins.rows:
        return False
    cell = int(row) * scene.bins.columns + int(column)
    sun = (scene.sun[0], scene.sun[1], scene.sun[2])
    for i in range(scene.bins.starts[cell], scene.bins.starts[cell + 1]):
        if _meets(scene, scene.bins.members[i], point, sun, 0.0) < math.inf:
            return True
    return False


@kernel
def _crown_density(table: NDArray[np.float32], x: float, y: float) -> float:
    """Density of the leaves of crowns over a place, 0 to 1."""
    return 0.7 * _noise2(table, x / 5.0 + 11.0, y / 5.0 + 43.0) + 0.3 * _noise2(table, x / 2.0 + 5.0, y / 2.0 + 61.0)


@kernel
def crown_densities(table: NDArray[np.float32], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Density of the leaves of crowns over places (x, y)."""
    densities = np.empty(places.shape[0])
    for k in range(places.shape[0]):
        densities[k] = _crown_density(table, places[k, 0], places[k, 1])
    return densities


@kernel
def _gap(table: NDArray[np.float32], x: float, y: float, cover: float, across: float, along: float) -> float:
    """Share of a pixel of `across` x `along` metres that the sun reaches between leaves; `cover` is their density."""
    total, blurred, wavelength, weight = 0.0, 0.03, 0.5, 0.5
    for _ in range(3):
        resolved = _clipped(2.0 * wavelength / across - 1.0, 0.0, 1.0) * min(1.0, math.sqrt(2.0 * wavelength / along))
        total += weight * resolved * (_noise2(table, x / wavelength + 19.0, y / wavelength + 7.0) - 0.5)
        # What a pixel cannot resolve turns sharp blotches into their mean.
        blurred += 0.5 * weight * (1.0 - resolved)
        # The turn between octaves hides the grid.
        x, y = 0.8 * x - 0.6 * y, 0.6 * x + 0.8 * y
        wavelength, weight = 0.5 * wavelength, 0.7 * weight
    return _clipped(0.5 + (total - cover) / blurred, 0.0, 1.0)


@kernel
def _through_crowns(
    table: NDArray[np.float32],
    canopy: NDArray[np.float64],
    sun: Vector,
    point: Vector,
    across: float,
    along: float,
) -> tuple[float, float]:
    """Shares of the sun's and of the sky's light that come through the crowns to a pixel's point."""
    rise = (canopy[0] - point[2]) / sun[2]
    x, y = point[0] + rise * sun[0], point[1] + rise * sun[1]
    excess = _crown_density(table, x, y) - canopy[1]
    if excess <= 0.0:
        return 1.0, 1.0
    gap = _gap(table, x, y, min(1.2 * excess - 0.12, 0.22), across, along)
    return gap, 1.0 - (1.0 - canopy[2]) * min(10.0 * excess, 1.0)


@inlined_kernel
def _lit(scene: Scene, colour: Vector, point: Vector, normal: Vector, across: float, along: float) -> Vector:
    """A surface's colour in the light of sun and sky, in a pixel of `across` x `along` metres."""
    facing = normal[0] * scene.sun[0] + normal[1] * scene.sun[1] + normal[2] * scene.sun[2]
    above = (
        point[0] + 2e-3 * normal[0],
        point[1] + 2e-3 * normal[1],
        point[2] + 2e-3 * normal[2],
    )
    sun = facing if facing > 0 and not _in_shadow(scene, above) else 0.0
    sky = 0.6 + 0.4 * normal[2]
    if scene.canopy[0] > 0:
        direction = (scene.sun[0], scene.sun[1], scene.sun[2])
        through = _through_crowns(scene.noise, scene.canopy, direction, point, across, along)
        sun, sky = sun * through[0], sky * through[1]
    if scene.pits.shape[0] > 0:
        hidden, share = _in_pit(scene.pits, scene.waves, above, (scene.sun[0], scene.sun[1], scene.sun[2]))
        sun, sky = 0.0 if hidden else sun, sky * share
    return (
        colour[0] * (sun * scene.light[0, 0] + sky * scene.light[1, 0]),
        colour[1] * (sun * scene.light[0, 1] + sky * scene.light[1, 1]),
        colour[2] * (sun * scene.light[0, 2] + sky * scene.light[1, 2]),
    )


@inlined_kernel
def _ground_material(scene: Scene, x: float, y: float, across: float, along: float) -> int:
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


@inlined_kernel
def _ground_colour(scene: Scene, given: int, point: Vector, t: float, focal: float) -> Vector:
    """Colour of the ground in its light, seen from depth `t` over about a metre; `given` is its material or -1."""
    across = t / focal
    along = max(across, t * across)
    x, y = point[0], point[1]
    if given < 0:
        given = _ground_material(scene, x, y, across, along)
    material = scene.materials[given]
    amount = _fractal(scene.noise, x, y, material[6], across, along)
    amount += 0.5 * (_noise2(scene.noise, x / 6.1 + 3.0, y / 6.1 + 87.0) - 0.5)
    _, along_x, along_y = _relief(scene.waves, x, y)
    length = math.sqrt(1 + along_x * along_x + along_y * along_y)
    normal = (-along_x / length, -along_y / length, 1 / length)
    return _lit(scene, _tinted(material, amount), point, normal, across, along)


@kernel
def _normal(solid: NDArray[np.float64], local: Vector) -> Vector:
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


@kernel
def _joint(material: NDArray[np.float64], normal: Vector, point: Vector) -> float:
    """Factor that darkens the joints of a wall laid in courses."""
    if material[8] == 0.0 or abs(normal[2]) > 0.5:
        return 1.0
    course = point[2] / material[8]
    aside = (point[1] * normal[0] - point[0] * normal[1]) / (2.4 * material[8]) + 0.5 * (math.floor(course) % 2)
    return 0.55 if course - math.floor(course) < 0.12 or aside - math.floor(aside) < 0.05 else 1.0


@inlined_kernel
def _solid_colour(scene: Scene, index: int, point: Vector, ray: Vector, t: float, focal: float) -> Vector:
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
    return _lit(scene, (colour[0] * joint, colour[1] * joint, colour[2] * joint), point, normal, across, across)


@inlined_kernel
def _wall_colour(scene: Scene, pit: int, point: Vector, ray: Vector, t: float, focal: float) -> Vector:
    """Colour of a pit's wall in its light, seen from depth `t`."""
    cos, sin = scene.pits[pit, 4], scene.pits[pit, 5]
    x, y = point[0] - scene.pits[pit, 0], point[1] - scene.pits[pit, 1]
    a, b = cos * x + sin * y, cos * y - sin * x
    if abs(a) / scene.pits[pit, 2] > abs(b) / scene.pits[pit, 3]:
        a, b = -math.copysign(1.0, a), 0.0
    else:
        a, b = 0.0, -math.copysign(1.0, b)
    normal = (cos * a - sin * b, sin * a + cos * b, 0.0)
    material = scene.materials[int(scene.pits[pit, 7])]
    across = t / focal
    around = point[1] * normal[0] - point[0] * normal[1]
    colour = _tinted(material, _fractal(scene.noise, around + 23.0, point[2], material[6], across, across))
    joint = _joint(material, normal, point)
    return _lit(scene, (colour[0] * joint, colour[1] * joint, colour[2] * joint), point, normal, across, across)


@kernel
def _mixed(a: Vector, b: Vector, share: float) -> Vector:
    """Mix two colours."""
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@inlined_kernel
def _sky_colour(scene: Scene, ray: Vector, focal: float) -> Vector:
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


@kernel
def _height(pits: NDArray[np.float64], waves: NDArray[np.float64], origin: Vector, ray: Vector, t: float) -> float:
    """Height of a ray's point over the ground or the bottom of the pit below it, at least 0."""
    pit = _pit_at(pits, origin[0] + t * ray[0], origin[1] + t * ray[1])
    height = _clearance(waves, origin, ray, t)
    return max(height + pits[pit, 6] if pit >= 0 else height, 0.0)


@kernel
def cast_columns(scene: Scene, view: View, tiles: Bins, first: int, last: int, picture: RenderedView) -> None:
    """Fill the columns first .. last - 1 of a picture."""
    bound, steepness = 0.0, 0.0
    for k in range(scene.waves.shape[0]):
        bound += abs(scene.waves[k, 3])
        steepness += abs(scene.waves[k, 3]) * math.hypot(scene.waves[k, 0], scene.waves[k, 1])
    origin = (view.origin[0], view.origin[1], view.origin[2])
    turn, focal = view.rotation, view.focal_px
    colour, depth_m, surface, height_m = picture
    for u in range(first, last):
        start = NEAR_M
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
            tile = (v // TILE_PX) * tiles.columns + u // TILE_PX
            t, pit, wall = _into_pits(scene.pits, scene.waves, bound, steepness, origin, ray, t)
            solid_t, index = _first_solid(scene, tiles, tile, origin, ray, 1 / focal)
            colour[v, u, 0], colour[v, u, 1], colour[v, u, 2] = _seen(
                scene, origin, ray, t, pit, wall, solid_t, index, focal
            )
            nearest = min(t, solid_t)
            ground = GROUND if pit < 0 else PIT
            surface[v, u] = SKY if nearest == math.inf else (ground if t <= solid_t else SOLID)
            depth_m[v, u] = 0.0 if nearest == math.inf else nearest
            height_m[v, u] = _height(scene.pits, scene.waves, origin, ray, solid_t) if solid_t < t else 0.0


@inlined_kernel
def _seen(
    scene: Scene,
    origin: Vector,
    ray: Vector,
    ground_t: float,
    pit: int,
    wall: bool,
    solid_t: float,
    index: int,
    focal: float,
) -> Vector:
    """Colour that a ray brings to the camera."""
    t = min(ground_t, solid_t)
    if t == math.inf:
        return _sky_colour(scene, ray, focal)
    point = (origin[0] + t * ray[0], origin[1] + t * ray[1], origin[2] + t * ray[2])
    if ground_t <= solid_t:
        if wall:
            colour = _wall_colour(scene, pit, point, ray, t, focal)
        else:
            colour = _ground_colour(scene, int(scene.pits[pit, 8]) if pit >= 0 else -1, point, t, focal)
    else:
        colour = _solid_colour(scene, index, point, ray, t, focal)
    return _mixed(colour, scene.sky[3], 1 - math.exp(-t / scene.weather[2]))
