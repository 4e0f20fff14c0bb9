"""Stereo matching: a rectified pair of images to the disparity of the left one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import ElasConfig, StereoConfig
from lrtrav_ros.numerics.checks import check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

__all__ = ["MATCHERS", "Matcher", "create_matcher"]


@runtime_checkable
class Matcher(Protocol):
    """The interface of every matcher; several threads may share one."""

    def compute(self, left: NDArray[np.generic], right: NDArray[np.generic]) -> NDArray[np.float32]:
        """Return the disparity of the left image.

        Parameters
        ----------
        left, right : (H, W), (H, W, 1) or (H, W, 3) ndarray of uint8 or uint16
            Rectified images, grey or BGR, of one shape and one type.

        Returns
        -------
        (H, W) ndarray of float32
            Disparity in pixels, 0 for none.

        Raises
        ------
        TypeError, ValueError
            If the images are not such a pair.
        """
        ...  # pragma: no cover


def create_matcher(stereo: StereoConfig, elas: ElasConfig, *, team: ThreadTeam = ALONE) -> Matcher:
    """Return the matcher that a configuration names.

    Parameters
    ----------
    stereo : StereoConfig
        `matcher` names it, one of `MATCHERS`; the rest is for all of them.
    elas : ElasConfig
        Settings of ELAS, which the others do not use.
    team : ThreadTeam
        Shares the work; the result does not depend on its number of threads.

    Raises
    ------
    TypeError
        If an argument is something else.
    """
    check_type("stereo", stereo, StereoConfig)
    check_type("elas", elas, ElasConfig)
    check_type("team", team, ThreadTeam)
    return MATCHERS[stereo.matcher](stereo, elas, team)


def _create_elas(stereo: StereoConfig, elas: ElasConfig, team: ThreadTeam) -> Matcher:
    """Return the paper's matcher."""
    from lrtrav_ros.method.matching.elas import Elas  # loads numba: only where it is needed

    return Elas(stereo, elas, team=team)


def _create_opencv(stereo: StereoConfig, elas: ElasConfig, team: ThreadTeam) -> Matcher:
    """Return one of OpenCV's matchers."""
    from lrtrav_ros.method.matching.opencv import OpenCVMatcher

    return OpenCVMatcher(stereo)


MATCHERS: dict[str, Callable[[StereoConfig, ElasConfig, ThreadTeam], Matcher]] = {
    "elas": _create_elas,
    "sgbm": _create_opencv,
    "bm": _create_opencv,
}
"""Makers of matchers, by the names that the setting ``stereo.matcher`` has for them."""
