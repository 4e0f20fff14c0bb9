"""A shared-memory segment of Fast DDS that holds images: with the default one of 0.5 MB, every second is lost."""

from __future__ import annotations

import os
import sys
from pathlib import Path

_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_SEGMENT_BYTES = 64 * 2**20
_SHARED_MEMORY = Path("/dev/shm")


def use_large_segment() -> None:
    """Let Fast DDS take the package's profile, before rclpy is initialised, unless the user chose another.

    Where shared memory is small, as in a container (64 MB), the stock segment stays: one that outgrows it would end the
    process.
    """
    file = profile_file()
    if file is not None and not any(name in os.environ for name in _VARIABLES) and _has_room():
        os.environ[_VARIABLES[0]] = str(file)


def profile_file() -> Path | None:
    """Return the profile, from the source tree or from where colcon or pip installed it; None if it is nowhere."""
    package = Path(__file__).resolve().parents[1]
    roots = [package.parent, *(parent / "share" / package.name for parent in (Path(sys.prefix), *package.parents))]
    candidates = (root / "config" / "fastdds.xml" for root in roots)
    return next((file for file in candidates if file.is_file()), None)


def _has_room() -> bool:
    """Return whether a few processes' segments fit into shared memory."""
    try:
        space = os.statvfs(_SHARED_MEMORY)
    except OSError:
        return False
    return space.f_bavail * space.f_frsize >= 4 * _SEGMENT_BYTES
