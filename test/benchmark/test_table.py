"""Tables of measurements: each figure in its row and column."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

from sample_figures import MACHINE, figures, workload

from lrtrav_ros.benchmark.figures import Figures, NodesRun
from lrtrav_ros.benchmark.table import table


def rows(text):
    """Return the numbers behind the name of each row."""
    found = {}
    for line in text:
        name, numbers = line[:34].strip(), line[34:].split()
        if name and numbers and name not in found:
            found[name] = numbers
    return found


def test_each_stage_has_its_time_and_its_ratio_for_each_number_of_threads():
    lines = list(table(figures(workload())))
    assert lines[0] == "Abacus, processors: 2, Python 3.11.7, numpy 2.0, sklearn 1.5"
    assert lines[2] == "640 x 480, 64 disparities, 500 superpixels, medians of 6 runs"
    found = rows(lines[5:])
    assert found["matching"] == ["1.0", "0.03", "1.0", "0.03"]
    assert found["extension"] == ["6.0", "0.15", "6.0", "0.15"]
    assert found["stages after matching"] == ["20.0", "0.50", "20.0", "0.50"]
    assert found["after matching"] == ["18.0", "0.45", "9.0", "0.23"]
    assert found["whole frame"] == ["24.0", "0.60", "12.0", "0.30"]
    assert found["whole frame, half resolution"] == ["20.0", "0.50", "10.0", "0.25"]
    assert found["frames/s"] == ["41.7", "83.3"]
    assert found["OpenCV StereoSGBM"] == ["40.0", "1.00"]
    assert found["superpixels"] == ["3.0", "0.07", "3.0", "0.07"]
    assert "memory: at most 150 MB, 100 MB of it before the first frame" in lines


def test_rivals_that_are_not_installed_are_named():
    lines = list(table(figures(workload())))
    assert lines[-1] == "scikit-image is not installed; `pip install scikit-image` to compare with it"
    assert not any("scikit-learn is not" in line for line in lines)


def test_stages_that_overlap_are_explained_where_there_are_several_threads():
    explained = [
        any("run beside each other" in line for line in table(figures(workload(threads=n)))) for n in ((1,), (2,))
    ]
    assert explained == [False, True]


def test_growth_has_a_row_for_each_workload_in_their_order():
    first, larger, finer = workload(), workload(1280, 720), workload(n_superpixels=1000)
    lines = list(table(figures(first, larger, finer)))
    start = next(i for i, line in enumerate(lines) if line.startswith("size "))
    assert [line.split()[:4] for line in lines[start + 1 : start + 4]] == [
        ["640", "x", "480", "500"],
        ["640", "x", "480", "1000"],
        ["1280", "x", "720", "500"],
    ]
    totals = ["18.0", "/", "9.0", "24.0", "/", "12.0", "40.0"]
    assert lines[start + 1].split()[4:] == ["1.0", "2.0", "3.0", "4.0", "5.0", "6.0", *totals]
    assert lines[start + 3].split()[4:8] == ["3.0", "6.0", "9.0", "12.0"]
    assert lines[-1].endswith("threads: 1 for stages, 1 / 2 for the two columns after them")


def test_nodes_have_a_row_for_each_run():
    measured = SimpleNamespace(
        source="stereo", rate_in_hz=30.0, rate_out_hz=29.5, latency_median_ms=41.25, latency_p99_ms=60.0,
        dropped_share=0.0125, cpu_share=1.5, start_s=1.9, peak_rss_mb=280.0,
    )  # fmt: skip
    run = NodesRun(
        width=640, height=480, n_disparities=64, n_superpixels=500, threads=0, seconds=10.0, measured=measured
    )
    silent = dataclasses.replace(
        run, threads=2, measured=SimpleNamespace(**{**vars(measured), "latency_median_ms": math.nan})
    )
    lines = list(table(Figures(machine=MACHINE, nodes=(run, silent))))
    assert lines[-2].split() == [
        "640", "x", "480", "all", "stereo", "30.0", "29.5", "41.2", "60.0", "1.2%", "1.50", "280", "1.9",
    ]  # fmt: skip
    assert lines[-1].split()[3:8] == ["2", "stereo", "30.0", "29.5", "-"]
