"""The settings of a synthetic scene, and of the stereo camera that drives through it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lrtrav_ros.config import CheckedConfig, setting

if TYPE_CHECKING:
    from lrtrav_ros.camera import StereoCamera

STYLES = ("forest", "field", "park", "road")


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneConfig(CheckedConfig):
    """A scene and the camera that drives through it; each field says what it sets.

    Raises
    ------
    ValueError
        If a value has another type or is out of range.

    Examples
    --------
    >>> SceneConfig(style="forest", width=320, height=200).camera.cx
    159.5
    """

    seed: int = setting(
        0,
        "makes the scene and the noise: same settings, same images; change it for another scene",
        minimum=0,
        maximum=2**63 - 1,
        option="--seed",
    )
    style: str = setting("any", "landscape; any: the seed chooses", choices=("any", *STYLES), option="--style")
    n_frames: int = setting(30, "stereo pairs", minimum=1, maximum=100_000, option="--frames")
    width: int = setting(640, "width of the images", minimum=32, maximum=8192, unit="px")
    height: int = setting(480, "height of the images", minimum=32, maximum=8192, unit="px")
    rate_hz: float = setting(10.0, "frames per second", minimum=0.1, maximum=1000.0, unit="Hz", option="--rate")
    speed_m_s: float = setting(
        2.5,
        "speed of the camera along the path; 0 for a camera that stands",
        minimum=0.0,
        maximum=50.0,
        unit="m/s",
        option="--speed",
    )
    hfov_deg: float = setting(
        66.0, "horizontal field of view", minimum=10.0, maximum=140.0, unit="deg", option="--hfov"
    )
    baseline_m: float = setting(
        0.12,
        "distance of the two cameras; raise it for a farther short range",
        minimum=0.001,
        maximum=10.0,
        unit="m",
        option="--baseline",
    )
    camera_height_m: float = setting(
        1.0,
        "height of the cameras over the ground below them",
        minimum=0.1,
        maximum=20.0,
        unit="m",
        option="--camera-height",
    )
    pitch_deg: float = setting(
        8.0,
        "how far the camera looks down; on a slope, relative to the slope",
        minimum=-45.0,
        maximum=60.0,
        unit="deg",
        option="--pitch",
    )
    roll_deg: float = setting(
        0.0, "how far the camera is turned clockwise", minimum=-45.0, maximum=45.0, unit="deg", option="--roll"
    )
    sway_deg: float = setting(
        0.6,
        "amplitude of the slow changes of pitch and roll while driving; 0 for a camera that is held level",
        minimum=0.0,
        maximum=10.0,
        unit="deg",
        option="--sway",
    )
    undulation_m: float = setting(
        0.06,
        "amplitude of the ground's waves; 0 for a flat ground",
        minimum=0.0,
        maximum=2.0,
        unit="m",
        option="--undulation",
    )
    n_obstacles: int = setting(
        100, "trees, bushes, rocks, boxes and walls", minimum=0, maximum=5000, option="--obstacles"
    )
    drops: str = setting(
        "none",
        "negative obstacles: ditches across and along the way, or an edge beyond which all ground lies lower by 0.2 to "
        "0.6 m (step) or 1 to 1.5 m (platform)",
        choices=("none", "ditch", "step", "platform"),
        option="--drops",
    )
    n_small_things: int = setting(
        0,
        "bricks and bottles that stand on the path from 2 m ahead on",
        minimum=0,
        maximum=1000,
        option="--small-things",
    )
    shadows: bool = setting(True, "let the obstacles cast shadows")
    sun_elevation_deg: float = setting(
        0.0,
        "elevation of the sun; 0: the seed chooses 28 to 55; below 1 counts as 1; lower it for long shadows",
        minimum=0.0,
        maximum=90.0,
        unit="deg",
        option="--sun-elevation",
    )
    sun_hardness: float = setting(
        1.0,
        "share of the sunlight that comes straight from the sun; the sky scatters the rest; 0 for an overcast sky",
        minimum=0.0,
        maximum=1.0,
        option="--sun-hardness",
    )
    dapple: float = setting(
        0.0,
        "share of the way and its surroundings in the dappled shade of crowns above the image",
        minimum=0.0,
        maximum=1.0,
        option="--dapple",
    )
    exposure: float = setting(
        0.0,
        "overexposure, negative for underexposure; from about 1 bright ground clips to white",
        minimum=-4.0,
        maximum=4.0,
        unit="stops",
        option="--exposure",
    )
    noise: float = setting(
        2.0,
        "standard deviation of the images' noise at medium brightness; it grows with brightness",
        minimum=0.0,
        maximum=50.0,
        unit="grey levels",
        option="--noise",
    )
    exposure_difference: float = setting(
        0.04,
        "share by which the right image is brighter than the left one",
        minimum=-0.9,
        maximum=2.0,
        option="--exposure-difference",
    )

    @property
    def camera(self) -> StereoCamera:
        """Calibration of the images."""
        from lrtrav_ros.camera import StereoCamera  # takes NumPy, which the help of `generate` does without

        focal_px = self.width / 2 / math.tan(math.radians(self.hfov_deg) / 2)
        return StereoCamera(
            fx=focal_px,
            fy=focal_px,
            cx=(self.width - 1) / 2,
            cy=(self.height - 1) / 2,
            baseline_m=self.baseline_m,
        )
