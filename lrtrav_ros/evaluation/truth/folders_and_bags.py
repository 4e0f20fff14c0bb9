"""Dataset folders, and rosbags with a folder of ground truth, as sets."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import SourceConfig
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame, LabelledItem
from lrtrav_ros.evaluation.truth.labels import Labels, decode_truth
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.bag_frames import UnusableFrame
from lrtrav_ros.io.dataset_folder import MILLIMETRES, DatasetFolder, FrameFile
from lrtrav_ros.io.image_files import read_disparity, read_image
from lrtrav_ros.io.recording import is_damaged, open_recording

_FOLDERS = ("left", "right", "disparity", "depth", "calib", "gt", "height")


class LabelledFolder:
    """A dataset folder with ``gt/NAME.png``; a `LabelledSet`.

    Where it has ``height/NAME.png`` too (16 bit, millimetres above the ground), obstacles are counted by height.

    Parameters
    ----------
    path : Path
        The folder.
    labels : Labels
        Values of the truth.
    source : SourceConfig
        Which input frames carry where the folder holds several, and how large images may be; see `DatasetFolder`.

    Raises
    ------
    OSError, ValueError
        If `DatasetFolder` refuses it.
    """

    unknown_rule = "ignore"

    def __init__(self, path: Path, *, labels: Labels, source: SourceConfig) -> None:
        self.path = path
        self._dataset = DatasetFolder(path, source=source.source, max_pixels=source.max_pixels)
        self._labels = labels
        self.names = sorted(file.stem for file in (path / "gt").glob("*.png"))
        self.n_without_truth = len(set(self._dataset.names) - set(self.names))
        self._files: dict[str, list[Path]] = {}
        for file in sorted(file for folder in _FOLDERS for file in (path / folder).glob("*")):
            self._files.setdefault(file.stem, []).append(file)

    def files(self, name: str) -> list[Path]:
        """Return the files that a frame may be read from."""
        return [*self._files[name], self.path / "calib.json"]

    def items(self, names: Collection[str]) -> Iterator[LabelledItem]:
        """Yield the frames of these names."""
        for name in sorted(names):
            file = self._dataset.frame_file(name)
            yield _FolderFrame(file, self._labels)


@dataclass(frozen=True, slots=True)
class _FolderFrame:
    file: FrameFile
    labels: Labels

    @property
    def name(self) -> str:
        return self.file.name

    def read(self) -> LabelledFrame:
        truth, height = (self.file.folder / kind / f"{self.name}.png" for kind in ("gt", "height"))
        return LabelledFrame(
            self.file.read(),
            read_truth(truth, self.labels),
            read_disparity(height, scale=MILLIMETRES) if height.exists() else None,
        )


class LabelledBag:
    """A rosbag whose frames have ground truth in a folder; a `LabelledSet`.

    Parameters
    ----------
    path : Path
        The bag.
    truth : Path
        Folder with ``NAME.png`` for each frame, named by its header stamp in nanoseconds.
    labels : Labels
        Values of the truth.
    source : SourceConfig
        How the bag is read.

    Raises
    ------
    ValueError
        If there is no image in the folder.
    """

    unknown_rule = "ignore"
    n_without_truth = 0  # the frames are not known until the bag is read

    def __init__(self, path: Path, *, truth: Path, labels: Labels, source: SourceConfig) -> None:
        self.path = path
        self._problems: list[str] | None = None  # None until the bag has been read to its end
        self._truth = {file.stem: file for file in truth.glob("*.png")}
        self.names = sorted(self._truth)
        if not self.names:
            raise ValueError(f"{truth}: holds no ground truth for {path}; put NAME.png there, named by header stamps")
        self._labels = labels
        self._source = source

    def problems(self) -> list[str]:
        """Return what of the bag is damaged or lost; reads it where no frame of it was asked for before."""
        if self._problems is None:
            for _ in self.items(()):
                pass
        return self._problems or []

    def files(self, name: str) -> list[Path]:
        """Return the bag's files and that of the truth."""
        bag = sorted(self.path.rglob("*")) if self.path.is_dir() else [self.path]
        return [*bag, self._truth[name]]

    def items(self, names: Collection[str]) -> Iterator[LabelledItem]:
        """Yield the frames of these names; those that the bag does not hold fail when they are read."""
        missing = dict.fromkeys(names, f"{self.path} has no such frame")
        try:
            with open_recording(self.path, self._source) as recording:
                for item in recording.items():
                    if isinstance(item, Frame) and item.name in missing:
                        del missing[item.name]
                        yield _BagFrame(item, self._truth[item.name], self._labels)
                    elif isinstance(item, UnusableFrame) and item.name in missing:
                        missing[item.name] = item.problem
                self._problems = recording.problems if is_damaged(recording) else []
        except ValueError as err:  # of a bag that breaks off
            self._problems = [str(err)]
            missing = dict.fromkeys(missing, str(err))
        for name, problem in missing.items():
            yield _MissingFrame(name, problem)


@dataclass(frozen=True, slots=True, eq=False)
class _BagFrame:
    frame: Frame
    truth: Path
    labels: Labels

    @property
    def name(self) -> str:
        return self.frame.name

    def read(self) -> LabelledFrame:
        return LabelledFrame(self.frame, read_truth(self.truth, self.labels))


@dataclass(frozen=True, slots=True)
class _MissingFrame:
    name: str
    problem: str

    def read(self) -> LabelledFrame:
        raise ValueError(self.problem)


def read_truth(path: Path, labels: Labels) -> NDArray[np.uint8]:
    """Read a ground-truth image.

    Parameters
    ----------
    path : Path
        PNG of one channel.
    labels : Labels
        Its values.

    Returns
    -------
    (H, W) ndarray of uint8
        255 traversable, 0 not, 128 unknown.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or has other values than its labels; the message names the file.
    """
    image = read_image(path)
    try:
        return decode_truth(image, labels)
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err
