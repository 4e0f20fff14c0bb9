"""Ground truth: which label stands for what, and what unknown pixels count as."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.numerics.checks import check_array, check_count, check_type

TRAVERSABLE = 255
NOT_TRAVERSABLE = 0
IGNORED = 128
"""The truth of a pixel is unknown: it is not scored, unless a rule says that it counts as not traversable."""

UNKNOWN_RULES = ("ignore", "not-traversable")
"""Unknown pixels are left out of the scores, or count as not traversable, as in the paper."""


@dataclass(frozen=True, slots=True)
class Labels:
    """The values of a ground-truth image; those of dataset folders by default.

    Parameters
    ----------
    traversable, not_traversable, unknown : int
        Value of such pixels in the image.

    Raises
    ------
    ValueError
        If two of them are the same.
    """

    traversable: int = TRAVERSABLE
    not_traversable: int = NOT_TRAVERSABLE
    unknown: int = IGNORED

    def __post_init__(self) -> None:
        for name in ("traversable", "not_traversable", "unknown"):
            check_count(name, getattr(self, name), least=-(2**31))
        if len({self.traversable, self.not_traversable, self.unknown}) < 3:
            raise ValueError(f"labels are {self}; give three different values")

    def __str__(self) -> str:
        """Return the three values as the command line takes them."""
        return f"{self.traversable},{self.not_traversable},{self.unknown}"


def decode_truth(image: NDArray[np.generic], labels: Labels) -> NDArray[np.uint8]:
    """Return the ground truth that an image holds.

    Parameters
    ----------
    image : (H, W) ndarray
        Label of each pixel.
    labels : Labels
        What the labels stand for.

    Returns
    -------
    (H, W) ndarray of uint8
        255 traversable, 0 not, 128 unknown.

    Raises
    ------
    ValueError
        If `image` has more than one channel, or a value that is none of the labels.
    """
    check_type("ground truth", image, np.ndarray)
    check_type("labels", labels, Labels)
    if image.ndim != 2 or image.dtype.kind not in "biuf":
        raise ValueError(f"ground truth has shape {image.shape} and type {image.dtype}; give an image of one channel")
    truth = np.full(image.shape, NOT_TRAVERSABLE, np.uint8)
    truth[image == labels.traversable] = TRAVERSABLE
    truth[image == labels.unknown] = IGNORED
    other = image[(truth == NOT_TRAVERSABLE) & (image != labels.not_traversable)]
    if other.size:
        raise ValueError(f"ground truth has the value {other.min()}, but its labels are {labels}; see --labels")
    return truth


def apply_unknown_rule(truth: NDArray[np.uint8], rule: str) -> NDArray[np.uint8]:
    """Return the truth as a rule wants it to be scored.

    Parameters
    ----------
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 unknown.
    rule : str
        One of `UNKNOWN_RULES`: with ``ignore`` unknown pixels stay, and are left out of the scores; with
        ``not-traversable`` they become 0.

    Returns
    -------
    (H, W) ndarray of uint8

    Raises
    ------
    TypeError, ValueError
        If `truth` is not such an array, or there is no such rule.
    """
    check_array("ground truth", truth, np.uint8, ("H", "W"))
    if rule not in UNKNOWN_RULES:
        raise ValueError(f"no rule {rule!r} for unknown pixels; choose one of {', '.join(UNKNOWN_RULES)}")
    return np.where(truth == IGNORED, np.uint8(NOT_TRAVERSABLE), truth) if rule == "not-traversable" else truth
