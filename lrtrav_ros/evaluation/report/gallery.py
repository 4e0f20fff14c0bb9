"""Pictures of the frames on which a method is best, in the middle and worst, for the report."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from lrtrav_ros.evaluation.scoring.frame_evaluation import MethodRun, Setup
from lrtrav_ros.evaluation.scoring.methods import MethodResult
from lrtrav_ros.evaluation.scoring.score_records import FrameRecord, MethodRecord
from lrtrav_ros.evaluation.scoring.shared_stages import FrameStages
from lrtrav_ros.evaluation.truth.labelled_sets import FrameSource, LabelledFrame
from lrtrav_ros.evaluation.truth.labels import apply_unknown_rule
from lrtrav_ros.evaluation.truth.opening import NamedSet
from lrtrav_ros.io import pictures
from lrtrav_ros.offline.parallel import TaskError, run_tasks

_WIDTH_PX = 560
_QUALITY = 80


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture with its title, as a JPEG file of `width` x `height` pixels."""

    title: str
    data: bytes
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Exhibit:
    """A frame that stands for how well a method does.

    Attributes
    ----------
    rank
        ``best``, ``median`` or ``worst`` frame of the method by RMSE.
    record
        The method's scores on it.
    pictures
        Image, truth, short range, superpixels, clusters, long range and errors, as far as the method has them; of a
        method with several seeds, those of the first. None where the frame could not be read again.
    """

    rank: str
    set: str
    frame: str
    record: MethodRecord
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, slots=True)
class GalleryTask:
    """A frame of which pictures are made for some methods."""

    source: FrameSource
    unknown_rule: str
    runs: tuple[MethodRun, ...]


def make_gallery(
    sets: Sequence[NamedSet],
    setup: Setup,
    records: Sequence[FrameRecord],
    *,
    unknown: str = "",
    jobs: int = 1,
    cluster: str | None = None,
) -> list[Exhibit]:
    """Return the exhibits of all methods, in the order of `setup`.

    Parameters
    ----------
    unknown
        The rule for unknown pixels; an empty text for that of each set.
    jobs, cluster
        See `parallel.run_tasks`.

    Raises
    ------
    OSError, RuntimeError
        If a set cannot be read, or the tasks not be run.
    """
    chosen = [item for run in setup.runs for item in choose_exhibits(records, run.method.name)]
    places, tasks = _tasks(sets, setup, chosen, unknown)
    found: dict[tuple[str, str, str], tuple[Picture, ...]] = {}
    results = run_tasks(make_pictures, tasks, jobs=jobs, cluster=cluster)
    progress = tqdm(results, desc="pictures", total=len(tasks), unit="frame", disable=None)
    for place, task, result in zip(places, tasks, progress, strict=True):
        if not isinstance(result, TaskError):
            found.update({(*place, run.method.name): made for run, made in zip(task.runs, result, strict=True)})
    return [
        dataclasses.replace(item, pictures=found.get((item.set, item.frame, item.record.method), ())) for item in chosen
    ]


def choose_exhibits(records: Iterable[FrameRecord], method: str) -> Iterator[Exhibit]:
    """Yield the best, the median and the worst frame of a method, without pictures; fewer where there are fewer."""
    of_method = [(frame, item) for frame in records for item in frame.methods if item.method == method]
    ordered = sorted(of_method, key=lambda pair: pair[1].scores.rmse)
    places = {"best": 0, "worst": len(ordered) - 1, "median": (len(ordered) - 1) // 2}
    taken = set()
    for rank in ("best", "worst", "median"):
        if ordered and places[rank] not in taken:
            taken.add(places[rank])
        else:
            del places[rank]
    for rank in sorted(places, key=places.__getitem__):
        frame, record = ordered[places[rank]]
        yield Exhibit(rank, frame.set, frame.frame, record)


def _tasks(
    sets: Sequence[NamedSet], setup: Setup, chosen: Sequence[Exhibit], unknown: str
) -> tuple[list[tuple[str, str]], list[GalleryTask]]:
    """Return each frame that is needed, by set and name, and what is to be made of it."""
    places, tasks = [], []
    for item in sets:
        wanted: dict[str, set[str]] = {}
        for exhibit in chosen:
            if exhibit.set == item.name:
                wanted.setdefault(exhibit.frame, set()).add(exhibit.record.method)
        for source in item.frames.sources(wanted) if wanted else ():
            runs = tuple(run for run in setup.runs if run.method.name in wanted[source.name])
            places.append((item.name, source.name))
            tasks.append(GalleryTask(source, unknown or item.frames.unknown_rule, runs))
    return places, tasks


def make_pictures(task: GalleryTask) -> list[tuple[Picture, ...]]:
    """Return the pictures of a frame, for each method of the task; raises OSError or ValueError if it is unusable."""
    labelled = task.source.read()
    labelled = LabelledFrame(labelled.frame, apply_unknown_rule(labelled.truth, task.unknown_rule))
    stages = FrameStages(labelled.frame)
    return [tuple(_pictures(labelled, run.method.find(stages, run.configs[0]))) for run in task.runs]


def _pictures(labelled: LabelledFrame, result: MethodResult) -> Iterator[Picture]:
    left, short = labelled.frame.left, result.short_range.occupancy
    yield _picture("image", pictures.colour_image(left))
    yield _picture("truth", pictures.truth_picture(left, labelled.truth))
    yield _picture("short range", pictures.overlay(left, short, short))
    if result.superpixels is not None and result.clusters is not None:
        yield _picture("superpixels", pictures.superpixel_picture(left, result.superpixels))
        yield _picture("clusters", pictures.label_picture(result.clusters))
        yield _picture("long range", pictures.overlay(left, short, result.occupancy))
    yield _picture("errors", pictures.error_picture(left, result.mask, labelled.truth))


def _picture(title: str, image: NDArray[np.uint8]) -> Picture:
    height, width = image.shape[:2]
    if width > _WIDTH_PX:
        size = (_WIDTH_PX, max(round(height * _WIDTH_PX / width), 1))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
    return Picture(title, data, image.shape[1], image.shape[0])
