"""Offline detection: the frames of a recording, one by one or many at a time, into an output folder."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import cv2
from tqdm import tqdm

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.io.bag_frames import UnusableFrame
from lrtrav_ros.io.dataset_folder import FrameFile
from lrtrav_ros.io.recording import RecordedFrame, Recording, open_recording
from lrtrav_ros.io.result_folder import FrameResult, ResultFolder, frame_result, unusable_frame
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
    """

    n_done: int
    n_skipped: int
    n_without_ground: int
    problems: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class DetectionTask:
    """A frame to detect in, and how; `extras` are names out of `result_folder.EXTRAS`."""

    item: RecordedFrame
    config: Config
    extras: tuple[str, ...] = ()


def detect_recording(
    path: Path,
    output: Path,
    config: Config,
    *,
    extras: tuple[str, ...] = (),
    jobs: int = 1,
    cluster: str | None = None,
) -> Outcome:
    """Detect in all frames of a dataset folder or rosbag and write the results; see `result_folder.ResultFolder`.

    Frames that cannot be used are skipped. The files do not depend on `jobs` and `cluster`, for which see
    `parallel.run_tasks`; only this process writes. A bag is read by this process, a folder's frames by those that
    detect in them. A memory (``memory.frames``) is empty when the recording begins.

    Raises
    ------
    OSError, ValueError, RuntimeError
        If the recording cannot be used, the output not be written, or the tasks not be run; and as `check_order`.
    """
    check_order(config, jobs=jobs, cluster=cluster)
    is_here = jobs == 1 and cluster is None
    detect = partial(detect_frame, detector=Detector(config)) if is_here else detect_frame
    with open_recording(path, config.source) as recording, ResultFolder(output, config) as folder:
        tasks = _tasks(recording, config, extras, single_threaded=not is_here)
        results = run_tasks(detect, tasks, jobs=jobs, cluster=cluster)
        n_done = n_without_ground = 0
        skipped = []
        for result in tqdm(results, desc=path.name, total=len(recording), unit="frame", disable=None):
            if isinstance(result, TaskFailure):
                raise RuntimeError(result.message)
            folder.write(result)
            n_done += bool(result.files)
            n_without_ground += bool(result.files and result.problem)
            if not result.files:
                skipped.append(f"{path}: skipped frame {result.name}: {result.problem}")
        problems = tuple(dict.fromkeys([*recording.problems, *skipped]))  # a bag has named its own
        return Outcome(n_done, len(skipped), n_without_ground, problems)


def check_order(config: Config, *, jobs: int, cluster: str | None) -> None:
    """Check that frames are detected in their order where the detector remembers them.

    Parameters
    ----------
    config : Config
        `memory` is used.
    jobs, cluster
        As `detect_recording` takes them.

    Raises
    ------
    ValueError
        If frames would be detected side by side although ``memory.frames`` is not 0.
    """
    if config.memory.frames and (jobs != 1 or cluster is not None):
        raise ValueError(
            f"memory.frames is {config.memory.frames}, so each frame needs those before it: detect in one process, "
            "with --jobs 1 and no --cluster, or set memory.frames to 0"
        )


def _tasks(
    recording: Recording, config: Config, extras: tuple[str, ...], *, single_threaded: bool
) -> Iterator[DetectionTask]:
    if single_threaded and config.threads == 0:
        config = config.updated({"threads": 1})
    for item in recording.items():
        yield DetectionTask(item, config, extras)


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
        return frame_result(frame.name, detection, frame.camera, extras=task.extras)
    except (OSError, ValueError, cv2.error) as err:
        return unusable_frame(item.name, " ".join(str(err).split()))


@lru_cache(maxsize=8)
def _detector(config: Config, thread: int) -> Detector:
    """Return a thread's own detector: matchers keep state."""
    return Detector(config)
