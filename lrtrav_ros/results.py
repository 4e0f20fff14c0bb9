"""The output folder of an offline detection."""

from __future__ import annotations

import csv
import dataclasses
import math
import os
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros import pictures
from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, dump_parameters
from lrtrav_ros.detector import Detection, StageTimes
from lrtrav_ros.features import to_gray, weber_descriptor
from lrtrav_ros.images import write_bytes, write_disparity, write_image

# What --save can add, each in a folder of its name.
EXTRAS: dict[str, Callable[[Detection], NDArray[Any]]] = {
    "disparity": lambda detection: detection.disparity,
    "superpixels": lambda detection: detection.long_range.superpixels.astype(np.uint16),
    "clusters": lambda detection: detection.long_range.clusters.astype(np.uint16),
    "occupancy": lambda detection: detection.long_range.occupancy,
    "u_disparity": lambda detection: pictures.histogram_picture(detection.short_range.u_disparity),
    "v_disparity": lambda detection: pictures.histogram_picture(detection.short_range.v_disparity),
    "obstacle_disparity": lambda detection: pictures.disparity_picture(detection.short_range.obstacle_disparity),
    "wld": lambda detection: weber_descriptor(to_gray(detection.left)),
}

_GROUND_COLUMNS = ("slope", "intercept", "tilt", "horizon_row", "camera_height_m", "pitch_deg", "roll_deg")
_COLUMNS = (
    "name",
    *(field.name for field in dataclasses.fields(StageTimes)),
    *_GROUND_COLUMNS,
    "n_superpixels",
    "n_clusters",
    "problem",
)


class ResultFolder:
    """Writes masks, pictures, ``frames.csv`` and ``config.yaml`` of a run; every file appears whole or not at all.

    Parameters
    ----------
    path
        Folder to make; an empty one may be there.
    extras
        Names out of `EXTRAS` of what is written besides the masks.

    Raises
    ------
    ValueError
        If a name is not in `EXTRAS`, or `path` is a file.
    """

    def __init__(self, path: Path, config: Config, *, extras: Collection[str] = ()) -> None:
        unknown = sorted(set(extras) - set(EXTRAS))
        if unknown:
            raise ValueError(f"cannot save {unknown[0]!r}; choose out of {', '.join(EXTRAS)}")
        self.path = path
        self._extras = extras
        path.mkdir(parents=True, exist_ok=True)
        write_bytes(path / "config.yaml", dump_parameters(config).encode())
        self._table = (path / "frames.csv").open("w", newline="", encoding="utf-8", buffering=1)
        self._rows = csv.DictWriter(self._table, _COLUMNS)
        self._rows.writeheader()

    def __enter__(self) -> ResultFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._table.close()

    def write(self, name: str, detection: Detection, camera: StereoCamera) -> None:
        """Write all that was found in a frame."""
        short, long = detection.short_range, detection.long_range
        self._image("short_range", name, short.mask)
        self._image("long_range", name, long.mask)
        picture = pictures.overlay(detection.left, short.occupancy, long.occupancy)
        self._image("overlay", name, picture, suffix=".jpg")
        for extra in self._extras:
            self._image(extra, name, EXTRAS[extra](detection))
        self._rows.writerow(_row(name, detection, camera))

    def write_problem(self, name: str, problem: str) -> None:
        """Write a row for a frame that could not be used."""
        self._rows.writerow({"name": name, "problem": problem})

    def _image(self, folder: str, name: str, image: NDArray[Any], *, suffix: str = ".png") -> None:
        path = self.path / folder / f"{name}{suffix}"
        path.parent.mkdir(exist_ok=True)
        if image.dtype == np.float32:
            write_disparity(path, image)
        else:
            write_image(path, image)


def _row(name: str, detection: Detection, camera: StereoCamera) -> dict[str, str]:
    row: dict[str, object] = {"name": name}
    row.update({key: f"{value:.2f}" for key, value in dataclasses.asdict(detection.times).items()})
    line = detection.short_range.line
    if line is None:
        row["problem"] = "no ground line found"
    else:
        values = (
            line.slope,
            line.intercept,
            line.tilt,
            line.horizon_row(camera.cx),
            line.camera_height_m(camera),
            math.degrees(line.pitch_rad(camera)),
            math.degrees(line.roll_rad(camera)),
        )
        row.update({key: f"{value:.5g}" for key, value in zip(_GROUND_COLUMNS, values, strict=True)})
    row["n_superpixels"] = int(detection.long_range.superpixels.max()) + 1
    row["n_clusters"] = int(detection.long_range.superpixel_clusters.max()) + 1
    return {key: str(value) for key, value in row.items()}


@contextmanager
def output_folder(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield the folder to write to, so that a finished result is never lost to an unfinished one.

    A new or empty folder is written to as it is. One that holds something is only replaced with `overwrite`, and only
    when the new one is finished.

    Raises
    ------
    FileExistsError
        If there is something at `path` and `overwrite` is not set.
    """
    if not path.exists() or (path.is_dir() and not any(path.iterdir())):
        yield path
        return
    if not overwrite or not path.is_dir():
        raise FileExistsError(f"{path} exists and is not an empty folder; choose another or give --overwrite")
    new = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        yield new
        old = path.with_name(f".{path.name}.{os.getpid()}.old")
        path.rename(old)
        new.rename(path)
        shutil.rmtree(old)
    finally:
        if new.exists():
            shutil.rmtree(new)
