"""KITTI Road in its own layout; Fritsch, Kuehnl and Geiger, ITSC 2013.

A folder, or one with ``training/`` in it, that holds ``image_2/um_000000.png`` (left, colour), ``image_3/`` (right, a
download of its own), ``calib/um_000000.txt`` and ``gt_image_2/um_road_000000.png``. The truth is that of the benchmark:
what is not road, such as grass, is not traversable, and pixels outside of the valid area are unknown.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame, LabelledItem
from lrtrav_ros.evaluation.truth.labels import IGNORED, NOT_TRAVERSABLE, TRAVERSABLE
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.image_files import read_image
from lrtrav_ros.io.input_files import read_text


class KittiRoad:
    """KITTI Road's frames with truth; a `LabelledSet`.

    Parameters
    ----------
    path : Path
        The folder, or the one that holds its ``training/``.
    max_pixels : int
        Most pixels that an image may have.
    """

    unknown_rule = "ignore"

    def __init__(self, path: Path, *, max_pixels: int = MAX_PIXELS) -> None:
        self.path = path
        self._max_pixels = max_pixels
        self._folder = path / "training" if (path / "training").is_dir() else path
        lefts = {file.stem for file in (self._folder / "image_2").glob("*.png")}
        truths = {file.stem.replace("_road_", "_") for file in (self._folder / "gt_image_2").glob("*_road_*.png")}
        self.names = sorted(truths)
        self.n_without_truth = len(lefts - truths)

    @staticmethod
    def is_at(path: Path) -> bool:
        """Return whether a folder has this layout."""
        return any((path / folder / "image_2").is_dir() for folder in ("training", "."))

    def files(self, name: str) -> list[Path]:
        """Return the files of a frame."""
        return _KittiFrame(self._folder, name, self._max_pixels).files

    def items(self, names: Collection[str]) -> Iterator[LabelledItem]:
        """Yield the frames of these names."""
        for name in sorted(names):
            yield _KittiFrame(self._folder.absolute(), name, self._max_pixels)


@dataclass(frozen=True, slots=True)
class _KittiFrame:
    folder: Path
    name: str
    max_pixels: int

    @property
    def files(self) -> list[Path]:
        """Left and right image, calibration and truth."""
        drive, _, number = self.name.partition("_")
        return [
            self.folder / "image_2" / f"{self.name}.png",
            self.folder / "image_3" / f"{self.name}.png",
            self.folder / "calib" / f"{self.name}.txt",
            self.folder / "gt_image_2" / f"{drive}_road_{number}.png",
        ]

    def read(self) -> LabelledFrame:
        """Read images, calibration and truth."""
        left, right, calibration, truth = self.files
        camera = read_calibration(calibration)
        read = partial(read_image, max_pixels=self.max_pixels)
        frame = Frame(name=self.name, camera=camera, left=read(left), right=read(right))
        return LabelledFrame(frame, _read_truth(truth))


def read_calibration(path: Path) -> StereoCamera:
    """Read the camera from the projection matrices P2 and P3 of a calibration file.

    Parameters
    ----------
    path : Path
        Text file with a line ``P2: `` and 12 numbers for each camera.

    Returns
    -------
    StereoCamera
        The colour cameras; the file does not say the images' size.

    Raises
    ------
    OSError, ValueError
        If the file cannot be read, or one of the matrices is not in it.
    """
    matrices = {}
    for line in read_text(path).splitlines():
        key, _, numbers = line.partition(":")
        if key in ("P2", "P3"):
            try:
                matrices[key] = np.array(numbers.split(), np.float64).reshape(3, 4)
            except ValueError as err:
                raise ValueError(f"{path}: {key} is no matrix of 3 x 4 numbers") from err
    if len(matrices) < 2:
        raise ValueError(f"{path}: has no P2 and P3, the projection matrices of the colour cameras")
    try:
        return _camera(matrices["P2"], matrices["P3"])
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


def _camera(left: NDArray[np.float64], right: NDArray[np.float64]) -> StereoCamera:
    """Return the camera of two projection matrices."""
    fx, shift = float(left[0, 0]), float(left[0, 3]) - float(right[0, 3])
    if not fx > 0:
        raise ValueError(f"P2 has the focal length {fx:g}; give a positive one")
    return StereoCamera(fx=fx, fy=float(left[1, 1]), cx=float(left[0, 2]), cy=float(left[1, 2]), baseline_m=shift / fx)


def _read_truth(path: Path) -> NDArray[np.uint8]:
    """Return the truth: the red channel marks the valid area, the blue one the road."""
    image = read_image(path)
    if image.ndim != 3 or image.dtype != np.uint8:
        raise ValueError(f"{path}: has shape {image.shape} and type {image.dtype}; give a colour image of 8 bits")
    truth = np.where(image[..., 2] > 0, np.uint8(NOT_TRAVERSABLE), np.uint8(IGNORED))
    truth[image[..., 0] > 0] = TRAVERSABLE
    return truth
