"""Reliability of a confidence: of the pixels of a confidence of 80 %, about 80 % should be right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.evaluation.scoring.scores import check_same_size
from lrtrav_ros.evaluation.truth.labels import IGNORED, TRAVERSABLE

CONFIDENCE_BINS: tuple[tuple[float, float], ...] = tuple((i / 20, (i + 1) / 20) for i in range(10, 20))
"""Least (inclusive) and greatest confidence of each bin; what is below the first counts there."""

_LEVELS = 255  # of certainty


@dataclass(frozen=True, slots=True)
class ConfidenceBin:
    """Pixels of about the same confidence.

    Attributes
    ----------
    n_pixels, n_right : int
        All of them, and those that the mask labels as the truth does.
    sum_levels : int
        Sum of their confidences, in levels of 1/255.
    """

    n_pixels: int
    n_right: int
    sum_levels: int

    @property
    def share_right(self) -> float | None:
        """Share of the pixels that are right; None where there are none."""
        return self.n_right / self.n_pixels if self.n_pixels else None

    @property
    def confidence(self) -> float | None:
        """Mean confidence of the pixels, 0 .. 1; None where there are none."""
        return self.sum_levels / _LEVELS / self.n_pixels if self.n_pixels else None

    def __add__(self, other: ConfidenceBin) -> ConfidenceBin:
        return ConfidenceBin(
            self.n_pixels + other.n_pixels, self.n_right + other.n_right, self.sum_levels + other.sum_levels
        )


def count_confidence(
    confidence: NDArray[np.uint8], mask: NDArray[np.uint8], truth: NDArray[np.uint8]
) -> tuple[ConfidenceBin, ...]:
    """Count the pixels that the truth judges in each of `CONFIDENCE_BINS`, and those of them that are right.

    Parameters
    ----------
    confidence : (H, W) ndarray of uint8
        Probability that the mask is right, times 255; 0 where nothing tells, and such pixels are left out.
    mask : (H, W) ndarray of uint8
        255 traversable, 0 not.
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 ignored.

    Raises
    ------
    TypeError, ValueError
        If an image is not as above, or they differ in size.
    """
    check_same_size(truth, confidence=confidence, mask=mask)
    right = (mask > 127) == (truth == TRAVERSABLE)
    counted = (truth != IGNORED) & (confidence > 0)
    levels = np.arange(_LEVELS + 1)
    n_pixels = np.bincount(confidence[counted], minlength=levels.size)
    n_right = np.bincount(confidence[counted & right], minlength=levels.size)
    # In whole numbers, so that a level on a bin's edge is in the bin that begins there.
    bins = np.clip((20 * levels - 10 * _LEVELS) // _LEVELS, 0, len(CONFIDENCE_BINS) - 1)
    return tuple(
        ConfidenceBin(int(n_pixels[of].sum()), int(n_right[of].sum()), int((n_pixels * levels)[of].sum()))
        for of in (bins == i for i in range(len(CONFIDENCE_BINS)))
    )


def calibration_error(bins: Sequence[ConfidenceBin]) -> float | None:
    """Return the expected calibration error: how far confidence is from the share that is right, a mean over pixels.

    Parameters
    ----------
    bins : sequence of ConfidenceBin
        Those of `count_confidence`, or sums of such.

    Returns
    -------
    float or None
        None where no pixel has a confidence.

    References
    ----------
    .. [1] C. Guo et al., "On Calibration of Modern Neural Networks", ICML 2017.
    """
    n_pixels = sum(item.n_pixels for item in bins)
    return sum(abs(item.n_right - item.sum_levels / _LEVELS) for item in bins) / n_pixels if n_pixels else None
