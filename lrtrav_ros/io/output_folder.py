"""The folder that a run writes to: of one run at a time, whole when it is finished, and resumed until it is."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from lrtrav_ros.io.atomic_files import hidden_name, is_leftover, remove_leftovers, write_bytes
from lrtrav_ros.io.folder_lock import LOCK_FILE, locked_folder
from lrtrav_ros.io.run_journal import JOURNAL_FILE, RunJournal, changes_since

_LONGEST_NAME = 255
_CHOOSE = "choose another"
_OVERWRITE = "choose another or give --overwrite"

MARK_FILE = ".lrtrav"
"""The file in a finished folder by which it is known that it may be replaced."""

_MARK = b"This folder was made by lrtrav, which replaces it when it is told --overwrite.\n"


@contextmanager
def output_folder(
    path: Path,
    identity: Mapping[str, str],
    *,
    overwrite: bool = False,
    can_overwrite: bool = True,
    keeps: bool = True,
) -> Iterator[RunJournal]:
    """Yield the journal of a run whose ``folder`` is to be written to; a finished result is never lost to another one.

    A new or empty folder is written to as it is, and so is one whose run was interrupted, with this identity. Another
    one that holds something is only replaced with `overwrite`, where it was made here, and only when the new one is
    finished: until then that is beside it, as ``.NAME.new``. There it is removed when the run ends by an exception, and
    resumed by the next one where it was killed.

    Parameters
    ----------
    path : Path
        The folder; missing ones are made.
    identity : mapping of str to str
        All that the results depend on, by names for the user; a digest's name begins with "the ".
    overwrite : bool
        Replace what is there.
    can_overwrite : bool
        Whether the user can be told to overwrite, now and of what is written.
    keeps : bool
        Whether frames that were finished before need not be done again.

    Raises
    ------
    FileExistsError
        If there is a result at `path`, or the unfinished one of another run, and `overwrite` is not set; or a file, or
        a folder that was not made here or cannot be replaced.
    BlockingIOError
        If another run writes to the folder.
    OSError
        If it cannot be written to.
    """
    path = path.resolve()  # what a link points to is replaced, not the link
    check = partial(_check, path, identity, overwrite=overwrite, can_overwrite=can_overwrite)
    check()
    _restore(path)
    with locked_folder(path):
        check()
        if _is_free(path, identity):
            _remove(_beside(path, "new"))  # of a run that was killed while it replaced what was here
            run = _journal(path, path, identity, keeps=keeps)
        else:
            run = _replacement(path, identity, keeps=keeps)
        with run as journal:
            yield journal
            if can_overwrite:
                write_bytes(journal.folder / MARK_FILE, _MARK)
        _remove(_beside(path, "old"))


@contextmanager
def _replacement(path: Path, identity: Mapping[str, str], *, keeps: bool) -> Iterator[RunJournal]:
    """Yield the journal of a folder that takes the place of another one when it is finished."""
    new = _beside(path, "new")
    with locked_folder(new, removes_empty=True, shown=path):
        if not _is_free(new, identity):
            _empty(new)
        try:
            with _journal(new, path, identity, keeps=keeps) as journal:
                yield journal
        finally:
            if new.exists():
                _empty(new)


@contextmanager
def _journal(folder: Path, path: Path, identity: Mapping[str, str], *, keeps: bool) -> Iterator[RunJournal]:
    """Yield the journal of a run, which goes when all is on the disk and at its path, or no frame was finished."""
    remove_leftovers(folder)
    journal = RunJournal(folder, identity, keeps=keeps)
    try:
        yield journal
        os.sync()  # once for all files: to wait for each takes half as long as to detect in it
        if folder != path:
            _replace(path, folder)
        (path / JOURNAL_FILE).unlink()
    finally:
        journal.close()
        if (folder / JOURNAL_FILE).exists() and journal.is_empty:
            _empty(folder)


def _check(path: Path, identity: Mapping[str, str], *, overwrite: bool, can_overwrite: bool) -> None:
    """Raise FileExistsError where there is no folder, or one that may not be written to, nor replaced."""
    if path.exists() and not path.is_dir():
        raise FileExistsError(f"{path} exists and is not an empty folder; {_CHOOSE}")
    if _is_free(path, identity):
        return
    if overwrite:
        _check_replaceable(path)
        return
    remedy = _OVERWRITE if can_overwrite and _is_own(path) else _CHOOSE
    if not (path / JOURNAL_FILE).exists():
        raise FileExistsError(f"{path} exists and is not an empty folder; {remedy}")
    changes = ", ".join(changes_since(path / JOURNAL_FILE, identity))
    raise FileExistsError(f"{path} holds what another run has not finished; since then changed: {changes}; {remedy}")


def _check_replaceable(path: Path) -> None:
    """Raise FileExistsError for a folder that is somebody else's, or that cannot be renamed, before the work."""
    working = Path.cwd()
    if path in (working, *working.parents):
        raise FileExistsError(f"{path} is the working directory or holds it, and is not replaced; {_CHOOSE}")
    if path.is_mount():
        raise FileExistsError(f"{path} is a mount point, which cannot be replaced; choose a folder in it")
    if not _is_own(path):
        raise FileExistsError(
            f"{path} holds what lrtrav did not make ({MARK_FILE} is not in it), and is not replaced; {_CHOOSE}, or "
            "remove it yourself"
        )


def _is_own(path: Path) -> bool:
    """Return whether a folder holds the result of a run, finished or not."""
    return any((path / name).is_file() for name in (MARK_FILE, JOURNAL_FILE))


def _is_free(path: Path, identity: Mapping[str, str]) -> bool:
    """Return whether there is nothing at a path, or a run to be resumed."""
    if not path.exists():
        return True
    journal = path / JOURNAL_FILE
    return not changes_since(journal, identity) if journal.exists() else not _content(path)


def _content(folder: Path) -> list[Path]:
    """Return what is in a folder, without what a run has there while it runs."""
    own = (LOCK_FILE, JOURNAL_FILE)
    return [item for item in folder.iterdir() if item.name not in own and not is_leftover(item)]


def _empty(folder: Path) -> None:
    """Remove all but the lock; the journal last, for without one what is left would be taken for a result."""
    for item in _content(folder):
        if item.is_dir() and not item.is_symlink():
            shutil.rmtree(item)
        else:
            item.unlink()
    (folder / JOURNAL_FILE).unlink(missing_ok=True)


def _replace(path: Path, new: Path) -> None:
    """Put a finished folder in the place of another one, which is then beside it."""
    old = _beside(path, "old")
    _remove(old)
    path.rename(old)
    try:
        new.rename(path)
    except BaseException:
        old.rename(path)
        raise


def _remove(folder: Path) -> None:
    if folder.exists():
        shutil.rmtree(folder)


def _restore(path: Path) -> None:
    """Put a result back that a run was about to replace when it was killed."""
    old = _beside(path, "old")
    if old.is_dir() and not path.exists():
        with locked_folder(old, shown=path):
            old.rename(path)


def _beside(path: Path, kind: str) -> Path:
    """Return a hidden name beside a path, that is not too long."""
    name = f".{path.name}.{kind}"
    if len(os.fsencode(name)) > _LONGEST_NAME:
        name = f"{hidden_name(path)}.{kind}"
    return path.with_name(name)
