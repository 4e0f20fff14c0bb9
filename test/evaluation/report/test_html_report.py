"""The report: it is one well-formed page without a network, shows what was found, and escapes every name."""

from __future__ import annotations

import base64
import dataclasses
import html
import re
import subprocess

import pytest
from sample_report import (
    METHODS,
    SETS,
    Page,
    make_records,
    make_report,
    make_summary,
    make_times,
    method_record,
    obstacles,
    reliability,
    table_row,
)

from lrtrav_ros.evaluation.report.gallery import CALLED_FREE, Exhibit, Picture
from lrtrav_ros.evaluation.report.html_report import report_html, write_report
from lrtrav_ros.evaluation.scoring.score_records import (
    MEAN,
    FailedFrame,
    FrameRecord,
    PaperScores,
    SetSummary,
)
from lrtrav_ros.evaluation.scoring.scores import Scores

EVIL = "<script>alert(1)</script>\"'&amp;</title></style><img src=x onerror=y>"


def exhibit(**values):
    image = Picture("image", b"\xff\xd8not looked at", 40, 30)
    return dataclasses.replace(Exhibit("best", "DS1A", "000001", method_record("robust", 5), (image,)), **values)


def test_page_is_well_formed_and_has_all_parts():
    page = Page(make_report(exhibits=[exhibit()]))
    parts = [attributes["id"] for attributes in page.all("h2")]
    assert parts == [
        "scores",
        "obstacles",
        "distance",
        "frames",
        "confidence",
        "time",
        "gallery",
        "called-free",
        "configuration",
    ]
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


