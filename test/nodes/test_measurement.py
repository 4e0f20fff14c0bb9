"""The measurement of the running detector: its figures, what it refuses, and a detector that does not start."""

import math
import threading

import pytest

pytest.importorskip("rclpy")

from rclpy.context import Context
from ros_graph import CAMERA, N_DISPARITIES, ground_disparity, stereo_pair

from lrtrav_ros.frame import Frame
from lrtrav_ros.nodes.measurement import measure_nodes

pytestmark = pytest.mark.usefixtures("ros")

SETTINGS = {"stereo.matcher": "bm", "stereo.n_disparities": N_DISPARITIES, "superpixels.n_superpixels": 40}
LEFT, RIGHT = stereo_pair()
STEREO = Frame(camera=CAMERA, left=LEFT, right=RIGHT)
DISPARITY = Frame(camera=CAMERA, left=LEFT, disparity=ground_disparity())


@pytest.mark.parametrize(("frame", "node"), [(STEREO, "long_range"), (DISPARITY, "short_range")])
def test_figures_of_a_second_at_a_low_rate(frame, node):
    for _ in range(3):  # a pause of the computer may take all of the second
        figures = measure_nodes([frame], SETTINGS, rate_hz=4.0, seconds=1.0, node=node)
        if figures.rate_out_hz > 0 and figures.frame_ms > 0:
            break
    assert figures.source == frame.source
    assert figures.frame_ms > 0
    assert 0 < figures.rate_in_hz <= 4.0
    assert figures.rate_out_hz > 0
    assert 0 <= figures.dropped_share < 1
    assert 0 < figures.latency_median_ms <= figures.latency_p99_ms < math.inf
    assert figures.cpu_share > 0
    assert figures.start_s > 0
    assert figures.first_rss_mb > 50
    assert 50 < figures.last_rss_mb <= figures.peak_rss_mb


def test_the_detector_s_own_words_tell_why_it_does_not_start():
    with pytest.raises(RuntimeError, match=r"stereo\.matcher is 'magic'; give one of elas, sgbm, bm"):
        measure_nodes([STEREO], {"stereo.matcher": "magic"}, rate_hz=4.0, seconds=1.0)


def test_ros_is_shut_down_when_nothing_is_spun_any_more(monkeypatch):
    spun = []
    shut_down = Context.try_shutdown

    def noting(context):
        spun.append("camera" in {thread.name for thread in threading.enumerate()})
        shut_down(context)

    monkeypatch.setattr(Context, "try_shutdown", noting)
    with pytest.raises(RuntimeError, match="magic"):
        measure_nodes([STEREO], {"stereo.matcher": "magic"}, rate_hz=4.0, seconds=1.0)
    assert spun == [False]


@pytest.mark.parametrize(
    ("frames", "rate_hz", "seconds", "message"),
    [
        ([STEREO], 0.0, 1.0, "rate is 0 Hz for 1 s"),
        ([STEREO], 4.0, -1.0, "rate is 4 Hz for -1 s"),
        ([], 4.0, 1.0, r"frames have the sources \[\]"),
        ([STEREO, DISPARITY], 4.0, 1.0, r"frames have the sources \['disparity', 'stereo'\]"),
        ([Frame(camera=CAMERA, disparity=ground_disparity())], 4.0, 1.0, "no left image"),
    ],
)
def test_what_cannot_be_measured_is_refused(frames, rate_hz, seconds, message):
    with pytest.raises(ValueError, match=message):
        measure_nodes(frames, SETTINGS, rate_hz=rate_hz, seconds=seconds)
