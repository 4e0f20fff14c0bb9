"""Measures time per stage, frames per second and memory, beside others' programs in the same run."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from lrtrav_ros.commands.options import add_detection_options, config_from, image_size, positive_integer
from lrtrav_ros.commands.reporting import print_result
from lrtrav_ros.commands.usage_error import UsageError
from lrtrav_ros.config import Config
from lrtrav_ros.io.parameter_file import read_parameter_file

if TYPE_CHECKING:
    from lrtrav_ros.benchmark.figures import Figures, NodesRun
    from lrtrav_ros.benchmark.workload import Workload
    from lrtrav_ros.frame import Frame

_T = TypeVar("_T")

_SIZE = (640, 480)
_THREADS = (1, 2)
_RATES_HZ = (10, 30, 60)
_DESCRIPTION = """\
Measures time per stage, frames per second and memory, beside others' programs in the same run: OpenCV's StereoSGBM
(block size 5, five directions, one thread), to which all times are set in relation, and StereoBM; scikit-image's SLIC
and scikit-learn's spectral clustering where they are installed. All take turns, frame by frame.
"""
_EPILOG = """\
The first of --sizes is the one at which numbers of superpixels are compared, the first of --superpixels the one with
which sizes are. Matching has 64 disparities at 640 pixels of width, and in proportion at others, unless
stereo.n_disparities is set.

"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "--input", type=Path, metavar="INPUT", help="dataset folder or rosbag; if not given, synthetic scenes"
    )
    parser.add_argument(
        "--sizes", type=_several(image_size), metavar="WxH,…", help="of synthetic images (640x480); 320x240,1280x720"
    )
    parser.add_argument("--superpixels", type=_several(positive_integer), metavar="N,…", help="numbers of superpixels")
    parser.add_argument(
        "--threads",
        type=_several(positive_integer),
        metavar="N,…",
        help="numbers of threads for whole frames (1,2; or what `threads` is set to)",
    )
    parser.add_argument("--frames", type=positive_integer, default=8, metavar="N", help="frames to use (%(default)s)")
    parser.add_argument(
        "--rounds", type=positive_integer, default=3, metavar="N", help="times that each is detected (%(default)s)"
    )
    parser.add_argument(
        "--ros",
        type=_several(positive_integer),
        nargs="?",
        const=_RATES_HZ,
        metavar="HZ,…",
        help="measure the running nodes instead, at these rates (10,30,60), and at the last with disparity given",
    )
    parser.add_argument(
        "--seconds", type=positive_integer, default=10, metavar="S", help="how long for, with --ros (%(default)s)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to a file as well")
    parser.add_argument(
        "--chart", type=Path, metavar="FILE", help="draw how time grows with sizes and superpixels (.svg)"
    )
    add_detection_options(parser)
    parser.description = _DESCRIPTION
    parser.epilog = f"{_EPILOG}{parser.epilog}"


def run(args: argparse.Namespace) -> int:
    """Measure, and print tables."""
    config = config_from(args)
    _check(args)
    _check_files(args)
    threads = _threads(args, config)
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, str(max(threads)))  # read when NumPy is imported, below

    figures = _of_nodes(args, config) if args.ros else _of_stages(args, config, threads)
    from lrtrav_ros.benchmark.table import table

    _write(args, figures)
    print_result(*table(figures))
    return 0


def _several(parse: Callable[[str], _T]) -> Callable[[str], tuple[_T, ...]]:
    """Return a parser of values between commas, each of which counts once."""
    return lambda text: tuple(dict.fromkeys(parse(part) for part in text.split(",")))


def _check(args: argparse.Namespace) -> None:
    """Raise UsageError for options that do not go together."""
    given = _given(args)
    if args.input and args.sizes:
        raise UsageError("--sizes is for synthetic images; leave it out with --input")
    for option, name in (("threads", "threads"), ("superpixels", "superpixels.n_superpixels")):
        if getattr(args, option) and name in given:
            raise UsageError(f"--{option} and the parameter {name} are both given; leave out one of them")
    if args.chart is None:
        return
    if args.chart.suffix != ".svg":
        raise UsageError(f"--chart {args.chart}: give a name that ends in .svg")
    if args.ros or (len(args.sizes or ()) < 2 and len(args.superpixels or ()) < 2):
        raise UsageError("--chart shows how time grows; give several --sizes or --superpixels, and not --ros")


