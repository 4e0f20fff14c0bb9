"""Detects the traversable region in a dataset folder or a rosbag, offline."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import add_detection_options, config_from

if TYPE_CHECKING:
    from lrtrav_ros.config import Config
    from lrtrav_ros.results import ResultFolder

_EXTRAS = "disparity, superpixels, clusters, occupancy, u_disparity, v_disparity, obstacle_disparity, wld"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "input", type=Path, metavar="INPUT", help="dataset folder, or rosbag (.bag, .mcap, .db3, folder)"
    )
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.add_argument("--save", default="", metavar="LIST", help=f"what to save besides: all, or out of {_EXTRAS}")
    parser.add_argument("--overwrite", action="store_true", help="replace an output folder that exists, when finished")
    add_detection_options(parser)


def run(args: argparse.Namespace) -> int:
    """Detect in all frames; frames that cannot be used are skipped, counted and reported."""
    config = config_from(args)

    from lrtrav_ros.results import EXTRAS, ResultFolder, output_folder

    extras = list(EXTRAS) if args.save == "all" else [name.strip() for name in args.save.split(",") if name.strip()]
    with (
        output_folder(args.output, overwrite=args.overwrite) as path,
        ResultFolder(path, config, extras=extras) as results,
    ):
        n_done, problems = detect_all(args.input, config, results)
    for problem in problems:
        print(problem, file=sys.stderr)
    skipped = f", {len(problems)} problems" if problems else ""
    print(f"{n_done} frames{skipped}: {args.output}")
    return 0 if n_done else 1


def detect_all(path: Path, config: Config, results: ResultFolder) -> tuple[int, list[str]]:
    """Write what is found in each frame of a folder or bag; return the number of frames and what went wrong."""
    from tqdm import tqdm

    from lrtrav_ros.detector import Detector
    from lrtrav_ros.sequences import open_sequence

    n_done = 0
    problems = []
    detector = None
    with open_sequence(path, config.source) as sequence:
        for frame in tqdm(sequence.frames(), total=len(sequence), unit="frame", disable=None):
            if detector is None or detector.camera != frame.camera:
                detector = Detector(config, frame.camera)
            try:
                detection = detector.detect(frame.left, frame.right, disparity=frame.disparity, depth_m=frame.depth_m)
            except ValueError as err:
                problems.append(f"frame {frame.name}: {err}")
                results.write_problem(frame.name, str(err))
                continue
            results.write(frame.name, detection, frame.camera)
            n_done += 1
        return n_done, [*sequence.problems, *problems]
