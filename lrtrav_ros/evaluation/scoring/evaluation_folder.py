"""The folder of an evaluation, and the run over all frames that fills it: where one was interrupted, the next resumes.

Scores, masks and what is made of them are the same in every run and for any number of processes; measured times, which
are not, have files of their own.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from lrtrav_ros.evaluation.scoring.evaluation_identity import EvaluationIdentity
from lrtrav_ros.evaluation.scoring.frame_evaluation import FrameOutcome, FrameTask, Setup, evaluate_frame
from lrtrav_ros.evaluation.scoring.score_records import FrameRecord, FrameTimes, Record, from_json, to_json
from lrtrav_ros.evaluation.truth.opening import NamedSet
from lrtrav_ros.frame import as_8bit
from lrtrav_ros.io.atomic_files import is_leftover, remove_leftovers, write_bytes
from lrtrav_ros.io.folder_lock import LOCK_FILE
from lrtrav_ros.io.image_files import read_image
from lrtrav_ros.offline.parallel import TaskFailure, run_tasks
from lrtrav_ros.offline.run_identity import files_digest

_IDENTITY_FILE = "run.json"
_LONGEST_NAME = 255
_RESULTS = ("records", "times", "masks", "configs", "scores.csv", "times.csv", "summary.json", "report.html")


@dataclass(frozen=True, slots=True)
class Superseded:
    """Earlier results that were moved aside: where they are now, and which changes made them obsolete."""

    path: Path
    changes: tuple[str, ...]


class EvaluationFolder:
    """The folder that an evaluation writes to.

    It holds ``run.json`` (what its results depend on), and for each frame ``records/SET/NAME.json``,
    ``times/SET/NAME.json`` and, where they are asked for, ``masks/SET/METHOD/NAME.png``. Every file appears whole or
    not at all.

    Parameters
    ----------
    path : Path
        Folder to make, or that of an earlier run; nobody else writes to it, see `locked_folder`. Its frames are kept
        where they have this identity; else all its results are moved into a folder ``superseded-N`` of it, and never
        removed.
    identity : EvaluationIdentity
        All that results depend on besides the frames.

    Attributes
    ----------
    superseded : Superseded or None
        The results that were moved aside; None where there were none.

    Raises
    ------
    FileExistsError
        If there is something else at `path`.
    """

    def __init__(self, path: Path, identity: EvaluationIdentity) -> None:
        self.path = path
        file = path / _IDENTITY_FILE
        check_place(path)
        remove_leftovers(path)
        changes = _changes_since(file, identity) if file.is_file() else []
        self.superseded = Superseded(self._set_aside(), tuple(changes)) if changes else None
        write_bytes(file, to_json(identity).encode(), durable=True)

    def _set_aside(self) -> Path:
        """Move all results into a folder of their own, with a copy of what they belong to, and return it."""
        numbered = (self.path / f"superseded-{number}" for number in count(1))
        aside = next(path for path in numbered if not path.exists())
        write_bytes(aside / _IDENTITY_FILE, (self.path / _IDENTITY_FILE).read_bytes(), durable=True)
        for name in _RESULTS:
            if (self.path / name).exists():
                (self.path / name).rename(aside / name)
        return aside

    def record(self, set_name: str, frame: str) -> FrameRecord | None:
        """Return the record of a frame; None where there is none that can be read."""
        return _read(FrameRecord, self.path / "records" / set_name / _file_name(frame))

    def times(self, set_name: str, frame: str) -> FrameTimes | None:
        """Return the times of a frame; None where there are none that can be read."""
        return _read(FrameTimes, self.path / "times" / set_name / _file_name(frame))

    def mask(self, set_name: str, method: str, frame: str) -> NDArray[np.uint8] | None:
        """Return a method's mask of a frame; None where masks are not kept.

        Raises
        ------
        ValueError
            If its file is no image.
        """
        path = self._mask_path(set_name, method, frame)
        return as_8bit(read_image(path)) if path.exists() else None

    def _mask_path(self, set_name: str, method: str, frame: str) -> Path:
        return self.path / "masks" / set_name / method / f"{frame}.png"

    def write(self, outcome: FrameOutcome) -> None:
        """Write what is kept of a frame; the record comes last, and tells that the rest is there."""
        record = outcome.record
        file = Path(record.set) / _file_name(record.frame)
        for mask in outcome.masks:
            write_bytes(self._mask_path(record.set, mask.method, record.frame), mask.data, durable=True)
        write_bytes(self.path / "times" / file, to_json(outcome.times).encode())
        write_bytes(self.path / "records" / file, to_json(record).encode())


def check_place(path: Path) -> None:
    """Raise FileExistsError where there is something else than an evaluation, or one that has just begun."""
    if not path.exists() or (path / _IDENTITY_FILE).is_file():
        return
    if not path.is_dir() or any(item.name != LOCK_FILE and not is_leftover(item) for item in path.iterdir()):
        raise FileExistsError(f"{path}: exists and is no evaluation; choose another folder")


def _file_name(frame: str) -> str:
    """Return the name of a frame's record: a digest stands for what is too long for a disk with this suffix."""
    name = f"{frame}.json"
    if len(os.fsencode(name)) > _LONGEST_NAME:
        name = f"{hashlib.sha256(os.fsencode(frame)).hexdigest()}.json"
    return name


