"""The ground line of the last frame that showed one: it helps where the next frames show too little ground."""

from __future__ import annotations

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import GroundConfig
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.numerics.checks import check_stamp, check_type


class GroundMemory:
    """Remembers a ground line for a short time.

    Parameters
    ----------
    config : GroundConfig
        `memory_s` says for how long; with 0 nothing is remembered.

    Raises
    ------
    TypeError
        If `config` is something else.
    """

    def __init__(self, config: GroundConfig) -> None:
        check_type("config", config, GroundConfig)
        self._memory_ns = round(config.memory_s * 1e9)
        self._last: tuple[GroundLine, StereoCamera, int] | None = None

    def recall(self, camera: StereoCamera, stamp_ns: int | None) -> GroundLine | None:
        """Return the last line where it is of use in a frame, and else forget it.

        Parameters
        ----------
        camera : StereoCamera
            The frame's calibration; with another one than the line's, the line is forgotten.
        stamp_ns : int or None
            The frame's time in nanoseconds; where it is not known, or before the line's, the line is forgotten too.

        Returns
        -------
        GroundLine or None

        Raises
        ------
        TypeError, ValueError
            If the time is no whole number of 64 bits.
        """
        stamp_ns = None if stamp_ns is None else check_stamp(stamp_ns)
        if self._last is None:
            return None
        line, of_camera, at_ns = self._last
        if stamp_ns is None or camera != of_camera or not 0 <= stamp_ns - at_ns <= self._memory_ns:
            self._last = None
            return None
        return line

    def remember(self, line: GroundLine, camera: StereoCamera, stamp_ns: int | None) -> None:
        """Remember a line that a frame shows; without a time, or with a memory of 0 seconds, nothing.

        Raises TypeError or ValueError if the time is no whole number of 64 bits.
        """
        if stamp_ns is not None and self._memory_ns:
            self._last = (line, camera, check_stamp(stamp_ns))
