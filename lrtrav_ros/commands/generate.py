"""Renders synthetic stereo sequences with exact disparity and ground truth.

DIR becomes a dataset folder: left/, right/, disparity/ (exact, of the left image), gt/ and calib.json.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lrtrav_ros.io.dataset_folder import Frame
    from lrtrav_ros.synthetic.scenes import SceneConfig

BAG_FORMATS = ("mcap", "sqlite3", "rosbag1")

# Option, field of SceneConfig, type, help; the default in brackets is SceneConfig's.
_OPTIONS: tuple[tuple[str, str, Callable[[str], Any], str], ...] = (
    ("--frames", "n_frames", int, "stereo pairs (30)"),
    ("--seed", "seed", int, "makes scene and noise: the same seed gives the same images (0)"),
    ("--style", "style", str, "forest, field, park, road; any: the seed chooses (any)"),
    ("--rate", "rate_hz", float, "frames per second (10)"),
    ("--speed", "speed_m_s", float, "speed of the camera, m/s (2.5)"),
    ("--hfov", "hfov_deg", float, "horizontal field of view, degrees (66)"),
    ("--baseline", "baseline_m", float, "distance of the two cameras, m (0.12)"),
    ("--camera-height", "camera_height_m", float, "height over the ground, m (1)"),
    ("--pitch", "pitch_deg", float, "how far the camera looks down, degrees (8)"),
    ("--roll", "roll_deg", float, "how far it is turned clockwise, degrees (0)"),
    ("--sway", "sway_deg", float, "amplitude of the changes of pitch and roll, degrees (0.6)"),
    ("--undulation", "undulation_m", float, "amplitude of the ground's waves, m; 0 is flat (0.06)"),
    ("--obstacles", "n_obstacles", int, "trees, bushes, rocks, boxes and walls (100)"),
    ("--noise", "noise", float, "standard deviation, grey levels (2)"),
    ("--exposure-difference", "exposure_difference", float, "share by which the right image is brighter (0.04)"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="new or empty folder to write")
    parser.add_argument("--size", type=_size, metavar="WxH", help="size of the images, pixels (640x480)")
    for option, field, kind, text in _OPTIONS:
        parser.add_argument(option, dest=field, type=_checked(field, kind), metavar=_metavar(kind), help=text)
    parser.add_argument("--no-shadows", action="store_true", help="let nothing cast a shadow")
    parser.add_argument(
        "--sequences",
        type=_positive,
        default=1,
        metavar="N",
        help="sequences, with seeds from --seed on; more than one go into folders of their own (1)",
    )
    parser.add_argument(
        "--bag", choices=BAG_FORMATS, help="write a rosbag too: bag/, or stereo.bag for rosbag1, in the folder"
    )


def run(args: argparse.Namespace) -> int:
    """Render and write the sequences; return the exit status."""
    if args.folder.exists() and (not args.folder.is_dir() or any(args.folder.iterdir())):
        raise FileExistsError(f"{args.folder}: exists; give a new or an empty folder")
    first = _scene(args)
    for number in range(args.sequences):
        folder = args.folder / f"sequence_{number:02d}" if args.sequences > 1 else args.folder
        _write_sequence(folder, dataclasses.replace(first, seed=first.seed + number), args.bag)
    print(f"{args.sequences * first.n_frames} frames written to {args.folder}")
    return 0


def _scene(args: argparse.Namespace) -> SceneConfig:
    """Return the scene that the options ask for."""
    from lrtrav_ros.synthetic.scenes import SceneConfig

    fields = [field for _, field, _, _ in _OPTIONS if getattr(args, field) is not None]
    scene = dataclasses.replace(SceneConfig(shadows=not args.no_shadows), **{f: getattr(args, f) for f in fields})
    return dataclasses.replace(scene, width=args.size[0], height=args.size[1]) if args.size else scene


def _write_sequence(folder: Path, scene: SceneConfig, bag: str | None) -> None:
    """Write a sequence as dataset folder, and as rosbag where `bag` names a format."""
    from lrtrav_ros.io.bag_frames import write_stereo_bag
    from lrtrav_ros.io.dataset_folder import write_calibration

    write_calibration(folder, scene.camera, scene.width, scene.height)
    frames = _written(folder, scene)
    if bag:
        write_stereo_bag(folder / ("stereo.bag" if bag == "rosbag1" else "bag"), frames, format=bag)
    for _ in frames:
        pass


def _written(folder: Path, scene: SceneConfig) -> Iterator[Frame]:
    """Render the frames, write each into the dataset folder, and yield it."""
    from tqdm import tqdm

    from lrtrav_ros.io.dataset_folder import write_frame
    from lrtrav_ros.synthetic.scenes import render_sequence

    for item in tqdm(render_sequence(scene), desc=folder.name, total=scene.n_frames, unit="frame", disable=None):
        write_frame(folder, dataclasses.replace(item.frame, disparity=item.disparity), item.truth)
        yield item.frame


def _size(text: str) -> tuple[int, int]:
    """Return width and height of a text such as 640x480."""
    width, separator, height = text.lower().partition("x")
    if not (separator and width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} is no size; write it as 640x480")
    return _checked("width", int)(width), _checked("height", int)(height)


def _positive(text: str) -> int:
    """Return a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number of at least 1")
    return int(text)


def _checked(field: str, kind: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return what reads a field of SceneConfig and refuses what it refuses."""

    def read(text: str) -> Any:
        from lrtrav_ros.synthetic.scenes import SceneConfig

        try:
            value = kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no number") from None
        try:
            dataclasses.replace(SceneConfig(), **{field: value})
        except ValueError as err:
            raise argparse.ArgumentTypeError(str(err)) from err
        return value

    return read


def _metavar(kind: Callable[[str], Any]) -> str:
    """Return what stands for a value of this type in the help."""
    return "N" if kind is int else "X" if kind is float else "NAME"
