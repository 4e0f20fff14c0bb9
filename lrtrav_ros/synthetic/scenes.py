"""Synthetic stereo sequences of outdoor scenes, with exact disparity and ground truth.

A camera drives along a winding path over ground that is not quite flat: asphalt, dirt or gravel between grass and soil,
trees, bushes, rocks, boxes and walls with sharp shadows near and far, woods and clouds at the horizon. A seed makes the
scene: what stands where, its colours, the light and the noise of the images.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.dataset_folder import Frame
from lrtrav_ros.synthetic import raycasting
from lrtrav_ros.synthetic.raycasting import (
    BOX,
    CYLINDER,
    ELLIPSOID,
    Scene,
    View,
)

STYLES = ("forest", "field", "park", "road")

_START_NS = 1_000_000_000_000_000_000
_BLUR_PX = 0.55
_GAMMA = 2.2
_AHEAD_M = 170.0

# Least and largest value of every setting that is a number.
_RANGES = {
    "seed": (0, 2**63 - 1),
    "n_frames": (1, 100_000),
    "width": (32, 8192),
    "height": (32, 8192),
    "rate_hz": (0.1, 1000.0),
    "speed_m_s": (0.0, 50.0),
    "hfov_deg": (10.0, 140.0),
    "baseline_m": (0.001, 10.0),
    "camera_height_m": (0.1, 20.0),
    "pitch_deg": (-45.0, 60.0),
    "roll_deg": (-45.0, 45.0),
    "sway_deg": (0.0, 10.0),
    "undulation_m": (0.0, 2.0),
    "n_obstacles": (0, 5000),
    "noise": (0.0, 50.0),
    "exposure_difference": (-0.9, 2.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneConfig:
    """A scene and the camera that drives through it.

    Parameters
    ----------
    seed
        Makes the scene and the noise: same settings, same images.
    style
        ``forest``, ``field``, ``park``, ``road``, or ``any``: the seed chooses.
    n_frames
        Number of stereo pairs.
    width, height
        Size of the images in pixels.
    rate_hz, speed_m_s
        Frames per second, and the camera's speed along the path.
    hfov_deg
        Horizontal field of view.
    baseline_m
        Distance of the two cameras.
    camera_height_m
        Height of the cameras over the ground below them.
    pitch_deg, roll_deg
        How far the camera looks down, and is turned clockwise. On a slope the pitch is relative to the slope.
    sway_deg
        Amplitude of the slow changes of pitch and roll while driving.
    undulation_m
        Amplitude of the ground's waves; 0 for a flat ground.
    n_obstacles
        Number of trees, bushes, rocks, boxes and walls.
    shadows
        Whether they cast shadows.
    noise
        Standard deviation of the images' noise in grey levels, at medium brightness; it grows with brightness.
    exposure_difference
        The right image is brighter than the left one by this share.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    seed: int = 0
    style: str = "any"
    n_frames: int = 30
    width: int = 640
    height: int = 480
    rate_hz: float = 10.0
    speed_m_s: float = 2.5
    hfov_deg: float = 66.0
    baseline_m: float = 0.12
    camera_height_m: float = 1.0
    pitch_deg: float = 8.0
    roll_deg: float = 0.0
    sway_deg: float = 0.6
    undulation_m: float = 0.06
    n_obstacles: int = 100
    shadows: bool = True
    noise: float = 2.0
    exposure_difference: float = 0.04

    def __post_init__(self) -> None:
        if self.style not in ("any", *STYLES):
            raise ValueError(f"style is {self.style!r}; choose one of any, {', '.join(STYLES)}")
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, type(low))):
                raise ValueError(f"{name} is {value!r}; give a number of type {type(low).__name__}")
            if not low <= value <= high:
                raise ValueError(f"{name} is {value!r}; give a value from {low} to {high}")

    @property
    def camera(self) -> StereoCamera:
        """Calibration of the images."""
        focal_px = self.width / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        return StereoCamera(
            fx=focal_px,
            fy=focal_px,
            cx=(self.width - 1) / 2,
            cy=(self.height - 1) / 2,
            baseline_m=self.baseline_m,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SyntheticFrame:
    """A stereo pair and what is true of its left image.

    Parameters
    ----------
    frame
        Left and right image (BGR), calibration, and time; its name is the time in nanoseconds.
    disparity : (H, W) ndarray of float32
        Exact disparity at the pixels' centres; 0 for the sky.
    truth : (H, W) ndarray of uint8
        255 traversable: ground; 0 not: obstacles and sky; 128 ignored: the pixels on either side of a boundary.
    """

    frame: Frame
    disparity: NDArray[np.float32]
    truth: NDArray[np.uint8]


def render_sequence(config: SceneConfig, *, n_threads: int = 2) -> Iterator[SyntheticFrame]:
    """Render the frames of a scene one by one; the images do not depend on the number of threads.

    Raises
    ------
    ValueError
        If `n_threads` is not positive.

    Examples
    --------
    >>> config = SceneConfig(seed=3, width=160, height=120, n_frames=2)
    >>> [item.disparity.shape for item in render_sequence(config)]
    [(120, 160), (120, 160)]
    """
    if n_threads < 1:
        raise ValueError(f"n_threads is {n_threads}; give at least 1")
    scene = make_scene(config)
    with ThreadPoolExecutor(n_threads) as executor:
        for index in range(config.n_frames):
            yield _render(config, scene, index, executor, n_threads)


def _render(
    config: SceneConfig, scene: Scene, index: int, executor: ThreadPoolExecutor, n_threads: int
) -> SyntheticFrame:
    """Render one frame."""
    views = [_view(config, scene, index, side) for side in (0, 1)]
    started = [raycasting.cast(scene, view, executor, n_threads) for view in views]
    for _, futures in started:
        for future in futures:
            future.result()
    pictures = [picture for picture, _ in started]
    gains = (1.0, 1.0 + config.exposure_difference)
    left, right = (
        _sensed(picture.colour, gain, config.noise, np.random.default_rng((config.seed, index, side)))
        for side, (picture, gain) in enumerate(zip(pictures, gains, strict=True))
    )
    stamp_ns = _START_NS + round(index * 1e9 / config.rate_hz)
    frame = Frame(name=str(stamp_ns), left=left, right=right, camera=config.camera, stamp_ns=stamp_ns)
    disparity = config.camera.disparity(pictures[0].depth_m.astype(np.float32))
    return SyntheticFrame(frame=frame, disparity=disparity, truth=_truth(pictures[0].surface))


def _truth(surface: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the ground truth; boundaries are ignored, for a pixel there holds both."""
    ground = (surface == raycasting.GROUND).astype(np.uint8)
    boundary = cv2.morphologyEx(ground, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    return np.where(boundary > 0, 128, ground * 255).astype(np.uint8)


def _sensed(colour: NDArray[np.float32], gain: float, noise: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a sensor's 8-bit image: the lens blurs, noise has a part that grows with the signal as shot noise does."""
    blurred = cv2.GaussianBlur(colour, (0, 0), _BLUR_PX)
    level = (255 * gain) * np.clip(blurred, 0, 1) ** np.float32(1 / _GAMMA)
    spread = noise * np.sqrt(0.3 + 0.7 / 128 * level)
    level += spread * rng.standard_normal(level.shape, np.float32)
    return np.clip(np.rint(level), 0, 255).astype(np.uint8)


def _view(config: SceneConfig, scene: Scene, index: int, side: int) -> View:
    """Return the left (0) or right (1) camera at a frame."""
    y = index * config.speed_m_s / config.rate_hz
    x = raycasting.path_middle(scene.path, y)
    yaw = math.atan2(raycasting.path_middle(scene.path, y + 0.5) - raycasting.path_middle(scene.path, y - 0.5), 1.0)
    height = raycasting.ground_height(scene.waves, x, y)
    ahead = raycasting.ground_height(scene.waves, x + 0.5 * math.sin(yaw), y + 0.5 * math.cos(yaw))
    phase = np.random.default_rng((config.seed, 2)).uniform(0, 2 * math.pi, 2)
    sway = config.sway_deg * np.sin(phase + y * np.array([1.9, 1.3]))
    slope = math.degrees(math.atan((ahead - height) / 0.5))
    rotation = _rotation(yaw, math.radians(config.pitch_deg + sway[0] - slope), math.radians(config.roll_deg + sway[1]))
    origin = np.array([x, y, height + config.camera_height_m]) + side * config.baseline_m * rotation[:, 0]
    camera = config.camera
    return View(origin, rotation, camera.fx, camera.cx, camera.cy, config.width, config.height)


def _rotation(yaw: float, pitch: float, roll: float) -> NDArray[np.float64]:
    """Return the camera's axes right, down, ahead as columns; yaw to the right, pitch down, roll clockwise."""
    level = np.array([math.sin(yaw), math.cos(yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    right = np.array([math.cos(yaw), -math.sin(yaw), 0.0])
    ahead = math.cos(pitch) * level - math.sin(pitch) * up
    down = -math.sin(pitch) * level - math.cos(pitch) * up
    return np.stack(
        (math.cos(roll) * right + math.sin(roll) * down, math.cos(roll) * down - math.sin(roll) * right, ahead), axis=1
    )


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
    """What may stand in a scene."""

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
    """What a kind of landscape is made of; `things` stand in the ratio of their numbers."""

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
_LANDSCAPES = (_FOREST, _FIELD, _PARK, _ROAD)


def make_scene(config: SceneConfig) -> Scene:
    """Return the scene that the seed makes, ready for ray casting."""
    rng = np.random.default_rng((config.seed, 1))
    chosen = int(rng.integers(len(STYLES)))
    style = _LANDSCAPES[chosen if config.style == "any" else STYLES.index(config.style)]
    waves, path = _waves(config, rng), _path(rng)
    half_width = style.half_width_m * rng.uniform(0.85, 1.2)
    tones = np.clip(rng.normal(1.0, 0.08, (3 + len(_Material), 1)) * rng.normal(1.0, 0.05, (1, 3)), 0.7, 1.3)
    azimuth, elevation = rng.uniform(0, 2 * math.pi), math.radians(rng.uniform(28, 55))
    clouds, haze = rng.uniform(0.2, 0.75), rng.uniform(400, 1200)
    scene = Scene(
        noise=rng.random((256, 256), np.float32),
        waves=waves,
        path=path,
        layout=np.array([half_width, style.strip_m, style.patches, style.ragged_m]),
        solids=_solids(config, style, half_width, waves, path, rng),
        materials=_materials(style, tones),
        sun=np.array(
            [math.cos(elevation) * math.sin(azimuth), math.cos(elevation) * math.cos(azimuth), math.sin(elevation)]
        ),
        light=np.array([[1.15, 1.38, 1.52], [0.34, 0.28, 0.23]]),
        sky=np.array([[0.80, 0.72, 0.64], [0.60, 0.30, 0.13], [0.085, 0.105, 0.065], [0.30, 0.29, 0.24]]),
        weather=np.array([clouds, style.woods * rng.uniform(0.7, 1.5), haze]),
        shadows=np.zeros(4),
        bins=raycasting.Bins(np.zeros(2, np.int32), np.zeros(0, np.int32), 1, 1),
    )
    return raycasting.with_shadows(scene) if config.shadows else scene


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
    """Where a thing stands, and the path's direction there."""

    x: float
    y: float
    z: float
    yaw: float


def _solids(
    config: SceneConfig,
    style: _Style,
    half_width: float,
    waves: NDArray[np.float64],
    path: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Return the solids of all things: they stand beside the path, and far ahead some stand on it."""
    travel = config.n_frames * config.speed_m_s / config.rate_hz
    kinds = [kind for kind, number in style.things for _ in range(number)]
    taken: list[tuple[float, float]] = []
    rows: list[list[float]] = []
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
        slope = raycasting.path_middle(path, y + 0.5) - raycasting.path_middle(path, y - 0.5)
        place = _Place(x, y, raycasting.ground_height(waves, x, y), math.atan(slope))
        rows += _thing(_Thing.BOX if on_path else kind, place, rng)
    return np.array(rows, np.float64).reshape(-1, 10)


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
