"""Tests that a command killed at random moments leaves whole files and is resumed: benchmarks/interruptions.py."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "interruptions.py"


def test_outputs_are_whole_or_absent_and_resumed() -> None:
    command = [sys.executable, str(SCRIPT), "--kills", "3", "--frames", "3", "--only", "detect"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert re.match(r"detect +3 kills of ", done.stdout)
