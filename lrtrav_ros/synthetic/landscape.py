"""The landscapes of synthetic scenes: asphalt, dirt or gravel between grass and soil, and what stands beside the path.

Trees, bushes, rocks, boxes and walls, with sharp shadows, near and far; woods and clouds at the horizon. A seed decides
what stands where, its colours and the light; settings change the light and add drops and small things.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.synthetic import drops, raycasting
from lrtrav_ros.synthetic.raycasting import BOX, CYLINDER, ELLIPSOID, Scene
from lrtrav_ros.synthetic.scene_config import STYLES, SceneConfig

_AHEAD_M = 170.0
_SUN = np.array([1.15, 1.38, 1.52])
_SKY = np.array([0.34, 0.28, 0.23])
_CROWNS_M = 8.0
_SKY_THROUGH_CROWNS = 0.5


class _Material(enum.Enum):
    """Dark and light colour (linear b, g, r), longest wavelength [m], contrast, courses [m], leaves [m]."""

    GRASS = (0.010, 0.050, 0.028, 0.075, 0.270, 0.180, 0.30, 0.60, 0, 0)
    DRY_GRASS = (0.035, 0.100, 0.110, 0.140, 0.330, 0.360, 0.25, 0.60, 0, 0)
    SOIL = (0.028, 0.052, 0.085, 0.110, 0.175, 0.245, 0.60, 0.45, 0, 0)
    LITTER = (0.012, 0.030, 0.050, 0.085, 0.160, 0.240, 0.20, 0.80, 0, 0)
    DIRT = (0.090, 0.135, 0.180, 0.210, 0.300, 0.380, 0.40, 0.50, 0, 0)
    GRAVEL = (0.090, 0.105, 0.115, 0.380, 0.410, 0.430, 0.06, 0.70, 0, 0)
    ASPHALT = (0.060, 0.060, 0.058, 0.150, 0.150, 0.145, 0.20, 0.50, 0, 0)
    BARK = (0.015, 0.024, 0.036, 0.100, 0.140, 0.190, 0.15, 0.70, 0, 0)
    LEAVES = (0.006, 0.030, 0.014, 0.060, 0.230, 0.130, 0.20, 0.80, 0, 0.10)
    NEEDLES = (0.010, 0.024, 0.012, 0.050, 0.115, 0.066, 0.20, 0.80, 0, 0.09)
    SHRUB = (0.010, 0.030, 0.020, 0.090, 0.240, 0.190, 0.15, 0.80, 0, 0.06)
    ROCK = (0.080, 0.090, 0.100, 0.310, 0.330, 0.340, 0.50, 0.55, 0, 0)
    WOOD = (0.040, 0.090, 0.160, 0.130, 0.250, 0.380, 0.20, 0.45, 0.15, 0)
    BRICK = (0.040, 0.060, 0.160, 0.110, 0.150, 0.360, 0.25, 0.45, 0.09, 0)
    STONE = (0.110, 0.130, 0.150, 0.330, 0.370, 0.400, 0.30, 0.50, 0.22, 0)
    PLASTER = (0.280, 0.340, 0.390, 0.480, 0.560, 0.600, 0.80, 0.40, 0, 0)
    PAINT = (0.160, 0.100, 0.060, 0.400, 0.260, 0.160, 0.50, 0.25, 0, 0)


class _Thing(enum.Enum):
    """A thing that may stand in a scene."""

    TREE = enum.auto()
    CONIFER = enum.auto()
    BUSH = enum.auto()
    ROCK = enum.auto()
    BOX = enum.auto()
    WALL = enum.auto()
    HEDGE = enum.auto()
    HOUSE = enum.auto()
    POST = enum.auto()


@dataclass(frozen=True, slots=True)
class _Style:
    """A kind of landscape; `things` stand in it in the ratio of their numbers."""

    ground: tuple[_Material, _Material, _Material]
    half_width_m: float
    strip_m: float
    patches: float
    ragged_m: float
    woods: float
    things: tuple[tuple[_Thing, int], ...]


_FOREST = _Style(
    ground=(_Material.DIRT, _Material.LITTER, _Material.GRASS),
    half_width_m=1.3, strip_m=-1.0, patches=0.47, ragged_m=0.5, woods=0.10,
    things=((_Thing.TREE, 5), (_Thing.CONIFER, 5), (_Thing.BUSH, 6), (_Thing.ROCK, 3)),
)  # fmt: skip
_FIELD = _Style(
    ground=(_Material.DIRT, _Material.GRASS, _Material.DRY_GRASS),
    half_width_m=1.5, strip_m=0.45, patches=0.45, ragged_m=0.5, woods=0.05,
    things=((_Thing.TREE, 3), (_Thing.BUSH, 6), (_Thing.ROCK, 3), (_Thing.POST, 3), (_Thing.BOX, 1), (_Thing.HEDGE, 2)),
)  # fmt: skip
_PARK = _Style(
    ground=(_Material.GRAVEL, _Material.GRASS, _Material.SOIL),
    half_width_m=1.6, strip_m=-1.0, patches=0.38, ragged_m=0.15, woods=0.07,
    things=(
        (_Thing.TREE, 5), (_Thing.BUSH, 5), (_Thing.BOX, 2), (_Thing.WALL, 2), (_Thing.HEDGE, 3), (_Thing.HOUSE, 1),
    ),
)  # fmt: skip
_ROAD = _Style(
    ground=(_Material.ASPHALT, _Material.GRASS, _Material.SOIL),
    half_width_m=2.6, strip_m=-1.0, patches=0.40, ragged_m=0.12, woods=0.06,
    things=((_Thing.TREE, 4), (_Thing.BUSH, 4), (_Thing.BOX, 4), (_Thing.WALL, 3), (_Thing.POST, 3), (_Thing.HOUSE, 2)),
)  # fmt: skip
_PITS = drops.PitMaterials(
    soil=3 + list(_Material).index(_Material.SOIL),
    masonry=3 + list(_Material).index(_Material.STONE),
    ballast=3 + list(_Material).index(_Material.GRAVEL),
)
_LANDSCAPES = (_FOREST, _FIELD, _PARK, _ROAD)


def make_scene(config: SceneConfig) -> Scene:
    """Return the scene that the settings make, ready for ray casting: same settings, same scene."""
    rng = np.random.default_rng((config.seed, 1))
    chosen = int(rng.integers(len(STYLES)))
    style = _LANDSCAPES[chosen if config.style == "any" else STYLES.index(config.style)]
    waves, path = _waves(config, rng), _path(rng)
    half_width = style.half_width_m * rng.uniform(0.85, 1.2)
    tones = np.clip(rng.normal(1.0, 0.08, (3 + len(_Material), 1)) * rng.normal(1.0, 0.05, (1, 3)), 0.7, 1.3)
    azimuth, usual = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(28, 55))
    elevation = math.radians(max(config.sun_elevation_deg, 1.0)) if config.sun_elevation_deg else usual
    clouds, haze = rng.uniform(0.2, 0.75), rng.uniform(400, 1200)
    clouds += (1 - config.sun_hardness) * (0.95 - clouds)
    noise = rng.random((256, 256), np.float32)
    things = _things(config, style, half_width, waves, path, rng) + _small_things(config, half_width, waves, path)
    pits = drops.make_pits(config, path, half_width, _PITS)
    scene = Scene(
        noise=noise,
        waves=waves,
        path=path,
        layout=np.array([half_width, style.strip_m, style.patches, style.ragged_m]),
        solids=drops.settled(things, pits),
        materials=_materials(style, tones),
        sun=np.array(
            [math.cos(elevation) * math.sin(azimuth), math.cos(elevation) * math.cos(azimuth), math.sin(elevation)]
        ),
        light=_light(config.sun_hardness, elevation, usual),
        sky=np.array([[0.80, 0.72, 0.64], [0.60, 0.30, 0.13], [0.085, 0.105, 0.065], [0.30, 0.29, 0.24]]),
        weather=np.array([clouds, style.woods * rng.uniform(0.7, 1.5), haze]),
        shadows=np.zeros(4),
        bins=raycasting.Bins(np.zeros(2, np.int32), np.zeros(0, np.int32), 1, 1),
        canopy=np.zeros(3),
        pits=pits,
    )
    scene = _under_crowns(scene, config) if config.dapple else scene
    return raycasting.with_shadows(scene) if config.shadows else scene


def _light(hardness: float, elevation: float, usual: float) -> NDArray[np.float64]:
    """Return the light of sun and sky; level ground in the sun is as bright as at the `usual` elevation."""
    level = _SUN * math.sin(elevation)
    exposure = (_SUN * math.sin(usual) + _SKY) / (level + _SKY)
    return np.stack((hardness * _SUN, _SKY + (1 - hardness) * level)) * exposure


def _under_crowns(scene: Scene, config: SceneConfig) -> Scene:
    """Return the scene with crowns over a share of the way, and of what lies to 8 m beside it."""
    ahead = np.arange(0.0, _travel_m(config) + 40.0, 0.5)
    middle = np.array([raycasting.path_middle(scene.path, y) for y in ahead])
    aside = np.arange(-8.0, 8.5, 0.5)
    places = np.stack((np.add.outer(middle, aside).ravel(), np.repeat(ahead, len(aside))), axis=1)
    return raycasting.with_canopy(scene, places, config.dapple, height_m=_CROWNS_M, sky_share=_SKY_THROUGH_CROWNS)


def _travel_m(config: SceneConfig) -> float:
    """Return how far the camera drives."""
    return config.n_frames * config.speed_m_s / config.rate_hz


def _waves(config: SceneConfig, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the ground's waves, 9 to 45 m long; none for a flat ground."""
    lengths, bearings = np.array([9.0, 20.0, 45.0]), rng.uniform(0, 2 * math.pi, 3)
    phases, shares = rng.uniform(0, 2 * math.pi, 3), np.array([0.2, 0.35, 0.45])
    waves = np.stack(
        (
            2 * math.pi / lengths * np.cos(bearings),
            2 * math.pi / lengths * np.sin(bearings),
            phases,
            config.undulation_m * shares,
        ),
        axis=1,
    )
    return waves if config.undulation_m else waves[:0]


