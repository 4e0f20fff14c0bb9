"""Scores methods on frames with ground truth: the paper's Table I on any dataset, with a report."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import (
    add_parallel_options,
    add_setting_options,
    check_output,
    output_folder_path,
    settings_from,
)
from lrtrav_ros.commands.reporting import print_result, report, warn
from lrtrav_ros.commands.usage_error import UsageError

if TYPE_CHECKING:
    from lrtrav_ros.evaluation.scoring.evaluation_folder import EvaluationFolder, Resumption
    from lrtrav_ros.evaluation.scoring.methods import Method
    from lrtrav_ros.evaluation.scoring.score_records import Summary
    from lrtrav_ros.evaluation.truth.opening import NamedSet, ReaderOptions

_METHODS = "uv_disparity, proposed, colour_only, texture_only, random_centres, robust, near_to_far, near_to_far_fused"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "datasets",
        type=Path,
        nargs="*",
        metavar="DATASET",
        help="dataset folder with gt/, KITTI Road, folder of .mat files with calib.json (LAGR), or rosbag with --truth",
    )
    parser.add_argument(
        "--output",
        type=output_folder_path,
        metavar="DIR",
        help="folder to write to; an interrupted run resumes there. Results that the code or a setting has changed "
        "since are moved into DIR/superseded-N, and computed anew",
    )
    parser.add_argument("--methods", metavar="LIST", help=f"comma-separated list of {_METHODS}; by default all")
    parser.add_argument(
        "--study",
        choices=("texture", "distance"),
        help="compare texture descriptors, or distances between histograms, in the methods named (proposed)",
    )
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="runs of random_centres (%(default)s)")
    parser.add_argument(
        "--save-masks",
        action="store_true",
        help="keep each method's masks, in masks/SET/METHOD/, and measure how much they flicker between frames",
    )
    _add_reading_options(parser)
    add_parallel_options(parser)
    add_setting_options(parser)


def _add_reading_options(parser: argparse.ArgumentParser) -> None:
    """Describe how datasets are read."""
    parser.add_argument(
        "--unknown",
        choices=("ignore", "not-traversable"),
        default="",
        help="what unknown pixels of the truth count as (not-traversable for .mat files, as in the paper; else ignore)",
    )
    parser.add_argument(
        "--labels",
        type=_labels,
        metavar="T,N,U",
        help="values of traversable, not traversable and unknown in the truth (255,0,128; 0,1,2 for .mat files)",
    )
    parser.add_argument(
        "--truth", type=Path, metavar="DIR", help="ground truth of a rosbag, NAME.png by header stamp (gt/ beside it)"
    )
    parser.add_argument(
        "--field",
        action="append",
        default=[],
        metavar="FIELD=NAME",
        dest="fields",
        help="name of an array in .mat files: image=im_rgb, right=im_rgb_right, disparity=im_disparity, "
        "depth=im_depth, truth=manual_human_labeling_mask; or layout=columns|rows, disparity_scale=1; can be repeated",
    )
    parser.add_argument("--inspect", type=Path, metavar="FILE", help="list the arrays of a .mat file and exit")


def _labels(text: str) -> tuple[int, int, int]:
    """Return three labels; raises what argparse reports."""
    try:
        traversable, not_traversable, unknown = map(int, text.split(","))
    except ValueError as err:
        raise argparse.ArgumentTypeError(f"{text!r} are not three whole numbers; write them as 255,0,128") from err
    return traversable, not_traversable, unknown


def run(args: argparse.Namespace) -> int:
    """Evaluate, write the results and print the table; frames that cannot be used are counted and named."""
    if args.inspect is not None:
        return _inspect(args.inspect)
    if not args.datasets or args.output is None:
        raise UsageError("give at least one DATASET, and --output DIR; see --help")
    return _evaluate(args, settings_from(args))


def _inspect(path: Path) -> int:
    from lrtrav_ros.evaluation.truth.mat_files import describe

    print_result(*describe(path))
    return 0


def _evaluate(args: argparse.Namespace, values: dict[str, object]) -> int:
    """Evaluate with these parameters; return the exit status."""
    from lrtrav_ros.evaluation.report.output_files import write_configs, write_results
    from lrtrav_ros.evaluation.scoring.evaluation_folder import EvaluationFolder, check_place, evaluate_frames
    from lrtrav_ros.evaluation.scoring.evaluation_identity import evaluation_identity
    from lrtrav_ros.evaluation.scoring.frame_evaluation import make_setup
    from lrtrav_ros.evaluation.truth.opening import open_sets
    from lrtrav_ros.io.folder_lock import locked_folder

    with _wrong_usage():
        reading, methods = _reader_options(args, values), _methods(args)
        setup = make_setup(methods, values, n_seeds=args.seeds, save_masks=args.save_masks)
    sets = open_sets(args.datasets, reading)
    check_output(args.output, args.datasets)
    check_place(args.output)
    with locked_folder(args.output):
        folder = EvaluationFolder(args.output, evaluation_identity(setup, reading, sets=sets, unknown=args.unknown))
        _print_superseded(folder)
        write_configs(methods, values, folder)
        resumption = evaluate_frames(sets, setup, folder, unknown=args.unknown, jobs=args.jobs, cluster=args.cluster)
        _print_resumption(resumption)
        summary = write_results(sets, setup, folder, unknown=args.unknown, jobs=args.jobs, cluster=args.cluster)
        os.sync()
    _print(summary)
    report(f"\n{args.output}/report.html, scores.csv, summary.json, times.csv")
    is_whole = _print_damage(sets)
    return 0 if summary.results and is_whole else 1


@contextmanager
def _wrong_usage() -> Iterator[None]:
    """Raise UsageError where an option's value is refused."""
    try:
        yield
    except ValueError as err:
        raise UsageError(str(err)) from err


