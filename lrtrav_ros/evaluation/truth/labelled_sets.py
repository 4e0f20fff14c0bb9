"""What a set of frames with ground truth is, in whatever layout it lies on the disk."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.io.dataset_folder import Frame


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFrame:
    """A frame and its truth, uint8 (H, W): 255 traversable, 0 not, 128 unknown.

    Raises
    ------
    ValueError
        If the two differ in size.
    """

    frame: Frame
    truth: NDArray[np.uint8]

    def __post_init__(self) -> None:
        if self.truth.shape != self.frame.left.shape[:2]:
            (height, width), (rows, columns) = self.truth.shape, self.frame.left.shape[:2]
            raise ValueError(
                f"ground truth is {width} x {height} pixels, the left image {columns} x {rows}; give images of one size"
            )


class FrameSource(Protocol):
    """A frame with truth that is perhaps not read yet: it goes to the process that will."""

    @property
    def name(self) -> str:
        """The frame's name."""

    def read(self) -> LabelledFrame:
        """Read it; raises OSError or ValueError where it cannot be used."""


class LabelledSet(Protocol):
    """Frames with truth."""

    @property
    def path(self) -> Path:
        """Where it lies."""

    @property
    def names(self) -> list[str]:
        """Names of the frames with truth, sorted."""

    @property
    def n_without_truth(self) -> int:
        """Number of frames that have none, as far as that is known without reading all of the set."""

    @property
    def unknown_rule(self) -> str:
        """What unknown pixels count as where nothing else is asked for; see `truth.UNKNOWN_RULES`."""

    def files(self, name: str) -> list[Path]:
        """Return the files that a frame is read from."""

    def sources(self, names: Collection[str]) -> Iterator[FrameSource]:
        """Yield the frames of these names, each once."""
