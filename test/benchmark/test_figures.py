"""What is measured of small images: complete, and figures that fit each other."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from sample_figures import MACHINE, figures, workload

from lrtrav_ros import Config
from lrtrav_ros.benchmark import rivals
from lrtrav_ros.benchmark.figures import (
    STAGES_AFTER_MATCHING,
    Figures,
    NodesRun,
    measure,
    numbers_of_threads,
    this_machine,
)
from lrtrav_ros.benchmark.workload import (
    AFTER_MATCHING,
    WHOLE_FRAME,
    Workload,
    detections,
    disparities_for,
    matched,
    synthetic_frames,
)
from lrtrav_ros.detector import Stage

STAGES = [stage.value for stage in Stage]
CONFIG = Config().updated({"stereo.n_disparities": 16, "superpixels.n_superpixels": 30})


@pytest.fixture(scope="module")
def small():
    return Workload(synthetic_frames(96, 64, 2), CONFIG)


@pytest.fixture(scope="module")
def measured(small):
    (found,) = measure([small], (1, 2), rounds=2)
    return found


def named(found, *, in_frame, n_threads=1, half=False):
    return {
        times.name: times
        for times in found.times
        if (times.in_frame, times.n_threads, times.half_resolution) == (in_frame, n_threads, half)
    }


def test_conditions_are_those_of_the_workload(measured):
    assert (measured.width, measured.height, measured.n_frames) == (96, 64, 2)
    assert (measured.n_disparities, measured.n_superpixels, measured.half_resolution) == (16, 30, False)
    assert numbers_of_threads(measured) == [1, 2]


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("half", [False, True])
def test_stages_take_less_than_the_whole_frame(measured, n_threads, half):
    whole = named(measured, in_frame=False, n_threads=n_threads, half=half)[WHOLE_FRAME]
    stages = named(measured, in_frame=True, n_threads=n_threads, half=half)
    assert list(stages) == [*STAGES, STAGES_AFTER_MATCHING]
    assert [name for name, times in stages.items() if times.wall_ms == 0] == ["clustering"]  # propagation needs none
    assert max(stages[name].wall_ms for name in STAGES) < whole.wall_ms
    assert stages[STAGES_AFTER_MATCHING].wall_ms > max(stages[name].wall_ms for name in STAGES[1:])


def test_on_one_thread_the_stages_make_up_the_frame(measured):
    whole, stages = (named(measured, in_frame=in_frame) for in_frame in (False, True))
    assert stages[STAGES_AFTER_MATCHING].wall_ms < whole[WHOLE_FRAME].wall_ms


def test_ratios_are_to_the_reference_which_comes_first(measured):
    reference = measured.times[0]
    assert (reference.name, reference.ratio, reference.n_threads) == ("OpenCV StereoSGBM", 1.0, 1)
    for times in measured.times:
        assert times.ratio == pytest.approx(times.wall_ms / reference.wall_ms, abs=1e-4)
        assert times.n_runs == 4
        assert (times.cpu_ms is None) == times.in_frame


def test_parts_and_rivals_run_alone_on_one_thread(measured):
    expected = {"OpenCV StereoSGBM", WHOLE_FRAME, AFTER_MATCHING, "matching, elas", "OpenCV StereoBM"}
    expected |= {"superpixels", "clustering"}
    names = {"skimage": "scikit-image SLIC", "sklearn": "scikit-learn SpectralClustering"}
    assert set(named(measured, in_frame=False)) == expected | {names[name] for name in rivals.installed()}
    assert set(named(measured, in_frame=False, half=True)) == {WHOLE_FRAME, AFTER_MATCHING, "matching, elas"}


def test_memory_is_that_of_a_process_with_the_package(measured):
    assert 30 < measured.memory.start_mb <= measured.memory.peak_mb


def test_rivals_that_are_not_installed_are_left_out(small, monkeypatch):
    monkeypatch.setattr(rivals, "installed", frozenset)
    names = [contender.name for contender in rivals.contests(small)]
    assert names == ["matching, elas", "matching, elas", "OpenCV StereoBM", "superpixels", "clustering"]


def test_slic_of_scikit_image_finds_about_as_many_superpixels(small):
    pytest.importorskip("skimage")
    contender = next(item for item in rivals.contests(small) if item.name == "scikit-image SLIC")
    assert [len(np.unique(call())) for call in contender.calls] == pytest.approx([30, 30], rel=0.5)


def test_scikit_learn_finds_as_many_clusters_in_the_same_superpixels(small):
    pytest.importorskip("sklearn")
    found = {item.name: [call() for call in item.calls] for item in rivals.contests(small)}
    for ours, theirs in zip(found["clustering"], found["scikit-learn SpectralClustering"], strict=True):
        assert ours.shape == theirs.shape
        assert ours.max() == theirs.max()


def test_after_matching_is_the_same_frame_with_its_disparity(small):
    whole, after = (
        [call() for call in contender.calls] for contender in detections(small, [1]) if not contender.half_resolution
    )
    for first, second in zip(whole, after, strict=True):
        assert np.array_equal(first.long_range.occupancy, second.long_range.occupancy)
        assert second.times.matching_ms == 0 < first.times.matching_ms


def test_several_workloads_keep_their_figures_apart(small):
    larger = Workload(synthetic_frames(128, 96, 2), CONFIG.updated({"superpixels.n_superpixels": 40}))
    found = measure([small, larger], [1], rounds=1)
    assert [(item.width, item.height, item.n_superpixels) for item in found] == [(96, 64, 30), (128, 96, 40)]
    first, second = ([(times.name, times.half_resolution) for times in item.times] for item in found)
    assert first == second
    assert all(item.times[0].ratio == 1 for item in found)
    assert first[0][0] == rivals.REFERENCE


def test_half_resolution_alone_is_measured_where_it_is_set(small):
    config = CONFIG.updated({"stereo.half_resolution": True})
    contenders = list(detections(Workload(small.frames, config), [1, 2]))
    assert [(c.name, c.n_threads, c.half_resolution) for c in contenders] == [
        (WHOLE_FRAME, 1, True),
        (AFTER_MATCHING, 1, True),
        (WHOLE_FRAME, 2, True),
        (AFTER_MATCHING, 2, True),
    ]


def test_frames_with_disparity_are_measured_whole(small):
    given = Workload(tuple(matched(frame, CONFIG) for frame in small.frames), CONFIG)
    assert [contender.name for contender in detections(given, [1])] == [WHOLE_FRAME]
    (found,) = measure([given], [1], rounds=1)
    assert "matching, elas" not in {times.name for times in found.times}
    with pytest.raises(ValueError, match="no pair of images to match"):
        matched(given.frames[0], CONFIG)


def test_images_too_narrow_for_the_reference_are_refused(small):
    workload = Workload(small.frames, CONFIG.updated({"stereo.n_disparities": 90}))
    with pytest.raises(ValueError, match="images are 96 pixels wide; OpenCV StereoSGBM needs more than its 96"):
        rivals.reference(workload)


@pytest.mark.parametrize(("width", "expected"), [(32, 16), (160, 16), (161, 32), (320, 32), (640, 64), (1920, 192)])
def test_disparities_grow_with_the_width(width, expected):
    assert disparities_for(width) == expected


def test_json_holds_all_figures(measured):
    values = json.loads(Figures(machine=MACHINE, workloads=(measured,)).to_json())
    assert values["machine"] == dataclasses.asdict(MACHINE)
    assert values["nodes"] == []
    (found,) = values["workloads"]
    assert found["memory"] == dataclasses.asdict(measured.memory)
    assert found["times"] == [dataclasses.asdict(times) for times in measured.times]
    assert set(found["times"][0]) == {
        "name", "in_frame", "n_threads", "half_resolution", "n_runs", "wall_ms", "cpu_ms", "ratio",
    }  # fmt: skip


def test_json_says_null_where_there_is_no_number():
    @dataclasses.dataclass
    class Measured:
        latency_median_ms: float = math.nan

    run = NodesRun(width=4, height=3, n_disparities=16, n_superpixels=5, threads=0, seconds=1.0, measured=Measured())
    values = json.loads(Figures(machine=MACHINE, nodes=(run,)).to_json(), parse_constant=pytest.fail)
    assert values["nodes"][0]["measured"] == {"latency_median_ms": None}


def test_sample_figures_are_of_the_same_form_as_measured_ones(measured):
    (sample,) = json.loads(figures(workload()).to_json())["workloads"]
    assert sample.keys() == dataclasses.asdict(measured).keys()


def test_machine_names_the_versions_that_count():
    machine = this_machine()
    assert machine.processor
    assert machine.n_processors >= 1
    assert machine.versions["numpy"] == np.__version__
    assert {"lrtrav_ros", "numpy", "scipy", "cv2", "numba"} <= set(machine.versions)


def test_a_size_that_no_scene_can_have_is_refused():
    with pytest.raises(ValueError, match="width is 20"):
        synthetic_frames(20, 64, 1)
