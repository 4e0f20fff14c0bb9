"""What results depend on besides the frames themselves, so that a change can be detected and named."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path

from lrtrav_ros.config import Config

PACKAGE = Path(__file__).parents[1]
LIBRARIES = ("numpy", "scipy", "cv2", "numba")
"""The libraries that compute; a new version may round differently."""

_WITHOUT_INFLUENCE = ("benchmark", "commands", "evaluation", "nodes")
_INPUT_FOLDERS = ("", "left", "right", "disparity", "depth", "calib")


def detection_identity(
    inputs: Sequence[Path], config: Config, *, extras: Sequence[str], topics: Mapping[str, str], output_bag: Path | None
) -> dict[str, str]:
    """Return all that the results of a detection depend on, by names for the user.

    Parameters
    ----------
    inputs : sequence of Path
        The recordings. Their files count by name, size and time of change.
    config : Config
        All settings.
    extras, topics, output_bag
        As `detection.detect_recording` takes them.
    """
    return {
        "the command": "detect",
        **{f"the files of {path.absolute()}": files_digest(_input_files(path)) for path in inputs},
        "the inputs": json.dumps([str(path.absolute()) for path in inputs]),
        "--save": ", ".join(extras),
        "--remap": ", ".join(f"{topic}:={name}" for name, topic in topics.items()),
        "--output-bag": "" if output_bag is None else str(output_bag.absolute()),
        **{name: str(value) for name, value in config.values().items()},
        **code_identity(),
    }


def code_identity() -> dict[str, str]:
    """Return what the results of ``detect`` and ``generate`` depend on, of the code and the libraries."""
    return {"the code of lrtrav_ros": code_digest(PACKAGE, without=_WITHOUT_INFLUENCE), **library_versions(LIBRARIES)}


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the versions of libraries by the names of their modules."""
    return {name: import_module(name).__version__ for name in names}


def files_digest(files: Iterable[Path]) -> str:
    """Return what tells whether files have changed: a digest of their sizes and times of change."""
    stamps = []
    for file in files:
        if file.exists():
            status = file.stat()
            stamps.append((file.name, status.st_size, status.st_mtime_ns))
    return hashlib.sha256(json.dumps(stamps).encode()).hexdigest()[:16]


def code_digest(package: Path, *, without: Collection[str]) -> str:
    """Return a digest of a package's sources.

    Parameters
    ----------
    package : Path
        The package's folder.
    without : collection of str
        Folders in it that no result depends on.
    """
    digest = hashlib.sha256()
    for name, source in sorted(_sources(package, "", without)):
        digest.update(f"{name} {len(source)}\n".encode())
        digest.update(source)
    return digest.hexdigest()


def _sources(folder: Path, prefix: str, without: Collection[str]) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of each module."""
    for item in folder.iterdir():
        if item.is_dir() and item.name not in without:
            yield from _sources(item, f"{prefix}{item.name}/", without)
        elif item.name.endswith(".py"):
            yield f"{prefix}{item.name}", item.read_bytes()


def _input_files(path: Path) -> list[Path]:
    """Return the files of a recording; an output folder in a dataset folder is none of it."""
    if not path.is_dir():
        return [path]
    folders = [path / name for name in _INPUT_FOLDERS]
    return [item for folder in folders if folder.is_dir() for item in sorted(folder.iterdir()) if item.is_file()]
