"""Frames and settings to measure with, and what is measured of the package."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from lrtrav_ros.benchmark.timing import Contender
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.frame import Frame
from lrtrav_ros.method.matching import create_matcher
from lrtrav_ros.synthetic.rendering import render_sequence
from lrtrav_ros.synthetic.scene_config import STYLES, SceneConfig

WHOLE_FRAME = "whole frame"
AFTER_MATCHING = "after matching"


@dataclass(frozen=True, slots=True, eq=False)
class Workload:
    """Frames of one size, and the settings they are detected with.

    Parameters
    ----------
    frames : tuple of Frame
        At least one.
    config : Config
        All but the number of threads.
    """

    frames: tuple[Frame, ...]
    config: Config

    @property
    def width(self) -> int:
        """Width of the images in pixels."""
        return self.frames[0].shape[1]

    @property
    def height(self) -> int:
        """Height of the images in pixels."""
        return self.frames[0].shape[0]

    @property
    def is_stereo(self) -> bool:
        """Whether there is something to match."""
        return all(frame.right is not None for frame in self.frames)


def disparities_for(width: int) -> int:
    """Return how many disparities images of a width are matched with where no setting says: 64 at 640 pixels."""
    return max(-(-width // 160), 1) * 16


def synthetic_frames(width: int, height: int, n_frames: int) -> tuple[Frame, ...]:
    """Return single frames of different scenes.

    Raises
    ------
    ValueError
        If no scene can have that size.
    """
    scenes = [
        SceneConfig(style=STYLES[i % len(STYLES)], seed=i, width=width, height=height, n_frames=1)
        for i in range(n_frames)
    ]
    return tuple(synthetic.frame for scene in scenes for synthetic in render_sequence(scene))


def detections(workload: Workload, threads: Sequence[int]) -> Iterator[Contender]:
    """Yield detection in whole frames, and where they are stereo pairs in frames that have their disparity already.

    Parameters
    ----------
    workload : Workload
        Pairs are matched at full and at half resolution, unless its settings want half resolution anyway.
    threads : sequence of int
        Numbers of threads.
    """
    stereo = workload.config.stereo
    resolutions = (False, True) if workload.is_stereo and not stereo.half_resolution else (stereo.half_resolution,)
    for n_threads in threads:
        for half in resolutions:
            config = workload.config.updated({"threads": n_threads, "stereo.half_resolution": half})
            yield _detection(WHOLE_FRAME, workload.frames, config)
            if workload.is_stereo:
                yield _detection(AFTER_MATCHING, [matched(frame, config) for frame in workload.frames], config)


def _detection(name: str, frames: Sequence[Frame], config: Config) -> Contender:
    """Return the detection in frames, one after the other."""
    detector = Detector(config)
    return Contender(
        name=name,
        calls=[partial(detector.detect_frame, frame) for frame in frames],
        n_threads=config.n_threads,
        half_resolution=config.stereo.half_resolution,
    )


def matched(frame: Frame, config: Config) -> Frame:
    """Return a stereo frame with its disparity in place of the right image.

    Raises
    ------
    ValueError
        If the frame is no stereo pair.
    """
    if frame.left is None or frame.right is None:
        raise ValueError("the frame has no pair of images to match; give one that has")
    matcher = create_matcher(config.stereo, config.elas)
    return dataclasses.replace(frame, right=None, disparity=matcher.compute(frame.left, frame.right))
