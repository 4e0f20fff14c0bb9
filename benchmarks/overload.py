#!/usr/bin/env python3
"""Latency of the running `detector` when three times as many frames come as it can process; it needs ROS.

    python benchmarks/overload.py
    python benchmarks/overload.py --sizes 640x480 --times 1 3 10 --set threads=1

Frames come one by one first, and the rate that fits is what their time allows; then at multiples of that. Latency is
from the publication of a frame's last image to the receipt of its mask. A frame time is the median that the node takes
for a frame, by its diagnostics; the long range takes its image when the short range begins with the frame, and waits
for what that finds.
"""

from __future__ import annotations

import argparse

from lrtrav_ros.benchmark.workload import disparities_for, synthetic_frames
from lrtrav_ros.commands.options import add_detection_options, config_from
from lrtrav_ros.config import Config
from lrtrav_ros.nodes.measurement import NodesFigures, measure_nodes

ONE_BY_ONE_HZ = 2.0
NODES = ("short_range", "long_range")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_detection_options(parser)
    parser.add_argument(
        "--sizes", nargs="+", default=["1280x960", "640x480", "320x240"], help="WxH (1280x960 640x480 320x240)"
    )
    parser.add_argument("--times", nargs="+", type=float, default=[3.0], help="multiples of the rate that fits (3)")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement (10)")
    args = parser.parse_args()
    values, defaults = config_from(args).values(), Config().values()
    changed = {name: value for name, value in values.items() if value != defaults[name]}
    print("size        node          in Hz  out Hz  frame ms  median ms   99 % ms  in frame times")
    for size in args.sizes:
        width, height = map(int, size.split("x"))
        frames = synthetic_frames(width, height, 4)
        settings = {"stereo.n_disparities": disparities_for(width), **changed}
        for node in NODES:
            alone = measure_nodes(frames, settings, rate_hz=ONE_BY_ONE_HZ, seconds=args.seconds, node=node)
            fits_hz = 1e3 / alone.frame_ms
            for times in args.times:
                figures = measure_nodes(frames, settings, rate_hz=times * fits_hz, seconds=args.seconds, node=node)
                print(f"{size:11} {node:12} {row(figures)}", flush=True)


def row(figures: NodesFigures) -> str:
    """Return what was measured as a row of the table."""
    median_ms, p99_ms, frame_ms = figures.latency_median_ms, figures.latency_p99_ms, figures.frame_ms
    return (
        f"{figures.rate_in_hz:6.1f} {figures.rate_out_hz:7.1f} {frame_ms:9.1f} {median_ms:10.1f} {p99_ms:9.1f} "
        f"{median_ms / frame_ms:7.2f} {p99_ms / frame_ms:7.2f}"
    )


if __name__ == "__main__":
    main()
