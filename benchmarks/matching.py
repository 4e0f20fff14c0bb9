#!/usr/bin/env python3
"""Time of ELAS against OpenCV's StereoSGBM: medians of interleaved runs, so that a busy machine slows both alike.

    taskset -c 0 python benchmarks/matching.py --threads 1
    python benchmarks/matching.py LEFT RIGHT --threads 1 2

Without images, a scene of a textured ground, walls and poles is made. Images are cropped to the ratio of each size
that is timed and resized to it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import StereoConfig
from lrtrav_ros.method.matching.elas import Elas

SIZES = ((320, 240), (640, 480), (1280, 720), (1920, 1080))
STEPS = ("_support_points", "_prior", "_match", "_refine")
Image = NDArray[np.uint8]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("images", nargs="*", type=Path, metavar="LEFT RIGHT", help="a rectified pair")
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2], help="threads of ELAS (default: 1 2)")
    parser.add_argument("--runs", type=int, default=21, help="runs of each (default: 21)")
    args = parser.parse_args()
    if len(args.images) not in (0, 2):
        parser.error("give a left and a right image, or none")
    cv2.setNumThreads(1)
    pair = tuple(read(path) for path in args.images) if args.images else make_pair(1280, 960)
    compare(resized(pair, (640, 480)), args.threads, args.runs)
    for half in (False, True):
        print_steps(resized(pair, (640, 480)), half, args.runs)
    for half in (False, True):
        print_growth(pair, half, args.runs)


def compare(pair: tuple[Image, ...], threads: list[int], runs: int) -> None:
    """Print the time of each way to match 640 x 480 pixels, and its ratio to StereoSGBM."""
    sgbm = cv2.StereoSGBM_create(0, 64, 5, 8 * 25, 32 * 25, 1, 63, 10, 200, 1, cv2.STEREO_SGBM_MODE_SGBM)
    ways: dict[str, Callable[[], object]] = {"StereoSGBM, one thread": lambda: sgbm.compute(*pair)}
    for n_threads in threads:
        for half in (False, True):
            elas = Elas(StereoConfig(n_disparities=64, half_resolution=half), threads=n_threads)
            name = f"ELAS, {'half' if half else 'full'} resolution, threads: {n_threads}"
            ways[name] = lambda elas=elas: elas.compute(*pair)
    times = interleaved(list(ways.values()), runs)
    print(f"640 x 480, disparities 0..63 {'ms':>17} {'ratio':>7}")
    for name, row in zip(ways, times, strict=True):
        print(f"{name:36} {1e3 * np.median(row):9.1f} {np.median(row / times[0]):7.2f}")


def interleaved(functions: list[Callable[[], object]], runs: int) -> NDArray[np.float64]:
    """Return the seconds (functions, runs) that each takes, called in turns."""
    times = np.empty((len(functions), runs))
    for run in range(-1, runs):  # the first, which compiles, is overwritten
        for index, function in enumerate(functions):
            start = time.perf_counter()
            function()
            times[index, run] = time.perf_counter() - start
    return times


def print_steps(pair: tuple[Image, ...], half: bool, runs: int) -> None:
    """Print how the time of one thread is divided between the steps."""
    elas = Elas(StereoConfig(n_disparities=64, half_resolution=half))
    spent: dict[str, list[float]] = {name: [] for name in STEPS}
    for name in STEPS:
        setattr(elas, name, timed(getattr(elas, name), spent[name]))
    total = np.median(interleaved([lambda: elas.compute(*pair)], runs))
    steps = {name: sum(values) / (runs + 1) for name, values in spent.items()}
    print(f"\nsteps at {'half' if half else 'full'} resolution, one thread [ms]; mean")
    for name, seconds in steps.items():
        print(f"{name.strip('_').replace('_', ' '):16} {1e3 * seconds:7.2f}")
    print(f"{'descriptors, …':16} {1e3 * max(total - sum(steps.values()), 0):7.2f}")


def timed(function: Callable[..., object], spent: list[float]) -> Callable[..., object]:
    def call(*args: object) -> object:
        start = time.perf_counter()
        result = function(*args)
        spent.append(time.perf_counter() - start)
        return result

    return call


def print_growth(pair: tuple[Image, ...], half: bool, runs: int) -> None:
    """Print time and memory by size, the disparities growing with the width."""
    print(f"\n{'half' if half else 'full'} resolution, one thread: ms, ns per pixel and disparity, MB, bytes per pixel")
    for size in SIZES:
        n_disparities = size[0] // 10
        scaled = resized(pair, size)
        elas = Elas(StereoConfig(n_disparities=n_disparities, half_resolution=half))
        seconds = np.median(interleaved([lambda elas=elas, scaled=scaled: elas.compute(*scaled)], max(runs // 3, 3)))
        pixels = size[0] * size[1]
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            used = pool.apply(memory, (scaled, n_disparities, half))
        print(
            f"{size[0]:5} x {size[1]:4}, 0..{n_disparities - 1:<3} {1e3 * seconds:8.1f} "
            f"{1e9 * seconds / pixels / n_disparities:6.2f} {used / 1e6:7.1f} {used / pixels:6.0f}"
        )


def memory(pair: tuple[Image, ...], n_disparities: int, half: bool) -> int:
    """Return by how many bytes matching makes this process grow."""
    elas = Elas(StereoConfig(n_disparities=n_disparities, half_resolution=half))
    elas.compute(*(image[:40, :80] for image in pair))
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak starts anew
    before = peak_memory()
    elas.compute(*pair)
    return peak_memory() - before


def peak_memory() -> int:
    """Return the most bytes that this process held so far."""
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * int(next(line.split()[1] for line in status if line.startswith("VmHWM:")))


def read(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SystemExit(f"{path} is not an image")
    return image


def resized(pair: tuple[Image, ...], size: tuple[int, int]) -> tuple[Image, ...]:
    """Return the middle of the images, cut to the ratio of `size`, at that size."""
    height, width = pair[0].shape
    crop_h, crop_w = min(height, width * size[1] // size[0]), min(width, height * size[0] // size[1])
    top, start = (height - crop_h) // 2, (width - crop_w) // 2
    return tuple(
        cv2.resize(image[top : top + crop_h, start : start + crop_w], size, interpolation=cv2.INTER_AREA)
        for image in pair
    )


def make_pair(width: int, height: int) -> tuple[Image, Image]:
    """Return a scene as a robot sees it: ground up to the horizon, walls and poles, noise of two scales."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    disparity = np.maximum((v - 0.4 * height) * width / 8 / height, 0.004 * width)
    for _ in range(12):
        near, left = rng.uniform(0.01, 0.08) * width, rng.uniform(0, width)
        foot = 0.4 * height + near * 8 * height / width
        wide = rng.uniform(0.02, 0.15) * width
        box = (abs(u - left) < wide) & (v < foot) & (v > foot - 4 * near) & (disparity < near)
        disparity[box] = near
    right = sum(
        cv2.resize(rng.normal(0, gain, (height // size, width // size)).astype(np.float32), (width, height))
        for size, gain in ((2, 20), (8, 20), (32, 30), (128, 40))
    )
    left_image = cv2.remap(right, u - disparity, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    noisy = (128 + image + rng.normal(0, 2, right.shape) for image in (left_image, right))
    first, second = (np.clip(image, 0, 255).astype(np.uint8) for image in noisy)
    return first, second


if __name__ == "__main__":
    main()
