"""Whether the rows of a stereo pair still match: knocks and heat move cameras away from their calibration."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.frame import Frame
from lrtrav_ros.method.matching.row_offset import row_offset

LIMIT_PX = 0.7
"""Rows that are farther apart do not match."""

_PERIOD_S = 1.0
_N_KEPT = 20  # measurements
_N_LEAST = 5
_AGE_S = 40.0  # twice as long as 20 measurements take


class RowCheck:
    """Measures now and then how far the rows of left and right images are apart.

    Parameters
    ----------
    clock : callable
        Returns the time in seconds; it should not jump.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._measured_s: float | None = None
        # Times [s] and offsets [px], replaced as a whole: one thread measures and another reads.
        self._measurements: tuple[tuple[float, float], ...] = ()

    def look(self, frame: Frame, disparity: NDArray[np.float32]) -> None:
        """Measure in a frame, if it is a stereo pair and the last measurement is a second old.

        Parameters
        ----------
        frame : Frame
            From any source.
        disparity : (H, W) ndarray of float32
            Of its left image, in pixels; 0 for none.

        Raises
        ------
        TypeError, ValueError
            If the disparity is not such an array.
        """
        if frame.left is None or frame.right is None:
            return
        now_s = self._clock()
        if self._measured_s is not None and now_s - self._measured_s < _PERIOD_S:
            return
        self._measured_s = now_s
        offset_px = row_offset(frame.left, frame.right, disparity)
        if offset_px is not None:
            self._measurements = (*self._measurements, (now_s, offset_px))[-_N_KEPT:]

    @property
    def offset_px(self) -> float | None:
        """Median of those of the last 40 s, above 0 where the right image is lower; None with fewer than 5."""
        offsets_px = self._recent_px()
        return statistics.median(offsets_px) if len(offsets_px) >= _N_LEAST else None

    def _recent_px(self) -> list[float]:
        """Return the offsets that still count: the cameras may have been mended since the older ones."""
        since_s = self._clock() - _AGE_S
        return [offset_px for at_s, offset_px in self._measurements if at_s >= since_s]

    def problem(self) -> str:
        """Return what is wrong with the rows; empty where they match or where too little is known."""
        offset_px = self.offset_px
        if offset_px is None or abs(offset_px) <= LIMIT_PX:
            return ""
        where = "lower" if offset_px > 0 else "higher"
        return (
            f"the rows of the pair do not match: the right image is {abs(offset_px):.1f} px {where} than the left "
            f"(median of {len(self._recent_px())} frames); calibrate the cameras again"
        )
