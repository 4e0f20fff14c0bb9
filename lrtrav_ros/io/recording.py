"""Recorded frames, whether they lie in a dataset folder or in a rosbag."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path
from typing import Protocol, TypeAlias

from lrtrav_ros.config import SourceConfig
from lrtrav_ros.frame import Frame
from lrtrav_ros.io.bag_frames import StereoBag, UnusableFrame
from lrtrav_ros.io.dataset_folder import DatasetFolder, FrameFile

RecordedFrame: TypeAlias = Frame | FrameFile | UnusableFrame


class Recording(Protocol):
    """A dataset folder or a rosbag that is open for reading as frames."""

    def __len__(self) -> int:
        """Return the number of frames; a bag may yield fewer."""

    def frames(self) -> Iterator[Frame]:
        """Yield the frames that can be used."""

    def items(self) -> Iterator[RecordedFrame]:
        """Yield all frames in the same order, as what is cheap to yield: the frames of a folder are not read yet."""

    @property
    def problems(self) -> list[str]:
        """One line for all that could not be used up to now, with the reason."""


def is_damaged(recording: Recording) -> bool:
    """Return whether something of a recording is damaged or lost, as far as it has been read; told of bags alone."""
    return isinstance(recording, StereoBag) and recording.is_damaged


def is_dataset_folder(path: Path) -> bool:
    """Return whether a recording is a dataset folder, and no rosbag."""
    return (path / "left").is_dir()


def open_recording(
    path: Path, config: SourceConfig, *, topics: Mapping[str, str] | None = None
) -> AbstractContextManager[Recording]:
    """Open a dataset folder, known by its folder ``left``, or else a rosbag, for a ``with`` block.

    Parameters
    ----------
    path : Path
        The folder or bag.
    config : SourceConfig
        Which of its inputs to take, and how.
    topics : mapping of str to str, optional
        The bag's topic for each input that is not to be searched for; see `StereoBag`.

    Raises
    ------
    FileNotFoundError
        If there is nothing at `path`.
    ValueError
        If it is neither, or holds nothing to detect in, or topics are given for a folder.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such folder or file")
    if path.is_dir() and not any(path.iterdir()):
        raise ValueError(f"{path}: is empty; give a dataset folder with left/, or a rosbag")
    if is_dataset_folder(path):
        if topics:
            raise ValueError(f"{path}: is a dataset folder, which has no topics to remap; give a rosbag")
        return nullcontext(DatasetFolder(path, source=config.source, max_pixels=config.max_pixels))
    return closing(
        StereoBag(
            path,
            source=config.source,
            rectify=config.rectify,
            depth_registered=config.depth_registered,
            depth_pose=config.depth_pose,
            topics=topics,
            max_stamp_difference_s=config.max_stamp_difference_s,
            max_pixels=config.max_pixels,
        )
    )


def distinct_names(paths: Sequence[Sequence[str]]) -> list[str]:
    """Return a name for each path, given by its parts; no two paths may be the same.

    It is the last part, with those before it where several have the same. Where these differ only in what is between
    their parts, as ``a_b/c`` and ``a/b_c`` do, it is the last part and a number.
    """
    for n_parts in range(1, max(map(len, paths)) + 1):
        names = ["_".join(parts[-n_parts:]) for parts in paths]
        if len(set(names)) == len(names):
            return names
    return ["_".join([*parts[-1:], str(i)]) for i, parts in enumerate(paths, 1)]