def _check_files(args: argparse.Namespace) -> None:
    """Raise OSError where a file cannot be written, before the measuring."""
    from lrtrav_ros.io.atomic_files import check_writable

    for path in (args.json, args.chart):
        if path is not None:
            check_writable(path)


def _given(args: argparse.Namespace) -> set[str]:
    """Return the names of the parameters that are set."""
    in_file = read_parameter_file(args.params).values if args.params else {}
    return {*in_file, *(assignment.partition("=")[0].strip() for assignment in args.settings)}


def _threads(args: argparse.Namespace, config: Config) -> Sequence[int]:
    """Return the numbers of threads to measure with."""
    return args.threads or ((config.n_threads,) if "threads" in _given(args) else _THREADS)


def _of_stages(args: argparse.Namespace, config: Config, threads: Sequence[int]) -> Figures:
    from lrtrav_ros.benchmark.figures import Figures, measure, this_machine

    workloads = list(_workloads(args, config))
    return Figures(machine=this_machine(), workloads=measure(workloads, threads, rounds=args.rounds))


def _of_nodes(args: argparse.Namespace, config: Config) -> Figures:
    try:
        import lrtrav_ros.nodes.measurement  # noqa: F401
    except ImportError as err:
        raise RuntimeError(
            f"--ros: {err}; source the setup.bash of ROS 2, or pip install 'ros-jazzy-rclpy[fastrtps]'"
        ) from err
    from lrtrav_ros.benchmark.figures import Figures, this_machine

    numbers = args.threads or (config.threads,)
    runs = tuple(
        run
        for workload in _workloads(args, config)
        for threads in numbers
        for run in _node_runs(workload, threads, args)
    )
    return Figures(machine=this_machine(), nodes=runs)


def _node_runs(workload: Workload, threads: int, args: argparse.Namespace) -> Iterator[NodesRun]:
    """Yield what is measured of the nodes at each rate, and at the last with disparity in place of right images."""
    from lrtrav_ros.benchmark.figures import measure_nodes
    from lrtrav_ros.benchmark.workload import matched

    config = workload.config.updated({"threads": threads})
    for rate_hz in args.ros:
        yield measure_nodes(workload.frames, config, rate_hz=rate_hz, seconds=args.seconds)
    if workload.is_stereo:
        frames = [matched(frame, config) for frame in workload.frames]
        yield measure_nodes(frames, config, rate_hz=args.ros[-1], seconds=args.seconds)


def _workloads(args: argparse.Namespace, config: Config) -> Iterator[Workload]:
    """Yield the frames and settings to measure with."""
    from lrtrav_ros.benchmark.workload import Workload, disparities_for

    sizes = args.sizes or (_SIZE,)
    numbers = args.superpixels or (config.superpixels.n_superpixels,)
    has_disparities = "stereo.n_disparities" in _given(args)
    for i, size in enumerate(sizes):
        frames = _frames(args, config, size)
        for n_superpixels in numbers if i == 0 else numbers[:1]:
            values = {"superpixels.n_superpixels": n_superpixels}
            if not has_disparities:
                values["stereo.n_disparities"] = disparities_for(frames[0].shape[1])
            try:
                yield Workload(frames, config.updated(values))
            except ValueError as err:
                raise UsageError(str(err)) from err


def _frames(args: argparse.Namespace, config: Config, size: tuple[int, int]) -> tuple[Frame, ...]:
    """Return the frames of the input, or synthetic ones of a size."""
    if args.input is None:
        from lrtrav_ros.benchmark.workload import synthetic_frames

        try:
            return synthetic_frames(*size, args.frames)
        except ValueError as err:
            raise UsageError(f"--sizes: {err}") from err
    from lrtrav_ros.io.recording import open_recording

    with open_recording(args.input, config.source) as recording:
        frames = tuple(islice(recording.frames(), args.frames))
    if not frames:
        raise ValueError(f"{args.input}: none of its frames can be used; `lrtrav detect` says why")
    return frames


def _write(args: argparse.Namespace, figures: Figures) -> None:
    """Write the files that are asked for."""
    from lrtrav_ros.io.atomic_files import write_bytes

    if args.json is not None:
        write_bytes(args.json, figures.to_json())
    if args.chart is not None:
        from lrtrav_ros.benchmark.chart import growth_chart

        write_bytes(args.chart, growth_chart(figures.workloads).encode())