def _changes_since(file: Path, identity: EvaluationIdentity) -> list[str]:
    """Return what differs from the identity in a file."""
    earlier = _read(EvaluationIdentity, file)
    return [f"{file.name}, which another version wrote"] if earlier is None else identity.changes_since(earlier)


def _read(kind: type[Record], path: Path) -> Record | None:
    try:
        return from_json(kind, path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


@dataclass(frozen=True, slots=True)
class Resumption:
    """Frames that an earlier run had finished: those that were kept, and those whose files have changed since."""

    n_kept: int
    n_changed: int


@dataclass(frozen=True, slots=True)
class _PendingFrames:
    """The frames of a set that are still to do, by name, with what identifies their files."""

    set: NamedSet
    digests: dict[str, str]
    n_changed: int


def evaluate_frames(
    sets: Sequence[NamedSet],
    setup: Setup,
    folder: EvaluationFolder,
    *,
    unknown: str = "",
    jobs: int = 1,
    cluster: str | None = None,
) -> Resumption:
    """Evaluate all frames that have no record yet, or one of other files or of an error.

    Parameters
    ----------
    sets : sequence of NamedSet
        The frames.
    setup : Setup
        What is done with each.
    folder : EvaluationFolder
        Where the results go.
    unknown : str
        The rule for unknown pixels; empty for that of each set.
    jobs : int
        Number of processes; see `parallel.run_tasks`. Only this process writes.
    cluster : str, optional
        Address of a Dask scheduler to use in their place.

    Raises
    ------
    OSError, RuntimeError
        If the output cannot be written, or the tasks not be run.
    """
    pending = [_pending_frames(item, folder) for item in sets]
    n_frames = sum(len(item.frames.names) for item in sets)
    n_kept = n_frames - sum(len(item.digests) for item in pending)
    outcomes = run_tasks(evaluate_frame, _tasks(pending, setup, unknown), jobs=jobs, cluster=cluster)
    for outcome in tqdm(outcomes, total=n_frames, initial=n_kept, unit="frame", disable=None):
        if isinstance(outcome, TaskFailure):
            raise RuntimeError(outcome.message)
        folder.write(outcome)
    return Resumption(n_kept, sum(item.n_changed for item in pending))


def _pending_frames(item: NamedSet, folder: EvaluationFolder) -> _PendingFrames:
    digests, n_changed = {}, 0
    for name in item.frames.names:
        identity = files_digest(item.frames.files(name))
        record = folder.record(item.name, name)
        if record is None or record.error or record.files_digest != identity or folder.times(item.name, name) is None:
            digests[name] = identity
            n_changed += record is not None and not record.error and record.files_digest != identity
    return _PendingFrames(item, digests, n_changed)


def _tasks(pending: Sequence[_PendingFrames], setup: Setup, unknown: str) -> Iterator[FrameTask]:
    for frames in pending:
        labelled, digests = frames.set.frames, frames.digests
        for item in labelled.items(digests) if digests else ():
            yield FrameTask(frames.set.name, item, unknown or labelled.unknown_rule, digests[item.name], setup)
