"""Options that all commands share which detect."""

from __future__ import annotations

import argparse
from pathlib import Path

from lrtrav_ros.config import (
    PRESETS,
    Config,
    find_parameter,
    load_parameters,
    parameters,
)


def add_detection_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--preset``, ``--params`` and ``--set``, and say in the epilog what can be set."""
    parser.add_argument("--preset", choices=PRESETS, default=PRESETS[0], help="settings to start from (%(default)s)")
    add_setting_options(parser)


def add_setting_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--params`` and ``--set``, and say in the epilog what can be set."""
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help="YAML file of parameters, the same as for the nodes"
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
        metavar="ADDRESS",
        help="Dask scheduler, such as tcp://host:8786, whose workers are used instead; "
        "they see the inputs under the same paths (needs lrtrav_ros[cluster])",
    )


def _jobs(text: str) -> int:
    """Return a number of processes; argparse reports a ValueError as wrong usage."""
    if int(text) < 0:
        raise ValueError
    return int(text)


def config_from(args: argparse.Namespace) -> Config:
    """Return the configuration that the options of `add_detection_options` give.

    Raises
    ------
    FileNotFoundError, ValueError
        If the file cannot be read, a parameter is unknown or a value does not fit.
    """
    return Config.preset(args.preset).updated(settings_from(args))


def settings_from(args: argparse.Namespace) -> dict[str, object]:
    """Return the parameters that the options of `add_setting_options` give, by full name; raises as `config_from`."""
    values = {} if args.params is None else load_parameters(args.params)
    for setting in args.settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ValueError(f"--set {setting}: write STAGE.FIELD=VALUE, such as stereo.matcher=bm")
        values[name.strip()] = find_parameter(name.strip()).parse(text.strip())
    return values


def _described() -> list[str]:
    return [
        f"  {parameter.name}={parameter.default}  {parameter.range_text}\n      {parameter.description}"
        for parameter in parameters()
    ]
