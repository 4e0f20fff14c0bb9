"""KITTI Road in its own layout; Fritsch, Kuehnl and Geiger, ITSC 2013.

A folder, or one with ``training/`` in it, that holds ``image_2/um_000000.png`` (left, colour), ``image_3/`` (right, a
download of its own), ``calib/um_000000.txt`` and ``gt_image_2/um_road_000000.png``. The truth is that of the benchmark:
what is not road, such as grass, is not traversable, and pixels outside of the valid area are unknown.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame, LabelledItem
from lrtrav_ros.evaluation.truth.labels import IGNORED, NOT_TRAVERSABLE, TRAVERSABLE
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.image_files import read_image


class KittiRoad:
    """KITTI Road's frames with truth; a `LabelledSet`.

    Parameters
    ----------
    path : Path
        The folder, or the one that holds its ``training/``.
    """

    unknown_rule = "ignore"

    def __init__(self, path: Path) -> None:
        self.path = path
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
        return _KittiFrame(self._folder, name).files

    def items(self, names: Collection[str]) -> Iterator[LabelledItem]:
        """Yield the frames of these names."""
        for name in sorted(names):
            yield _KittiFrame(self._folder.absolute(), name)


@dataclass(frozen=True, slots=True)
class _KittiFrame:
    folder: Path
    name: str

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
        frame = Frame(name=self.name, camera=camera, left=read_image(left), right=read_image(right))
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
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        key, _, numbers = line.partition(":")
        if key in ("P2", "P3"):
            try:
                matrices[key] = np.array(numbers.split(), np.float64).reshape(3, 4)
            except ValueError as err:
                raise ValueError(f"{path}: {key} is no matrix of 3 x 4 numbers") from err
    if len(matrices) < 2:
        raise ValueError(f"{path}: has no P2 and P3, the projection matrices of the colour cameras")
    left, right = matrices["P2"], matrices["P3"]
    return StereoCamera(
        fx=float(left[0, 0]),
        fy=float(left[1, 1]),
        cx=float(left[0, 2]),
        cy=float(left[1, 2]),
        baseline_m=float((left[0, 3] - right[0, 3]) / left[0, 0]),
    )


def _read_truth(path: Path) -> NDArray[np.uint8]:
    """Return the truth: the red channel marks the valid area, the blue one the road."""
    image = read_image(path)
    if image.ndim != 3 or image.dtype != np.uint8:
        raise ValueError(f"{path}: has shape {image.shape} and type {image.dtype}; give a colour image of 8 bits")
    truth = np.where(image[..., 2] > 0, np.uint8(NOT_TRAVERSABLE), np.uint8(IGNORED))
    truth[image[..., 0] > 0] = TRAVERSABLE
    return truth
