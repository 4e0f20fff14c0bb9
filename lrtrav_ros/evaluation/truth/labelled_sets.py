"""A set of frames with ground truth, whatever its layout on the disk."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.frame import Frame
from lrtrav_ros.numerics.checks import check_array, check_type


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFrame:
    """A frame and its truth.

    Parameters
    ----------
    frame : Frame
        What the camera saw.
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 unknown.
    height_m : (H, W) ndarray of float32, optional
        Height above the ground of what each pixel shows, in metres; 0 for ground and sky. None where it is not known.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or they differ in size.
    """

    frame: Frame
    truth: NDArray[np.uint8]
    height_m: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        check_type("frame", self.frame, Frame)
        check_array("ground truth", self.truth, np.uint8, ("H", "W"))
        if self.height_m is not None:
            check_array("heights", self.height_m, np.float32, ("H", "W"))
        for name, image in (("ground truth is", self.truth), ("heights are", self.height_m)):
            if image is not None and image.shape != self.frame.shape:
                size, wanted = (f"{shape[1]} x {shape[0]}" for shape in (image.shape, self.frame.shape))
                raise ValueError(f"the {name} {size} pixels, but the frame is {wanted}; give images of one size")


class LabelledItem(Protocol):
    """A frame of a set, possibly not read yet; the process that evaluates it reads it."""

    @property
    def name(self) -> str:
        """The frame's name."""

    def read(self) -> LabelledFrame:
        """Read it; raises OSError or ValueError where it cannot be used."""


class LabelledSet(Protocol):
    """Frames with truth."""

    @property
    def path(self) -> Path:
        """Folder or file that the set was opened from."""

    @property
    def names(self) -> list[str]:
        """Names of the frames with truth, sorted."""

    @property
    def n_without_truth(self) -> int:
        """Number of frames that have none, as far as that is known without reading all of the set."""

    @property
    def unknown_rule(self) -> str:
        """The rule for unknown pixels where nothing else is asked for; one of `labels.UNKNOWN_RULES`."""

    def files(self, name: str) -> list[Path]:
        """Return the files that a frame is read from."""

    def items(self, names: Collection[str]) -> Iterator[LabelledItem]:
        """Yield the frames of these names, each once."""
