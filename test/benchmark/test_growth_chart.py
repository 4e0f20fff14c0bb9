"""The picture of how time grows: lines through the right places, on axes that both are logarithmic."""

from __future__ import annotations

from itertools import pairwise
from xml.etree import ElementTree

import pytest
from sample_figures import workload

from lrtrav_ros.benchmark.chart import growth_chart

SVG = "{http://www.w3.org/2000/svg}"


def drawn(*workloads):
    """Return the points of each line, and the texts."""
    root = ElementTree.fromstring(growth_chart(workloads))
    lines = [
        [tuple(map(float, point.split(","))) for point in line.get("points").split()]
        for line in root.iter(f"{SVG}polyline")
    ]
    return lines, [text.text for text in root.iter(f"{SVG}text")]


def test_time_in_proportion_to_the_size_is_a_straight_line():
    lines, texts = drawn(workload(), workload(320, 240), workload(1280, 960))
    assert len(lines) == 9  # the reference, whole frames and what follows matching on 1 and 2 threads, and 4 alone
    for line in lines:
        assert [x for x, _ in line] == sorted(x for x, _ in line)
        (right_1, up_1), (right_2, up_2) = ((x2 - x1, y1 - y2) for (x1, y1), (x2, y2) in pairwise(line))
        assert up_1 > 0
        assert (right_2, up_2) == pytest.approx((right_1, up_1), abs=0.2)
    assert {"320x240", "640x480", "1280x960", "size, 500 superpixels", "OpenCV StereoSGBM"} <= set(texts)
    assert not any("superpixels, 640" in text for text in texts)


def test_time_that_does_not_grow_is_a_level_line():
    lines, texts = drawn(workload(), workload(n_superpixels=2000), workload(n_superpixels=200))
    assert len(lines) == 9
    assert all(len({y for _, y in line}) == 1 for line in lines)
    assert {"200", "500", "2000", "superpixels, 640 x 480"} <= set(texts)


def test_both_diagrams_share_the_scale_of_time():
    lines, _ = drawn(workload(), workload(320, 240), workload(n_superpixels=1000))
    assert len(lines) == 18
    for by_size, by_number in zip(lines[:9], lines[9:], strict=True):
        assert by_size[1][1] == by_number[0][1] == by_number[1][1]


def test_slower_is_higher():
    lines, texts = drawn(workload(), workload(320, 240))
    names = [text for text in texts if text.startswith(("OpenCV", "whole", "after", "matching", "superpix", "cluster"))]
    heights = {name: line[-1][1] for name, line in zip(names, lines, strict=True)}
    order = sorted(heights, key=heights.__getitem__)
    assert order[:2] == ["OpenCV StereoSGBM", "whole frame, threads: 1"]
    assert order[-1] == "clustering"


def test_nothing_that_grows_is_refused():
    with pytest.raises(ValueError, match="give more of either"):
        growth_chart([workload()])
