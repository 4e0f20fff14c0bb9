"""What a run has finished, noted while it runs, so that the next one can go on where it was interrupted."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from lrtrav_ros.io.atomic_files import named_errors, write_all, write_bytes

JOURNAL_FILE = ".unfinished"
"""The file in an output folder that is there as long as the folder is not finished."""

_UNREADABLE = ("its journal, which another version wrote or which is damaged",)
_READ_BYTES = 1 << 20
_BAG = b'{"bag": true}'


@dataclass(frozen=True, slots=True)
class FinishedFrame:
    """A frame whose files are written.

    Attributes
    ----------
    part : str
        The folder in the output folder that it is in, that of its input; empty where there is one input.
    name : str
        The frame's name.
    row : dict of str to str
        Its row of the table, by column.
    checksums : dict of str to int
        CRC-32 of its files, by their paths in the part: a power loss can leave some empty.
    """

    part: str
    name: str
    row: dict[str, str]
    checksums: dict[str, int]

    def is_whole(self, folder: Path) -> bool:
        """Return whether all files are as they were written to an output folder."""
        return all(_checksum(folder / self.part / path) == crc for path, crc in self.checksums.items())


class RunJournal:
    """The journal of a run: what its results depend on, and which frames are finished.

    Parameters
    ----------
    folder : Path
        The output folder; it is there, locked, and empty or has a journal of this identity.
    identity : mapping of str to str
        All that the results depend on, by names for the user.
    keeps : bool
        Whether frames that were finished before need not be done again.

    Attributes
    ----------
    folder : Path
        Where to write.
    has_bag : bool
        Whether the run's output bag was finished before.
    is_empty : bool
        Whether no frame is finished.
    """

    def __init__(self, folder: Path, identity: Mapping[str, str], *, keeps: bool = True) -> None:
        self.folder = folder
        self._path = folder / JOURNAL_FILE
        self.is_empty = not any(_frames_in(self._path))
        before = list(_whole(_frames_in(self._path), folder)) if keeps else []
        self._finished: dict[str, list[FinishedFrame]] = {}
        for frame in before:
            self._finished.setdefault(frame.part, []).append(frame)
        self.has_bag = _BAG in _lines_of(self._path)
        # A last line that was cut off is dropped.
        lines = [{"identity": dict(identity)}, *map(asdict, before)]
        write_bytes(self._path, b"".join([*map(_line, lines), *([_BAG + b"\n"] if self.has_bag else [])]))
        self._file = os.open(self._path, os.O_WRONLY | os.O_APPEND)

    def close(self) -> None:
        """Close the file, so that the run can be resumed."""
        os.close(self._file)

    def part(self, name: str = "") -> JournalPart:
        """Return the journal of one input."""
        return JournalPart(self, name, tuple(self._finished.get(name, ())))

    def note(self, frame: FinishedFrame) -> None:
        """Note a frame whose files are written."""
        self.is_empty = False
        self._append(_line(asdict(frame)))

    def note_bag(self) -> None:
        """Note that the output bag is about to get its name: what is there afterwards is this run's."""
        self._append(_BAG + b"\n")

    def _append(self, line: bytes) -> None:
        with named_errors(self._path):
            write_all(self._file, line)


@dataclass(frozen=True, slots=True)
class JournalPart:
    """The journal of one input: `finished` are the frames that were finished before, the first ones of the input."""

    journal: RunJournal
    name: str
    finished: tuple[FinishedFrame, ...]

    @property
    def folder(self) -> Path:
        """The folder of the input's results."""
        return self.journal.folder / self.name

    def note(self, name: str, files: Mapping[str, bytes], *, row: Mapping[str, str] | None = None) -> None:
        """Note a frame whose files, by their paths in the folder, are written."""
        checksums = {path: zlib.crc32(data) for path, data in files.items()}
        self.journal.note(FinishedFrame(self.name, name, dict(row or {}), checksums))


def changes_since(path: Path, identity: Mapping[str, str]) -> Collection[str]:
    """Return what differs from the identity in a journal, for the user; nothing where the run can be resumed."""
    try:
        earlier = json.loads(_lines_of(path)[0])["identity"]
        names = list(dict.fromkeys([*identity, *earlier]))
        changed = [name for name in names if earlier.get(name) != identity.get(name)]
        return [_change(name, earlier.get(name), identity.get(name)) for name in changed]
    except (IndexError, KeyError, TypeError, AttributeError, ValueError):
        return _UNREADABLE


def _change(name: str, before: str | None, now: str | None) -> str:
    """Return what changed; digests, whose names begin with an article, say nothing to the user."""
    return name if name.startswith("the ") else f"{name}: {before or 'none'} -> {now or 'none'}"


def _lines_of(path: Path) -> list[bytes]:
    return path.read_bytes().splitlines() if path.exists() else []


def _line(values: Mapping[str, object]) -> bytes:
    return json.dumps(values).encode() + b"\n"


def _frames_in(path: Path) -> Iterator[FinishedFrame]:
    """Yield the frames of a journal up to the first line that is damaged."""
    for line in _lines_of(path)[1:]:
        if line == _BAG:
            continue
        try:
            yield FinishedFrame(**json.loads(line))
        except (TypeError, ValueError):
            return


def _whole(frames: Iterable[FinishedFrame], folder: Path) -> Iterator[FinishedFrame]:
    """Yield of each part the frames up to the first one that is not whole."""
    ended: set[str] = set()
    for frame in frames:
        if frame.part not in ended and frame.is_whole(folder):
            yield frame
        else:
            ended.add(frame.part)


def _checksum(path: Path) -> int | None:
    """Return the CRC-32 of a file; None where there is none that can be read."""
    checksum = 0
    try:
        with path.open("rb") as file:
            while block := file.read(_READ_BYTES):
                checksum = zlib.crc32(block, checksum)
    except OSError:
        return None
    return checksum
