#!/usr/bin/env python3
"""Whether outputs are whole or absent, and resumed, when commands are killed at random moments.

    python benchmarks/interruptions.py
    python benchmarks/interruptions.py --kills 100 --only detect --seed 7

Each command is run undisturbed, then again and again: SIGKILL ends it at a random moment, and it is started anew until
it is finished. After each kill every file with its final name is the same as that of the undisturbed run, but for
times, and tables are the beginning of it; in the end all is the same, and nothing else is there. The exit status is 1
where one of these does not hold.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from lrtrav_ros.commands import run
from lrtrav_ros.io.atomic_files import is_leftover
from lrtrav_ros.io.folder_lock import LOCK_FILE
from lrtrav_ros.io.run_journal import JOURNAL_FILE

# One thread, so that this process has no others when it forks: that saves the start of an interpreter for each run.
FAST = ("--set", "stereo.n_disparities=16", "--set", "superpixels.n_superpixels=40", "--set", "threads=1")
SCENE = ("--size", "96x64", "--style", "road")
DEADLINE_S = 120.0
OWN = (LOCK_FILE, JOURNAL_FILE)


@dataclass(frozen=True)
class Command:
    """A command that is killed: its arguments by input and output folder, whether that holds an old result, and whether
    it can be run again when it is finished."""

    name: str
    arguments: Callable[[Path, Path], Sequence[str | Path]]
    replaces: bool = False
    resumes_finished: bool = False


def commands(n_frames: int) -> dict[str, Command]:
    def detect(inputs: Path, out: Path) -> Sequence[str | Path]:
        return ("detect", inputs / "scene", "--output", out / "out", *FAST)

    def generate(_: Path, out: Path) -> Sequence[str | Path]:
        return ("generate", out / "out", *SCENE, "--frames", str(n_frames))

    evaluation = ("--methods", "uv_disparity,robust", "--save-masks", *FAST)
    chosen = [
        Command("detect", detect),
        Command(
            "detect --overwrite",
            lambda inputs, out: (*detect(inputs, out), "--overwrite"),
            replaces=True,
            resumes_finished=True,
        ),
        Command("detect --jobs", lambda inputs, out: (*detect(inputs, out), "--jobs", "2")),
        Command(
            "detect --output-bag",
            lambda inputs, out: (
                *("detect", inputs / "scene" / "bag", "--output", out / "out", *FAST),
                *("--output-bag", out / "out.mcap"),
            ),
        ),
        Command(
            "evaluate",
            lambda inputs, out: ("evaluate", inputs / "scene", "--output", out / "out", *evaluation),
            resumes_finished=True,
        ),
        Command("generate", generate),
        Command("generate --bag", lambda inputs, out: (*generate(inputs, out), "--bag", "mcap")),
    ]
    return {command.name: command for command in chosen}


def started(arguments: Sequence[str | Path], log: Path) -> int:
    """Run a command in a process of its own; return its id."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads of libraries, which are idle here
        child = os.fork()
    if child:
        return child
    try:
        os.setpgid(0, 0)
        stream = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(stream, 1)
        os.dup2(stream, 2)
        sys.stdout = sys.stderr = io.TextIOWrapper(os.fdopen(1, "wb", 0), write_through=True)
        name, *options = map(str, arguments)
        os._exit(run(name, options))
    except BaseException as err:
        print(repr(err), file=sys.stderr)
        os._exit(70)


def ended(child: int, *, after_s: float) -> int | None:
    """Return the exit status of a process; None where it is killed, after so long."""
    deadline = time.monotonic() + after_s
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return None if code == -signal.SIGKILL else code


