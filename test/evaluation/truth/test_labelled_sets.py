"""Frames with truth."""

import numpy as np
import pytest

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame
from lrtrav_ros.frame import Frame

CAMERA = StereoCamera(fx=100.0, cx=39.5, cy=20.0, baseline_m=0.5)


def test_truth_has_the_size_of_the_frame_whatever_that_holds():
    depth_m = np.ones((60, 80), np.float32)
    for left in (None, np.zeros((60, 80, 3), np.uint8)):
        frame = Frame(camera=CAMERA, left=left, depth_m=depth_m)
        assert LabelledFrame(frame, np.zeros((60, 80), np.uint8)).frame is frame
        with pytest.raises(ValueError, match="the ground truth is 60 x 80 pixels, but the frame is 80 x 60"):
            LabelledFrame(frame, np.zeros((80, 60), np.uint8))
