"""Tests of the report: it is one well-formed page without a network, shows what was found, and escapes every name."""

from __future__ import annotations

import base64
import dataclasses
import html
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from recorded import FAST, frames, write_dataset

from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.report.charts import Bar, Series, line_chart, stacked_bars
from lrtrav_ros.evaluation.report.gallery import Exhibit, Picture, choose_exhibits, make_gallery
from lrtrav_ros.evaluation.report.html_report import report_html, write_report
from lrtrav_ros.evaluation.scoring.frame_evaluation import make_setup
from lrtrav_ros.evaluation.scoring.methods import choose_methods
from lrtrav_ros.evaluation.scoring.score_records import (
    MEAN,
    FrameError,
    FrameRecord,
    FrameTimes,
    MethodRecord,
    MethodSummary,
    MethodTimes,
    PaperScores,
    Result,
    SetSummary,
    Summary,
)
from lrtrav_ros.evaluation.scoring.scores import Scores
from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_sets
from lrtrav_ros.io import pictures

METHODS = ("uv_disparity", "robust")
SETS = ("DS1A", "DS2B")
VOID = {"meta", "img", "input", "br", "path", "rect"}
SETTINGS = dict(option.split("=") for option in FAST if "=" in option)


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
    return Scores(precision=0.9 + i / 1000, recall=0.8 + i / 1000, rmse=0.3 - i / 1000)


def method_record(name, i, **values):
    return MethodRecord(name, scores(i), seeds=(scores(i),), **values)


