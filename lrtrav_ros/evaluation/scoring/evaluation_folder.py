"""A run over all frames: one record a frame in an output folder, so that an interrupted run goes on where it was.

Scores, masks and what is made of them are the same in every run and for any number of processes; measured times, which
are not, have files of their own.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from lrtrav_ros.evaluation.scoring.frame_evaluation import FrameOutcome, FrameTask, Setup, evaluate_frame
from lrtrav_ros.evaluation.scoring.score_records import (
    FrameRecord,
    FrameTimes,
    Record,
    from_json,
    to_json,
)
from lrtrav_ros.evaluation.truth.opening import NamedSet
from lrtrav_ros.io.encodings import write_bytes
from lrtrav_ros.offline.parallel import TaskError, run_tasks

_FOLDERS = ("records", "times", "masks", "configs")
_FILES = ("scores.csv", "times.csv", "summary.json", "report.html")


class RunFolder:
    """The folder that a run writes to.

    It holds ``run.json`` (what its records belong to), and for each frame ``records/SET/NAME.json``,
    ``times/SET/NAME.json`` and, where they are asked for, ``masks/SET/METHOD/NAME.png``. Every file appears whole or
    not at all.

    Parameters
    ----------
    path
        Folder to make, or that of a run before, whose frames are kept where `identity` is the same, else removed.
    identity
        All that results depend on besides the frames, as text.

    Attributes
    ----------
    was_discarded : bool
        Whether results of another configuration were removed.

    Raises
    ------
    FileExistsError
        If there is something else at `path`.
    """

    def __init__(self, path: Path, identity: str) -> None:
        self.path = path
        file = path / "run.json"
        if path.exists() and not file.is_file() and (not path.is_dir() or any(path.iterdir())):
            raise FileExistsError(f"{path}: exists and is no evaluation; choose another folder")
        self.was_discarded = file.is_file() and file.read_text(encoding="utf-8") != identity
        if self.was_discarded:
            self._discard()
        for leftover in sorted(path.rglob(".*.tmp")):
            leftover.unlink()  # of a process that was killed while it wrote
        write_bytes(file, identity.encode())

    def _discard(self) -> None:
        for folder in _FOLDERS:
            shutil.rmtree(self.path / folder, ignore_errors=True)
        for file in _FILES:
            (self.path / file).unlink(missing_ok=True)

    def record(self, set_name: str, frame: str) -> FrameRecord | None:
        """Return the record of a frame; None where there is none that can be read."""
        return _read(FrameRecord, self.path / "records" / set_name / f"{frame}.json")

    def times(self, set_name: str, frame: str) -> FrameTimes | None:
        """Return the times of a frame; None where there are none that can be read."""
        return _read(FrameTimes, self.path / "times" / set_name / f"{frame}.json")

    def write(self, outcome: FrameOutcome) -> None:
        """Write what is kept of a frame; the record comes last, and tells that the rest is there."""
        record = outcome.record
        file = Path(record.set) / f"{record.frame}.json"
        for mask in outcome.masks:
            write_bytes(self.path / "masks" / record.set / mask.method / f"{record.frame}.png", mask.data)
        write_bytes(self.path / "times" / file, to_json(outcome.times).encode())
        write_bytes(self.path / "records" / file, to_json(record).encode())


def _read(kind: type[Record], path: Path) -> Record | None:
    try:
        return from_json(kind, path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


@dataclass(frozen=True, slots=True)
class _Pending:
    """The frames of a set that are still to do, by name, with what identifies their files."""

    set: NamedSet
    inputs: dict[str, str]


def run_frames(
    sets: Sequence[NamedSet],
    setup: Setup,
    folder: RunFolder,
    *,
    unknown: str = "",
    jobs: int = 1,
    cluster: str | None = None,
) -> int:
    """Evaluate all frames that have no record yet, or one of other files or of an error; return how many were kept.

    Parameters
    ----------
    unknown
        The rule for unknown pixels; an empty text for that of each set.
    jobs, cluster
        See `parallel.run_tasks`; only this process writes.

    Raises
    ------
    OSError, RuntimeError
        If the output cannot be written, or the tasks not be run.
    """
    pending = [_pending(item, folder) for item in sets]
    n_frames = sum(len(item.frames.names) for item in sets)
    n_kept = n_frames - sum(len(item.inputs) for item in pending)
    outcomes = run_tasks(evaluate_frame, _tasks(pending, setup, unknown), jobs=jobs, cluster=cluster)
    for outcome in tqdm(outcomes, total=n_frames, initial=n_kept, unit="frame", disable=None):
        if isinstance(outcome, TaskError):
            raise RuntimeError(outcome.message)
        folder.write(outcome)
    return n_kept


def _pending(item: NamedSet, folder: RunFolder) -> _Pending:
    inputs = {}
    for name in item.frames.names:
        identity = _identity_of(item.frames.files(name))
        record = folder.record(item.name, name)
        if record is None or record.error or record.inputs != identity or folder.times(item.name, name) is None:
            inputs[name] = identity
    return _Pending(item, inputs)


def _tasks(pending: Sequence[_Pending], setup: Setup, unknown: str) -> Iterator[FrameTask]:
    for item in pending:
        frames = item.set.frames
        for source in frames.sources(item.inputs) if item.inputs else ():
            yield FrameTask(item.set.name, source, unknown or frames.unknown_rule, item.inputs[source.name], setup)


def _identity_of(files: Sequence[Path]) -> str:
    """Return what tells whether files have changed: a digest of their sizes and times of change."""
    stamps = []
    for file in files:
        if file.exists():
            status = file.stat()
            stamps.append((file.name, status.st_size, status.st_mtime_ns))
    return hashlib.sha256(json.dumps(stamps).encode()).hexdigest()[:16]


def run_identity(setup: Setup, *, unknown: str, reading: str) -> str:
    """Return as text all that results depend on besides the frames; `reading` says how those are read."""
    methods = {run.method.name: [config.values() for config in run.configs] for run in setup.runs}
    identity = {
        "methods": methods,
        "geometry": setup.geometry.values(),
        "unknown": unknown,
        "reading": reading,
        "save_masks": setup.save_masks,
    }
    return json.dumps(identity, indent=1) + "\n"
