"""Offline detection: the frames of a recording, one by one or many at a time, into an output folder."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import cv2
from tqdm import tqdm

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.io.bag_frames import StereoBag, UnusableFrame
from lrtrav_ros.io.dataset_folder import FrameFile
from lrtrav_ros.io.output_bag import OutputBag
from lrtrav_ros.io.output_messages import OutputLayout, frame_outputs
from lrtrav_ros.io.problems import Problems
from lrtrav_ros.io.recording import RecordedFrame, Recording, is_damaged, open_recording
from lrtrav_ros.io.result_folder import FrameResult, ResultFolder, frame_result, unusable_frame
from lrtrav_ros.io.run_journal import FinishedFrame, JournalPart
from lrtrav_ros.offline.parallel import TaskFailure, run_tasks


@dataclass(frozen=True, slots=True)
class Outcome:
    """Counts and problems of a detection in the frames of a recording.

    Attributes
    ----------
    n_done : int
        Frames that were written.
    n_skipped : int
        Frames that could not be used.
    n_without_ground : int
        Frames among those written in which no ground line was found.
    problems : tuple of str
        One line for all that could not be used, with the reason.
    n_kept : int
        Frames among all these that were finished before.
    is_damaged : bool
        Whether something of a rosbag is damaged or lost.
    """

    n_done: int
    n_skipped: int
    n_without_ground: int
    problems: tuple[str, ...]
    n_kept: int = 0
    is_damaged: bool = False


@dataclass(frozen=True, slots=True)
class DetectionTask:
    """A frame to detect in, and how.

    `extras` are names out of `result_folder.EXTRAS`; with `layout`, the result holds messages too.
    """

    item: RecordedFrame
    config: Config
    extras: tuple[str, ...] = ()
    layout: OutputLayout | None = None


def detect_recording(
    path: Path,
    output: Path,
    config: Config,
    *,
    extras: tuple[str, ...] = (),
    output_bag: Path | None = None,
    topics: Mapping[str, str] | None = None,
    jobs: int = 1,
    cluster: str | None = None,
    journal: JournalPart | None = None,
) -> Outcome:
    """Detect in all frames of a dataset folder or rosbag and write the results; see `result_folder.ResultFolder`.

    Frames that cannot be used are skipped. The files do not depend on `jobs` and `cluster`, for which see
    `parallel.run_tasks`; only this process writes. A bag is read by this process, a folder's frames by those that
    detect in them. Memories (``memory.frames``, ``ground.memory_s``) are empty when the recording begins. `output_bag`
    is the MCAP file to make of a bag, see `output_bag.OutputBag`, or to replace, when a frame could be used and all is
    done. `topics` are the bag's for the inputs that are not to be searched for, see `StereoBag`. `journal` notes which
    frames are finished; those that it says were before are not done again, see `can_keep_frames`.

    Raises
    ------
    OSError, ValueError, RuntimeError
        If the recording cannot be used, the output not be written, or the tasks not be run; and as `check_order`.
    """
    check_order(config, jobs=jobs, cluster=cluster)
    is_here = jobs == 1 and cluster is None
    detect = partial(detect_frame, detector=Detector(config)) if is_here else detect_frame
    with ExitStack() as stack:
        recording = stack.enter_context(open_recording(path, config.source, topics=topics))
        folder = stack.enter_context(ResultFolder(output, config, journal=journal))
        bag = None if output_bag is None else stack.enter_context(_output_bag(output_bag, recording))
        layout = None if bag is None else bag.layout
        finished = journal.finished if journal else ()
        tasks = _tasks(_pending(recording, finished), config, extras, layout, single_threaded=not is_here)
        results = run_tasks(detect, tasks, jobs=jobs, cluster=cluster)
        total, n_kept = len(recording), len(finished)
        bar = tqdm(results, desc=path.name, total=total, initial=n_kept, unit="frame", disable=None)
        frames = [*map(_WrittenFrame.finished_before, finished), *_written(bar, folder, bag)]
        if bag is not None and any(frame.is_usable for frame in frames):
            if journal is not None:
                journal.journal.note_bag()
            bag.finish()
        problems = [*recording.problems, *(bag.problems if bag else ())]
        outcome = _outcome(path, frames, problems, n_kept=n_kept)
        return dataclasses.replace(outcome, is_damaged=is_damaged(recording))


def can_keep_frames(config: Config, *, output_bag: Path | None) -> bool:
    """Return whether an interrupted detection goes on where it was, or begins anew.

    It begins anew where frames need those before them, and where messages of all frames are wanted.
    """
    return not config.memories and output_bag is None


@dataclass(frozen=True, slots=True)
class _WrittenFrame:
    """What is counted of a frame: whether it could be used, and its problem."""

    name: str
    is_usable: bool
    problem: str

    @classmethod
    def finished_before(cls, frame: FinishedFrame) -> _WrittenFrame:
        return cls(frame.name, bool(frame.checksums), frame.row.get("problem", ""))


def _output_bag(path: Path, recording: Recording) -> OutputBag:
    if not isinstance(recording, StereoBag):
        raise ValueError(
            f"an output bag ({path}) holds the messages of a bag beside the outputs; give a rosbag as input"
        )
    return OutputBag(path, recording)


def _written(
    results: Iterable[FrameResult | TaskFailure], folder: ResultFolder, bag: OutputBag | None
) -> Iterator[_WrittenFrame]:
    """Write the results of the frames as they come."""
    for result in results:
        if isinstance(result, TaskFailure):
            raise RuntimeError(result.message)
        folder.write(result)
        if bag is not None and result.outputs is not None:
            bag.write(result.outputs)
        yield _WrittenFrame(result.name, bool(result.files), result.problem)


def _outcome(path: Path, frames: Sequence[_WrittenFrame], problems: Sequence[str], *, n_kept: int) -> Outcome:
    """Count the frames."""
    usable = [frame for frame in frames if frame.is_usable]
    skipped = Problems()
    for i, frame in enumerate(frames):
        if not frame.is_usable:
            skipped.add(f"{path}: skipped frame {frame.name}: {frame.problem}", kind=frame.problem, case=i)
    return Outcome(
        n_done=len(usable),
        n_skipped=len(frames) - len(usable),
        n_without_ground=sum(bool(frame.problem) for frame in usable),
        problems=tuple(dict.fromkeys([*problems, *skipped.lines()])),  # a bag has named its own skipped ones
        n_kept=n_kept,
    )


def check_order(config: Config, *, jobs: int, cluster: str | None) -> None:
    """Check that frames are detected in their order where the detector remembers them.

    Parameters
    ----------
    config : Config
        Its `memories` are used.
    jobs, cluster
        As `detect_recording` takes them.

    Raises
    ------
    ValueError
        If frames would be detected side by side although ``memory.frames`` or ``ground.memory_s`` is not 0.
    """
    if jobs == 1 and cluster is None:
        return
    for name, value in config.memories.items():
        raise ValueError(
            f"{name} is {value}, so each frame needs those before it: detect in one process, with --jobs 1 and no "
            f"--cluster, or set {name} to 0"
        )


def _pending(recording: Recording, finished: Sequence[FinishedFrame]) -> Iterator[RecordedFrame]:
    """Yield the frames after those that were finished before."""
    items = recording.items()
    for frame in finished:
        item = next(items, None)
        if item is None or item.name != frame.name:
            raise RuntimeError(f"frame {frame.name} was finished before, but is not there any more; give --overwrite")
    yield from items


def _tasks(
    items: Iterable[RecordedFrame],
    config: Config,
    extras: tuple[str, ...],
    layout: OutputLayout | None,
    *,
    single_threaded: bool,
) -> Iterator[DetectionTask]:
    if single_threaded and config.threads == 0:
        config = config.updated({"threads": 1})
    for item in items:
        yield DetectionTask(item, config, extras, layout)


def detect_frame(task: DetectionTask, detector: Detector | None = None) -> FrameResult:
    """Return the output of one frame; for one that cannot be used, the reason.

    Parameters
    ----------
    task : DetectionTask
        The frame.
    detector : Detector, optional
        With the task's configuration, where it is to remember the frames before; else one of this thread's own.
    """
    item = task.item
    if isinstance(item, UnusableFrame):
        return unusable_frame(item.name, item.problem)
    try:
        frame = item.read() if isinstance(item, FrameFile) else item
        detector = detector or _detector(task.config, threading.get_ident())
        detection = detector.detect_frame(frame)
        result = frame_result(frame.name, detection, frame.camera, extras=task.extras, maps=task.config.maps)
        if task.layout is None:
            return result
        return dataclasses.replace(result, outputs=frame_outputs(frame, detection, task.config, task.layout))
    except (OSError, ValueError, cv2.error) as err:
        return unusable_frame(item.name, " ".join(str(err).split()))


@lru_cache(maxsize=8)
def _detector(config: Config, thread: int) -> Detector:
    """Return a thread's own detector: matchers keep state."""
    return Detector(config)
