"""A shared-memory segment of Fast DDS that holds images: with the default one of 0.5 MB, every second is lost."""

from __future__ import annotations

import os
import sys
from pathlib import Path

IMAGES_PROFILE = "fastdds.xml"
DETECTOR_PROFILE = "fastdds_detector.xml"

_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_SEGMENT_BYTES = 64 * 2**20
_SHARED_MEMORY = Path("/dev/shm")


def use_segment(profile: str) -> None:
    """Let Fast DDS take one of the package's profiles, before rclpy is initialised, unless the user chose another.

    A segment holds what a process publishes, and all of it counts as the process's memory: `IMAGES_PROFILE` is for who
    publishes the images of a camera, `DETECTOR_PROFILE` for the masks.

    Where shared memory is small, as in a container (64 MB), the stock segment stays: one that outgrows it would end the
    process.
    """
    file = profile_file(profile)
    others = {os.environ[name] for name in _VARIABLES if name in os.environ} - _own_files()
    if file is not None and not others and _has_room():
        os.environ[_VARIABLES[0]] = str(file)


def profile_file(profile: str) -> Path | None:
    """Return a profile's file, from the source tree or from where colcon or pip installed it; None if it is nowhere."""
    package = Path(__file__).resolve().parents[1]
    roots = [package.parent, *(parent / "share" / package.name for parent in (Path(sys.prefix), *package.parents))]
    candidates = (root / "config" / profile for root in roots)
    return next((file for file in candidates if file.is_file()), None)


def _own_files() -> set[str]:
    """Return the files of the package's profiles, which a parent process may have chosen for itself."""
    return {str(profile_file(profile)) for profile in (IMAGES_PROFILE, DETECTOR_PROFILE)}


def _has_room() -> bool:
    """Return whether a few processes' segments fit into shared memory."""
    try:
        space = os.statvfs(_SHARED_MEMORY)
    except OSError:
        return False
    return space.f_bavail * space.f_frsize >= 4 * _SEGMENT_BYTES