def _methods(args: argparse.Namespace) -> list[Method]:
    """Return the methods that are named, or the usual ones; with --study, their variants."""
    from lrtrav_ros.evaluation.scoring.methods import DEFAULT_METHODS, choose_methods
    from lrtrav_ros.evaluation.scoring.studies import study_methods

    if args.methods is None:
        names = ["proposed"] if args.study else list(DEFAULT_METHODS)
    else:
        names = [name.strip() for name in args.methods.split(",") if name.strip()]
    methods = choose_methods(names)
    return study_methods(methods, args.study) if args.study else methods


def _reader_options(args: argparse.Namespace, values: dict[str, object]) -> ReaderOptions:
    from lrtrav_ros.config import Config
    from lrtrav_ros.evaluation.truth.labels import Labels
    from lrtrav_ros.evaluation.truth.mat_files import MatFields
    from lrtrav_ros.evaluation.truth.opening import ReaderOptions

    fields = []
    for setting in args.fields:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ValueError(f"--field {setting}: write FIELD=NAME, such as disparity=im_disparity")
        fields.append((name.strip(), text.strip()))
    return ReaderOptions(
        source=Config().updated(values).source,
        truth=args.truth,
        labels=None if args.labels is None else Labels(*args.labels),
        fields=MatFields.parsed(fields),
    )


def _print_superseded(folder: EvaluationFolder) -> None:
    """Say on standard error which earlier results are kept aside, and why they do not count any more."""
    if folder.superseded is not None:
        lines = [f"{folder.path}: these have changed since the earlier run:"]
        lines += [f"  {change}" for change in folder.superseded.changes]
        lines += [f"starting afresh; the earlier results are kept in {folder.superseded.path}"]
        warn(*lines)


def _print_resumption(resumption: Resumption) -> None:
    """Say on standard error what an earlier run had finished."""
    if resumption.n_kept:
        warn(f"{resumption.n_kept} frames were finished before")
    if resumption.n_changed:
        warn(f"frames evaluated again, because their files have changed: {resumption.n_changed}")


def _print_damage(sets: Sequence[NamedSet]) -> bool:
    """Say on standard error what of the rosbags is damaged; return whether nothing is."""
    from lrtrav_ros.evaluation.truth.folders_and_bags import LabelledBag

    problems = [problem for item in sets if isinstance(item.frames, LabelledBag) for problem in item.frames.problems()]
    warn(*problems)
    return not problems


def _print(summary: Summary) -> None:
    """Print the tables, and on standard error what went wrong."""
    from lrtrav_ros.evaluation.report.tables import band_table, obstacle_table, score_table
    from lrtrav_ros.method.ground import NO_GROUND

    if summary.results:
        report("", *score_table(summary), "", *band_table(summary), "", *obstacle_table(summary))
    for item in summary.sets:
        for failed in item.errors:
            warn(f"{item.name}/{failed.frame}: {failed.error}")
        if item.n_without_truth:
            warn(f"{item.name}: {item.n_without_truth} frames have no ground truth")
    for result in summary.results:
        if result.gave_up:
            frames = ", ".join(result.gave_up)
            warn(f"{result.set}, {result.method}: {NO_GROUND} in {frames}")
