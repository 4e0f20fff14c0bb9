"""Names that other systems allow: not UTF-8, as long as a disk takes, formulas; and no files among the images."""

import csv
import io
import json
import os
import sys

from recorded import FAST, frames, write_dataset

from lrtrav_ros.commands import run

NOT_UTF8 = os.fsdecode(b"caf\xe9")
LONGEST = "n" * 251
NAMES = ("-1+2", "=1+2", "h\N{LATIN SMALL LETTER O WITH DIAERESIS}he", NOT_UTF8, LONGEST)
CELLS = ["'-1+2", "'=1+2", r"caf\udce9", "h\N{LATIN SMALL LETTER O WITH DIAERESIS}he", LONGEST, "pipe", "zero"]


def oddly_named(folder):
    """Write a dataset of one frame under all names, with a pipe and a device beside it; not UTF-8 itself."""
    write_dataset(folder, frames(n=1), truth=True)
    for part in ("left", "right", "gt"):
        (image,) = (folder / part).iterdir()
        for name in NAMES:
            (folder / part / f"{name}.png").write_bytes(image.read_bytes())
        image.unlink()
    os.mkfifo(folder / "left" / "pipe.png")
    (folder / "left" / "zero.png").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        (folder / "gt" / f"{name}.png").symlink_to(f"{NAMES[0]}.png")
    return folder


def names_in(table):
    text = io.StringIO(table.read_bytes().decode("utf-8"), newline="")
    return sorted({row.get("name", row.get("frame")) for row in csv.DictReader(text)})


def ascii_output(monkeypatch):
    """Replace standard output by one that can encode ASCII alone, and return its bytes."""
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii", write_through=True))
    return written


def test_detect_takes_any_name_of_files(tmp_path, monkeypatch, capfd):
    folder, output = oddly_named(tmp_path / os.fsdecode(b"in\xff")), tmp_path / os.fsdecode(b"out\xff")
    written = ascii_output(monkeypatch)
    assert run("detect", [str(folder), "--output", str(output), *FAST]) == 0
    assert names_in(output / "frames.csv") == CELLS
    assert sorted(mask.stem for mask in (output / "long_range").iterdir()) == sorted(NAMES)
    assert written.getvalue().startswith(b"5 frames, 2 skipped: ")
    assert rb"out\udcff" in written.getvalue()
    assert "pipe.png: is no regular file but a pipe; give a file" in capfd.readouterr().err


def test_evaluate_takes_any_name_of_files_and_resumes(tmp_path, monkeypatch, capfd):
    folder, output = oddly_named(tmp_path / os.fsdecode(b"in\xff")), tmp_path / "out"
    options = [str(folder), "--output", str(output), *FAST, "--methods", "uv_disparity", "--save-masks"]
    written = ascii_output(monkeypatch)
    assert run("evaluate", options) == 0
    assert names_in(output / "scores.csv") == CELLS
    assert names_in(output / "times.csv") == CELLS[:5]
    summary = json.loads((output / "summary.json").read_text(encoding="utf-8"))
    assert summary["sets"][0]["name"] == folder.name
    assert r"in\udcff" in (output / "report.html").read_text(encoding="utf-8")
    assert b"report.html, scores.csv" in written.getvalue()
    capfd.readouterr()
    assert run("evaluate", options) == 0
    assert "5 frames were finished before" in capfd.readouterr().err
