"""Measures time per stage, frames per second and memory, beside OpenCV's StereoSGBM in the same run."""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import add_detection_options, config_from, image_size, positive_integer

if TYPE_CHECKING:
    from lrtrav_ros.config import Config, Value
    from lrtrav_ros.frame import Frame

_REFERENCE = "StereoSGBM"
_REFERENCE_DISPARITIES = 64
_DEFAULTS: dict[str, Value] = {"threads": 1, "stereo.n_disparities": 64}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "--input", type=Path, metavar="INPUT", help="dataset folder or rosbag; if not given, synthetic scenes"
    )
    parser.add_argument(
        "--size", type=image_size, default=(640, 480), metavar="WxH", help="of synthetic images (640x480)"
    )
    parser.add_argument("--frames", type=positive_integer, default=8, metavar="N", help="frames to use (%(default)s)")
    parser.add_argument(
        "--rounds", type=positive_integer, default=5, metavar="N", help="times that each is detected (%(default)s)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to a file as well")
    add_detection_options(parser)
    parser.description = (
        f"{__doc__} Starts from one thread and 64 disparities; --set threads=0 "
        "takes all processors. The reference has block size 5, five directions, 64 disparities and one thread."
    )


@dataclass(frozen=True, slots=True)
class Figures:
    """Measurements: the median time of each stage in milliseconds, the frame rate and the memory's peak."""

    width: int
    height: int
    n_frames: int
    median_ms: dict[str, float]
    reference_ms: float
    after_matching_ms: float
    frames_per_s: float
    memory_mb: float


def run(args: argparse.Namespace) -> int:
    """Measure, and print a table."""
    config = config_from(args, defaults=_DEFAULTS)
    if config.threads == 1:
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(variable, "1")  # read when NumPy is imported, below

    frames = _frames(args, config)
    if not frames:
        raise ValueError(f"{args.input}: none of its frames can be used; `lrtrav detect` says why")
    if frames[0].shape[1] <= _REFERENCE_DISPARITIES:
        raise ValueError(
            f"images are {frames[0].shape[1]} pixels wide; {_REFERENCE} needs more than {_REFERENCE_DISPARITIES}"
        )
    figures = measure(frames, config, rounds=args.rounds)
    for line in _table(figures):
        print(line)
    if args.json is not None:
        import dataclasses

        args.json.write_text(json.dumps(dataclasses.asdict(figures), indent=2) + "\n", encoding="utf-8")
    return 0


def measure(frames: Sequence[Frame], config: Config, *, rounds: int) -> Figures:
    """Detect in all frames, `rounds` times after one to warm up, each beside a run of the reference."""
    import dataclasses
    import resource

    import cv2
    import numpy as np
    from tqdm import tqdm

    from lrtrav_ros.detector import Detector, StageTimes

    cv2.setNumThreads(config.n_threads)
    detector = Detector(config)
    reference_ms: list[float] = []
    times: list[StageTimes] = []
    for repetition in tqdm(range(rounds + 1), unit="round", disable=None):
        for frame in frames:
            reference = _reference_ms(frame)
            found = detector.detect_frame(frame)
            if repetition:
                reference_ms.append(reference)
                times.append(found.times)
    names = [field.name.removesuffix("_ms") for field in dataclasses.fields(StageTimes)]
    table = np.array([dataclasses.astuple(row) for row in times])
    return Figures(
        width=frames[0].shape[1],
        height=frames[0].shape[0],
        n_frames=len(times),
        median_ms=dict(zip(names, np.median(table, axis=0).round(3).tolist(), strict=True)),
        reference_ms=round(float(np.median(reference_ms)), 3),
        after_matching_ms=round(float(np.median(table[:, 1:].sum(axis=1))), 3),
        frames_per_s=round(1000 / float(np.median(table.sum(axis=1))), 2),
        memory_mb=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
    )


def _reference_ms(frame: Frame) -> float:
    """Return how long StereoSGBM takes for the frame's pair; for one without a right image, on the left alone."""
    import time

    import cv2

    from lrtrav_ros.frame import pair_as_8bit, to_grey

    block = 5
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=_REFERENCE_DISPARITIES, blockSize=block,
        P1=8 * block**2, P2=32 * block**2, disp12MaxDiff=1,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM,
    )  # fmt: skip
    pair = pair_as_8bit(frame.image, frame.image if frame.right is None else frame.right)
    left, right = map(to_grey, pair)
    start = time.perf_counter()
    matcher.compute(left, right)
    return (time.perf_counter() - start) * 1e3


def _frames(args: argparse.Namespace, config: Config) -> list[Frame]:
    from itertools import islice

    if args.input is not None:
        from lrtrav_ros.io.recording import open_recording

        with open_recording(args.input, config.source) as recording:
            return list(islice(recording.frames(), args.frames))
    from lrtrav_ros.synthetic.rendering import render_sequence
    from lrtrav_ros.synthetic.scene_config import STYLES, SceneConfig

    width, height = args.size
    scenes = [
        SceneConfig(style=STYLES[i % len(STYLES)], seed=i, width=width, height=height, n_frames=1)
        for i in range(args.frames)
    ]
    return [synthetic.frame for scene in scenes for synthetic in render_sequence(scene)]


def _table(figures: Figures) -> list[str]:
    rows = [
        *figures.median_ms.items(),
        ("all after matching", figures.after_matching_ms),
        (_REFERENCE, figures.reference_ms),
    ]
    head = f"{figures.width} x {figures.height}, medians of {figures.n_frames} frames"
    lines = [head, f"{'stage':20} {'ms':>8} {'/ ' + _REFERENCE:>13}"]
    lines += [f"{name:20} {value:8.1f} {value / figures.reference_ms:13.2f}" for name, value in rows]
    return [*lines, f"{figures.frames_per_s:.1f} frames/s, memory at most {figures.memory_mb:.0f} MB"]
