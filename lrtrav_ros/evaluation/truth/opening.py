"""Opening sets: which layout a path has, and the name that its results get."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lrtrav_ros.config import SourceConfig
from lrtrav_ros.evaluation.truth.folders_and_bags import LabelledBag, LabelledFolder
from lrtrav_ros.evaluation.truth.kitti_road import KittiRoad
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledSet
from lrtrav_ros.evaluation.truth.labels import Labels
from lrtrav_ros.evaluation.truth.mat_files import LAGR_LABELS, MatFields, MatFolder
from lrtrav_ros.io.recording import distinct_names


@dataclass(frozen=True, slots=True)
class ReaderOptions:
    """Options of reading sets.

    Parameters
    ----------
    source : SourceConfig
        Which input to use where a set holds several, how large images may be, and how those of a bag are paired.
    truth : Path, optional
        Folder with the ground truth of a rosbag; else ``gt`` in the bag's folder, or beside the bag's file.
    labels : Labels, optional
        Values of the truth, where they are not those of the layout.
    fields : MatFields
        Where things are in ``.mat`` files.
    """

    source: SourceConfig = field(default_factory=SourceConfig)
    truth: Path | None = None
    labels: Labels | None = None
    fields: MatFields = field(default_factory=MatFields)


@dataclass(frozen=True, slots=True)
class NamedSet:
    """A set under the name that its results have."""

    name: str
    frames: LabelledSet


def open_sets(paths: Sequence[Path], options: ReaderOptions) -> list[NamedSet]:
    """Open sets, named by their folders.

    Parameters
    ----------
    paths : sequence of Path
        Where they lie, each once.
    options : ReaderOptions
        How all of them are read.

    Raises
    ------
    OSError, ValueError
        If one cannot be read, has no frame with truth, or is named twice.
    """
    return [NamedSet(name, open_set(path, options)) for name, path in zip(_names(paths), paths, strict=True)]


def open_set(path: Path, options: ReaderOptions) -> LabelledSet:
    """Open a set of whatever layout.

    Parameters
    ----------
    path : Path
        Dataset folder, folder of KITTI Road or of ``.mat`` files, or a rosbag.
    options : ReaderOptions
        How it is read.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or has no frame with truth.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such folder or file")
    frames = _open_by_layout(path, options)
    if not frames.names:
        raise ValueError(f"{path}: no frame has ground truth; there is nothing to compare with")
    return frames


def _open_by_layout(path: Path, options: ReaderOptions) -> LabelledSet:
    if (path / "left").is_dir():
        return LabelledFolder(path, labels=options.labels or Labels(), source=options.source)
    if KittiRoad.is_at(path):
        return KittiRoad(path, max_pixels=options.source.max_pixels)
    if path.is_dir() and any(path.glob("*.mat")):
        return MatFolder(
            path, fields=options.fields, labels=options.labels or LAGR_LABELS, source=options.source.source
        )
    truth = options.truth or (path if path.is_dir() else path.parent) / "gt"
    return LabelledBag(path, truth=truth, labels=options.labels or Labels(), source=options.source)


def _names(paths: Sequence[Path]) -> list[str]:
    """Return a name for each path; raises ValueError where one is named twice."""
    parts = [Path(os.path.normpath(path.absolute())).parts[1:] for path in paths]
    if len(set(parts)) < len(parts):
        raise ValueError("a dataset is named twice; name each once")
    return distinct_names(parts)
