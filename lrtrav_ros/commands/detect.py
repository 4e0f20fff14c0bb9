"""Detects the traversable region in dataset folders and rosbags, offline."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import (
    add_detection_options,
    add_parallel_options,
    check_output,
    config_from,
    output_folder_path,
    topic_remap,
)
from lrtrav_ros.commands.reporting import report, warn
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
        type=output_folder_path,
        required=True,
        metavar="DIR",
        help="folder to write to; with several inputs, one subfolder for each, named after it. An interrupted run "
        "resumes there, unless inputs, settings or code have changed",
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
    """Detect in all frames; return the exit status, which is 1 where something of an input is damaged.

    Frames that cannot be used are skipped, counted and reported.
    """
    config = config_from(args)
    extras, topics = _extras(args.save, config), _topics(args.remap)

    from lrtrav_ros.io.output_folder import output_folder
    from lrtrav_ros.offline.detection import can_keep_frames, detect_recording
    from lrtrav_ros.offline.run_identity import detection_identity

    _check_order(args, config)
    names = output_names(args.inputs)
    _check_inputs(args.inputs)
    check_output(args.output, args.inputs)
    if args.output_bag is not None:
        _check_output_bag(args.output_bag, args.inputs)
    identity = detection_identity(args.inputs, config, extras=extras, topics=topics, output_bag=args.output_bag)
    keeps = can_keep_frames(config, output_bag=args.output_bag)
    outcomes: dict[Path, Outcome] = {}
    failures = []
    try:
        with output_folder(args.output, identity, overwrite=args.overwrite, keeps=keeps) as journal:
            if args.output_bag is not None:
                _check_is_new(args.output_bag, overwrite=args.overwrite or journal.has_bag)
            for path, name in zip(args.inputs, names, strict=True):
                try:
                    outcomes[path] = detect_recording(
                        path,
                        journal.folder / name,
                        config,
                        extras=extras,
                        output_bag=_moved(args.output_bag, args.output, journal.folder),
                        topics=topics,
                        jobs=args.jobs,
                        cluster=args.cluster,
                        journal=journal.part(name),
                    )
                except ValueError as err:
                    failures.append(str(err))
                else:
                    failures += _failure(path, outcomes[path])
            if len(failures) == len(names):
                raise ValueError("; ".join(failures))
    finally:  # what is printed comes when the folder is finished, or as far as it got
        for path, name in zip(args.inputs, names, strict=True):
            if path in outcomes:
                _report(args.output / name, outcomes[path])
    damaged = [path for path, outcome in outcomes.items() if outcome.is_damaged]
    warn(*failures, *(f"{path}: is damaged; what could be read of it is done" for path in damaged))
    return 1 if failures or damaged else 0


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


def _check_inputs(inputs: Sequence[Path]) -> None:
    """Raise FileNotFoundError where an input is not there, before the work begins."""
    for path in inputs:
        if not path.exists():
            raise FileNotFoundError(f"{path}: there is no such folder or file")


def _check_output_bag(path: Path, inputs: Sequence[Path]) -> None:
    """Raise UsageError where no bag can be made of the inputs; before the work begins."""
    from lrtrav_ros.io.recording import is_dataset_folder

    if path.suffix != ".mcap":
        raise UsageError(f"--output-bag {path}: give a file that ends in .mcap")
    if len(inputs) > 1:
        raise UsageError(f"--output-bag {path}: is for one input; run detect for each of the {len(inputs)} inputs")
    if is_dataset_folder(inputs[0]):
        raise UsageError(f"--output-bag {path}: {inputs[0]} is a dataset folder, which has no messages; give a rosbag")
    if path.resolve().is_relative_to(inputs[0].resolve()):
        raise UsageError(f"--output-bag {path}: is in the input {inputs[0]}; choose another place")


def _check_is_new(path: Path, *, overwrite: bool) -> None:
    """Raise FileExistsError where a file is there that is not to be replaced."""
    if path.exists() and not (overwrite and path.is_file()):
        remedy = "choose another name" + (" or give --overwrite" if path.is_file() else "")
        raise FileExistsError(f"{path} exists; {remedy}")


def _moved(path: Path | None, folder: Path, written: Path) -> Path | None:
    """Return where to write a file that may lie in a folder, which is written under another name until finished."""
    if path is None or not path.resolve().is_relative_to(folder.resolve()):
        return path
    return written / path.resolve().relative_to(folder.resolve())


def _failure(path: Path, outcome: Outcome) -> list[str]:
    """Return a line where nothing came of an input."""
    return [] if outcome.n_done else [f"{path}: none of its {outcome.n_skipped} frames could be used"]


def _report(output: Path, outcome: Outcome) -> None:
    """Say what came of an input."""
    if outcome.n_kept:
        warn(f"{outcome.n_kept} frames were finished before")
    warn(*outcome.problems)
    if not outcome.n_done:
        return
    counts = [f"{outcome.n_done} frames"]
    if outcome.n_skipped:
        counts.append(f"{outcome.n_skipped} skipped")
    if outcome.n_without_ground:
        counts.append(f"{outcome.n_without_ground} without ground in sight")
    report(f"{', '.join(counts)}: {output}")


def output_names(inputs: Sequence[Path]) -> list[str]:
    """Return a folder's name for each input, see `recording.distinct_names`; none is needed for one input.

    Raises
    ------
    ValueError
        If an input is given twice, or only the suffix tells two apart.
    """
    from lrtrav_ros.io.recording import distinct_names

    if len(inputs) == 1:
        return [""]
    paths = [path.resolve() for path in inputs]
    parts = [(*path.parts[1:-1], path.stem if path.is_file() else path.name) for path in paths]
    for i, path in enumerate(inputs):
        if parts[i] in parts[:i]:
            raise ValueError(
                f"{path}: is given twice, or beside one that differs in its suffix alone; run them one by one"
            )
    return distinct_names(parts)
