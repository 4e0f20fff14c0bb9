"""Options shared by all commands that detect."""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

from lrtrav_ros.commands.reporting import warn
from lrtrav_ros.commands.usage_error import UsageError
from lrtrav_ros.config import PRESETS, Config, Value, find_parameter, parameters
from lrtrav_ros.io.parameter_file import ParameterFile, read_parameter_file

_ADDRESS = re.compile(r"((tcp|tls|ws|wss)://)?([^\s/:]+|\[[0-9a-fA-F:.]+\]):(?P<port>\d{1,5})")

_MOST = 1_000_000
_MOST_JOBS = 1024


def add_detection_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--preset``, ``--params`` and ``--set``, and say in the epilog what can be set."""
    parser.add_argument(
        "--preset",
        choices=PRESETS,
        help=f"settings to start from (the preset that --params names, else {PRESETS[0]})",
    )
    add_setting_options(parser)


def add_setting_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--params`` and ``--set``, and say in the epilog what can be set."""
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="ROS 2 parameter file, the same as for the nodes (--params-file)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="STAGE.FIELD=VALUE",
        dest="settings",
        help="one parameter, such as stereo.matcher=bm; can be repeated, and wins over --params",
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = f"parameters, with the values of --preset {PRESETS[0]}:\n" + "\n".join(_described())


def add_parallel_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--jobs`` and ``--cluster``."""
    parser.add_argument(
        "--jobs", type=_jobs, default=1, metavar="N", help="processes; 0 for as many as there are processors (1)"
    )
    parser.add_argument(
        "--cluster",
        type=_address,
        metavar="ADDRESS",
        help="Dask scheduler, such as tcp://host:8786, whose workers are used instead; "
        "they see the inputs under the same paths (needs lrtrav_ros[cluster])",
    )


def topic_remap(text: str) -> tuple[str, str]:
    """Return both topics of ``FROM:=TO``; raises ValueError where it is none."""
    topic, separator, name = text.partition(":=")
    if not topic or not separator or not name:
        raise ValueError(f"--remap {text}: write FROM:=TO, such as /cam0/image_raw:=left/image_rect")
    return topic, name


def output_folder_path(text: str) -> Path:
    """Return the path of a folder to write; raises what argparse reports for none, which Path takes for ``.``."""
    if not text:
        raise argparse.ArgumentTypeError("no folder is named; give its name, or . for the working directory")
    return Path(text)


def check_output(output: Path, inputs: Sequence[Path]) -> None:
    """Raise ValueError where an output folder holds an input, or is in one of a dataset folder's own folders."""
    from lrtrav_ros.io.dataset_folder import OWN_FOLDERS

    place = output.resolve()
    for path in inputs:
        if path.resolve().is_relative_to(place):
            raise ValueError(f"--output {output} holds the input {path}; choose another folder")
        if any(place.is_relative_to(path.resolve() / name) for name in OWN_FOLDERS):
            raise ValueError(f"--output {output} is, or is in, a folder of the input {path}; choose another folder")


def positive_integer(text: str) -> int:
    """Return a whole number from 1 to a million; raises what argparse reports."""
    if not _is_number(text, 1, _MOST):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 to {_MOST}")
    return int(text)


def _is_number(text: str, low: int, high: int) -> bool:
    """Return whether a text is a whole number in a range; Python refuses to read thousands of digits."""
    return text.isdecimal() and len(text) <= len(str(high)) and low <= int(text) <= high


def image_size(text: str) -> tuple[int, int]:
    """Return width and height of a text such as 640x480; raises what argparse reports."""
    width, separator, height = text.lower().partition("x")
    if not (separator and _is_number(width, 0, _MOST) and _is_number(height, 0, _MOST)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a size; write it as 640x480")
    return int(width), int(height)


def _jobs(text: str) -> int:
    """Return a number of processes; raises what argparse reports."""
    if not _is_number(text, 0, _MOST_JOBS):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a number of processes; give 1 to {_MOST_JOBS}, or 0 for one on each processor"
        )
    return int(text)


def _address(text: str) -> str:
    """Return the address of a scheduler; raises what argparse reports. Dask tries what is none for long."""
    match = _ADDRESS.fullmatch(text)
    if match is None or not 0 < int(match["port"]) < 1 << 16:
        raise argparse.ArgumentTypeError(f"{text!r} is no address of a scheduler; write it as tcp://host:8786")
    return text


def config_from(args: argparse.Namespace, *, defaults: Mapping[str, Value] | None = None) -> Config:
    """Return the configuration that the options of `add_detection_options` give.

    Parameters
    ----------
    args : argparse.Namespace
        The options.
    defaults : mapping of str to value, optional
        Parameters by full name that take the place of the preset's, where neither file nor ``--set`` gives them.

    Raises
    ------
    UsageError
        If the file cannot be read, a parameter is unknown or a value does not fit.
    """
    file = _parameter_file(args)
    missing = {name: value for name, value in (defaults or {}).items() if name not in file.values}
    return file.config(args.preset or "").updated(missing).updated(_set_values(args))


def settings_from(args: argparse.Namespace) -> dict[str, object]:
    """Return the parameters that the options of `add_setting_options` give, by full name.

    The file's preset is not included: commands without ``--preset`` choose their presets themselves.

    Raises
    ------
    UsageError
        As `config_from` does.
    """
    return {**_parameter_file(args).values, **_set_values(args)}


def _parameter_file(args: argparse.Namespace) -> ParameterFile:
    """Read the file of ``--params``; names in it that belong to other packages' nodes are reported."""
    if args.params is None:
        return ParameterFile()
    try:
        file = read_parameter_file(args.params)
    except (OSError, ValueError) as err:
        raise UsageError(f"--params: {err}") from err
    if file.foreign:
        warn(f"--params: {args.params}: not for this package, ignored: {', '.join(file.foreign)}")
    return file


def _set_values(args: argparse.Namespace) -> dict[str, Value]:
    """Return the parameters of ``--set``."""
    values = {}
    for assignment in args.settings:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise UsageError(f"--set {assignment}: write STAGE.FIELD=VALUE, such as stereo.matcher=bm")
        try:
            values[name.strip()] = find_parameter(name.strip()).parse(text.strip())
        except ValueError as err:
            raise UsageError(f"--set {assignment}: {err}") from err
    return values


def _described() -> list[str]:
    """Return the lines that say of each parameter what it is and may be."""
    lines = []
    for parameter in parameters():
        lines.append(f"  {parameter.name}={parameter.default}  {parameter.range_text}")
        lines += textwrap.wrap(parameter.description, 112, initial_indent=" " * 6, subsequent_indent=" " * 6)
    return lines
