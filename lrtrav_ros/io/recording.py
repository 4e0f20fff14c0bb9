"""Recorded frames, whether they lie in a dataset folder or in a rosbag."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

from lrtrav_ros.config import SourceConfig
from lrtrav_ros.io.bag_frames import StereoBag, UnusableFrame
from lrtrav_ros.io.dataset_folder import FolderDataset, Frame


@dataclass(frozen=True, slots=True)
class FrameFile:
    """A frame of a dataset folder that is not read yet: a few bytes that any process can read it by.

    Attributes
    ----------
    folder, source, name
        As `FolderDataset` takes them; the path is absolute.
    opened_ns
        When the folder was opened. It is listed once for all the frames of one opening.
    """

    folder: Path
    source: str
    name: str
    opened_ns: int

    def read(self) -> Frame:
        """Read the frame; raises what `FolderDataset.frame` does."""
        return _dataset(self.folder, self.source, self.opened_ns).frame(self.name)


SequenceItem = Frame | FrameFile | UnusableFrame


class Sequence(Protocol):
    """What dataset folders and bags have in common."""

    def __len__(self) -> int:
        """Return the number of frames; a bag may yield fewer."""

    def frames(self) -> Iterator[Frame]:
        """Yield the frames that can be used."""

    def items(self) -> Iterator[SequenceItem]:
        """Yield all frames in the same order, as what is cheap to yield: the frames of a folder are not read yet."""

    @property
    def problems(self) -> list[str]:
        """What could not be used up to now, and why."""


def open_sequence(path: Path, config: SourceConfig) -> AbstractContextManager[Sequence]:
    """Open a dataset folder, known by its folder ``left``, or else a rosbag, for a ``with`` block.

    Raises
    ------
    FileNotFoundError
        If there is nothing at `path`.
    ValueError
        If it is neither, or holds nothing to detect in.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such folder or file")
    if path.is_dir() and not any(path.iterdir()):
        raise ValueError(f"{path}: is empty; give a dataset folder with left/, or a rosbag")
    if (path / "left").is_dir():
        return nullcontext(_Folder(path, source=config.source))
    return closing(_Bag(path, source=config.source, max_stamp_difference_s=config.max_stamp_difference_s))


class _Folder(FolderDataset):
    def items(self) -> Iterator[SequenceItem]:
        opened_ns = time.time_ns()
        for name in self.names:
            yield FrameFile(self.path.absolute(), self.source, name, opened_ns)


class _Bag(StereoBag):
    def items(self) -> Iterator[SequenceItem]:
        n_unusable = 0
        for frame in self.frames():
            yield from self.unusable[n_unusable:]
            n_unusable = len(self.unusable)
            yield frame
        yield from self.unusable[n_unusable:]


@lru_cache(maxsize=4)
def _dataset(folder: Path, source: str, opened_ns: int) -> FolderDataset:
    return FolderDataset(folder, source=source)
