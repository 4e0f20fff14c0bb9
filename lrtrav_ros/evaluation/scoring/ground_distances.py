"""The distance of the ground that each pixel shows, and the distance to which a mask follows it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.evaluation.scoring.scores import check_same_size
from lrtrav_ros.evaluation.truth.labels import TRAVERSABLE
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.numerics.checks import check_array, check_count, check_type

MAX_REACH_M = 100.0
"""A mask that reaches farther counts as reaching this far: a row at the horizon is a kilometre long."""

_SMOOTHING_ROWS = 5
_MOST_PX = 2**15  # rows or columns of an image
_MIN_RECALL = 0.5


class GroundDistances:
    """Distances on the ground in an image.

    Parameters
    ----------
    line : GroundLine
        The ground's disparity.
    camera : StereoCamera
        Calibration of the image.
    shape : tuple of int
        Height and width of the image, in pixels.

    Attributes
    ----------
    distance_m : (H, W) ndarray of float64
        Distance of each pixel's ground ahead of the camera, in metres; infinite from the horizon up.
    """

    def __init__(self, line: GroundLine, camera: StereoCamera, shape: tuple[int, ...]) -> None:
        check_type("line", line, GroundLine)
        check_type("camera", camera, StereoCamera)
        check_type("shape", shape, tuple)
        if len(shape) < 2:
            raise ValueError(f"shape is {shape}; give height and width")
        height, width = shape[:2]
        check_count("height", height, most=_MOST_PX)
        check_count("width", width, most=_MOST_PX)
        # A pixel's ground is about as far away as that at the principal column in the row with the same disparity.
        rows = np.arange(height)[:, None] + line.tilt / line.slope * (np.arange(width) - camera.cx)
        self.distance_m = line.distance_m(rows, camera)
        self._rows = np.rint(rows).astype(np.intp)
        first = int(self._rows.min())
        self._rows -= first
        self._row_distance_m = line.distance_m(
            np.arange(first, first + int(self._rows.max()) + 1, dtype=np.float64), camera
        )

    def reach_m(self, mask: NDArray[np.uint8], truth: NDArray[np.uint8]) -> float:
        """Return how far ahead a mask finds the ground without interruption, in metres.

        Rows of the ground are followed away from the camera, from the first on which the mask finds at least half of
        what is traversable to the last before one on which it does not; each counted with two rows on either side.
        Rows without traversable pixels are passed over. What is found wrongly does not count, except in the precision.

        Parameters
        ----------
        mask : (H, W) ndarray of uint8
            255 traversable, 0 not.
        truth : (H, W) ndarray of uint8
            255 traversable, 0 not, 128 ignored.

        Returns
        -------
        float
            The distance of the farthest of these rows, at most `MAX_REACH_M`; 0 where there is none.

        Raises
        ------
        TypeError, ValueError
            If an image is not as above, or not of the size that the distances are for.
        """
        check_same_size(truth, mask=mask)
        check_array("ground truth", truth, np.uint8, self.distance_m.shape)
        traversable = truth == TRAVERSABLE
        n_traversable = self._per_row(traversable)
        n_hits = self._per_row(traversable & (mask > 127))
        near_to_far = np.flatnonzero(n_traversable)[::-1]
        found = n_hits[near_to_far] >= _MIN_RECALL * n_traversable[near_to_far]
        if not found.any():
            return 0.0
        start = int(np.argmax(found))
        lost = np.flatnonzero(~found[start:])
        last = near_to_far[start + lost[0] - 1 if lost.size else -1]
        return min(float(self._row_distance_m[last]), MAX_REACH_M)

    def _per_row(self, pixels: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Return the number of pixels in each row of the ground, summed over a few neighbouring rows."""
        counts = np.bincount(self._rows[pixels], minlength=self._row_distance_m.size)
        return np.convolve(counts, np.ones(_SMOOTHING_ROWS, np.intp))[_SMOOTHING_ROWS // 2 :][: counts.size]