def result(set_name, method, i, **values):
    row = Result(
        set=set_name,
        method=method,
        n_frames=3,
        scores=scores(i),
        spread=None,
        bands=(None, scores(1), scores(2), scores(3), None),
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
        results=tuple(result(name, method, i) for name in sets for i, method in enumerate(methods)),
        means=tuple(result(MEAN, method, i) for i, method in enumerate(methods)),
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


def exhibit(**values):
    image = Picture("image", b"\xff\xd8not looked at", 40, 30)
    return dataclasses.replace(Exhibit("best", "DS1A", "000001", method_record("robust", 5), (image,)), **values)


def test_page_is_well_formed_and_has_all_parts():
    page = Page(make_report(exhibits=[exhibit()]))
    parts = [attributes["id"] for attributes in page.all("h2")]
    assert parts == ["scores", "distance", "frames", "time", "gallery", "configuration"]
    assert [attributes["href"] for attributes in page.all("a")] == [f"#{part}" for part in parts]
    assert page.all("meta")[1] == {"name": "viewport", "content": "width=device-width, initial-scale=1"}


def test_page_needs_no_network():
    text = make_report(exhibits=[exhibit()])
    page = Page(text)
    assert not re.search(r"https?:|//[a-z]|@import|url\(", text)
    assert not page.all("link")
    assert all(
        attributes["src"].startswith("data:image/jpeg;base64,") for attributes in page.all("img") if attributes["alt"]
    )
    policy = page.all("meta")[2]
    assert policy["http-equiv"] == "Content-Security-Policy"
    assert policy["content"].startswith("default-src 'none'; img-src data:;")


def test_table_has_all_scores_and_the_best_are_marked():
    page = Page(make_report())
    cells = page.text_of("td")
    assert cells.count("0.9000") == 3  # precision of the first method on two sets, and their mean
    assert cells.count("0.2990") >= 3
    best = [attributes for attributes in page.all("td") if "best" in attributes.get("class", "")]
    assert len(best) == 9  # three scores of two sets and the mean
    shares = [attributes["style"] for attributes in page.all("td") if "rmse" in attributes.get("class", "")]
    assert shares == ["--share:100%", "--share:99.7%"] * 3
    assert "mean of the sets" in page.text
    assert cells.count("12.3") == 6
    assert cells.count("5.7") == 6


def test_single_set_has_no_means_of_sets():
    summary = make_summary(sets=("DS1A",))
    assert "mean of the sets" not in Page(make_report(summary, make_records(sets=("DS1A",)))).text


def test_rows_of_the_paper_stand_beside_the_results():
    assert "paper:" not in make_report()
    paper = result("DS1A", "robust", 1, paper=PaperScores(rmse=0.2521))
    page = Page(make_report(make_summary(results=(result("DS1A", "uv_disparity", 0), paper))))
    assert "paper: precision" in page.text_of("th")
    assert page.text_of("td").count("0.2521") == 1


def test_spread_over_seeds_is_shown():
    spread = result("DS1A", "robust", 1, spread=Scores(0.001, 0.002, 0.0034))
    page = Page(make_report(make_summary(results=(spread,), seeds=(0, 1, 2))))
    assert "± RMSE" in page.text_of("th")
    assert "0.0034" in page.text_of("td")
    assert "± is the standard deviation over 3 seeds." in page.text


def test_frames_with_problems_are_named():
    sets = (
        SetSummary("DS1A", "/data", 3, (FrameError("000007", "left/000007.png: no image"),), 2, "ignore"),
        SetSummary("DS2B", "/data", 3, (), 0, "not-traversable"),
    )
    gave_up = result("DS2B", "robust", 1, gave_up=("000002", "000003"))
    summary = dataclasses.replace(make_summary(), sets=sets, results=(gave_up,))
    text = Page(make_report(summary)).text
    assert "DS1A/000007 could not be used: left/000007.png: no image" in text
    assert "DS1A: 2 frames without ground truth" in text
    assert "DS2B, robust: no ground line found in 000002, 000003; scored as found" in text
    assert "Pixels of unknown truth: DS1A: are ignored; DS2B: count as not traversable." in text
    assert "All frames could be used, and no stage gave up." in Page(make_report()).text


def test_curves_have_a_line_for_each_method_and_name_every_frame():
    page = Page(make_report())
    lines = [attributes for attributes in page.all("path") if attributes["class"].startswith("line")]
    assert len(lines) == 3 * 2 * (1 + len(SETS))  # three scores, two methods; by distance, and of each set
    titles = page.text_of("title")
    assert sum("000001\nuv_disparity: 0.9010\nrobust: 0.9020" in title for title in titles) == len(SETS)
    boxes = page.all("input")
    assert [box["id"] for box in boxes] == ["m0", "m1"]
    assert all(box["type"] == "checkbox" for box in boxes)
    style = page.text_of("style")[0]
    assert "body:has(#m1:not(:checked)) .line.s1 { display: none; }" in style
    assert ".s2 " not in style


def test_frame_that_could_not_be_used_is_a_gap():
    records = make_records(sets=("DS1A",))
    records[1] = FrameRecord("DS1A", "000001", (), error="no image")
    page = Page(make_report(make_summary(sets=("DS1A",)), records))
    dots = [attributes["d"] for attributes in page.all("path") if attributes["class"] == "line dot s0"]
    assert [path.count("M") for path in dots] == [2, 2, 2]
    assert dots[0].startswith("M0.5 ")
    assert "M2.5 " in dots[0]


def test_times_are_medians():
    page = Page(make_report())
    assert "sum" in page.text_of("th")
    cells = page.text_of("td")
    assert cells.count("35.0") == 2  # of 10, 20 .. 60 for either method
    assert cells.count("55.0") == 2
    assert page.text_of("b") == ["55 ms", "55 ms"]


def test_configuration_tells_what_differs_from_what_is_common():
    text = make_report()
    different, common = text[text.index('id="configuration"') :].split("<details>")
    assert "clustering.k" in different
    assert "threads" not in different
    assert "threads" in common
    assert "/data/DS1A" in different


def test_gallery_shows_pictures_inline_with_their_titles():
    page = Page(make_report(exhibits=[exhibit(), exhibit(rank="worst", pictures=())]))
    (image,) = [attributes for attributes in page.all("img") if attributes["alt"]]
    assert base64.b64decode(image["src"].split(",")[1]) == b"\xff\xd8not looked at"
    assert (image["width"], image["height"], image["alt"]) == ("40", "30", "robust, DS1A/000001: image")
    assert "RMSE 0.2950, precision 0.9050, recall 0.8050" in page.text
    assert "No pictures of this frame." in page.text


EVIL = "<script>alert(1)</script>\"'&amp;</title></style><img src=x onerror=y>"


def test_every_name_is_escaped():
    methods, sets = (f"{EVIL}m", f"{EVIL}n"), (f"{EVIL}a", f"{EVIL}b")
    summary = make_summary(methods, sets)
    summary = dataclasses.replace(
        summary,
        sets=tuple(
            dataclasses.replace(item, path=EVIL, errors=(FrameError(EVIL, EVIL),), n_without_truth=1, unknown=unknown)
            for item, unknown in zip(summary.sets, ("ignore", EVIL), strict=True)
        ),
        methods=tuple(dataclasses.replace(m, description=EVIL, configuration={EVIL: m.name}) for m in summary.methods),
        results=tuple(dataclasses.replace(row, gave_up=(EVIL,)) for row in summary.results),
    )
    records = [
        FrameRecord(record.set, f"{EVIL}{record.frame}", record.methods) for record in make_records(methods, sets)
    ]
    record = dataclasses.replace(method_record(methods[0], 1), problem=EVIL)
    shown = exhibit(rank=EVIL, set=sets[0], frame=EVIL, record=record, pictures=(Picture(EVIL, b"x", 1, 1),))
    text = make_report(summary, records, [shown])
    page = Page(text)
    assert len(page.all("script")) == 1
    assert len(page.all("style")) == 1
    assert len(page.all("img")) == 2  # the picture, and the one for zooming
    assert not any("onerror" in attributes for _, attributes in page.tags)
    assert EVIL not in text
    assert text.count(html.escape(EVIL)) > 50


@pytest.mark.parametrize("n_methods", [1, 12])
def test_any_number_of_methods(n_methods):
    methods = tuple(f"method {i}" for i in range(n_methods))
    page = Page(make_report(make_summary(methods), make_records(methods)))
    assert [box["id"] for box in page.all("input")] == [f"m{i}" for i in range(n_methods)]
    assert page.text_of("style")[0].count("stroke-dasharray") == max(n_methods - 8, 0)


def test_nothing_found_is_a_page_too():
    summary = make_summary(results=(), means=())
    page = Page(report_html(summary, [], []))
    assert len(page.all("h2")) == 6


def test_report_is_written_as_utf8(tmp_path):
    records = make_records()
    write_report(tmp_path / "report.html", make_summary(), records, make_times(records))
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == make_report()


# Charts


def chart_of(values, **options):
    text = line_chart("t", [Series("m", 0, tuple(values))], [str(i) for i in range(len(values))], **options)
    return Page(text), [re.findall(rf'class="line {kind}s0" d="([^"]*)"', text) for kind in ("", "dot ")]


def test_line_goes_through_its_values():
    page, (line, dots) = chart_of([0.0, 0.5, 0.25])
    assert line == ["M0.5 100L1.5 0L2.5 50"]
    assert dots == []
    assert page.all("svg")[0]["viewbox"] == "0 0 3 100"
    assert page.text_of("span")[:6] == ["0.5", "0.4", "0.3", "0.2", "0.1", "0"]


def test_line_has_gaps_where_values_are_missing():
    _, (line, dots) = chart_of([None, 0.1, None, 0.2, 0.1, None, 0.0])
    assert line == ["M3.5 0L4.5 50"]
    assert dots == ["M1.5 50h0M6.5 100h0"]


def test_axis_of_shares_ends_at_1():
    page, (line, _) = chart_of([0.87, 1.0], top=1.0)
    assert line == ["M0.5 65L1.5 0"]
    assert page.text_of("span")[:5] == ["1", "0.95", "0.9", "0.85", "0.8"]


@pytest.mark.parametrize("values", [[], [None], [0.0], [1.0, 1.0]])
@pytest.mark.parametrize("top", [None, 1.0])
def test_chart_of_little_is_well_formed(values, top):
    page, _ = chart_of(values, top=top)
    assert len(page.all("svg")) == 1


def test_numbers_of_points_stand_below_the_axis():
    page, _ = chart_of([0.5] * 38)
    assert page.text_of("span")[-4:] == ["1", "10", "20", "30"]
    page, _ = chart_of([0.5] * 3, every_label=True)
    assert page.text_of("span")[-3:] == ["0", "1", "2"]


def test_bars_share_one_scale():
    page = Page(stacked_bars([Bar("a", 0, (30.0, 10.0)), Bar("b", 1, (20.0, 0.0))], ("x", "y"), unit="ms"))
    parts = [attributes for attributes in page.all("i") if "style" in attributes]
    assert [part["style"] for part in parts] == ["width:75%", "width:25%", "width:50%"]
    assert [part["title"] for part in parts] == ["x: 30.0 ms", "y: 10.0 ms", "x: 20.0 ms"]
    assert page.text_of("b") == ["40 ms", "20 ms"]


# Gallery


@pytest.mark.parametrize(
    ("n", "expected"),
    [
        (0, []),
        (1, [("best", 0)]),
        (2, [("best", 1), ("worst", 0)]),
        (3, [("best", 2), ("median", 1), ("worst", 0)]),
        (6, [("best", 5), ("median", 3), ("worst", 0)]),
    ],
)
def test_best_median_and_worst_are_chosen(n, expected):
    records = [FrameRecord("s", str(i), (method_record("robust", i),)) for i in range(n)]
    records.insert(0, FrameRecord("s", "broken", (), error="no"))
    chosen = list(choose_exhibits(records, "robust"))
    assert [(item.rank, item.frame) for item in chosen] == [(rank, str(i)) for rank, i in expected]
    assert list(choose_exhibits(records, "other")) == []


@pytest.fixture
def evaluated(tmp_path):
    """A set of four frames with truth, and records by which the last is the best."""
    path = write_dataset(tmp_path / "set", frames(), truth=True)
    sets = open_sets([path], ReaderOptions())
    values = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60}
    setup = make_setup(choose_methods(METHODS), values, n_seeds=1)
    records = [
        FrameRecord("set", name, tuple(method_record(method, i) for method in METHODS))
        for i, name in enumerate(sets[0].frames.names)
    ]
    return sets, setup, records


