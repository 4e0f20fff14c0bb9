"""Results as tables: on the terminal, and as CSV with a row for each frame and method."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Iterable, Iterator, Sequence

from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.scoring.obstacles import HEIGHT_BANDS, ObstacleCounts, ObstacleScores
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
from lrtrav_ros.io.csv_cells import cells

SCORE_TITLES = {
    "precision": "precision",
    "recall": "recall",
    "rmse": "RMSE",
    "false_positive_rate": "false positives",
}
"""The scores and their titles."""

PAPER_SCORES = ("precision", "recall", "rmse")
"""The scores that the paper reports."""

_STAGES = tuple(field.name for field in dataclasses.fields(StageTimes))


def band_name(near: float, far: float) -> str:
    """Return the name of a band of distances or heights, such as ``5-10`` or ``40+``."""
    return f"{near:g}+" if math.isinf(far) else f"{near:g}-{far:g}"


BAND_NAMES = tuple(band_name(*band) for band in DISTANCE_BANDS)
HEIGHT_NAMES = tuple(band_name(*band) for band in HEIGHT_BANDS)
_OBSTACLE_COLUMNS = (
    "",
    *(f"_{band}m" for band in BAND_NAMES),
    *(f"_{band}m_high" for band in HEIGHT_NAMES),
)


def scores_csv(records: Iterable[FrameRecord], methods: Sequence[str]) -> str:
    """Return the scores as CSV: a row for each frame and method.

    A row of a frame that could not be used says why in ``problem``. Empty cells: scores of such a frame, spreads of a
    method with one result, distances without a ground line, scores in a band without pixels, obstacles by height where
    heights are not known. Names and problems that a spreadsheet would take for formulas have an apostrophe before them,
    see `csv_cells.cell_text`; here and in `times_csv`.

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
            *SCORE_TITLES,
            *(f"{name}_std" for name in SCORE_TITLES),
            "reach_m",
            "gain_m",
            *(f"{name}_{band}m" for band in BAND_NAMES for name in SCORE_TITLES),
            *(f"{name}{band}" for band in _OBSTACLE_COLUMNS for name in ("obstacles", "missed_obstacles")),
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
        **_obstacle_cells(record.obstacles),
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
    return {} if scores is None else {column.format(name): f"{getattr(scores, name):.6f}" for name in SCORE_TITLES}


def _obstacle_cells(obstacles: ObstacleScores) -> dict[str, str]:
    cells: dict[str, str] = {}
    for band, counts in zip(_OBSTACLE_COLUMNS, obstacle_bands(obstacles), strict=True):
        if counts is not None:
            cells.update({f"obstacles{band}": str(counts.n_obstacles), f"missed_obstacles{band}": _missed(counts)})
    return cells


def obstacle_bands(obstacles: ObstacleScores) -> tuple[ObstacleCounts | None, ...]:
    """Return the counts of all obstacles, of those in each distance band, and of each height; None where not known."""
    return (
        obstacles.total,
        *(obstacles.by_distance or (None,) * len(DISTANCE_BANDS)),
        *(obstacles.by_height or (None,) * len(HEIGHT_BANDS)),
    )


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
    table.writerows(map(cells, rows))
    return text.getvalue()


def score_table(summary: Summary) -> list[str]:
    """Return the lines of the table of all sets, with the paper's own rows beside them, and of the means."""
    rows = [*summary.results, *(summary.means if len(summary.sets) > 1 else ())]
    with_paper = any(row.paper for row in rows)
    with_spread = any(row.spread for row in rows)
    with_flicker = any(row.flicker is not None for row in rows)
    with_confidence = any(row.reliability for row in rows)
    head = ["set", "method", "frames", *SCORE_TITLES.values(), "missed obstacles", "reach m", "gained m"]
    head += ["flicker"] * with_flicker + ["calibration error"] * with_confidence + ["+- RMSE"] * with_spread
    head += ["the paper: precision, recall, RMSE"] * with_paper + ["gave up"]
    cells = []
    for row in rows:
        line = [
            _set_title(row),
            row.method,
            str(row.n_frames),
            *(_number(getattr(row.scores, name), 4) for name in SCORE_TITLES),
            missed_of(row.obstacles.total),
            _number(row.reach_m, 1),
            _number(row.gain_m, 1),
        ]
        line += [_number(row.flicker, 4)] * with_flicker + [_number(row.calibration_error, 4)] * with_confidence
        line += [_number(row.spread.rmse if row.spread else None, 4)] * with_spread
        line += [_paper(row.paper)] * with_paper + [str(len(row.gave_up) or "")]
        cells.append(line)
    return _aligned(head, cells)


def band_table(summary: Summary) -> list[str]:
    """Return the lines of a table of the scores by distance."""
    rows = _overall(summary)
    cells = [
        [row.method, title, *(_number(getattr(band, name) if band else None, 4) for band in row.bands)]
        for row in rows
        for name, title in SCORE_TITLES.items()
    ]
    return _aligned(["method", "by distance", *(f"{name} m" for name in BAND_NAMES)], cells)


def obstacle_table(summary: Summary) -> list[str]:
    """Return the lines of a table of the obstacles that are missed, by distance and, where it is known, by height."""
    rows = _overall(summary)
    with_height = any(row.obstacles.by_height for row in rows)
    head = ["method", "missed obstacles", "all", *(f"{name} m" for name in BAND_NAMES)]
    head += [f"{name} m high" for name in HEIGHT_NAMES] * with_height
    cells = [[row.method, "", *map(missed_of, obstacle_bands(row.obstacles))][: len(head)] for row in rows]
    return _aligned(head, cells)


def missed_of(counts: ObstacleCounts | None) -> str:
    """Return how many obstacles are missed, such as ``3 of 12``; an empty text where there are none."""
    return f"{_missed(counts)} of {counts.n_obstacles}" if counts is not None and counts.n_obstacles else ""


def _missed(counts: ObstacleCounts) -> str:
    return f"{round(counts.n_missed, 2):g}"


def _overall(summary: Summary) -> tuple[TableRow, ...]:
    """Return a row for each method, of all sets."""
    return summary.means if len(summary.sets) > 1 else summary.results


def _set_title(row: TableRow) -> str:
    return "mean of sets" if row.set == MEAN else row.set


def _paper(paper: PaperScores | None) -> str:
    if paper is None:
        return ""
    return " ".join(_number(getattr(paper, name), 4) or "-" for name in PAPER_SCORES)


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
