"""What all maps are made with, checked."""

from __future__ import annotations

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MapsConfig
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.numerics.checks import check_type


def checked_settings(config: MapsConfig | None, line: GroundLine | None, camera: StereoCamera) -> MapsConfig:
    """Return the settings, the default ones for None; raises TypeError where one of the three is something else."""
    config = MapsConfig() if config is None else config
    check_type("config", config, MapsConfig)
    check_type("line", line, GroundLine, may_be_none=True)
    check_type("camera", camera, StereoCamera)
    return config
