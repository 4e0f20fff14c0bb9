"""Results as tables: on the terminal, and as CSV with a row for each frame and method."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Iterable, Iterator, Sequence

from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.scoring.score_records import (
    MEAN,
    FrameRecord,
    FrameTimes,
    MethodRecord,
    PaperScores,
    Summary,
    TableRow,
)
from lrtrav_ros.evaluation.scoring.scores import DISTANCE_BANDS, Counts, Scores

_SCORES = ("precision", "recall", "rmse")
_STAGES = tuple(field.name for field in dataclasses.fields(StageTimes))


def band_name(near: float, far: float) -> str:
    """Return the name of a distance band, such as ``5-10`` or ``40+``."""
    return f"{near:g}+" if math.isinf(far) else f"{near:g}-{far:g}"


BAND_NAMES = tuple(band_name(*band) for band in DISTANCE_BANDS)


def scores_csv(records: Iterable[FrameRecord], methods: Sequence[str]) -> str:
    """Return the scores as CSV: a row for each frame and method.

    A row of a frame that could not be used says why in ``problem``. Empty cells: scores of such a frame, spreads of a
    method with one result, distances without a ground line, scores in a band without pixels.

    Parameters
    ----------
    records : iterable of FrameRecord
        The frames, in the order of the rows.
    methods : sequence of str
        Names of all methods.
    """
    return _csv(
        [
            "set",
            "frame",
            "method",
            *_SCORES,
            *(f"{name}_std" for name in _SCORES),
            "reach_m",
            "gain_m",
            *(f"{name}_{band}m" for band in BAND_NAMES for name in _SCORES),
            "problem",
        ],
        (row for record in records for row in _score_rows(record, methods)),
    )


def _score_rows(frame: FrameRecord, methods: Sequence[str]) -> Iterator[dict[str, str]]:
    place = {"set": frame.set, "frame": frame.frame}
    if frame.error:
        yield from ({**place, "method": method, "problem": frame.error} for method in methods)
    for record in frame.methods:
        yield {**place, "method": record.method, **_score_cells(record)}


def _score_cells(record: MethodRecord) -> dict[str, str]:
    cells = {
        **_cells(record.scores, "{}"),
        **_cells(record.spread, "{}_std"),
        "reach_m": _number(record.reach_m, 2),
        "gain_m": _number(record.gain_m, 2),
        "problem": record.problem,
    }
    for band, counts in zip(BAND_NAMES, record.bands, strict=False):
        cells.update(_cells(_band_scores(counts), f"{{}}_{band}m"))
    return cells


def _band_scores(counts: Counts) -> Scores | None:
    return counts.scores if counts.n_pixels else None


def _cells(scores: Scores | None, column: str) -> dict[str, str]:
    return {} if scores is None else {column.format(name): f"{getattr(scores, name):.6f}" for name in _SCORES}


def times_csv(times: Iterable[FrameTimes]) -> str:
    """Return the times as CSV: a row with the milliseconds of each stage for each frame and method.

    Parameters
    ----------
    times : iterable of FrameTimes
        The frames, in the order of the rows.
    """
    return _csv(
        ["set", "frame", "method", *_STAGES],
        (
            {
                "set": frame.set,
                "frame": frame.frame,
                "method": item.method,
                **{stage: f"{getattr(item.stages, stage):.2f}" for stage in _STAGES},
            }
            for frame in times
            for item in frame.methods
        ),
    )


def _csv(columns: Sequence[str], rows: Iterable[dict[str, str]]) -> str:
    text = io.StringIO()
    table = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def score_table(summary: Summary) -> list[str]:
    """Return the lines of the table of all sets, with the paper's own rows beside them, and of the means."""
    rows = [*summary.results, *(summary.means if len(summary.sets) > 1 else ())]
    with_paper = any(row.paper for row in rows)
    with_spread = any(row.spread for row in rows)
    head = ["set", "method", "frames", "precision", "recall", "RMSE", "reach m", "gained m"]
    head += ["+- RMSE"] * with_spread + ["the paper: precision, recall, RMSE"] * with_paper + ["gave up"]
    cells = []
    for row in rows:
        scores = [_number(getattr(row.scores, name), 4) for name in _SCORES]
        line = [
            _set_title(row),
            row.method,
            str(row.n_frames),
            *scores,
            _number(row.reach_m, 1),
            _number(row.gain_m, 1),
        ]
        line += [_number(row.spread.rmse if row.spread else None, 4)] * with_spread
        line += [_paper(row.paper)] * with_paper + [str(len(row.gave_up) or "")]
        cells.append(line)
    return _aligned(head, cells)


def band_table(summary: Summary) -> list[str]:
    """Return the lines of a table of precision, recall and RMSE by distance."""
    rows = summary.means if len(summary.sets) > 1 else summary.results
    cells = [
        [row.method, title, *(_number(getattr(band, name) if band else None, 4) for band in row.bands)]
        for row in rows
        for name, title in zip(_SCORES, ("precision", "recall", "RMSE"), strict=True)
    ]
    return _aligned(["method", "by distance", *(f"{name} m" for name in BAND_NAMES)], cells)


def _set_title(row: TableRow) -> str:
    return "mean of sets" if row.set == MEAN else row.set


def _paper(paper: PaperScores | None) -> str:
    if paper is None:
        return ""
    return " ".join(_number(getattr(paper, name), 4) or "-" for name in _SCORES)


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _aligned(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return lines with columns of equal width, names to the left and numbers to the right."""
    widths = [max(len(cell) for cell in column) for column in zip(head, *rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i < 2 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in (head, *rows)
    ]
