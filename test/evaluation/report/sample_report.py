"""Sample results for the tests of the report, and the page that is made of them."""

from __future__ import annotations

import dataclasses
from html.parser import HTMLParser

from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.report.html_report import report_html
from lrtrav_ros.evaluation.scoring.obstacles import ObstacleCounts, ObstacleScores
from lrtrav_ros.evaluation.scoring.reliability import ConfidenceBin
from lrtrav_ros.evaluation.scoring.score_records import (
    MEAN,
    FrameRecord,
    FrameTimes,
    MethodRecord,
    MethodSummary,
    MethodTimes,
    SetSummary,
    Summary,
    TableRow,
)
from lrtrav_ros.evaluation.scoring.scores import Counts, Scores

METHODS = ("uv_disparity", "robust")
SETS = ("DS1A", "DS2B")
VOID = {"meta", "img", "input", "br", "path", "rect"}


class Page(HTMLParser):
    """A page as its parser sees it; raises where tags are not closed in order."""

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.tags = []
        self.texts = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append((self.open[-1] if self.open else "", data))

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]

    def text_of(self, tag):
        return [text for name, text in self.texts if name == tag]

    @property
    def text(self):
        return " ".join(text for name, text in self.texts if name not in ("style", "script"))


def scores(i):
    return Scores(
        precision=0.9 + i / 1000, recall=0.8 + i / 1000, rmse=0.3 - i / 1000, false_positive_rate=0.04 - i / 1000
    )


def obstacles(i, *, with_height=False):
    """Seven obstacles, `i` of them missed, all of them low and 5 to 10 m away."""
    none, all_of_them = ObstacleCounts(), ObstacleCounts(7, i)
    heights = (all_of_them, none, none, none) if with_height else ()
    return ObstacleScores(all_of_them, (none, all_of_them, none, none, none), heights)


def reliability(share_right):
    """A hundred pixels of the lowest confidence and two hundred of the highest, of which a share is right."""
    none = ConfidenceBin(0, 0, 0)
    low, high = ConfidenceBin(100, 50, 100 * 128), ConfidenceBin(200, round(200 * share_right), 200 * 250)
    return (low, *(none,) * 8, high)


def method_record(name, i, **values):
    record = MethodRecord(name, scores(i), Counts(1000, 500, 500, 480 - i), obstacles(i), seeds=(scores(i),))
    return dataclasses.replace(record, **values)


def table_row(set_name, method, i, **values):
    row = TableRow(
        set=set_name,
        method=method,
        n_frames=3,
        scores=scores(i),
        spread=None,
        bands=(None, scores(1), scores(2), scores(3), None),
        obstacles=obstacles(i),
        reliability=(),
        calibration_error=None,
        flicker=None,
        reach_m=12.34,
        gain_m=5.67,
        gave_up=(),
    )
    return dataclasses.replace(row, **values)


def make_summary(methods=METHODS, sets=SETS, **values):
    summary = Summary(
        sets=tuple(SetSummary(name, f"/data/{name}", 3, (), 0, "ignore") for name in sets),
        methods=tuple(
            MethodSummary(name, f"what {name} is", {"clustering.k": i, "threads": 1}) for i, name in enumerate(methods)
        ),
        results=tuple(table_row(name, method, i) for name in sets for i, method in enumerate(methods)),
        means=tuple(table_row(MEAN, method, i) for i, method in enumerate(methods)),
        seeds=(0,),
    )
    return dataclasses.replace(summary, **values)


def make_records(methods=METHODS, sets=SETS):
    return [
        FrameRecord(name, f"{i:06}", tuple(method_record(method, i + j) for j, method in enumerate(methods)))
        for name in sets
        for i in range(3)
    ]


def make_times(records):
    return [
        FrameTimes(
            record.set,
            record.frame,
            tuple(
                MethodTimes(item.method, StageTimes(10.0 * (i + 1), 2.0, 3.0, 4.0, 5.0, 6.0)) for item in record.methods
            ),
        )
        for i, record in enumerate(records)
    ]


def make_report(summary=None, records=None, exhibits=()):
    records = make_records() if records is None else records
    return report_html(summary or make_summary(), records, make_times(records), exhibits)
