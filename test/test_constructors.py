"""What is made of other objects refuses those of another class at once, and says which."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from public_calls import raw_pair, small
from sample_arrays import CAMERA, LINE

from lrtrav_ros.config import Config, ElasConfig, GroundConfig, MapsConfig, MemoryConfig, StereoConfig
from lrtrav_ros.detector import Appearance, Detector, LongRangeDetector, ShortRangeDetector
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.method.features import Features
from lrtrav_ros.method.ground_memory import GroundMemory
from lrtrav_ros.method.matching import create_matcher
from lrtrav_ros.method.matching.elas import Elas
from lrtrav_ros.method.matching.opencv import OpenCVMatcher
from lrtrav_ros.method.memory import Memory
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam
from lrtrav_ros.pose import Pose
from lrtrav_ros.rectification import Rectification
from lrtrav_ros.registration import DepthRegistration

POSE = Pose(np.eye(3), np.zeros(3))
SIZED = dataclasses.replace(CAMERA, width=20, height=12)
MATCHER = Elas()
APPEARANCE = Appearance(np.zeros((12, 20), np.int32), Features(*(np.ones((1, n)) for n in (4, 3, 2))), None)

# Each with arguments that it takes.
CONSTRUCTORS: dict[str, tuple[Callable[..., object], dict[str, Any]]] = {
    "Config": (Config, {item.name: getattr(Config(), item.name) for item in dataclasses.fields(Config)[1:]}),
    "Detector": (Detector, {"config": small(), "camera": CAMERA, "matcher": MATCHER}),
    "ShortRangeDetector": (ShortRangeDetector, {"config": small(), "matcher": MATCHER, "team": ALONE}),
    "LongRangeDetector": (LongRangeDetector, {"config": small(), "memory": Memory(MemoryConfig()), "team": ALONE}),
    "create_matcher": (create_matcher, {"stereo": StereoConfig(), "elas": ElasConfig(), "team": ALONE}),
    "Elas": (Elas, {"stereo": StereoConfig(), "elas": ElasConfig(), "team": ALONE}),
    "OpenCVMatcher": (OpenCVMatcher, {"stereo": StereoConfig(matcher="bm")}),
    "Memory": (Memory, {"config": MemoryConfig()}),
    "GroundMemory": (GroundMemory, {"config": GroundConfig()}),
    "DepthRegistration": (DepthRegistration, {"depth_camera": CAMERA, "left_camera": SIZED, "pose": POSE}),
    "Rectification": (Rectification, {"pair": raw_pair(12, 20)}),
    "GroundFrame.of": (GroundFrame.of, {"line": LINE, "camera": CAMERA}),
    "Pose.__matmul__": (POSE.__matmul__, {"inner": POSE}),
    "ThreadTeam": (ThreadTeam, {"n_threads": 1}),
}
MAY_BE_LEFT_OUT = {("Elas", "stereo"), ("Elas", "elas")} | {
    (name, argument)
    for name in ("Detector", "ShortRangeDetector", "LongRangeDetector")
    for argument in ("camera", "matcher", "memory", "team")
}
OTHERS = (None, "robust", 0.5, {}, [], (), object(), MapsConfig, SIZED.coefficients)
PAIRS = [(name, argument) for name, (_, arguments) in CONSTRUCTORS.items() for argument in arguments]


@pytest.mark.parametrize("name", CONSTRUCTORS)
def test_what_is_of_the_right_class_is_taken(name: str) -> None:
    constructor, arguments = CONSTRUCTORS[name]
    constructor(**arguments)
    constructor(**{key: value for key, value in arguments.items() if (name, key) not in MAY_BE_LEFT_OUT})


@pytest.mark.parametrize(("name", "argument"), PAIRS)
def test_what_is_of_another_class_is_refused(name: str, argument: str) -> None:
    constructor, arguments = CONSTRUCTORS[name]
    for other in OTHERS:
        if other is None and (name, argument) in MAY_BE_LEFT_OUT:
            continue
        with pytest.raises(TypeError, match=rf"^{argument} is .*; give "):
            constructor(**{**arguments, argument: other})


def test_the_part_of_another_stage_is_refused() -> None:
    with pytest.raises(TypeError, match=r"^memory is of type MapsConfig; give MemoryConfig$"):
        Config(memory=MapsConfig())  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"^superpixels is of type NoneType; give SuperpixelsConfig$"):
        dataclasses.replace(Config(), superpixels=None)


def test_looks_without_features_are_refused() -> None:
    detector = LongRangeDetector(small(**{"extension.rule": "evidence"}))
    with pytest.raises(TypeError, match=r"^appearance\.features is of type range; give Features$"):
        detector.extend(dataclasses.replace(APPEARANCE, features=range(3)), np.zeros((12, 20), np.uint8))