def test_gallery_has_all_pictures_of_each_method(evaluated):
    exhibits = make_gallery(*evaluated)
    assert [(item.record.method, item.rank) for item in exhibits] == [
        (method, rank) for method in METHODS for rank in ("best", "median", "worst")
    ]
    few = ["image", "truth", "short range", "errors"]
    all_titles = ["image", "truth", "short range", "superpixels", "clusters", "long range", "errors"]
    for item in exhibits:
        assert [picture.title for picture in item.pictures] == (few if item.record.method == METHODS[0] else all_titles)
        for picture in item.pictures:
            image = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
            assert image.shape == (128, 208, 3)
            assert (picture.width, picture.height) == (208, 128)
    assert make_gallery(*evaluated, jobs=2) == exhibits


def test_frame_that_is_gone_has_no_pictures(evaluated):
    sets, setup, records = evaluated
    (sets[0].frames.path / "right" / f"{records[-1].frame}.png").unlink()
    exhibits = make_gallery(sets, setup, records)
    assert [len(item.pictures) for item in exhibits] == [0, 4, 4, 0, 7, 7]
    assert "No pictures of this frame." in make_report(make_summary(sets=("set",)), records, exhibits)


def test_large_pictures_are_made_smaller():
    from lrtrav_ros.evaluation.report import gallery

    picture = gallery._picture("image", np.zeros((600, 1120, 3), np.uint8))
    assert (picture.width, picture.height) == (560, 300)


def test_errors_are_told_by_colour():
    left = np.full((1, 5, 3), 100, np.uint8)
    mask = np.array([[255, 255, 0, 0, 255]], np.uint8)
    truth = np.array([[255, 0, 255, 0, 128]], np.uint8)
    right, wrong, missed, empty, ignored = pictures.error_picture(left, mask, truth)[0].astype(int)
    assert right[1] > right[2]  # green
    assert wrong[2] > wrong[1] > wrong[0]  # vermilion
    assert missed[0] > missed[1] > missed[2]  # blue
    assert len(set(empty)) == 1
    assert len(set(ignored)) == 1
    assert abs(ignored[0] - 128) < abs(empty[0] - 128)
    gray = pictures.error_picture(left[..., 0], mask, truth)[0].astype(int)
    assert np.array_equal(gray[1], wrong)


def test_truth_is_told_by_colour():
    left = np.full((1, 3, 3), 100, np.uint8)
    traversable, not_traversable, ignored = pictures.truth_picture(left, np.array([[255, 0, 128]], np.uint8))[0]
    assert traversable[1] > traversable[2]
    assert list(not_traversable) == [100, 100, 100]
    assert ignored[0] == ignored[1] == ignored[2] > 100
