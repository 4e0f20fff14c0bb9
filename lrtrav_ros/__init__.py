"""Long-range traversable region detection for mobile robots, without any learning."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lrtrav_ros.camera import StereoCamera
    from lrtrav_ros.config import Config
    from lrtrav_ros.detector import Detection, Detector

__all__ = ["Config", "Detection", "Detector", "StereoCamera"]

_HOMES = {"Config": "config", "Detection": "detector", "Detector": "detector", "StereoCamera": "camera"}


def __getattr__(name: str) -> Any:
    """Import what is asked for only then: commands that need none of it, such as ``--help``, start at once."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
