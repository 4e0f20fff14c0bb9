"""The galleries of the report: best, median and worst frames, and those where most of the obstacles is called free."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from lrtrav_ros.evaluation.scoring.frame_evaluation import SeededMethod, Setup
from lrtrav_ros.evaluation.scoring.methods import MethodDetection
from lrtrav_ros.evaluation.scoring.obstacles import StandingObstacles
from lrtrav_ros.evaluation.scoring.score_records import FrameRecord, MethodRecord
from lrtrav_ros.evaluation.scoring.scores import check_same_size
from lrtrav_ros.evaluation.scoring.shared_stages import SharedStages
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame, LabelledItem
from lrtrav_ros.evaluation.truth.labels import NOT_TRAVERSABLE, apply_unknown_rule
from lrtrav_ros.evaluation.truth.opening import NamedSet
from lrtrav_ros.io import pictures
from lrtrav_ros.numerics.checks import check_array, check_image, check_type
from lrtrav_ros.offline.parallel import TaskFailure, run_tasks

CALLED_FREE = "obstacle pixels called free"
"""The rank of the frames that have most of them, and the title of the picture that marks them."""

_WIDTH_PX = 560
_QUALITY = 80
_N_CALLED_FREE = 3
_FALSE_COLOUR = (0, 94, 213)
_SEEN_COLOUR = (0, 230, 255)

_Value = TypeVar("_Value", np.uint8, np.float32)


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
    rank : str
        ``best``, ``median`` or ``worst`` frame of the method by RMSE; or `CALLED_FREE`.
    set, frame : str
        Names of the set and of the frame.
    record : MethodRecord
        The method's scores on it.
    pictures : tuple of Picture
        Image, truth, short range, superpixels, clusters, long range and errors, as far as the method has them; of
        `CALLED_FREE` the image, short range, and obstacle pixels that are called free. Of a method with several seeds,
        those of the first. Empty where the frame could not be read again.
    """

    rank: str
    set: str
    frame: str
    record: MethodRecord
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, slots=True)
class GalleryTask:
    """A frame of a set of which pictures are made, for some methods."""

    set: str
    item: LabelledItem
    unknown_rule: str
    methods: tuple[SeededMethod, ...]


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
    sets : sequence of NamedSet
        The frames.
    setup : Setup
        The methods.
    records : sequence of FrameRecord
        By which the frames are chosen.
    unknown : str
        The rule for unknown pixels; empty for that of each set.
    jobs : int
        Number of processes; see `parallel.run_tasks`.
    cluster : str, optional
        Address of a Dask scheduler to use in their place.

    Raises
    ------
    OSError, RuntimeError
        If a set cannot be read, or the tasks not be run.
    """
    chosen = [
        item
        for seeded in setup.methods
        for choose in (choose_exhibits, choose_called_free)
        for item in choose(records, seeded.method.name)
    ]
    tasks = _tasks(sets, setup, chosen, unknown)
    made: dict[tuple[str, str, str], tuple[Picture, ...]] = {}
    results = run_tasks(make_pictures, tasks, jobs=jobs, cluster=cluster)
    progress = tqdm(results, desc="pictures", total=len(tasks), unit="frame", disable=None)
    for task, result in zip(tasks, progress, strict=True):
        if not isinstance(result, TaskFailure):
            for seeded, of_method in zip(task.methods, result, strict=True):
                made[task.set, task.item.name, seeded.method.name] = of_method
    return [
        dataclasses.replace(item, pictures=_shown(item, made.get((item.set, item.frame, item.record.method), ())))
        for item in chosen
    ]


def _shown(item: Exhibit, made: Sequence[Picture]) -> tuple[Picture, ...]:
    """Return the pictures of a frame that its exhibit shows."""
    if item.rank == CALLED_FREE:
        return tuple(picture for picture in made if picture.title in ("image", "short range", CALLED_FREE))
    return tuple(picture for picture in made if picture.title != CALLED_FREE)


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


def choose_called_free(records: Iterable[FrameRecord], method: str) -> Iterator[Exhibit]:
    """Yield the frames on which a method calls most obstacle pixels free, without pictures; none where there are none.

    Obstacle pixels are all that the truth says are not traversable.
    """
    of_method = [(frame, item) for frame in records for item in frame.methods if item.method == method]
    ordered = sorted(of_method, key=lambda pair: -pair[1].pixels.n_false_positives)
    for frame, record in ordered[:_N_CALLED_FREE]:
        if record.pixels.n_false_positives:
            yield Exhibit(CALLED_FREE, frame.set, frame.frame, record)


def _tasks(sets: Sequence[NamedSet], setup: Setup, chosen: Sequence[Exhibit], unknown: str) -> list[GalleryTask]:
    """Return a task for each frame that is needed."""
    tasks = []
    for labelled in sets:
        wanted: dict[str, set[str]] = {}
        for exhibit in chosen:
            if exhibit.set == labelled.name:
                wanted.setdefault(exhibit.frame, set()).add(exhibit.record.method)
        for item in labelled.frames.items(wanted) if wanted else ():
            methods = tuple(seeded for seeded in setup.methods if seeded.method.name in wanted[item.name])
            tasks.append(GalleryTask(labelled.name, item, unknown or labelled.frames.unknown_rule, methods))
    return tasks


def make_pictures(task: GalleryTask) -> list[tuple[Picture, ...]]:
    """Return the pictures of a frame, for each method of the task.

    Raises
    ------
    OSError, ValueError
        If the frame cannot be used.
    """
    try:
        labelled, stages = task.item.read(), SharedStages()
        obstacles = StandingObstacles(labelled.truth)
        labelled = LabelledFrame(labelled.frame, apply_unknown_rule(labelled.truth, task.unknown_rule))
        detections = (seeded.method.find(labelled.frame, seeded.configs[0], stages.runner()) for seeded in task.methods)
        return [tuple(_pictures(labelled, obstacles, detection)) for detection in detections]
    except cv2.error as err:
        raise ValueError(" ".join(str(err).split())) from err


def _pictures(labelled: LabelledFrame, obstacles: StandingObstacles, detection: MethodDetection) -> Iterator[Picture]:
    image, short = labelled.frame.image, detection.short_range.occupancy
    yield _picture("image", pictures.colour_image(image))
    yield _picture("truth", pictures.truth_picture(image, labelled.truth))
    yield _picture("short range", pictures.overlay(image, short, short))
    if detection.long_range is not None:
        yield _picture("superpixels", pictures.superpixel_picture(image, detection.long_range.superpixels))
        yield _picture("clusters", pictures.label_picture(detection.long_range.clusters))
        yield _picture("long range", pictures.overlay(image, short, detection.occupancy))
    yield _picture("errors", pictures.error_picture(image, detection.mask, labelled.truth))
    yield _picture(CALLED_FREE, called_free_picture(image, detection.mask, labelled.truth, obstacles))


def called_free_picture(
    image: NDArray[np.uint8], mask: NDArray[np.uint8], truth: NDArray[np.uint8], obstacles: StandingObstacles
) -> NDArray[np.uint8]:
    """Return the image, darker and as wide as it is shown, with every obstacle pixel that is called free.

    Those are vermilion, and a pixel of the picture is where any that it stands for is. Standing obstacles are outlined,
    in vermilion where they are missed, else in yellow.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        Left image, BGR or grey.
    mask : (H, W) ndarray of uint8
        255 traversable, 0 not.
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 ignored.
    obstacles : StandingObstacles
        Those of the frame.

    Returns
    -------
    (h, w, 3) ndarray of uint8
        BGR.

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above, or two images differ in size.
    """
    check_image("image", image)
    check_same_size(truth, mask=mask)
    check_array("ground truth", truth, np.uint8, image.shape[:2])
    check_type("obstacles", obstacles, StandingObstacles)
    called_free = ((mask > 127) & (truth == NOT_TRAVERSABLE)).astype(np.float32)
    picture = _at_most_as_wide_as_shown(pictures.colour_image(image)) // 2
    scale = picture.shape[1] / image.shape[1]
    for outline, missed in zip(obstacles.outlines(), obstacles.missed(mask), strict=True):
        points = np.rint((outline + 0.5) * scale - 0.5).astype(np.int32)
        cv2.polylines(picture, [points], True, _FALSE_COLOUR if missed else _SEEN_COLOUR, 1)
    picture[_at_most_as_wide_as_shown(called_free) > 0] = _FALSE_COLOUR
    return picture


def _at_most_as_wide_as_shown(image: NDArray[_Value]) -> NDArray[_Value]:
    height, width = image.shape[:2]
    if width <= _WIDTH_PX:
        return image
    return cv2.resize(image, (_WIDTH_PX, max(round(height * _WIDTH_PX / width), 1)), interpolation=cv2.INTER_AREA)


def _picture(title: str, image: NDArray[np.uint8]) -> Picture:
    image = _at_most_as_wide_as_shown(image)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
    return Picture(title, data, image.shape[1], image.shape[0])
