"""Detects the traversable region in dataset folders and rosbags, offline."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import (
    add_detection_options,
    add_parallel_options,
    config_from,
    topic_remap,
)
from lrtrav_ros.commands.usage_error import UsageError

if TYPE_CHECKING:
    from lrtrav_ros.config import Config
    from lrtrav_ros.offline.detection import Outcome

_EXTRAS = (
    "disparity, superpixels, clusters, occupancy, confidence, grid, u_disparity, v_disparity, obstacle_disparity, wld"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "inputs",
        type=Path,
        nargs="+",
        metavar="INPUT",
        help="dataset folder, or rosbag (.bag, .mcap, .db3, folder; compressed with zstd or not); several can be given",
    )
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder to write to; with several inputs, one subfolder for each, named after it",
    )
    parser.add_argument(
        "--save", default="", metavar="LIST", help=f"what else to save: all, or a comma-separated list of {_EXTRAS}"
    )
    parser.add_argument(
        "--output-bag",
        type=Path,
        metavar="OUT.mcap",
        help="write all outputs as messages too, beside those of the rosbag INPUT, under the names that the nodes "
        "publish; for Foxglove and `ros2 bag`",
    )
    parser.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="FROM:=TO",
        help="take the rosbag's topic FROM for the input TO, such as /zed/left/color:=left/image_rect, in place of the "
        "one that is found by its name; can be repeated",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace outputs that exist, when finished")
    add_parallel_options(parser)
    add_detection_options(parser)


def run(args: argparse.Namespace) -> int:
    """Detect in all frames; frames that cannot be used are skipped, counted and reported."""
    config = config_from(args)
    extras, topics = _extras(args.save, config), _topics(args.remap)

    from lrtrav_ros.io.result_folder import output_folder
    from lrtrav_ros.offline.detection import detect_recording

    _check_order(args, config)
    names = output_names(args.inputs)
    _check_inputs(args.inputs, args.output)
    if args.output_bag is not None:
        _check_output_bag(args.output_bag, args.inputs, overwrite=args.overwrite)
    failures = []
    with _terminable(), output_folder(args.output, overwrite=args.overwrite) as output:
        for path, name in zip(args.inputs, names, strict=True):
            try:
                outcome = detect_recording(
                    path,
                    output / name,
                    config,
                    extras=extras,
                    output_bag=_moved(args.output_bag, args.output, output),
                    topics=topics,
                    jobs=args.jobs,
                    cluster=args.cluster,
                )
                _report(path, args.output / name, outcome)
            except ValueError as err:
                failures.append(str(err))
        if len(failures) == len(names):
            raise ValueError("; ".join(failures))
    for failure in failures:
        print(failure, file=sys.stderr)
    return 1 if failures else 0


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM end the block as Ctrl-C does, so that nothing temporary stays, decompressed bags above all."""
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _topics(remaps: Sequence[str]) -> dict[str, str]:
    """Return the topic for each input that is named."""
    try:
        return {name.strip("/"): topic for topic, name in map(topic_remap, remaps)}
    except ValueError as err:
        raise UsageError(str(err)) from err


def _extras(text: str, config: Config) -> tuple[str, ...]:
    """Return what is named to be saved besides."""
    from lrtrav_ros.io.result_folder import available_extras, checked_extras

    if text == "all":
        return available_extras(config)
    try:
        return checked_extras(list(filter(None, map(str.strip, text.split(",")))), config)
    except ValueError as err:
        raise UsageError(f"--save {text}: {err}") from err


def _check_order(args: argparse.Namespace, config: Config) -> None:
    """Raise UsageError where the options do not detect frames in the order that the memory needs."""
    from lrtrav_ros.offline.detection import check_order

    try:
        check_order(config, jobs=args.jobs, cluster=args.cluster)
    except ValueError as err:
        raise UsageError(str(err)) from err


def _check_inputs(inputs: Sequence[Path], output: Path) -> None:
    """Raise OSError or ValueError where an input cannot be worked on, before the work begins."""
    for path in inputs:
        if not path.exists():
            raise FileNotFoundError(f"{path}: there is no such folder or file")
        if path.resolve().is_relative_to(output.resolve()):
            raise ValueError(f"--output {output} holds the input {path}; choose another folder")


def _check_output_bag(path: Path, inputs: Sequence[Path], *, overwrite: bool) -> None:
    """Raise where no bag can be made of the inputs, or it cannot be written; before the work begins."""
    from lrtrav_ros.io.recording import is_dataset_folder

    if path.suffix != ".mcap":
        raise UsageError(f"--output-bag {path}: give a file that ends in .mcap")
    if len(inputs) > 1:
        raise UsageError(f"--output-bag {path}: is for one input; run detect for each of the {len(inputs)} inputs")
    if is_dataset_folder(inputs[0]):
        raise UsageError(f"--output-bag {path}: {inputs[0]} is a dataset folder, which has no messages; give a rosbag")
    if path.resolve().is_relative_to(inputs[0].resolve()):
        raise UsageError(f"--output-bag {path}: is in the input {inputs[0]}; choose another place")
    if path.exists() and not (overwrite and path.is_file()):
        raise FileExistsError(f"{path} exists; choose another name" + ("" if path.is_dir() else " or give --overwrite"))


def _moved(path: Path | None, folder: Path, written: Path) -> Path | None:
    """Return where to write a file that may lie in a folder, which is written under another name until finished."""
    if path is None or not path.resolve().is_relative_to(folder.resolve()):
        return path
    return written / path.resolve().relative_to(folder.resolve())


def _report(path: Path, output: Path, outcome: Outcome) -> None:
    """Say what came of an input; raises ValueError where nothing did."""
    for problem in outcome.problems:
        print(problem, file=sys.stderr)
    if not outcome.n_done:
        raise ValueError(f"{path}: none of its {outcome.n_skipped} frames could be used")
    counts = [f"{outcome.n_done} frames"]
    if outcome.n_skipped:
        counts.append(f"{outcome.n_skipped} skipped")
    if outcome.n_without_ground:
        counts.append(f"{outcome.n_without_ground} without ground in sight")
    print(f"{', '.join(counts)}: {output}")


def output_names(inputs: Sequence[Path]) -> list[str]:
    """Return a folder's name for each input; none is needed for one input.

    It is the input's own name, with those of the folders around it where several inputs have the same.

    Raises
    ------
    ValueError
        If an input is given twice, or only the suffix tells two apart.
    """
    if len(inputs) == 1:
        return [""]
    paths = [path.resolve() for path in inputs]
    parts = [(*path.parts[1:-1], path.stem if path.is_file() else path.name) for path in paths]
    for n in range(1, max(map(len, parts)) + 1):
        names = ["_".join(part[-n:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    twice = next(path for i, path in enumerate(inputs) if parts[i] in parts[:i])
    raise ValueError(f"{twice}: is given twice, or beside one that differs in its suffix alone; run them one by one")
