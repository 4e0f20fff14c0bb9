"""The output of an offline detection, and the files that it is written to."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, MapsConfig
from lrtrav_ros.detector import Detection, StageTimes
from lrtrav_ros.frame import to_grey
from lrtrav_ros.io import pictures
from lrtrav_ros.io.atomic_files import named_errors, write_all, write_bytes
from lrtrav_ros.io.csv_cells import cells
from lrtrav_ros.io.image_files import encode_file, scaled_disparity
from lrtrav_ros.io.output_messages import FrameOutputs
from lrtrav_ros.io.parameter_file import dump_parameters
from lrtrav_ros.io.run_journal import JournalPart
from lrtrav_ros.mapping.grid import ground_grid
from lrtrav_ros.method.ground import NO_GROUND
from lrtrav_ros.method.textures import weber_descriptor

_RULE_WITH_CONFIDENCE = "propagation"
_NO_CONFIDENCE = f"cannot save 'confidence': only the rule {_RULE_WITH_CONFIDENCE} finds it; set extension.rule to that"


def _confidence(detection: Detection, *_: object) -> NDArray[np.uint8]:
    """Return how sure the mask is; raises ValueError where the rule does not say."""
    confidence = detection.long_range.confidence
    if confidence is None:
        raise ValueError(_NO_CONFIDENCE)
    return confidence


def _grid(detection: Detection, camera: StereoCamera, maps: MapsConfig | None) -> NDArray[np.uint8]:
    """Return the ground ahead as a picture."""
    return ground_grid(detection.long_range.occupancy, detection.short_range, camera, maps).image


# What --save can add, each in a folder of its name.
EXTRAS: dict[str, Callable[[Detection, StereoCamera, MapsConfig | None], NDArray[Any]]] = {
    "disparity": lambda detection, *_: scaled_disparity(detection.disparity),
    "superpixels": lambda detection, *_: detection.superpixels.astype(np.uint16),
    "clusters": lambda detection, *_: detection.clusters.astype(np.uint16),
    "occupancy": lambda detection, *_: detection.long_range.occupancy,
    "confidence": _confidence,
    "grid": _grid,
    "u_disparity": lambda detection, *_: pictures.histogram_picture(detection.short_range.u_disparity),
    "v_disparity": lambda detection, *_: pictures.histogram_picture(detection.short_range.v_disparity),
    "obstacle_disparity": lambda detection, *_: pictures.disparity_picture(detection.short_range.obstacle_disparity),
    "wld": lambda detection, *_: weber_descriptor(to_grey(detection.image)),
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


@dataclass(frozen=True, slots=True)
class FrameResult:
    """The output of one frame.

    Attributes
    ----------
    row : dict of str to str
        Its row of ``frames.csv``, by column.
    files : dict of str to bytes
        Content of its files by their paths in the output folder; none where the frame could not be used.
    outputs : FrameOutputs, optional
        The same as messages, where a bag is to be written.
    """

    row: dict[str, str]
    files: dict[str, bytes]
    outputs: FrameOutputs | None = None

    @property
    def name(self) -> str:
        """The frame's name."""
        return self.row["name"]

    @property
    def problem(self) -> str:
        """Why the frame could not be used, or what was not found in it; empty where all went well."""
        return self.row.get("problem", "")


def frame_result(
    name: str,
    detection: Detection,
    camera: StereoCamera,
    *,
    extras: Collection[str] = (),
    maps: MapsConfig | None = None,
) -> FrameResult:
    """Return the output of a frame in which something was detected; `extras` are names out of `EXTRAS`."""
    short, long = detection.short_range, detection.long_range
    images = {
        f"short_range/{name}.png": short.mask,
        f"long_range/{name}.png": long.mask,
        f"overlay/{name}.jpg": pictures.overlay(detection.image, short.occupancy, long.occupancy),
        **{f"{extra}/{name}.png": EXTRAS[extra](detection, camera, maps) for extra in extras},
    }
    return FrameResult(
        _row(name, detection, camera), {path: encode_file(path, image) for path, image in images.items()}
    )


def unusable_frame(name: str, problem: str) -> FrameResult:
    """Return the output of a frame that could not be used: its name, and why."""
    return FrameResult({"name": name, "problem": problem}, {})


def available_extras(config: Config) -> tuple[str, ...]:
    """Return all names of `EXTRAS` that a detection with this configuration has: confidence only by propagation."""
    has_confidence = config.extension.rule == _RULE_WITH_CONFIDENCE
    return tuple(name for name in EXTRAS if has_confidence or name != "confidence")


def checked_extras(names: Collection[str], config: Config) -> tuple[str, ...]:
    """Return the names; raises ValueError if one is not in `EXTRAS`, or there is none with this configuration."""
    unknown = sorted(set(names) - set(EXTRAS))
    if unknown:
        raise ValueError(f"cannot save {unknown[0]!r}; choose one of {', '.join(EXTRAS)}")
    if not set(names) <= set(available_extras(config)):
        raise ValueError(_NO_CONFIDENCE)
    return tuple(names)


class ResultFolder:
    """Writes masks, pictures, ``frames.csv`` and ``config.yaml`` of a run; every file appears whole or not at all,
    but for the table, which grows by a row with each frame.

    Parameters
    ----------
    path : Path
        Folder to make; an empty one may be there, or that of the run that is resumed.
    config : Config
        The run's settings, for ``config.yaml``.
    journal : JournalPart, optional
        Where to note frames that are written; its rows of frames that were finished before come first in the table.
    """

    def __init__(self, path: Path, config: Config, *, journal: JournalPart | None = None) -> None:
        self._path = path
        self._journal = journal
        self._table = path / "frames.csv"
        rows = [frame.row for frame in journal.finished] if journal else []
        write_bytes(path / "config.yaml", dump_parameters(config).encode())
        write_bytes(self._table, _table(rows))
        self._file = os.open(self._table, os.O_WRONLY | os.O_APPEND)

    def __enter__(self) -> ResultFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._file)

    def write(self, result: FrameResult) -> None:
        """Write a frame's files, then its row, and note that they are there."""
        for path, data in result.files.items():
            write_bytes(self._path / path, data)
        with named_errors(self._table):
            write_all(self._file, _table([result.row], with_header=False))
        if self._journal is not None:
            self._journal.note(result.name, result.files, row=result.row)


def _table(rows: Iterable[Mapping[str, str]], *, with_header: bool = True) -> bytes:
    """Return rows of ``frames.csv``, in which no name is a formula: see `csv_cells`."""
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, _COLUMNS)
    if with_header:
        table.writeheader()
    table.writerows(map(cells, rows))
    return text.getvalue().encode()


def _row(name: str, detection: Detection, camera: StereoCamera) -> dict[str, str]:
    row: dict[str, object] = {"name": name}
    row.update({key: f"{value:.2f}" for key, value in dataclasses.asdict(detection.times).items()})
    line = detection.short_range.line
    if line is None:
        row["problem"] = NO_GROUND
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
