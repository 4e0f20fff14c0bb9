"""Options that all commands share which detect."""

from __future__ import annotations

import argparse
from pathlib import Path

from lrtrav_ros.config import PRESETS, Config, find_parameter, load_parameters, parameters


def add_detection_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--preset``, ``--params`` and ``--set``, and say in the epilog what can be set."""
    parser.add_argument("--preset", choices=PRESETS, default=PRESETS[0], help="settings to start from (%(default)s)")
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


def config_from(args: argparse.Namespace) -> Config:
    """Return the configuration that the options of `add_detection_options` give.

    Raises
    ------
    FileNotFoundError, ValueError
        If the file cannot be read, a parameter is unknown or a value does not fit.
    """
    config = Config.preset(args.preset)
    if args.params is not None:
        config = config.updated(load_parameters(args.params))
    values = {}
    for setting in args.settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ValueError(f"--set {setting}: write STAGE.FIELD=VALUE, such as stereo.matcher=bm")
        values[name.strip()] = find_parameter(name.strip()).parse(text.strip())
    return config.updated(values)


def _described() -> list[str]:
    return [
        f"  {parameter.name}={parameter.default}  {parameter.range_text}\n      {parameter.description}"
        for parameter in parameters()
    ]
