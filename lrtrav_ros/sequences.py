"""Recorded frames, whether they lie in a dataset folder or in a rosbag."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Protocol

from lrtrav_ros.bags import StereoBag
from lrtrav_ros.config import SourceConfig
from lrtrav_ros.datasets import FolderDataset, Frame


class Sequence(Protocol):
    """What dataset folders and bags have in common."""

    def __len__(self) -> int:
        """Return the number of frames; a bag may yield fewer."""

    def frames(self) -> Iterator[Frame]:
        """Yield the frames that can be used."""

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
        return nullcontext(FolderDataset(path, source=config.source))
    return StereoBag(path, source=config.source, max_stamp_difference_s=config.max_stamp_difference_s)
