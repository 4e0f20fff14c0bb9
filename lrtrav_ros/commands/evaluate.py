"""Scores methods on frames with ground truth: the paper's Table I on any dataset, with a report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import add_parallel_options, add_setting_options, settings_from

if TYPE_CHECKING:
    from lrtrav_ros.evaluation.scoring.methods import Method
    from lrtrav_ros.evaluation.scoring.score_records import Summary
    from lrtrav_ros.evaluation.truth.opening import ReaderOptions

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
        "--output", type=Path, metavar="DIR", help="folder to write to; one that was interrupted is gone on with"
    )
    parser.add_argument(
        "--methods", metavar="LIST", help=f"out of {_METHODS}; all but the last one where none are named"
    )
    parser.add_argument(
        "--study",
        choices=("texture", "distance"),
        help="compare texture descriptors, or distances between histograms, in the methods named (proposed)",
    )
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="runs of random_centres (%(default)s)")
    parser.add_argument("--save-masks", action="store_true", help="keep each method's masks, in masks/SET/METHOD/")
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
    parser.add_argument("--inspect", type=Path, metavar="FILE", help="list the arrays of a .mat file, and do no more")


def run(args: argparse.Namespace) -> int:
    """Evaluate, write the results and print the table; frames that cannot be used are counted and named."""
    if args.inspect is not None:
        return _inspect(args.inspect)
    if not args.datasets or args.output is None:
        print("evaluate: give at least one DATASET, and --output DIR; see --help", file=sys.stderr)
        return 2
    values = settings_from(args)

    from lrtrav_ros.evaluation.report.output_files import write_configs, write_results
    from lrtrav_ros.evaluation.scoring.evaluation_folder import RunFolder, run_frames, run_identity
    from lrtrav_ros.evaluation.scoring.frame_evaluation import make_setup
    from lrtrav_ros.evaluation.truth.opening import open_sets

    options = _reader_options(args, values)
    sets = open_sets(args.datasets, options)
    methods = _methods(args)
    setup = make_setup(methods, values, n_seeds=args.seeds, save_masks=args.save_masks)
    folder = RunFolder(args.output, run_identity(setup, unknown=args.unknown, reading=repr(options)))
    if folder.was_discarded:
        print(f"{args.output}: the configuration has changed; starting afresh", file=sys.stderr)
    write_configs(methods, values, folder)
    n_kept = run_frames(sets, setup, folder, unknown=args.unknown, jobs=args.jobs, cluster=args.cluster)
    if n_kept:
        print(f"{n_kept} frames were finished before", file=sys.stderr)
    summary = write_results(sets, setup, folder, unknown=args.unknown, jobs=args.jobs, cluster=args.cluster)
    _print(summary)
    print(f"\n{args.output}/report.html, scores.csv, summary.json, times.csv")
    return 0 if summary.results else 1


def _inspect(path: Path) -> int:
    from lrtrav_ros.evaluation.truth.mat_files import describe

    print("\n".join(describe(path)))
    return 0


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


def _labels(text: str) -> tuple[int, int, int]:
    """Return three labels; argparse reports a ValueError as wrong usage."""
    traversable, not_traversable, unknown = map(int, text.split(","))
    return traversable, not_traversable, unknown


def _print(summary: Summary) -> None:
    """Print the tables, and on standard error what went wrong."""
    from lrtrav_ros.evaluation.report.tables import band_table, score_table
    from lrtrav_ros.method.ground import NO_GROUND

    if summary.results:
        print("\n".join(["", *score_table(summary), "", *band_table(summary)]))
    for item in summary.sets:
        for failed in item.errors:
            print(f"{item.name}/{failed.frame}: {failed.error}", file=sys.stderr)
        if item.n_without_truth:
            print(f"{item.name}: {item.n_without_truth} frames have no ground truth", file=sys.stderr)
    for result in summary.results:
        if result.gave_up:
            frames = ", ".join(result.gave_up)
            print(f"{result.set}, {result.method}: {NO_GROUND} in {frames}", file=sys.stderr)
