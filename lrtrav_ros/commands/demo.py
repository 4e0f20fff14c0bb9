"""Shows all of it: renders a stereo sequence, replays it through both nodes over DDS, scores and draws the masks."""

from __future__ import annotations

import argparse
import ctypes
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lrtrav_ros.commands.options import output_folder_path, positive_integer
from lrtrav_ros.commands.reporting import report, warn
from lrtrav_ros.commands.usage_error import UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from lrtrav_ros.nodes.image_collector import ImageCollector
    from lrtrav_ros.synthetic.rendering import SyntheticFrame

_TOPICS = (
    "short_range/occupancy",
    "short_range/mask",
    "long_range/occupancy",
    "long_range/mask",
    "long_range/superpixels",
    "long_range/clusters",
    "long_range/grid",
)
_MASKS = ("short_range", "long_range")
_TRUSTED_M = 10.0  # as far as a small stereo camera sees; what lies beyond is for the long range
_QUIET = ("--log-level", "error")  # the nodes would say that no images come while these are rendered
_START_S = 300.0  # kernels are compiled at the first start, which takes minutes on a small computer
_END_S = 10.0
_PR_SET_PDEATHSIG = 1  # of Linux' prctl
_VIDEO_RATE_HZ = 10.0
_SILENCE_S = 5.0  # after which no more masks come, once the replay has ended


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "--output",
        type=output_folder_path,
        default=Path("demo"),
        metavar="DIR",
        help="folder to write (%(default)s)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an output folder that exists, when finished")
    parser.add_argument(
        "--frames", type=positive_integer, default=30, metavar="N", help="stereo pairs to render (%(default)s)"
    )
    parser.add_argument("--style", default="park", help="of the scene: forest, field, park or road (%(default)s)")
    parser.add_argument("--seed", type=int, default=6, help="makes the scene (%(default)s)")
    parser.add_argument(
        "--rate", type=float, default=0.5, help="speed of the replay; its sequence has 10 Hz (%(default)s)"
    )


def run(args: argparse.Namespace) -> int:
    """Run the demonstration; it fails where no mask came back."""
    from lrtrav_ros.io.output_folder import output_folder
    from lrtrav_ros.offline.run_identity import code_identity
    from lrtrav_ros.synthetic.scene_config import SceneConfig

    if not args.rate > 0:
        raise UsageError(f"--rate is {args.rate:g}; give a number above 0")
    try:
        scene = SceneConfig(style=args.style, seed=args.seed, n_frames=args.frames, pitch_deg=5.0)
    except ValueError as err:
        raise UsageError(str(err)) from err
    identity = {"the command": "demo", "--rate": f"{args.rate:g}", "scene": str(scene), **code_identity()}
    with output_folder(args.output, identity, overwrite=args.overwrite, keeps=False) as journal:
        path = journal.folder
        for name in ("bag", *_MASKS):
            shutil.rmtree(path / name, ignore_errors=True)  # of a run that was interrupted
        with _process("detector", "--ros-args", "-r", f"__ns:={_namespace()}", *_parameters()) as detector:
            frames = _render(scene, path / "bag")
            results = _replay(path / "bag", detector, n_frames=len(frames), rate=args.rate)
        scored = [frame for frame in frames if len(results.get(_stamp(frame), {})) == len(_TOPICS)]
        if not scored:
            raise RuntimeError("no masks came back from the nodes; look for their messages above")
        _write(path, scored, results)
    report(*_table(scored, len(frames), results))
    report(f"\nin {args.output}: overlay.mp4, stages.jpg, grid.jpg, masks in long_range")
    return 0


def _namespace() -> str:
    """A namespace of this process's own: a detector that runs on the same machine is left alone."""
    return f"/lrtrav_demo_{os.getpid()}"


def _parameters() -> Iterator[str]:
    """Yield the detector's parameters as ROS arguments."""
    yield from (*_QUIET, "-p", f"source.max_depth_m:={_TRUSTED_M}", "-p", "stereo.n_disparities:=64")
    for side in ("left", "right"):
        # Best effort, which suits a camera, would lose frames where shared memory is small.
        yield from ("-p", f"qos_overrides.{_namespace()}/{side}/image_rect.subscription.reliability:=reliable")


