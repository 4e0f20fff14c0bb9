"""Renders synthetic stereo sequences with exact disparity and ground truth.

DIR becomes a dataset folder: left/, right/, disparity/ (exact, of the left image), gt/, height/ (over the ground, in
millimetres) and calib.json.
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from lrtrav_ros.commands.options import image_size, output_folder_path, positive_integer
from lrtrav_ros.commands.reporting import report, warn
from lrtrav_ros.config import Parameter, Value, settings_of
from lrtrav_ros.synthetic.scene_config import SceneConfig

if TYPE_CHECKING:
    from lrtrav_ros.frame import Frame
    from lrtrav_ros.io.run_journal import JournalPart

BAG_FORMATS = ("mcap", "sqlite3", "rosbag1")

_SETTINGS = settings_of(SceneConfig)
_METAVARS = {int: "N", float: "X", str: "NAME"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    width, height = _SETTINGS["width"].default, _SETTINGS["height"].default
    parser.add_argument(
        "folder",
        type=output_folder_path,
        metavar="DIR",
        help="new or empty folder to write; an interrupted run resumes there",
    )
    parser.add_argument("--size", type=_size, metavar="WxH", help=f"size of the images, pixels ({width}x{height})")
    for field, parameter in _SETTINGS.items():
        if parameter.option:
            _add_option(parser, field, parameter)
    parser.add_argument("--no-shadows", action="store_true", help="let nothing cast a shadow")
    parser.add_argument(
        "--sequences",
        type=positive_integer,
        default=1,
        metavar="N",
        help="sequences, with seeds from --seed on; more than one go into folders of their own (1)",
    )
    parser.add_argument(
        "--bag", choices=BAG_FORMATS, help="write a rosbag too: bag/, or stereo.bag for rosbag1, in the folder"
    )


def _add_option(parser: argparse.ArgumentParser, field: str, parameter: Parameter) -> None:
    """Add the option of a setting; its value is the setting's default where it is not given."""
    default = f"{parameter.default:g}" if isinstance(parameter.default, float) else str(parameter.default)
    parser.add_argument(
        parameter.option,
        dest=field,
        type=_reader(parameter),
        default=parameter.default,
        metavar=_METAVARS[parameter.type],
        help=f"{parameter.description}; {parameter.range_text} ({default})",
    )


def run(args: argparse.Namespace) -> int:
    """Render and write the sequences; return the exit status."""
    from lrtrav_ros.io.output_folder import output_folder

    first = _scene(args)
    n_kept = 0
    with output_folder(args.folder, _identity(args, first), can_overwrite=False, keeps=not args.bag) as journal:
        for number in range(args.sequences):
            part = journal.part(f"sequence_{number:02d}" if args.sequences > 1 else "")
            _write_sequence(part, dataclasses.replace(first, seed=first.seed + number), args.bag)
            n_kept += len(part.finished)
    if n_kept:
        warn(f"{n_kept} frames were finished before")
    report(f"{args.sequences * first.n_frames} frames written to {args.folder}")
    return 0


def _identity(args: argparse.Namespace, scene: SceneConfig) -> dict[str, str]:
    """Return all that the files depend on."""
    from lrtrav_ros.offline.run_identity import code_identity

    settings = {field: str(value) for field, value in dataclasses.asdict(scene).items()}
    options = {"--sequences": str(args.sequences), "--bag": args.bag or ""}
    return {"the command": "generate", **settings, **options, **code_identity()}


def _scene(args: argparse.Namespace) -> SceneConfig:
    """Return the scene that the options ask for."""
    given = {field: getattr(args, field) for field, parameter in _SETTINGS.items() if parameter.option}
    scene = SceneConfig(shadows=not args.no_shadows, **given)
    return dataclasses.replace(scene, width=args.size[0], height=args.size[1]) if args.size else scene


def _write_sequence(journal: JournalPart, scene: SceneConfig, bag: str | None) -> None:
    """Write a sequence as dataset folder, and as rosbag where `bag` names a format."""
    from lrtrav_ros.io.bag_writer import write_stereo_bag
    from lrtrav_ros.io.dataset_folder import write_calibration

    write_calibration(journal.folder, scene.camera, scene.width, scene.height)
    frames = _written(journal, scene)
    if bag:
        path = journal.folder / ("stereo.bag" if bag == "rosbag1" else "bag")
        _remove(path)
        write_stereo_bag(path, frames, format=bag)
    for _ in frames:
        pass


def _remove(path: Path) -> None:
    """Remove a bag, that of a run that was interrupted later on."""
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)


def _written(journal: JournalPart, scene: SceneConfig) -> Iterator[Frame]:
    """Render the frames that were not finished before, write each into the dataset folder, and yield it."""
    from tqdm import tqdm

    from lrtrav_ros.io.atomic_files import write_bytes
    from lrtrav_ros.io.dataset_folder import frame_files
    from lrtrav_ros.synthetic.rendering import render_sequence

    total, first = scene.n_frames, len(journal.finished)
    rendered = render_sequence(scene, first=first)
    for item in tqdm(rendered, desc=journal.name or None, total=total, initial=first, unit="frame", disable=None):
        files = frame_files(item.frame, truth=item.truth, disparity=item.disparity, height_m=item.height_m)
        for path, data in files.items():
            write_bytes(journal.folder / path, data)
        journal.note(item.frame.name, files)
        yield item.frame


def _size(text: str) -> tuple[Value, Value]:
    """Return width and height of a text such as 640x480."""
    width, height = image_size(text)
    return _reader(_SETTINGS["width"])(str(width)), _reader(_SETTINGS["height"])(str(height))


def _reader(parameter: Parameter) -> Callable[[str], Value]:
    """Return a function that reads the value of a setting, and refuses what the setting refuses."""

    def read(text: str) -> Value:
        try:
            return parameter.parse(text)
        except ValueError as err:
            raise argparse.ArgumentTypeError(str(err)) from err

    return read
