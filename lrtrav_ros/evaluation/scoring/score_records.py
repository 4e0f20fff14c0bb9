"""Findings of an evaluation, as plain values that go to JSON and back.

`FrameRecord` and `FrameTimes` are what one frame gives, `Summary` is what all of them come to. Measured times stand
apart from scores: those are the same in every run, these are not.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import lru_cache
from types import UnionType
from typing import TYPE_CHECKING, Any, TypeVar, cast, get_args, get_origin, get_type_hints

from lrtrav_ros.config import Value
from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.scoring.obstacles import ObstacleScores
from lrtrav_ros.evaluation.scoring.reliability import ConfidenceBin
from lrtrav_ros.evaluation.scoring.scores import Counts, Scores
from lrtrav_ros.io.csv_cells import printable

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, slots=True)
class MethodRecord:
    """Scores of one method on one frame.

    Attributes
    ----------
    method : str
        Its name.
    scores : Scores
        Means over the seeds, for a method that is run with several.
    pixels : Counts
        Pixel counts that they come from, summed over the seeds.
    obstacles : ObstacleScores
        Standing obstacles, and those of them that are missed.
    spread : Scores or None
        Standard deviations over the seeds; None for a method that has one result.
    bands : tuple of Counts
        Pixel counts of each of `scores.DISTANCE_BANDS`; empty where no ground line gives distances.
    reliability : tuple of ConfidenceBin
        Pixels in each of `reliability.CONFIDENCE_BINS`, summed over the seeds; empty for a method without confidence.
    reach_m, gain_m : float or None
        How far ahead the mask reaches, and how much farther than the short range of the same preset; None where no
        ground line gives distances.
    problem : str
        What gave up, such as ``no ground line found``; the mask is scored all the same.
    seeds : tuple of Scores
        The scores of each seed; those of `scores` alone for a method that has one result.
    """

    method: str
    scores: Scores
    pixels: Counts
    obstacles: ObstacleScores
    spread: Scores | None = None
    bands: tuple[Counts, ...] = ()
    reliability: tuple[ConfidenceBin, ...] = ()
    reach_m: float | None = None
    gain_m: float | None = None
    problem: str = ""
    seeds: tuple[Scores, ...] = ()


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """Scores of all methods on one frame.

    Attributes
    ----------
    set, frame : str
        Names of the set and of the frame.
    methods : tuple of MethodRecord
        Empty where the frame could not be used.
    error : str
        Why it could not; empty where it could.
    files_digest : str
        A digest of the files that the frame was read from, by which a change of them is noticed.
    """

    set: str
    frame: str
    methods: tuple[MethodRecord, ...]
    error: str = ""
    files_digest: str = ""


@dataclass(frozen=True, slots=True)
class MethodTimes:
    """Time of each stage of a method on a frame; a stage that methods share counts for each of them."""

    method: str
    stages: StageTimes


@dataclass(frozen=True, slots=True)
class FrameTimes:
    """The times of all methods on one frame."""

    set: str
    frame: str
    methods: tuple[MethodTimes, ...]


@dataclass(frozen=True, slots=True)
class PaperScores:
    """Scores that the paper reports for a set or for the mean of its sets; None where it does not say."""

    rmse: float
    precision: float | None = None
    recall: float | None = None


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row of the table: one method on one set, or the means over the sets.

    Attributes
    ----------
    set : str
        Name of the set; `MEAN` for the means over the sets.
    method : str
        Name of the method.
    n_frames : int
        Frames that were scored.
    scores : Scores
        Means over the frames.
    spread : Scores or None
        Standard deviations of those means over the seeds; None for a method that has one result.
    bands : tuple of (Scores or None)
        Scores in each of `scores.DISTANCE_BANDS`, all frames' pixels taken together; None for a band without pixels.
    obstacles : ObstacleScores
        The standing obstacles of all frames.
    reliability : tuple of ConfidenceBin
        The pixels of all frames in each of `reliability.CONFIDENCE_BINS`; empty for a method without confidence.
    calibration_error : float or None
        Expected calibration error of the confidence; None for a method without.
    flicker : float or None
        Mean share of the pixels whose label changes from a frame to the next, in the order of their names; None where
        there are no two frames, or masks are not kept. It says something about consecutive frames of one camera only.
    reach_m, gain_m : float or None
        Means over the frames that have them; None where none has.
    gave_up : tuple of str
        Names of the frames where a stage gave up, SET/FRAME in the means.
    paper : PaperScores or None
        The paper's own row.
    """

    set: str
    method: str
    n_frames: int
    scores: Scores
    spread: Scores | None
    bands: tuple[Scores | None, ...]
    obstacles: ObstacleScores
    reliability: tuple[ConfidenceBin, ...]
    calibration_error: float | None
    flicker: float | None
    reach_m: float | None
    gain_m: float | None
    gave_up: tuple[str, ...]
    paper: PaperScores | None = None