def test_policy_lets_in_its_own_script_and_style_alone():
    text = make_report()
    policy = dict(part.split(" ", 1) for part in Page(text).all("meta")[2]["content"].split("; "))
    for tag, directive in (("script", "script-src"), ("style", "style-src-elem")):
        (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", text, re.DOTALL)
        digest = subprocess.run(
            ["openssl", "dgst", "-sha256", "-binary"], input=content.encode(), stdout=-1, check=True
        )
        assert policy[directive] == f"'sha256-{base64.b64encode(digest.stdout).decode()}'"
    assert policy["style-src"] == "'unsafe-inline'"  # of attributes, and for browsers without style-src-elem
    assert not re.search(r"\son\w+=|javascript:", text)


def test_names_that_are_not_utf8_are_written(tmp_path):
    summary = make_summary(sets=(b"caf\xe9".decode("utf-8", "surrogateescape"),))
    write_report(tmp_path / "report.html", summary, [], [])
    assert r"caf\udce9" in Page((tmp_path / "report.html").read_text(encoding="utf-8")).text


def test_table_has_all_scores_and_the_best_are_marked():
    page = Page(make_report())
    cells = page.text_of("td")
    assert cells.count("0.9000") == 3  # precision of the first method on two sets, and their mean
    assert cells.count("0.2990") >= 3
    best = [attributes for attributes in page.all("td") if "best" in attributes.get("class", "")]
    assert len(best) == 12  # four scores of two sets and the mean
    assert cells.count("0.0390") == 3 + 2  # the lower rate of false positives; and by distance
    shares = [attributes["style"] for attributes in page.all("td") if "rmse" in attributes.get("class", "")]
    assert shares == ["--share:100%", "--share:99.7%"] * 3
    assert "mean of the sets" in page.text
    assert cells.count("12.3") == 6
    assert cells.count("5.7") == 6


def test_missed_obstacles_are_shown_by_distance_and_height():
    rows = tuple(table_row(MEAN, name, i, obstacles=obstacles(i, with_height=True)) for i, name in enumerate(METHODS))
    page = Page(make_report(make_summary(means=rows)))
    text = page.text[page.text.index("Standing obstacles") : page.text.index("Distance on the ground")]
    assert text.count("1 of 7") == text.count("0 of 7") == 3  # all of them, those at 5-10 m, and those below 0.2 m
    assert "0-0.2 m high" in page.text_of("th")
    assert "0 of 7 uv_disparity" in page.text  # the tile
    assert "0-0.2 m high" not in Page(make_report()).text_of("th")


def test_flicker_is_shown_where_it_is_known():
    assert "flicker" not in Page(make_report()).text_of("th")
    page = Page(make_report(make_summary(results=(table_row("DS1A", "robust", 1, flicker=0.0234),))))
    assert "flicker" in page.text_of("th")
    assert page.text_of("td").count("0.0234") == 1


def test_reliability_curve_is_that_of_the_methods_with_a_confidence():
    assert "No method says how sure it is." in Page(make_report()).text
    means = (
        table_row(MEAN, METHODS[0], 0),
        table_row(MEAN, METHODS[1], 1, reliability=reliability(0.9), calibration_error=0.0555),
    )
    report = make_report(make_summary(means=means))
    page = Page(report[report.index('<section><h2 id="confidence"') : report.index('<section><h2 id="time"')])
    paths = {path["class"]: path["d"] for path in page.all("path")}
    assert paths["line dot s1"] == "M0.5 100h0M9.5 20h0"  # 50 % and 90 % are right, from 50 to 100 %
    assert paths["line s1"].startswith("M0.5 52.38L1.5 100L")  # a third of the pixels, from 0 to 70 %
    assert paths["reference"].startswith("M0.5 95L1.5 85L")
    assert "0.0555" in page.text_of("td")
    assert {"95%\nrobust: 0.9000", "95%\nrobust: 0.6667"} <= set(page.text_of("title"))
    assert page.text_of("td").count("200") == 1
    assert "line s0" not in paths


def test_frames_with_most_obstacle_pixels_called_free_have_a_section_of_their_own():
    shown = exhibit(rank=CALLED_FREE, frame="000002")
    text = make_report(exhibits=[exhibit(), shown])
    gallery, called_free = text[text.index('id="gallery"') :].split('id="called-free"')
    assert "000001" in gallery
    assert "000002" not in gallery
    assert "DS1A/000002" in called_free
    assert "missed 5 of 7 obstacles" in called_free
    assert "No method calls anything free that is not traversable." in Page(make_report(exhibits=[exhibit()])).text


def test_single_set_has_no_means_of_sets():
    summary = make_summary(sets=("DS1A",))
    assert "mean of the sets" not in Page(make_report(summary, make_records(sets=("DS1A",)))).text


def test_rows_of_the_paper_stand_beside_the_results():
    assert "paper:" not in make_report()
    paper = table_row("DS1A", "robust", 1, paper=PaperScores(rmse=0.2521))
    page = Page(make_report(make_summary(results=(table_row("DS1A", "uv_disparity", 0), paper))))
    assert "paper: precision" in page.text_of("th")
    assert page.text_of("td").count("0.2521") == 1


def test_spread_over_seeds_is_shown():
    spread = table_row("DS1A", "robust", 1, spread=Scores(0.001, 0.002, 0.0034, 0.0005))
    page = Page(make_report(make_summary(results=(spread,), seeds=(0, 1, 2))))
    assert "± RMSE" in page.text_of("th")
    assert "0.0034" in page.text_of("td")
    assert "± is the standard deviation over 3 seeds." in page.text


def test_frames_with_problems_are_named():
    sets = (
        SetSummary("DS1A", "/data", 3, (FailedFrame("000007", "left/000007.png: no image"),), 2, "ignore"),
        SetSummary("DS2B", "/data", 3, (), 0, "not-traversable"),
    )
    gave_up = table_row("DS2B", "robust", 1, gave_up=("000002", "000003"))
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
    assert len(lines) == 4 * 2 * (1 + len(SETS))  # four scores, two methods; by distance, and of each set
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
    assert [path.count("M") for path in dots] == [2, 2, 2, 2]
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


def test_every_name_is_escaped():
    methods, sets = (f"{EVIL}m", f"{EVIL}n"), (f"{EVIL}a", f"{EVIL}b")
    summary = make_summary(methods, sets)
    summary = dataclasses.replace(
        summary,
        sets=tuple(
            dataclasses.replace(item, path=EVIL, errors=(FailedFrame(EVIL, EVIL),), n_without_truth=1, unknown=unknown)
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
    assert page.text_of("style")[0].count("stroke-dasharray: 5 3") == max(n_methods - 8, 0)


def test_nothing_found_is_a_page_too():
    summary = make_summary(results=(), means=())
    page = Page(report_html(summary, [], []))
    assert len(page.all("h2")) == 9


def test_report_is_written_as_utf8(tmp_path):
    records = make_records()
    write_report(tmp_path / "report.html", make_summary(), records, make_times(records))
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == make_report()
