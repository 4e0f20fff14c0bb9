"""The camera's pose over the ground, smoothed in time."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.numerics.checks import check_stamp, check_type

_TIME_CONSTANT_S = 0.1  # a robot that pitches and rolls takes about a second to sway once
_MAX_GAP_S = 1.0
_N_MEDIAN = 3  # frames, of which one may be wrong
_STRAY = 0.035  # from their median, in the direction up (radians) and as a share of the height: a frame that is wrong


class PoseSmoother:
    """Smooths height, pitch and roll exponentially in time, with a time constant of 0.1 s, whatever the frame rate.

    Where a frame is far from the median of the last three, 2 degrees or 3.5 % of the height, the median is taken. A gap
    of more than a second, or a jump back in time, makes it begin anew.
    """

    def __init__(self) -> None:
        self._last: deque[NDArray[np.float64]] = deque(maxlen=_N_MEDIAN)
        self._pose = np.zeros(4)  # direction up and height, where there are last ones
        self._stamp_ns: int | None = None

    def add(self, ground: GroundFrame, stamp_ns: int | None) -> GroundFrame:
        """Go on to a frame in which ground is found, and return the smoothed pose.

        Parameters
        ----------
        ground : GroundFrame
            The pose as the frame shows it.
        stamp_ns : int or None
            The frame's time in nanoseconds; without it the pose is returned as it is, and all is forgotten.

        Returns
        -------
        GroundFrame
        """
        check_type("ground", ground, GroundFrame)
        stamp_ns = None if stamp_ns is None else check_stamp(stamp_ns)
        passed_s = math.inf if stamp_ns is None or self._stamp_ns is None else (stamp_ns - self._stamp_ns) / 1e9
        self._stamp_ns = stamp_ns
        if not 0 <= passed_s <= _MAX_GAP_S:
            self._last.clear()
        self._last.append(np.append(ground.up, ground.height_m))
        pose, middle = self._last[-1], np.median(self._last, axis=0)
        if np.linalg.norm(pose[:3] - middle[:3]) > _STRAY or abs(pose[3] - middle[3]) > _STRAY * middle[3]:
            pose = middle
        if len(self._last) > 1:
            pose = self._pose + (1 - math.exp(-passed_s / _TIME_CONSTANT_S)) * (pose - self._pose)
        self._pose = pose
        return GroundFrame.from_up(pose[:3], float(pose[3]))