@contextmanager
def _process(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run ``lrtrav ARGUMENTS``; at the end, or when this process is killed, it is interrupted, as by Ctrl-C."""
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    end_with_parent = partial(ctypes.CDLL(None).prctl, _PR_SET_PDEATHSIG, signal.SIGINT)
    command = [sys.executable, "-m", "lrtrav_ros", *arguments]
    process = subprocess.Popen(command, env=environment, preexec_fn=end_with_parent)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _render(scene: Any, bag: Path) -> list[SyntheticFrame]:
    from tqdm import tqdm

    from lrtrav_ros.io.bag_writer import write_stereo_bag
    from lrtrav_ros.synthetic.rendering import render_sequence

    frames = list(tqdm(render_sequence(scene), total=scene.n_frames, desc="render", unit="frame", disable=None))
    write_stereo_bag(bag, (frame.frame for frame in frames))
    return frames


def _replay(bag: Path, detector: subprocess.Popen[bytes], *, n_frames: int, rate: float) -> dict[int, dict[str, Any]]:
    """Replay the bag through the running detector; return the images that come back, by stamp and topic."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    from tqdm import tqdm

    from lrtrav_ros.nodes.image_collector import ImageCollector

    with ImageCollector(_TOPICS, namespace=_namespace()) as collector:
        warn("waiting for the detector; its first start compiles kernels")
        if not collector.spin_until(
            lambda: collector.publishers_are_there() or detector.poll() is not None, timeout_s=_START_S
        ):
            raise RuntimeError(f"the detector was not ready within {_START_S:.0f} s")
        deadline = time.monotonic() + _START_S + n_frames / rate
        with (
            _process("replay", str(bag), "--rate", str(rate), "--ros-args", "-r", f"__ns:={_namespace()}") as replay,
            tqdm(total=n_frames, desc="detect", unit="frame", disable=None) as bar,
        ):
            n_done = 0  # not the bar's count, which stands still where no bar is shown
            while n_done < n_frames and time.monotonic() < deadline:
                collector.spin_until(partial(_more_than, collector, n_done), timeout_s=_SILENCE_S)
                n_new = collector.n_complete() - n_done
                bar.update(n_new)
                n_done += n_new
                if not n_new and (detector.poll() is not None or replay.poll() is not None):
                    break
        return dict(collector.images)


def _more_than(collector: ImageCollector, n: int) -> bool:
    return collector.n_complete() > n


def _stamp(frame: SyntheticFrame) -> int:
    stamp_ns = frame.frame.stamp_ns
    return 0 if stamp_ns is None else stamp_ns


def _write(path: Path, frames: Sequence[SyntheticFrame], results: dict[int, dict[str, Any]]) -> None:
    """Write masks, pictures and the video."""
    from tqdm import tqdm

    from lrtrav_ros.io.image_files import write_image
    from lrtrav_ros.io.pictures import stages_picture

    for frame in tqdm(frames, desc="write", unit="frame", disable=None):
        for mask in _MASKS:
            write_image(path / mask / f"{frame.frame.name}.png", results[_stamp(frame)][f"{mask}/mask"])
    _write_video(path / "overlay.mp4", [_side_by_side(frame, results[_stamp(frame)]) for frame in frames])
    middle = frames[len(frames) // 2]
    images = results[_stamp(middle)]
    write_image(path / "grid.jpg", _with_grid(middle, images))
    picture = stages_picture(
        middle.frame.image,
        short_range=images["short_range/occupancy"],
        superpixels=images["long_range/superpixels"],
        clusters=images["long_range/clusters"],
        long_range=images["long_range/occupancy"],
        truth=middle.truth,
    )
    write_image(path / "stages.jpg", picture)


def _write_video(path: Path, pictures: Sequence[NDArray[np.uint8]]) -> None:
    """Write a video of pictures of one size, whole or not at all; raises OSError where OpenCV cannot."""
    import cv2

    from lrtrav_ros.io.atomic_files import scratch_folder

    height, width = pictures[0].shape[:2]
    with scratch_folder(path) as folder:
        unfinished = folder / path.name
        video = cv2.VideoWriter(str(unfinished), cv2.VideoWriter.fourcc(*"mp4v"), _VIDEO_RATE_HZ, (width, height))
        try:
            for picture in pictures:
                video.write(picture)
        finally:
            video.release()
        # OpenCV says nothing where the disk is full.
        if cv2.VideoCapture(str(unfinished)).get(cv2.CAP_PROP_FRAME_COUNT) != len(pictures):
            raise OSError(f"{path}: cannot be written as a video; OpenCV has no MPEG-4 encoder or the disk is full")
        unfinished.replace(path)


def _side_by_side(frame: SyntheticFrame, images: dict[str, Any]) -> NDArray[np.uint8]:
    import numpy as np

    from lrtrav_ros.io.pictures import colour_image

    return np.hstack([colour_image(frame.frame.image), _with_grid(frame, images)])


def _with_grid(frame: SyntheticFrame, images: dict[str, Any]) -> NDArray[np.uint8]:
    """Return what was found in a frame, in the image and on the ground."""
    from lrtrav_ros.io.pictures import overlay, overlay_beside_grid

    drawn = overlay(frame.frame.image, images["short_range/occupancy"], images["long_range/occupancy"])
    return overlay_beside_grid(drawn, images["long_range/grid"])


def _table(frames: Sequence[SyntheticFrame], n_sent: int, results: dict[int, dict[str, Any]]) -> list[str]:
    from lrtrav_ros.evaluation.scoring.scores import mean_scores, score

    lines = [f"\n{len(frames)} of {n_sent} frames detected", f"{'mask':12} {'precision':>9} {'recall':>7} {'RMSE':>7}"]
    for mask in _MASKS:
        mean = mean_scores([score(results[_stamp(frame)][f"{mask}/mask"], frame.truth) for frame in frames])
        lines.append(f"{mask:12} {mean.precision:9.3f} {mean.recall:7.3f} {mean.rmse:7.3f}")
    return lines
