"""Negative obstacles of synthetic scenes: ditches, steps down and platforms' edges, as pits with upright walls.

A ditch lies across the way, a little past the end of the drive, and can be driven around; others run along one side of
the way. Beyond the edge of a step or a platform all ground lies lower.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.checks import check_array, check_count, check_number, check_range, check_type
from lrtrav_ros.synthetic import raycasting
from lrtrav_ros.synthetic.scene_config import SceneConfig

_ENDLESS_M = 1e6
_FARTHEST_M = 1e9  # farther than anything on earth
_SEGMENT_M = 8.0
_CULVERT_M = 2.0
_CROSSING_M = 2.5
_FOOT_M = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PitMaterials:
    """Indices of the materials of pits in `Scene.materials`.

    Parameters
    ----------
    soil : int
        Walls and bottoms of ditches.
    masonry : int
        Walls of steps and platforms.
    ballast : int
        What lies before a platform.
    """

    soil: int
    masonry: int
    ballast: int

    def __post_init__(self) -> None:
        for name in ("soil", "masonry", "ballast"):
            check_count(name, getattr(self, name), least=0)


def make_pits(
    config: SceneConfig, path: NDArray[np.float64], half_width: float, materials: PitMaterials
) -> NDArray[np.float64]:
    """Return the pits that the settings ask for, as `Scene.pits`.

    Parameters
    ----------
    config : SceneConfig
        The settings; `drops` chooses the kind of pits, the seed their place and size.
    path : (n, 3) ndarray of float64
        `Scene.path`.
    half_width : float
        Half width of the path [m].
    materials : PitMaterials
        What they are made of.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    check_type("config", config, SceneConfig)
    half_width = check_number("half_width", half_width, most=_FARTHEST_M)
    check_type("materials", materials, PitMaterials)
    check_array("path", path, np.float64, ("n", 3), may_be_empty=True)
    rng = np.random.default_rng((config.seed, 3))
    y = (config.n_frames - 1) * config.speed_m_s / config.rate_hz + rng.uniform(4.0, 6.0)
    rows: list[list[float]] = []
    if config.drops == "ditch":
        rows = _ditches(path, half_width, y, materials.soil, rng)
    elif config.drops == "step":
        turn, depth = rng.uniform(-0.35, 0.35), rng.uniform(0.2, 0.6)
        rows = [_edge(path, y, turn, depth, materials.masonry, -1)]
    elif config.drops == "platform":
        turn, depth = math.copysign(rng.uniform(0.2, 0.75), rng.uniform(-1, 1)), rng.uniform(1.0, 1.5)
        rows = [_edge(path, y, turn, depth, materials.masonry, materials.ballast)]
    return np.array(rows, np.float64).reshape(-1, 9)


def _ditches(
    path: NDArray[np.float64], half_width: float, y: float, soil: int, rng: np.random.Generator
) -> list[list[float]]:
    """Return a ditch across the way at `y`, and some along one of its sides."""
    sizes = rng.uniform((0.3, 0.3), (1.0, 0.8), (2, 2))
    side = math.copysign(1.0, rng.uniform(-1, 1))
    turn, beyond = rng.uniform(-0.25, 0.25), rng.uniform(0.5, 1.5)
    width, depth = sizes[0].tolist()
    rows = [_pit(path, (0.0, y), (half_width + beyond, width / 2), depth, turn, soil)]
    width, depth = sizes[1].tolist()
    aside = side * (half_width + 0.8 + width / 2)
    for index in range(2 + int(y / (_SEGMENT_M + _CULVERT_M))):
        distance = _CROSSING_M + _SEGMENT_M / 2 + index * (_SEGMENT_M + _CULVERT_M)
        rows += [
            _pit(path, (aside, y + way * distance), (width / 2, _SEGMENT_M / 2), depth, 0.0, soil) for way in (-1, 1)
        ]
    return rows


def _pit(
    path: NDArray[np.float64],
    place: tuple[float, float],
    half: tuple[float, float],
    depth: float,
    turn: float,
    soil: int,
) -> list[float]:
    """Return the row of a pit beside the path's middle (x) at a way ahead (y), turned against the path."""
    aside, y = place
    heading = raycasting.path_heading(path, y)
    x = raycasting.path_middle(path, y) + aside * math.cos(heading)
    yaw = turn - heading
    return [x, y - aside * math.sin(heading), *half, math.cos(yaw), math.sin(yaw), depth, soil, soil]


def _edge(path: NDArray[np.float64], y: float, turn: float, depth: float, wall: int, floor: int) -> list[float]:
    """Return the row of a pit without end, whose edge crosses the path's middle at a way ahead."""
    yaw = turn - raycasting.path_heading(path, y)
    cos, sin = math.cos(yaw), math.sin(yaw)
    x = raycasting.path_middle(path, y) - _ENDLESS_M * sin
    return [x, y + _ENDLESS_M * cos, _ENDLESS_M, _ENDLESS_M, cos, sin, depth, wall, floor]


def settled(things: list[NDArray[np.float64]], pits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solids of all things: those in a pit stand on its bottom, those over its edge are left out.

    Parameters
    ----------
    things : list of (n, 10) ndarray of float64
        The solids of each thing, as in `Scene.solids`, on the ground without pits.
    pits : (n, 9) ndarray of float64
        `Scene.pits`.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above.
    """
    check_array("pits", pits, np.float64, ("n", 9), may_be_empty=True)
    check_range("pits", pits, -_FARTHEST_M, _FARTHEST_M)
    for thing in things:
        check_array("thing", thing, np.float64, ("n", 10))
        check_range("thing", thing, -_FARTHEST_M, _FARTHEST_M)
    kept = [np.zeros((0, 10))]
    for thing in things:
        inside = np.array([_distance_inside(pit, thing) for pit in pits])
        if (np.abs(inside) < _reach(thing)).any():
            continue
        fallen = thing.copy()
        fallen[:, 3] -= pits[inside > 0, 6].sum()
        kept.append(fallen)
    return np.concatenate(kept)


def _foot(thing: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solids of a thing that stand on the ground."""
    bottom = thing[:, 3] - thing[:, 6]
    return thing[bottom < bottom.min() + _FOOT_M]


def _reach(thing: NDArray[np.float64]) -> float:
    """Return the radius of a thing's foot [m]."""
    foot = _foot(thing)
    middle = foot[:, 1:3].mean(axis=0)
    return float(np.max(np.hypot(*(foot[:, 1:3] - middle).T) + np.hypot(foot[:, 4], foot[:, 5])))


def _distance_inside(pit: NDArray[np.float64], thing: NDArray[np.float64]) -> float:
    """Return how far a thing's middle is from a pit's edge [m], negative outside."""
    x, y = _foot(thing)[:, 1:3].mean(axis=0) - pit[:2]
    outside = np.abs((pit[4] * x + pit[5] * y, pit[4] * y - pit[5] * x)) - pit[2:4]
    return float(-np.hypot(*np.maximum(outside, 0)) - min(outside.max(), 0))
