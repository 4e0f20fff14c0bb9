"""What an evaluation finds, as plain values that go to JSON and back.

`FrameRecord` and `FrameTimes` are what one frame gives, `Summary` is what all of them come to. Measured times stand
apart from scores: those are the same in every run, these are not.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import lru_cache
from types import UnionType
from typing import Any, TypeVar, cast, get_args, get_origin, get_type_hints

from lrtrav_ros.config import Value
from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.scoring.scores import Counts, Scores


@dataclass(frozen=True, slots=True)
class MethodRecord:
    """What one method gave on one frame.

    Attributes
    ----------
    scores
        Means over the seeds, for a method that is run with several.
    spread
        Standard deviations over the seeds; None for a method that has one result.
    bands
        Pixel counts of each of `scores.DISTANCE_BANDS`; empty where no ground line gives distances.
    reach_m, gain_m
        How far ahead the mask reaches, and how much farther than the short range of the same preset; None where no
        ground line gives distances.
    problem
        What gave up, such as ``no ground line found``; the mask is scored all the same.
    seeds
        The scores of each seed; those of `scores` alone for a method that has one result.
    """

    method: str
    scores: Scores
    spread: Scores | None = None
    bands: tuple[Counts, ...] = ()
    reach_m: float | None = None
    gain_m: float | None = None
    problem: str = ""
    seeds: tuple[Scores, ...] = ()


@dataclass(frozen=True, slots=True)
class FrameRecord:
    """What all methods gave on one frame.

    Attributes
    ----------
    methods
        None where the frame could not be used, and `error` says why.
    inputs
        Tells whether the files that the frame was read from are the same.
    """

    set: str
    frame: str
    methods: tuple[MethodRecord, ...]
    error: str = ""
    inputs: str = ""


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
    """What the paper reports for a set or for the mean of its sets; None where it does not say."""

    rmse: float
    precision: float | None = None
    recall: float | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """A row of the table: one method on one set, or the means over the sets.

    Attributes
    ----------
    set
        Name of the set; `MEAN` for the means over the sets.
    n_frames
        Frames that were scored.
    scores
        Means over the frames.
    spread
        Standard deviations of those means over the seeds; None for a method that has one result.
    bands
        Scores in each of `scores.DISTANCE_BANDS`, all frames' pixels taken together; None for a band without pixels.
    reach_m, gain_m
        Means over the frames that have them; None where none has.
    gave_up
        Names of the frames where a stage gave up, SET/FRAME in the means.
    paper
        The paper's own row.
    """

    set: str
    method: str
    n_frames: int
    scores: Scores
    spread: Scores | None
    bands: tuple[Scores | None, ...]
    reach_m: float | None
    gain_m: float | None
    gave_up: tuple[str, ...]
    paper: PaperScores | None = None


MEAN = "mean"
"""Stands in place of a set's name in the means over the sets."""


@dataclass(frozen=True, slots=True)
class FrameError:
    """A frame that could not be used, and why."""

    frame: str
    error: str


@dataclass(frozen=True, slots=True)
class SetSummary:
    """A set: where it lies, its frames with truth, and those that failed or have no truth.

    Attributes
    ----------
    unknown
        What unknown pixels of the truth count as: ``ignore`` or ``not-traversable``.
    """

    name: str
    path: str
    n_frames: int
    errors: tuple[FrameError, ...]
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
    """What an evaluation comes to.

    Attributes
    ----------
    results
        One for each set and method, in the order of sets, then methods.
    means
        One for each method: means over the sets, each set with the same weight. The same as `results` for one set.
    seeds
        Seeds of the methods that are run with several.
    """

    sets: tuple[SetSummary, ...]
    methods: tuple[MethodSummary, ...]
    results: tuple[Result, ...]
    means: tuple[Result, ...]
    seeds: tuple[int, ...]


Record = TypeVar("Record", FrameRecord, FrameTimes, Summary)


def to_json(record: FrameRecord | FrameTimes | Summary) -> str:
    """Return a record as JSON text, one indented line a value, the same text for the same values."""
    return json.dumps(dataclasses.asdict(record), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def from_json(kind: type[Record], text: str) -> Record:
    """Return what `to_json` wrote.

    Raises
    ------
    ValueError
        If `text` is no JSON, or not of this `kind`.
    """
    try:
        return cast(Record, _decoded(kind, json.loads(text)))
    except (KeyError, TypeError, AttributeError) as err:
        raise ValueError(f"is no {kind.__name__} ({err!r})") from err


@lru_cache(maxsize=32)
def _fields(kind: Any) -> list[tuple[str, Any]]:
    """Return the name and the annotated type of each field of a dataclass."""
    hints = get_type_hints(kind)
    return [(item.name, hints[item.name]) for item in dataclasses.fields(kind)]


def _decoded(kind: Any, value: Any) -> Any:
    """Return a value out of JSON as the type that an annotation names."""
    if dataclasses.is_dataclass(kind):
        return cast(Any, kind)(**{name: _decoded(hint, value[name]) for name, hint in _fields(cast(Any, kind))})
    if get_origin(kind) is tuple:
        return tuple(_decoded(get_args(kind)[0], item) for item in value)
    optional = [option for option in get_args(kind) if option is not type(None)]
    if get_origin(kind) is UnionType and len(optional) == 1:
        return None if value is None else _decoded(optional[0], value)
    return value
