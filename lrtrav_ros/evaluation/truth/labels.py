"""Ground truth: which label stands for what, and what unknown pixels count as."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.evaluation.scoring.scores import IGNORED, TRAVERSABLE

UNKNOWN_RULES = ("ignore", "not-traversable")


@dataclass(frozen=True, slots=True)
class Labels:
    """The values of a ground-truth image; those of dataset folders by default.

    Raises
    ------
    ValueError
        If two of them are the same.
    """

    traversable: int = TRAVERSABLE
    not_traversable: int = 0
    unknown: int = IGNORED

    def __post_init__(self) -> None:
        if len({self.traversable, self.not_traversable, self.unknown}) < 3:
            raise ValueError(f"labels are {self.text}; give three different values")

    @property
    def text(self) -> str:
        """The three values as the command line takes them."""
        return f"{self.traversable},{self.not_traversable},{self.unknown}"


def decode_truth(image: NDArray[np.generic], labels: Labels) -> NDArray[np.uint8]:
    """Return a ground-truth image (H, W) as 255 traversable, 0 not, 128 unknown.

    Raises
    ------
    ValueError
        If it has more than one channel or a value that is none of the labels.
    """
    if image.ndim != 2:
        raise ValueError(f"ground truth has shape {image.shape}; give an image of one channel")
    truth = np.zeros(image.shape, np.uint8)
    truth[image == labels.traversable] = TRAVERSABLE
    truth[image == labels.unknown] = IGNORED
    other = image[(truth == 0) & (image != labels.not_traversable)]
    if other.size:
        raise ValueError(f"ground truth has the value {other.min()}, but its labels are {labels.text}; see --labels")
    return truth


def apply_unknown_rule(truth: NDArray[np.uint8], rule: str) -> NDArray[np.uint8]:
    """Return truth in which unknown pixels are ignored, or not traversable as in the paper; see `UNKNOWN_RULES`."""
    return np.where(truth == IGNORED, np.uint8(0), truth) if rule == "not-traversable" else truth
