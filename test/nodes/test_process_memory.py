"""Memory of the nodes' process: images take no new pages, and settling leaves kernels that work."""

import subprocess
import sys

COPIES = """
import resource
from lrtrav_ros.nodes.process_memory import keep_freed_images
keep_freed_images()
image = bytes(2**20)
faults = []
for _ in range(40):
    bytearray(image)
    faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
print(faults[-1] - faults[10])
"""

SETTLED = """
import gc
import numpy as np
from lrtrav_ros import Config, Detector, StereoCamera
from lrtrav_ros.nodes.process_memory import settle
detector = Detector(Config(), StereoCamera(fx=200.0, cx=100.0, cy=40.0, baseline_m=0.2))
left = np.random.default_rng(0).integers(0, 256, (160, 200, 3), np.uint8)
ground = np.repeat(np.maximum(0.2 * (np.arange(160, dtype=np.float32) - 40), 0)[:, None], 200, axis=1)
before = detector.detect(left, disparity=ground).long_range.mask
settle()
print(gc.get_freeze_count() > 0, np.array_equal(detector.detect(left, disparity=ground).long_range.mask, before))
"""


def output_of(code):
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.strip()


def test_copies_of_an_image_take_no_new_pages():
    assert int(output_of(COPIES)) < 256  # pages of one image; 29 copies of its 256 pages would take 7424


def test_after_settling_frames_are_detected_as_before():
    assert output_of(SETTLED) == "True True"
