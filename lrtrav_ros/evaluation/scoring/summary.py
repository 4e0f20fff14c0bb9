"""From the records of frames to the table: methods x sets, and the means over the sets."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.evaluation.scoring.flicker import mean_flicker
from lrtrav_ros.evaluation.scoring.frame_evaluation import SeededMethod, Setup
from lrtrav_ros.evaluation.scoring.obstacles import ObstacleScores
from lrtrav_ros.evaluation.scoring.paper_figures import paper_mean, paper_scores
from lrtrav_ros.evaluation.scoring.reliability import ConfidenceBin, calibration_error
from lrtrav_ros.evaluation.scoring.score_records import (
    MEAN,
    FailedFrame,
    FrameRecord,
    MethodRecord,
    MethodSummary,
    SetSummary,
    Summary,
    TableRow,
)
from lrtrav_ros.evaluation.scoring.scores import (
    DISTANCE_BANDS,
    Counts,
    Scores,
    mean_scores,
    spread_of_scores,
    sum_each,
)
from lrtrav_ros.evaluation.truth.opening import NamedSet

_Row = TypeVar("_Row", MethodRecord, TableRow)


MaskReader = Callable[[str, str, str], NDArray[np.uint8] | None]
"""Returns the mask of a set's name, a method's and a frame's; None where there is none."""


def summarise(
    sets: Sequence[NamedSet],
    records: Sequence[FrameRecord],
    setup: Setup,
    unknown: str,
    read_mask: MaskReader,
) -> Summary:
    """Return the table that the records of all frames come to, and what it is of.

    Parameters
    ----------
    sets : sequence of NamedSet
        The sets, in the order of the table.
    records : sequence of FrameRecord
        The records of all of their frames.
    setup : Setup
        The methods.
    unknown : str
        The rule for unknown pixels; empty for that of each set.
    read_mask : MaskReader
        Reads the masks, as far as they are kept, for the flicker.
    """
    methods = [seeded.method.name for seeded in setup.methods]
    results, means = [], []
    for method in methods:
        on_sets = [_MethodOnSet(item.name, method, records, read_mask) for item in sets]
        on_sets = [item for item in on_sets if item.records]
        results += [item.row() for item in on_sets]
        if on_sets:
            means.append(_mean_row(on_sets))
    order = {item.name: i for i, item in enumerate(sets)}
    return Summary(
        sets=tuple(_set_summary(item, records, unknown) for item in sets),
        methods=tuple(map(_method_summary, setup.methods)),
        results=tuple(sorted(results, key=lambda result: order[result.set])),
        means=tuple(means),
        seeds=max(map(_seeds, setup.methods), key=len, default=()),
    )


class _MethodOnSet:
    """The records of one method on one set."""

    def __init__(self, name: str, method: str, records: Sequence[FrameRecord], read_mask: MaskReader) -> None:
        self.set = name
        self.method = method
        of_set = [frame for frame in records if frame.set == name]
        found = [(frame.frame, record) for frame in of_set for record in frame.methods if record.method == method]
        self.frames = [frame for frame, _ in found]
        self.records = [record for _, record in found]
        self.flicker = mean_flicker(None if frame.error else read_mask(name, method, frame.frame) for frame in of_set)

    @property
    def seed_means(self) -> list[Scores]:
        """The means over the frames for each seed."""
        return [mean_scores(scores) for scores in zip(*(record.seeds for record in self.records), strict=True)]

    @property
    def bands(self) -> tuple[Counts, ...]:
        """The pixels of all frames in each band; none where no frame has distances."""
        return sum_each(record.bands for record in self.records)

    @property
    def reliability(self) -> tuple[ConfidenceBin, ...]:
        """The pixels of all frames in each bin; none for a method without confidence."""
        return sum_each(record.reliability for record in self.records)

    @property
    def gave_up(self) -> list[str]:
        """The frames where a stage gave up."""
        return [frame for frame, record in zip(self.frames, self.records, strict=True) if record.problem]

    def row(self) -> TableRow:
        """Return this row of the table."""
        return TableRow(
            set=self.set,
            method=self.method,
            n_frames=len(self.records),
            scores=mean_scores([record.scores for record in self.records]),
            spread=_spread(self.seed_means),
            bands=_band_scores(self.bands),
            obstacles=_sum_of(record.obstacles for record in self.records),
            reliability=self.reliability,
            calibration_error=calibration_error(self.reliability),
            flicker=self.flicker,
            reach_m=_mean_of(self.records, lambda record: record.reach_m),
            gain_m=_mean_of(self.records, lambda record: record.gain_m),
            gave_up=tuple(self.gave_up),
            paper=paper_scores(self.set, self.method),
        )


def _mean_row(sets: Sequence[_MethodOnSet]) -> TableRow:
    """Return the means of a method over the sets; numbers of obstacles and pixels are sums."""
    rows = [item.row() for item in sets]
    reliability = sum_each(item.reliability for item in sets)
    return TableRow(
        set=MEAN,
        method=rows[0].method,
        n_frames=sum(row.n_frames for row in rows),
        scores=mean_scores([row.scores for row in rows]),
        spread=_spread([mean_scores(scores) for scores in zip(*(item.seed_means for item in sets), strict=True)]),
        bands=_band_scores(sum_each(item.bands for item in sets)),
        obstacles=_sum_of(row.obstacles for row in rows),
        reliability=reliability,
        calibration_error=calibration_error(reliability),
        flicker=_mean_of(rows, lambda row: row.flicker),
        reach_m=_mean_of(rows, lambda row: row.reach_m),
        gain_m=_mean_of(rows, lambda row: row.gain_m),
        gave_up=tuple(f"{item.set}/{frame}" for item in sets for frame in item.gave_up),
        paper=paper_mean([row.set for row in rows], rows[0].method),
    )


def _spread(seeds: Sequence[Scores]) -> Scores | None:
    return spread_of_scores(seeds) if len(seeds) > 1 else None


def _band_scores(bands: tuple[Counts, ...]) -> tuple[Scores | None, ...]:
    """Return the scores of each band, None where it has no pixels."""
    return tuple(band.scores if band.n_pixels else None for band in bands) or (None,) * len(DISTANCE_BANDS)


def _sum_of(obstacles: Iterable[ObstacleScores]) -> ObstacleScores:
    return functools.reduce(operator.add, obstacles)


def _mean_of(rows: Sequence[_Row], value: Callable[[_Row], float | None]) -> float | None:
    """Return the mean of a value over the rows that have it; None where none has."""
    values = [number for number in map(value, rows) if number is not None]
    return float(np.mean(values)) if values else None


def _method_summary(seeded: SeededMethod) -> MethodSummary:
    return MethodSummary(seeded.method.name, seeded.method.description, seeded.configs[0].values())


def _seeds(seeded: SeededMethod) -> tuple[int, ...]:
    return tuple(config.clustering.seed for config in seeded.configs)


def _set_summary(item: NamedSet, records: Sequence[FrameRecord], unknown: str) -> SetSummary:
    frames = [record for record in records if record.set == item.name]
    return SetSummary(
        name=item.name,
        path=str(item.frames.path),
        n_frames=len(frames),
        errors=tuple(FailedFrame(record.frame, record.error) for record in frames if record.error),
        n_without_truth=item.frames.n_without_truth,
        unknown=unknown or item.frames.unknown_rule,
    )
