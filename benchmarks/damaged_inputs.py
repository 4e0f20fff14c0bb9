#!/usr/bin/env python3
"""What the readers of files make of damaged ones: an error that names the file, or a value; a table of the outcomes.

    python benchmarks/damaged_inputs.py
    python benchmarks/damaged_inputs.py --files 3000 --only mat jpeg
    python benchmarks/damaged_inputs.py --files 700 --jobs 2 --only bags

Files are cut off, have zeros at their end or in a sector, two sectors swapped, or bits flipped. A value that is not
that of the whole file is one that no reader can tell: JPEG, text and uncompressed ``.mat`` have no checksums, nor have
bags but for MCAP. Of a bag all messages are compared, byte for byte: there may be fewer, or others, where that is told.

The exit status is 1 where a reader ends its process, takes more than half a minute or 3 GB, fails in another way than
with an error that names the file, loses messages of a bag silently, or yields altered ones in spite of checksums.
"""

from __future__ import annotations

import argparse
import io
import multiprocessing
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.io import savemat

sys.path += [str(Path(__file__).parents[1] / "test"), str(Path(__file__).parents[1] / "test" / "io")]
from damaged_files import flipped, holed, swapped, truncated, zero_tailed
from small_bags import SMALL_BAGS, SmallBag

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.evaluation.truth.folders_and_bags import read_truth
from lrtrav_ros.evaluation.truth.kitti_road import read_calibration
from lrtrav_ros.evaluation.truth.labels import Labels
from lrtrav_ros.evaluation.truth.mat_arrays import read_arrays
from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.io.dataset_folder import read_camera, write_calibration
from lrtrav_ros.io.image_files import encode_file, read_image
from lrtrav_ros.io.parameter_file import dump_parameters, read_parameter_file

LIMIT_S = 30.0
MEMORY_BYTES = 3 << 30
ALTERED, ALTERED_TOLD = "other value", "fewer or altered, told"
GOOD = ("error", "whole", "whole, damage told", "fewer, told", ALTERED, ALTERED_TOLD)
NOISE = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
IMAGE = cv2.GaussianBlur(NOISE, (0, 0), 3)
KITTI = "P2: 7.2e+02 0 6e+02 4.4e+01 0 7.2e+02 1.7e+02 2e-01 0 0 1 2.7e-03\n"
KITTI += "P3: 7.2e+02 0 6e+02 -3.4e+02 0 7.2e+02 1.7e+02 2e-01 0 0 1 2.7e-03\n"


def calibration() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write_calibration(folder, StereoCamera(fx=500, cx=160, cy=120, baseline_m=0.1), 320, 240)
        return (Path(folder) / "calib.json").read_bytes()


def mat(*, compressed: bool) -> bytes:
    file = io.BytesIO()
    content = {"image": IMAGE[:24, :32], "truth": IMAGE[:24, :32, 0] / 3, "info": {"name": "x", "cells": [1, "b"]}}
    savemat(file, content, do_compression=compressed)
    return file.getvalue()


@dataclass(frozen=True)
class Content:
    """What is read of a file; of a bag, how often each message is, and what is told of damage."""

    value: Any
    messages: Counter[tuple[str, int, bytes]] = field(default_factory=Counter)
    is_told: bool = False


@dataclass(frozen=True)
class Reader:
    """A reader, and the file to damage that is written into a folder for it."""

    read: Callable[[Path], Content]
    file: Path
    has_checksums: bool = False


def of_values(folder: Path, name: str, read: Callable[[Path], Any], make: Callable[[], bytes]) -> Reader:
    (folder / name).write_bytes(make())
    return Reader(lambda path: Content(digest(read(path))), folder / name)


def of_bag(folder: Path, make: Callable[[Path], SmallBag]) -> Reader:
    bag = make(folder)
    return Reader(lambda _: read_bag(bag.path), bag.file, bag.has_checksums)


def read_bag(path: Path) -> Content:
    """Return the messages of a bag, and go through its frames, which may be refused."""
    content = None
    try:
        with StereoBag(path) as bag:
            content = content_of(bag.reader)
            list(bag.items())
    except ValueError as err:
        if str(path) not in str(err):
            raise
    if content is None:
        with BagReader(path) as reader:
            content = content_of(reader)
    return content


def content_of(reader: BagReader) -> Content:
    messages = Counter((message.topic, message.time_ns, message.data) for message in reader.messages())
    return Content(None, messages, bool(reader.problems))


