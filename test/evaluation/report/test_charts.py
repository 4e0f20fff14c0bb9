"""Charts as HTML."""

from __future__ import annotations

import re

import pytest
from sample_report import (
    Page,
)

from lrtrav_ros.evaluation.report.charts import Bar, Series, line_chart, stacked_bars


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


def test_axis_of_small_values_ends_close_to_them():
    page, (line, _) = chart_of([0.0, 0.024])
    assert line == ["M0.5 100L1.5 20"]
    assert page.text_of("span")[:4] == ["0.03", "0.02", "0.01", "0"]


def test_reference_is_a_line_of_its_own():
    page, (line, _) = chart_of([0.5, 0.75], top=1.0, reference=[0.5, 1.0])
    assert line == ["M0.5 100L1.5 50"]
    assert [path["d"] for path in page.all("path") if path["class"] == "reference"] == ["M0.5 100L1.5 0"]


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
