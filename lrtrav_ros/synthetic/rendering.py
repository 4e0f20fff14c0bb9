"""Synthetic stereo sequences of outdoor scenes, with exact disparity and ground truth.

A camera drives along a winding path, over ground that is not quite flat; see `landscape` for what stands there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.frame import Frame
from lrtrav_ros.numerics.checks import check_count, check_type
from lrtrav_ros.synthetic import raycasting
from lrtrav_ros.synthetic.landscape import make_scene
from lrtrav_ros.synthetic.raycasting import Scene, View
from lrtrav_ros.synthetic.scene_config import SceneConfig

_START_NS = 1_000_000_000_000_000_000
_BLUR_PX = 0.55
_GAMMA = 2.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SyntheticFrame:
    """A stereo pair and what is true of its left image.

    Parameters
    ----------
    frame : Frame
        Left and right image (BGR), calibration, and time; its name is the time in nanoseconds.
    disparity : (H, W) ndarray of float32
        Exact disparity at the pixels' centres; 0 for the sky.
    truth : (H, W) ndarray of uint8
        255 traversable: ground; 0 not: obstacles, the sky, and all that lies below a drop: walls and bottom of a
        ditch, and the lower ground beyond a step or a platform's edge, which cannot be reached from here; 128 ignored:
        the pixels on either side of a boundary.
    height_m : (H, W) ndarray of float32
        Height of what a pixel shows over the ground below it, in metres; 0 for ground, sky and what lies below a drop.
    """

    frame: Frame
    disparity: NDArray[np.float32]
    truth: NDArray[np.uint8]
    height_m: NDArray[np.float32]


def render_sequence(config: SceneConfig, *, first: int = 0, n_threads: int = 2) -> Iterator[SyntheticFrame]:
    """Render the frames of a scene one by one.

    Parameters
    ----------
    config : SceneConfig
        The scene.
    first : int
        Number of frames at the beginning to leave out.
    n_threads : int
        Threads to render with, at least 1; the images do not depend on it.

    Yields
    ------
    SyntheticFrame

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
        for index in range(first, config.n_frames):
            yield _render(config, scene, index, executor, n_threads)


def _render(
    config: SceneConfig, scene: Scene, index: int, executor: ThreadPoolExecutor, n_threads: int
) -> SyntheticFrame:
    """Render one frame."""
    views = [camera_view(config, scene, index, side=side) for side in (0, 1)]
    started = [raycasting.cast(scene, view, executor, n_threads) for view in views]
    for _, futures in started:
        for future in futures:
            future.result()
    pictures = [picture for picture, _ in started]
    left, right = (
        _sensed(picture.colour, config, side, np.random.default_rng((config.seed, index, side)))
        for side, picture in enumerate(pictures)
    )
    stamp_ns = _START_NS + round(index * 1e9 / config.rate_hz)
    frame = Frame(name=str(stamp_ns), left=left, right=right, camera=config.camera, stamp_ns=stamp_ns)
    disparity = config.camera.disparity(pictures[0].depth_m.astype(np.float32))
    return SyntheticFrame(
        frame=frame, disparity=disparity, truth=_truth(pictures[0].surface), height_m=pictures[0].height_m
    )


def _truth(surface: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the ground truth; boundaries are ignored, for a pixel there shows both sides."""
    ground = (surface == raycasting.GROUND).astype(np.uint8)
    boundary = cv2.morphologyEx(ground, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    return np.where(boundary > 0, 128, ground * 255).astype(np.uint8)


def _sensed(colour: NDArray[np.float32], config: SceneConfig, side: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a sensor's 8-bit image: the lens blurs, noise has a part that grows with the signal as shot noise does."""
    gain = 1.0 + side * config.exposure_difference
    exposed = cv2.GaussianBlur(colour, (0, 0), _BLUR_PX) * np.float32(2**config.exposure)
    level = (255 * gain) * np.clip(exposed, 0, 1) ** np.float32(1 / _GAMMA)
    spread = config.noise * np.sqrt(0.3 + 0.7 / 128 * level)
    level += spread * rng.standard_normal(level.shape, np.float32)
    return np.clip(np.rint(level), 0, 255).astype(np.uint8)


def camera_view(config: SceneConfig, scene: Scene, index: int, *, side: int = 0) -> View:
    """Return a camera at a frame.

    Parameters
    ----------
    config : SceneConfig
        The drive.
    scene : Scene
        What `make_scene` makes of it.
    index : int
        Number of the frame, from 0.
    side : int
        0 for the left camera, 1 for the right one.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    check_type("config", config, SceneConfig)
    check_type("scene", scene, Scene)
    index = check_count("index", index, least=0)
    side = check_count("side", side, least=0, most=1)
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
