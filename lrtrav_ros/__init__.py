"""Long-range traversable region detection for mobile robots, without any learning.

`Detector` is the way in. Each stage is a function or a small class in `lrtrav_ros.method` that can be used alone.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lrtrav_ros.camera import StereoCamera
    from lrtrav_ros.config import Config
    from lrtrav_ros.detector import Detection, Detector
    from lrtrav_ros.frame import Frame

    __version__: str

__all__ = ["Config", "Detection", "Detector", "Frame", "StereoCamera"]

_HOMES = {
    "Config": "config",
    "Detection": "detector",
    "Detector": "detector",
    "Frame": "frame",
    "StereoCamera": "camera",
}


def __getattr__(name: str) -> Any:
    """Import an export on first use: commands that need none of them, such as ``--help``, start at once."""
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
