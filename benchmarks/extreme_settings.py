#!/usr/bin/env python3
"""What settings at the ends of their ranges take: CPU time and memory of a frame, clusters and maps included.

    python benchmarks/extreme_settings.py
    python benchmarks/extreme_settings.py --combinations 1000 --seed 7

Each setting is at either end, or each of its choices, alone; then come random combinations of ends. Those that are
refused are counted. A frame has 640 x 480 pixels, and is the second one, so that there is something to remember; it
shows noise in all colours, or a board of squares, which has three times as many superpixels as are asked for. The exit
status is 1 where a frame takes more than 5 s of all processors together, or makes the process grow by more than
2 GB. Memory is Linux's.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, MapsConfig, Parameter, Value, parameters
from lrtrav_ros.detector import Detection, Detector
from lrtrav_ros.frame import Frame
from lrtrav_ros.mapping.grid import ground_grid
from lrtrav_ros.mapping.points import free_points, obstacle_points
from lrtrav_ros.mapping.segmentation import segmentation_points

MAX_CPU_S = 5.0
MAX_GROWTH_MB = 2000.0
HEIGHT, WIDTH, HORIZON = 480, 640, 200
SQUARE = 14  # pixels, of the board: just above what is no superpixel where 500 are asked for
CAMERA = StereoCamera(fx=500.0, cx=320.0, cy=float(HORIZON), baseline_m=0.2)
TOGETHER = (2, 3, 5, 10, 30)  # settings of a combination
N_SHOWN = 5
STATUS = Path("/proc/self/status")
FIXED: dict[str, Value] = {"maps.frame": "odom"}  # the grid is turned, which makes it larger


@dataclass(frozen=True, slots=True)
class Cost:
    """What a frame took with some settings."""

    cpu_s: float
    growth_mb: float
    values: dict[str, Value]

    @property
    def is_bounded(self) -> bool:
        """Whether both are within the bounds."""
        return self.cpu_s <= MAX_CPU_S and self.growth_mb <= MAX_GROWTH_MB

    def __str__(self) -> str:
        settings = " ".join(f"{name}={value}" for name, value in self.values.items())
        return f"{self.cpu_s:6.2f} s {self.growth_mb:6.0f} MB  {settings or 'defaults'}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--combinations", type=int, default=300, help="random combinations (300)")
    parser.add_argument("--seed", type=int, default=0, help="of the combinations (0)")
    args = parser.parse_args()
    scenes, tried = (
        (frames_of(noise()), frames_of(board())),
        [*alone(), *combinations(args.combinations, random.Random(args.seed))],
    )
    process({}, scenes[0])  # loads all kernels of the defaults
    start_mb = status_mb("VmRSS")
    costs = [cost for values in tried if (cost := measured(values, scenes, start_mb)) is not None]
    for key in ("cpu_s", "growth_mb"):
        print(f"most by {key}:")
        for cost in sorted(costs, key=lambda cost: -getattr(cost, key))[:N_SHOWN]:
            print(cost)
    n_over = sum(not cost.is_bounded for cost in costs)
    print(f"{len(costs)} settings measured, {len(tried) - len(costs)} refused, {n_over} over the bounds")
    return int(n_over > 0)


def alone() -> Iterator[dict[str, Value]]:
    """Yield each end of each setting."""
    for parameter in changeable():
        for end in ends(parameter):
            yield {parameter.name: end}


def combinations(n: int, rng: random.Random) -> Iterator[dict[str, Value]]:
    """Yield ends of some settings, chosen at random."""
    for _ in range(n):
        chosen = rng.sample(changeable(), rng.choice(TOGETHER))
        yield {parameter.name: rng.choice(ends(parameter)) for parameter in chosen}


def changeable() -> list[Parameter]:
    """Return the settings that can change while a node runs."""
    return [parameter for parameter in parameters() if not parameter.read_only]


def ends(parameter: Parameter) -> list[Value]:
    """Return the ends of a setting's range, or its choices."""
    if parameter.choices:
        return list(parameter.choices)
    if parameter.type is bool:
        return [False, True]
    return [parameter.check(parameter.type(bound)) for bound in (parameter.minimum, parameter.maximum)]


def measured(values: dict[str, Value], scenes: Iterable[list[Frame]], start_mb: float) -> Cost | None:
    """Return what a frame takes at most, and print it where that is too much; None where the settings are refused."""
    try:
        Config().updated({**FIXED, **values})
    except ValueError:
        return None
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak is what is in use now
    cpu_s = max(process(values, frames) for frames in scenes)
    cost = Cost(cpu_s, status_mb("VmHWM") - start_mb, values)
    if not cost.is_bounded:
        print(f"over: {cost}", flush=True)
    return cost


def process(values: dict[str, Value], frames: list[Frame]) -> float:
    """Return the CPU time of the last of some frames, in seconds."""
    config = Config().updated({**FIXED, **values})
    detector = Detector(config, CAMERA)
    for frame in frames:
        start_s = time.process_time()
        detection = detector.detect_frame(frame)
        _ = detection.clusters
        make_maps(detection, config.maps)
    return time.process_time() - start_s


def make_maps(detection: Detection, maps: MapsConfig) -> None:
    """Make all maps of a frame."""
    short_range, far = detection.short_range, detection.long_range.occupancy
    obstacle_points(detection.disparity, short_range.occupancy, short_range.line, CAMERA, maps)
    free_points(short_range.occupancy, short_range.line, CAMERA, maps)
    segmentation_points(far, detection.disparity, short_range.line, CAMERA, maps)
    ground_grid(far, short_range, CAMERA, maps).in_frame(0.0, 0.0, 1.0)


def noise() -> NDArray[np.uint8]:
    """Return an image in all colours, twice as wide as a frame."""
    pixels = np.random.default_rng(0).integers(0, 256, (HEIGHT, 2 * WIDTH, 3), np.uint8)
    return np.asarray(cv2.GaussianBlur(pixels, (0, 0), 1.2), np.uint8)


def board() -> NDArray[np.uint8]:
    """Return a board of black and white squares, each just large enough to be a superpixel, twice as wide."""
    rows, columns = np.indices((HEIGHT, 2 * WIDTH)) // SQUARE
    return np.repeat(((rows + columns) % 2 * 255).astype(np.uint8)[:, :, None], 3, axis=2)


def frames_of(left: NDArray[np.uint8]) -> list[Frame]:
    """Return two frames of level ground that looks so."""
    shifts = np.maximum(np.arange(HEIGHT) - HORIZON, 0) // 10
    right = np.stack([np.roll(row, -shift, axis=0) for row, shift in zip(left, shifts, strict=True)])
    left, right = (np.ascontiguousarray(image[:, :WIDTH]) for image in (left, right))
    return [Frame(camera=CAMERA, left=left, right=right, stamp_ns=i * 10**8) for i in range(2)]


def status_mb(name: str) -> float:
    """Return a line of this process's status, in MB."""
    lines = STATUS.read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))


if __name__ == "__main__":
    sys.exit(main())