def contents(folder: Path) -> dict[str, bytes]:
    """Return what is in a folder, by paths, without what depends on times."""
    return {
        str(path.relative_to(folder)): normalised(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not {"times", "times.csv", "report.html"} & set(path.relative_to(folder).parts)
    }


def normalised(path: Path) -> bytes:
    """Return what a file holds: of a table of frames only the columns that are the same in every run."""
    if path.name != "frames.csv":
        return path.read_bytes()
    with path.open(newline="", encoding="utf-8") as table:
        rows = [{key: value for key, value in row.items() if key and "_ms" not in key} for row in csv.DictReader(table)]
    return b"".join(json.dumps(row).encode() + b"\n" for row in rows)


def check_unfinished(out: Path, whole: dict[str, bytes], old: dict[str, bytes]) -> None:
    """Check what is there after a kill; raises ValueError for a file that is not whole."""
    found = contents(out)
    for path, data in found.items():
        parts = Path(path).parts
        if parts[-1] in OWN or any(is_leftover(Path(part)) for part in parts):
            continue
        place = path.replace(".out.new/", "out/").replace(".out.old/", "out/")
        expected = [known[place] for known in (whole, old) if place in known]
        is_table = place == "out/frames.csv" and data.count(b"\n") <= whole[place].count(b"\n")
        if is_table:  # its last row may be cut off
            data = data[: data.rfind(b"\n", 0, -1) + 1]
            expected = [whole[place][: len(data)], *expected]
        if data not in expected:
            raise ValueError(f"{path} is not whole: {len(data)} bytes")
    results = [contents(folder) for folder in (out / "out", out / ".out.old") if folder.is_dir()]
    if old and not any(set(result) - set(OWN) >= {name.removeprefix("out/") for name in old} for result in results):
        raise ValueError("the old result is gone, and the new one is not there")


def is_finished(folder: Path) -> bool:
    """Return whether a folder holds a result."""
    return not (folder / JOURNAL_FILE).exists() and any(path.name not in OWN for path in folder.glob("[!.]*"))


class Interruptions:
    """A command that is killed again and again, in a folder, and what was seen of it."""

    def __init__(self, command: Command, inputs: Path, folder: Path, random_: random.Random) -> None:
        self._command, self._inputs, self._random = command, inputs, random_
        self._reference, self._out, self._log = folder / "reference", folder / "at" / "work", folder / "log"
        self._reference.mkdir(parents=True)
        self._n_runs = self._n_resumed = self._most = 0
        begun = time.monotonic()
        if self._status(self._reference, after_s=DEADLINE_S) != 0:
            raise ValueError(f"fails undisturbed: {self._log.read_text()}")
        self._duration_s = time.monotonic() - begun
        self._whole = contents(self._reference)

    def kill(self, n_kills: int) -> None:
        """Kill it so many times; raises ValueError where something is not as it is undisturbed."""
        n_left = n_kills
        while n_left:
            n_killed = self._killed_until_finished(n_left)
            n_left, self._most = n_left - n_killed, max(self._most, n_killed)
        print(
            f"{self._command.name:22} {n_kills:5} kills of {self._n_runs:5} runs of {self._duration_s:.2f} s, at most "
            f"{self._most} before one finished; {self._n_resumed} resumed",
            flush=True,
        )

    def _killed_until_finished(self, n_kills: int) -> int:
        """Kill it, at most so many times, until a run is finished; return how often."""
        out, n_killed = self._out, 0
        if self._command.replaces:
            shutil.copytree(self._reference, out)
        else:
            out.mkdir(parents=True)
        while (status := self._status(out, after_s=self._moment_s(n_killed, n_kills))) is None:
            n_killed += 1
            check_unfinished(out, self._whole, self._whole if self._command.replaces else {})
            if not self._command.resumes_finished and is_finished(out / "out"):
                status = 0  # it was killed after that
                (out / "out" / LOCK_FILE).unlink(missing_ok=True)  # nobody holds it, and the folder is refused
                break
            if n_killed > n_kills:
                raise ValueError(f"is not finished after {DEADLINE_S} s")
        if status != 0 or contents(out) != self._whole:
            raise ValueError(f"ends with status {status}: {self._log.read_text()}")
        shutil.rmtree(out)
        return n_killed

    def _moment_s(self, n_killed: int, n_kills: int) -> float:
        """Return when to kill a run: later after each kill, so that one is finished at last though all are slow."""
        return self._random.uniform(0, self._duration_s * (1 + n_killed / 2)) if n_killed < n_kills else DEADLINE_S

    def _status(self, out: Path, *, after_s: float) -> int | None:
        """Run it; return its exit status, or None where it was killed."""
        status = ended(started(self._command.arguments(self._inputs, out), self._log), after_s=after_s)
        self._n_runs += 1
        self._n_resumed += "finished before" in self._log.read_text()
        return status


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--kills", type=int, default=50, metavar="N", help="of each command (%(default)s)")
    parser.add_argument("--frames", type=int, default=6, metavar="N", help="that each works on (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="makes the moments (%(default)s)")
    parser.add_argument(
        "--only", action="append", choices=commands(1), metavar="COMMAND", help="can be repeated; by default all"
    )
    args = parser.parse_args()
    known, random_, status = commands(args.frames), random.Random(args.seed), 0
    chosen = args.only or list(known)
    with tempfile.TemporaryDirectory(prefix="interruptions_") as name:
        folder = Path(name)
        os.environ["TMPDIR"] = tempfile.tempdir = str(folder)
        with contextlib.redirect_stdout(io.StringIO()):
            frames = ("--frames", str(args.frames))
            run("generate", [str(folder / "scene"), *SCENE, *frames, "--bag", "mcap"])
            # Compiled kernels are those of this process from now on.
            for command in {choice.split()[0] for choice in chosen} - {"generate"}:
                arguments = commands(1)[command].arguments(folder, folder / f"warm_{command}")
                run(str(arguments[0]), [str(argument) for argument in arguments[1:]])
        for number, choice in enumerate(chosen):
            try:
                Interruptions(known[choice], folder, folder / f"command_{number}", random_).kill(args.kills)
            except ValueError as err:
                print(f"{choice}: {err}", file=sys.stderr)
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main())