READERS: dict[str, Callable[[Path], Reader]] = {
    name: partial(of_values, name=file, read=read, make=make)
    for name, file, read, make in (
        ("png", "a.png", read_image, lambda: encode_file("a.png", IMAGE)),
        ("png of 16 bits", "a.png", read_image, lambda: encode_file("a.png", IMAGE[..., 0].astype(np.uint16) * 200)),
        (
            "truth",
            "a.png",
            lambda path: read_truth(path, Labels()),
            lambda: encode_file("a.png", IMAGE[..., 0] // 128 * 255),
        ),
        ("jpeg", "a.jpg", read_image, lambda: encode_file("a.jpg", IMAGE)),
        ("calib.json", "calib.json", read_camera, calibration),
        ("kitti", "a.txt", read_calibration, lambda: KITTI.encode()),
        ("parameters", "a.yaml", read_parameter_file, lambda: dump_parameters(Config()).encode()),
        ("mat", "a.mat", read_arrays, lambda: mat(compressed=False)),
        ("mat, compressed", "a.mat", read_arrays, lambda: mat(compressed=True)),
    )
}
BAGS: dict[str, Callable[[Path], Reader]] = {name: partial(of_bag, make=make) for name, make in SMALL_BAGS.items()}


def damaged(whole: bytes, n: int) -> list[bytes]:
    """Return so many damaged files: of each five one is cut off, one has zeros to its end, and one has them inside."""
    step = max(1, 5 * len(whole) // n)
    found = list(chain(truncated(whole, step=step), zero_tailed(whole, step=step), holed(whole, step=step)))[:n]
    found += [swapped(whole, seed) for seed in range(n // 10)]
    found += [flipped(whole, seed, 2 ** (seed % 5)) for seed in range(n - len(found))]
    return [data for data in found if data != whole]


def outcome(reader: Reader, whole: Content) -> str:
    """Return in a few words what comes of reading a damaged file."""
    try:
        found = reader.read(reader.file)
    except (ValueError, OSError) as err:
        names = (reader.file.name, str(reader.file.parent))
        return "error" if any(name in str(err) for name in names) else f"error without name: {err}"
    except Exception as err:
        return f"uncaught {type(err).__name__}: {err}"[:200]
    if found.value != whole.value:
        return ALTERED
    if found.messages == whole.messages:
        return "whole, damage told" if found.is_told else "whole"
    told = "told" if found.is_told else "silent"
    if found.messages <= whole.messages:
        return f"fewer, {told}"
    if reader.has_checksums:
        return f"altered in spite of checksums, {told}"
    if found.is_told:
        return ALTERED_TOLD
    return ALTERED if found.messages.total() >= whole.messages.total() else "fewer and altered, silent"


def digest(value: Any) -> Any:
    """Return what can be compared."""
    if isinstance(value, dict):
        return {name: digest(item) for name, item in value.items()}
    return repr((value.dtype, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value)


def work(name: str, n: int, first: int, results: Connection) -> None:
    """Read the damaged files of a reader from the first one on, and send what comes of each; None before and after."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        reader = {**READERS, **BAGS}[name](Path(folder))
        content, whole = reader.file.read_bytes(), reader.read(reader.file)
        results.send(None)
        for data in damaged(content, n)[first:]:
            reader.file.write_bytes(data)
            results.send(outcome(reader, whole))
    results.send(None)


def outcomes(name: str, n: int) -> Counter[str]:
    """Return how often each outcome is; a process that ends or hangs is started anew after the file that did it."""
    counts: Counter[str] = Counter()
    context = multiprocessing.get_context("spawn")
    while True:
        results, end = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(name, n, counts.total(), end))
        process.start()
        end.close()
        results.recv()  # it is ready, which may take longer on a busy machine
        try:
            while results.poll(LIMIT_S):
                result = results.recv()
                if result is None:
                    process.join()
                    return counts
                counts[result] += 1
            counts["hung"] += 1
            process.kill()
        except EOFError:
            process.join()
            counts[f"dead ({process.exitcode})"] += 1


def line(name: str, n: int) -> tuple[str, int]:
    """Return the line of the table for a reader, and how many outcomes are bad."""
    start = time.perf_counter()
    counts = outcomes(name, n)
    listed = ", ".join(f"{result} {count}" for result, count in counts.most_common())
    text = f"{name:22} {counts.total()} files, {time.perf_counter() - start:.0f} s: {listed}"
    return text, sum(count for result, count in counts.items() if result not in GOOD)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--files", type=int, default=2000, help="damaged files for each reader (%(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="readers that are tried at once (%(default)s)")
    parser.add_argument(
        "--only", nargs="+", metavar="READER", help="those whose names begin with one of these, or `bags` for all bags"
    )
    args = parser.parse_args()
    starts = tuple(args.only or [""])
    names = [name for name in READERS if name.startswith(starts)]
    names += [name for name in BAGS if name.startswith(starts) or "bags" in starts]
    n_bad = 0
    with ThreadPoolExecutor(args.jobs) as pool:
        for text, bad in pool.map(lambda name: line(name, args.files), names):
            print(text, flush=True)
            n_bad += bad
    return 1 if n_bad or not names else 0


if __name__ == "__main__":
    sys.exit(main())
