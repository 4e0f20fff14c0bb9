"""Tests of output folders: never half replaced, of one run at a time, and resumed where a run was interrupted."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import pytest

from lrtrav_ros.io.atomic_files import write_bytes
from lrtrav_ros.io.output_folder import MARK_FILE, output_folder
from lrtrav_ros.io.run_journal import JOURNAL_FILE, JournalPart, RunJournal

IDENTITY = {"the command": "detect", "clustering.k": "10"}
FILES = {"a/0.png": b"first", "b/0.png": b"second"}


def write(part: JournalPart, name: str, files: Mapping[str, bytes]) -> None:
    for path, data in files.items():
        write_bytes(part.folder / path, data)
    part.note(name, files, row={"name": name})


def interrupted(path: Path, *, names: str = "01", part: str = "", overwrite: bool = False) -> None:
    """Write some frames, as a run does that is then killed."""
    context = output_folder(path, IDENTITY, overwrite=overwrite)
    journal = context.__enter__()
    for name in names:
        write(journal.part(part), name, {f"a/{name}.png": name.encode() * 100})
    killed = path.with_name("killed")
    shutil.copytree(path.parent, killed)
    context.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    for item in path.parent.iterdir():
        if item != killed:
            shutil.rmtree(item)
    for item in killed.iterdir():
        item.rename(path.parent / item.name)
    killed.rmdir()


def finished(path: Path, *, part: str = "", **options: bool) -> list[str]:
    """Run to the end; return the names of the frames that were finished before."""
    with output_folder(path, IDENTITY, **options) as journal:
        names = [frame.name for frame in journal.part(part).finished]
        assert all(frame.row == {"name": frame.name} for frame in journal.part(part).finished)
        write(journal.part(part), "last", FILES)
    return names


def listed(path: Path) -> list[str]:
    return sorted(str(file.relative_to(path)) for file in path.rglob("*") if file.is_file() and file.name != MARK_FILE)


def old_result(path: Path, name: str = "old") -> None:
    """Make a folder that a run has finished."""
    path.mkdir()
    (path / name).touch()
    (path / MARK_FILE).touch()


@pytest.mark.parametrize("exists", [False, True])
def test_new_or_empty_folder_is_written_to_as_it_is(tmp_path: Path, exists: bool) -> None:
    path = tmp_path / "out"
    if exists:
        path.mkdir()
    with output_folder(path, IDENTITY) as journal:
        assert journal.folder == path
        write(journal.part(), "0", FILES)
    assert listed(tmp_path) == ["out/a/0.png", "out/b/0.png"]


def test_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    with pytest.raises(FileExistsError, match=r"exists and is not an empty folder; choose another$"):
        output_folder(tmp_path, IDENTITY).__enter__()
    (tmp_path / MARK_FILE).touch()
    with pytest.raises(FileExistsError, match="exists and is not an empty folder; choose another or give --overwrite"):
        output_folder(tmp_path, IDENTITY).__enter__()
    with pytest.raises(FileExistsError, match=r"choose another$"):
        output_folder(tmp_path, IDENTITY, can_overwrite=False).__enter__()
    assert listed(tmp_path) == ["a"]


def test_file_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "out"
    path.touch()
    with pytest.raises(FileExistsError, match="out exists"):
        output_folder(path, IDENTITY, overwrite=True).__enter__()


def test_folder_that_was_not_made_here_is_never_replaced(tmp_path: Path) -> None:
    path = tmp_path / "home"
    path.mkdir()
    (path / "diary.txt").touch()
    with output_folder(path / "results" / "a", IDENTITY) as journal:  # what it holds may be
        write(journal.part(), "0", FILES)
    before = listed(tmp_path)
    for folder in (path, path / "results"):
        with pytest.raises(
            FileExistsError, match=r"holds what lrtrav did not make \(\.lrtrav is not in it\), and is not"
        ):
            output_folder(folder, IDENTITY, overwrite=True).__enter__()
    assert listed(tmp_path) == before
    assert finished(path / "results" / "a", overwrite=True) == []


def test_what_cannot_be_overwritten_is_not_marked(tmp_path: Path) -> None:
    assert finished(tmp_path / "out", can_overwrite=False) == []
    assert not (tmp_path / "out" / MARK_FILE).exists()
    with pytest.raises(FileExistsError, match="holds what lrtrav did not make"):
        output_folder(tmp_path / "out", IDENTITY, overwrite=True).__enter__()


@pytest.mark.parametrize("inside", ["", "sub", "sub/sub"])
def test_working_directory_is_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: str) -> None:
    path = tmp_path / "out"
    old_result(path)
    (path / inside).mkdir(parents=True, exist_ok=True)
    monkeypatch.chdir(path / inside)
    for name in (path, Path("../" * len(Path(inside).parts) or ".")):
        with pytest.raises(
            FileExistsError, match="out is the working directory or holds it, and is not replaced; choose"
        ):
            output_folder(name, IDENTITY, overwrite=True).__enter__()
    assert listed(tmp_path) == ["out/old"]


def test_mount_point_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "out"
    old_result(path)
    monkeypatch.setattr(Path, "is_mount", lambda self: self == path)
    with pytest.raises(FileExistsError, match="out is a mount point, which cannot be replaced; choose a folder in it"):
        output_folder(path, IDENTITY, overwrite=True).__enter__()
    assert listed(tmp_path) == ["out/old"]
    assert finished(path / "new") == []


def test_old_folder_is_replaced_when_the_new_one_is_finished(tmp_path: Path) -> None:
    path = tmp_path / "out"
    old_result(path)
    with output_folder(path, IDENTITY, overwrite=True) as journal:
        write(journal.part(), "0", FILES)
        assert (path / "old").exists()
    assert listed(tmp_path) == ["out/a/0.png", "out/b/0.png"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_old_folder_stays_when_the_run_is_interrupted(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "out"
    old_result(path)
    context = output_folder(path, IDENTITY, overwrite=True)
    write(context.__enter__().part(), "0", FILES)
    context.__exit__(error, error(), None)
    assert listed(tmp_path) == ["out/old"]
    assert [item.name for item in tmp_path.iterdir()] == ["out"]


def test_link_to_a_folder_stays_a_link(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    old_result(target)
    link.symlink_to(target)
    with output_folder(link, IDENTITY, overwrite=True) as journal:
        write(journal.part(), "0", FILES)
    assert link.is_symlink()
    assert listed(target) == ["a/0.png", "b/0.png"]


@pytest.mark.parametrize("overwrite", [False, True])
def test_second_run_is_refused_at_once(tmp_path: Path, overwrite: bool) -> None:
    path = tmp_path / "out"
    for is_replaced in (False, True):
        with output_folder(path, IDENTITY, overwrite=is_replaced) as journal:
            write(journal.part(), "0", FILES)
            if overwrite or not is_replaced:
                with pytest.raises(BlockingIOError, match="out: another run writes to it; let that end, or choose"):
                    output_folder(path, IDENTITY, overwrite=overwrite).__enter__()
    assert listed(tmp_path) == ["out/a/0.png", "out/b/0.png"]


@pytest.mark.parametrize("overwrite", [False, True])
def test_interrupted_run_is_resumed(tmp_path: Path, overwrite: bool) -> None:
    path = tmp_path / "out"
    if overwrite:
        old_result(path)
    interrupted(path, part="road", overwrite=overwrite)
    assert (tmp_path / (".out.new" if overwrite else "out") / JOURNAL_FILE).exists()
    assert finished(path, part="road", overwrite=overwrite) == ["0", "1"]
    assert [item.name for item in tmp_path.iterdir()] == ["out"]
    assert listed(path) == ["road/a/0.png", "road/a/1.png", "road/b/0.png"]


@pytest.mark.parametrize("content", [b"", bytes(100), None], ids=["empty", "zeros", "missing"])
def test_frames_from_the_first_that_is_not_whole_are_done_again(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "out"
    interrupted(path, names="0123")
    if content is None:
        (path / "a" / "2.png").unlink()
    else:
        (path / "a" / "2.png").write_bytes(content)  # as a power loss leaves it
    assert finished(path) == ["0", "1"]


@pytest.mark.parametrize(("n_lost", "tail"), [(20, b""), (0, bytes(50)), (0, b'{"part": "", "na')])
def test_line_that_is_cut_off_is_dropped(tmp_path: Path, n_lost: int, tail: bytes) -> None:
    path = tmp_path / "out"
    interrupted(path, names="0123")
    whole = (path / JOURNAL_FILE).read_bytes()
    (path / JOURNAL_FILE).write_bytes(whole[: len(whole) - n_lost] + tail)
    interrupted(path, names="")
    assert finished(path) == list("012" if n_lost else "0123")


def test_interrupted_run_with_something_changed_is_refused(tmp_path: Path) -> None:
    path, now = tmp_path / "out", {**IDENTITY, "clustering.k": "5", "the files of in": "0123"}
    interrupted(path)
    before = listed(path)
    message = "out holds what another run has not finished; since then changed: clustering.k: 10 -> 5, the files of in;"
    with pytest.raises(FileExistsError, match=message):
        output_folder(path, now).__enter__()
    assert listed(path) == before
    with output_folder(path, now, overwrite=True) as journal:
        assert journal.part().finished == ()
        write(journal.part(), "0", FILES)
        assert listed(path) == before
    assert listed(tmp_path) == ["out/a/0.png", "out/b/0.png"]


def test_run_begins_anew_where_frames_need_those_before_them(tmp_path: Path) -> None:
    path = tmp_path / "out"
    interrupted(path)
    assert finished(path, keeps=False) == []


def test_run_that_ends_before_a_frame_is_finished_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "out"
    context = output_folder(path, IDENTITY)
    (context.__enter__().folder / "config.yaml").touch()
    context.__exit__(ValueError, ValueError("no frame can be used"), None)
    assert not path.exists()


def test_result_is_put_back_where_a_run_was_killed_while_it_replaced_it(tmp_path: Path) -> None:
    path = tmp_path / "out"
    old_result(path, "result")
    interrupted(path, overwrite=True)
    path.rename(tmp_path / ".out.old")
    with pytest.raises(FileExistsError):
        output_folder(path, IDENTITY).__enter__()
    assert (path / "result").exists()
    path.rename(tmp_path / ".out.old")
    (tmp_path / ".out.new").rename(path)  # the new one is in its place, but not yet said to be finished
    assert finished(path, overwrite=True) == ["0", "1"]
    assert [item.name for item in tmp_path.iterdir()] == ["out"]
    assert not (path / "result").exists()


def test_names_may_be_as_long_as_the_disk_takes(tmp_path: Path) -> None:
    path = tmp_path / ("a" * 255)
    for _ in range(2):
        assert finished(path, overwrite=True) == []
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_output_bag_that_was_finished_is_known(tmp_path: Path) -> None:
    RunJournal(tmp_path, IDENTITY).note_bag()
    for _ in range(2):
        assert RunJournal(tmp_path, IDENTITY, keeps=False).has_bag
    assert not RunJournal(tmp_path / "..", IDENTITY).has_bag