MEAN = "mean"
"""Stands in place of a set's name in the means over the sets."""


@dataclass(frozen=True, slots=True)
class FailedFrame:
    """A frame that could not be used, and why."""

    frame: str
    error: str


@dataclass(frozen=True, slots=True)
class SetSummary:
    """A set, and which of its frames could be scored.

    Attributes
    ----------
    name, path : str
        Its name in the results, and where it lies.
    n_frames : int
        Its frames with truth.
    errors : tuple of FailedFrame
        Those of them that could not be used.
    n_without_truth : int
        Frames beside them that have no truth.
    unknown : str
        What unknown pixels of the truth count as; one of `labels.UNKNOWN_RULES`.
    """

    name: str
    path: str
    n_frames: int
    errors: tuple[FailedFrame, ...]
    n_without_truth: int
    unknown: str


@dataclass(frozen=True, slots=True)
class MethodSummary:
    """A method: what it is, and its effective configuration by full parameter names."""

    name: str
    description: str
    configuration: dict[str, Value]


@dataclass(frozen=True, slots=True)
class Summary:
    """Results of an evaluation: methods x sets.

    Attributes
    ----------
    sets : tuple of SetSummary
        The sets.
    methods : tuple of MethodSummary
        The methods.
    results : tuple of TableRow
        One for each set and method, in the order of sets, then methods.
    means : tuple of TableRow
        One for each method: means over the sets, each set with the same weight. The same as `results` for one set.
    seeds : tuple of int
        Seeds of the methods that are run with several.
    """

    sets: tuple[SetSummary, ...]
    methods: tuple[MethodSummary, ...]
    results: tuple[TableRow, ...]
    means: tuple[TableRow, ...]
    seeds: tuple[int, ...]


Record = TypeVar("Record")


def to_json(record: DataclassInstance) -> str:
    """Return a record, a dataclass of this kind, as JSON text: an indented line a value, the same for the same values.

    Parameters
    ----------
    record : dataclass instance
        Of numbers, texts, tuples, dicts by text, and such dataclasses.
    """
    text = json.dumps(dataclasses.asdict(record), indent=1, ensure_ascii=False, allow_nan=False)
    return f"{printable(text)}\n"  # what that escapes is read as it was: JSON has the same escapes


def from_json(kind: type[Record], text: str) -> Record:
    """Return the record that `to_json` wrote.

    Parameters
    ----------
    kind : type
        The dataclass.
    text : str
        The JSON.

    Raises
    ------
    ValueError
        If `text` is no JSON, or not of this `kind`.
    """
    try:
        return cast(Record, _decode(kind, json.loads(text)))
    except (KeyError, TypeError, AttributeError) as err:
        raise ValueError(f"is no {kind.__name__} ({err!r})") from err


@lru_cache(maxsize=32)
def _fields(kind: Any) -> list[tuple[str, Any]]:
    """Return the name and the annotated type of each field of a dataclass."""
    hints = get_type_hints(kind)
    return [(item.name, hints[item.name]) for item in dataclasses.fields(kind)]


def _decode(kind: Any, value: Any) -> Any:
    """Return a value out of JSON as the type that an annotation names."""
    if dataclasses.is_dataclass(kind):
        return cast(Any, kind)(**{name: _decode(hint, value[name]) for name, hint in _fields(cast(Any, kind))})
    if get_origin(kind) is tuple:
        return tuple(_decode(get_args(kind)[0], item) for item in value)
    if get_origin(kind) is dict:
        return {name: _decode(get_args(kind)[1], item) for name, item in value.items()}
    optional = [option for option in get_args(kind) if option is not type(None)]
    if get_origin(kind) is UnionType and len(optional) == 1:
        return None if value is None else _decode(optional[0], value)
    return value
