"""Stereo matching: a rectified pair of images to the disparity of the left one."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import Config

__all__ = ["Matcher", "create_matcher"]


class Matcher(Protocol):
    """What every matcher can do."""

    def compute(self, left: NDArray[np.generic], right: NDArray[np.generic]) -> NDArray[np.float32]:
        """Return the disparity of the left image.

        Parameters
        ----------
        left, right : (H, W) or (H, W, 3) ndarray of uint8 or uint16
            Rectified images, grey or BGR, of one shape and one dtype.

        Returns
        -------
        (H, W) ndarray of float32
            Disparity [px], 0 where there is none.

        Raises
        ------
        ValueError
            If the images are not such a pair.
        """
        ...  # pragma: no cover


def create_matcher(config: Config) -> Matcher:
    """Return the matcher that ``stereo.matcher`` names, with the settings of `config`."""
    if config.stereo.matcher == "elas":
        from lrtrav_ros.method.matching.elas import Elas  # compiles kernels: only where it is used

        return Elas(config.stereo, config.elas, threads=config.n_threads)
    from lrtrav_ros.method.matching.opencv import OpenCVMatcher

    return OpenCVMatcher(config.stereo)