def _path(rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the path's bends, 35 to 120 m long."""
    lengths = rng.uniform((35, 70), (50, 120))
    phases, slopes = rng.uniform(0, 2 * math.pi, 2), rng.uniform((0.03, 0.05), (0.10, 0.2))
    return np.stack((2 * math.pi / lengths, phases, slopes * lengths / (2 * math.pi)), axis=1)


def _materials(style: _Style, tones: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the materials' values, their colours multiplied by `tones`: the ground's three, then every one."""
    rows = np.array([material.value for material in (*style.ground, *_Material)], np.float64)
    rows[:, 0:3] *= tones
    rows[:, 3:6] *= tones
    return rows


@dataclass(frozen=True, slots=True)
class _Place:
    """The place where a thing stands, and the path's direction there."""

    x: float
    y: float
    z: float
    yaw: float


def _things(
    config: SceneConfig,
    style: _Style,
    half_width: float,
    waves: NDArray[np.float64],
    path: NDArray[np.float64],
    rng: np.random.Generator,
) -> list[NDArray[np.float64]]:
    """Return the solids of each thing: they stand beside the path, and far ahead some stand on it."""
    travel = _travel_m(config)
    kinds = [kind for kind, number in style.things for _ in range(number)]
    taken: list[tuple[float, float]] = []
    things: list[NDArray[np.float64]] = []
    for index in range(config.n_obstacles):
        kind = kinds[int(rng.integers(len(kinds)))]
        on_path = index % 24 == 5
        y = travel + rng.uniform(14, 70) if on_path else rng.uniform(3, 10) + (travel + _AHEAD_M) * rng.random() ** 1.7
        side = math.copysign(1.0, rng.uniform(-1, 1))
        aside = (
            half_width * rng.uniform(0.3, 0.7) if on_path else half_width + _room_m(kind) + rng.exponential(2 + y / 12)
        )
        x = raycasting.path_middle(path, y) + side * aside
        if any(math.hypot(x - a, y - b) < 2.2 for a, b in taken):
            continue
        taken.append((x, y))
        place = _Place(x, y, raycasting.ground_height(waves, x, y), raycasting.path_heading(path, y))
        things.append(np.array(_thing(_Thing.BOX if on_path else kind, place, rng), np.float64))
    return things


def _small_things(
    config: SceneConfig, half_width: float, waves: NDArray[np.float64], path: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return bricks and bottles, spread over the path so that each frame has some 2 to 5 m ahead."""
    rng = np.random.default_rng((config.seed, 4))
    things: list[NDArray[np.float64]] = []
    for index in range(config.n_small_things):
        y = 2.0 + (_travel_m(config) + 3.0) * (index + rng.random()) / config.n_small_things
        x = raycasting.path_middle(path, y) + half_width * rng.uniform(-0.8, 0.8)
        place = _Place(x, y, raycasting.ground_height(waves, x, y), 0.0)
        things.append(np.array([(_brick, _bottle)[int(rng.integers(2))](place, rng)]))
    return things


def _brick(place: _Place, rng: np.random.Generator) -> list[float]:
    """A brick of 0.1 x 0.1 x 0.2 m, upright or lying."""
    half = ((0.05, 0.05, 0.1), (0.1, 0.05, 0.05))[int(rng.integers(2))]
    return _solid(BOX, place, (0, 0, half[2] - 0.01), half, _Material.BRICK, rng.uniform(0, math.pi))


def _bottle(place: _Place, rng: np.random.Generator) -> list[float]:
    """A bottle."""
    radius, height = rng.uniform(0.035, 0.05), rng.uniform(0.2, 0.3)
    return _solid(CYLINDER, place, (0, 0, height / 2 - 0.01), (radius, radius, height / 2), _Material.PAINT)


def _room_m(kind: _Thing) -> float:
    """Return how far from the path's edge a thing's middle stands at least."""
    wide = {_Thing.WALL: 1.2, _Thing.HEDGE: 1.4, _Thing.HOUSE: 7.0, _Thing.BUSH: 1.2, _Thing.CONIFER: 1.4}
    return wide.get(kind, 0.8)


def _thing(kind: _Thing, place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """Return the solids of a thing."""
    makers = {
        _Thing.TREE: _tree,
        _Thing.CONIFER: _conifer,
        _Thing.BUSH: _bush,
        _Thing.ROCK: _rock,
        _Thing.BOX: _box,
        _Thing.WALL: _wall,
        _Thing.HEDGE: _hedge,
        _Thing.HOUSE: _house,
        _Thing.POST: _post,
    }
    return makers[kind](place, rng)


def _solid(
    kind: int,
    place: _Place,
    centre: tuple[float, float, float],
    half: tuple[float, float, float],
    material: _Material,
    yaw: float = 0.0,
) -> list[float]:
    """Return a row of `Scene.solids`; `centre` is relative to the place."""
    x, y, z = centre
    index = 3 + list(_Material).index(material)
    return [kind, place.x + x, place.y + y, place.z + z, *half, math.cos(yaw), math.sin(yaw), index]


def _tree(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A trunk and a crown of many lumps."""
    height, radius, spread = rng.uniform(2.0, 3.6), rng.uniform(0.12, 0.3), rng.uniform(1.1, 2.0)
    rows = [_solid(CYLINDER, place, (0, 0, height / 2), (radius, radius, height / 2 + 0.6), _Material.BARK)]
    for _ in range(26):
        x, y, z = np.clip(rng.normal(0, 0.45, 3), -0.75, 0.75) * spread
        lump = spread * rng.uniform(0.22, 0.5)
        rows.append(
            _solid(
                ELLIPSOID, place, (x, y, height + 0.8 * spread + 0.8 * z), (lump, lump, 0.8 * lump), _Material.LEAVES
            )
        )
    return rows


def _conifer(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A trunk and flat lumps that narrow to the top."""
    height, spread = rng.uniform(5.0, 9.0), rng.uniform(1.0, 1.6)
    rows = [_solid(CYLINDER, place, (0, 0, height / 3), (0.16, 0.16, height / 3), _Material.BARK)]
    for level in np.linspace(0.13, 1.0, 13):
        width = spread * (1.12 - level) * rng.uniform(0.75, 1.2)
        x, y = rng.normal(0, 0.08, 2)
        rows.append(_solid(ELLIPSOID, place, (x, y, level * height), (width, width, 0.06 * height), _Material.NEEDLES))
    return rows


def _bush(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """Lumps on the ground."""
    size = rng.uniform(0.5, 1.0)
    rows = []
    for _ in range(14):
        x, y = rng.normal(0, 0.55 * size, 2)
        lump = size * rng.uniform(0.25, 0.55)
        z = 0.5 * lump + size * rng.uniform(0, 0.8) * math.exp(-math.hypot(x, y) / size)
        rows.append(_solid(ELLIPSOID, place, (x, y, z), (lump, lump, 0.9 * lump), _Material.SHRUB))
    return rows


def _rock(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A few stones that lean on one another."""
    rows = []
    for _ in range(3):
        x, y = rng.normal(0, 0.22, 2)
        half = rng.uniform(0.2, 0.5, 3)
        rows.append(
            _solid(ELLIPSOID, place, (x, y, 0.3 * half[2]), tuple(half.tolist()), _Material.ROCK, rng.uniform(0, 3))
        )
    return rows


def _box(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A crate."""
    half = rng.uniform((0.25, 0.25, 0.25), (0.7, 0.5, 0.6))
    material = (_Material.WOOD, _Material.PAINT)[int(rng.integers(2))]
    return [_solid(BOX, place, (0, 0, half[2] - 0.1), tuple(half.tolist()), material, rng.uniform(0, math.pi))]


def _wall(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A wall along the path."""
    half = (rng.uniform(0.12, 0.25), rng.uniform(1.5, 5.0), rng.uniform(0.5, 1.2))
    material = (_Material.BRICK, _Material.STONE)[int(rng.integers(2))]
    return [_solid(BOX, place, (0, 0, half[2] - 0.2), half, material, rng.normal(0, 0.08) - place.yaw)]


def _hedge(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A trimmed hedge along the path; the inner box closes most of its gaps."""
    half = np.array((rng.uniform(0.3, 0.5), rng.uniform(1.5, 4.0), rng.uniform(0.5, 0.9)))
    yaw = rng.normal(0, 0.08) - place.yaw
    centre = (0.0, 0.0, half[2] - 0.2)
    return [_solid(BOX, place, centre, tuple((half - inset).tolist()), _Material.SHRUB, yaw) for inset in (0.0, 0.1)]


def _house(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A house with a flat roof, askew to the path."""
    half = rng.uniform((2.5, 2.5, 1.8), (4.5, 5.5, 3.2))
    yaw = rng.normal(0, 0.15) - place.yaw
    roof = (float(half[0]) + 0.3, float(half[1]) + 0.3, 0.12)
    material = (_Material.PLASTER, _Material.BRICK)[int(rng.integers(2))]
    return [
        _solid(BOX, place, (0, 0, half[2] - 0.3), tuple(half.tolist()), material, yaw),
        _solid(BOX, place, (0, 0, 2 * half[2] - 0.3), roof, _Material.BARK, yaw),
    ]


def _post(place: _Place, rng: np.random.Generator) -> list[list[float]]:
    """A slim post."""
    height, radius = rng.uniform(0.9, 1.6), rng.uniform(0.05, 0.09)
    return [_solid(CYLINDER, place, (0, 0, height / 2 - 0.1), (radius, radius, height / 2), _Material.WOOD)]
