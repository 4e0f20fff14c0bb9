"""Nodes as processes of their own, which are watched, stopped and killed: what long runs and faults are tried on."""

import re
import signal
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ros_graph import ROOT

START_S = 300.0  # kernels are compiled at the first start
END_S = 20.0
_COMMAND = "import sys; from lrtrav_ros.commands import run; sys.exit(run(sys.argv[1], sys.argv[2:]))"


@dataclass(frozen=True)
class Usage:
    """What a process has of the system's resources."""

    rss_mb: float
    n_descriptors: int
    n_threads: int

    def __str__(self):
        return f"{self.rss_mb:.1f} MB, {self.n_descriptors} descriptors, {self.n_threads} threads"


class NodeProcess:
    """An executable such as ``detector`` in a process; its log goes to a file, which never fills up as a pipe does."""

    def __init__(self, name, log, *ros_args):
        self.name = name
        self.log = Path(log)
        with self.log.open("w") as file:
            command = (sys.executable, "-c", _COMMAND, name, "--ros-args", *ros_args)
            self._process = subprocess.Popen(command, stdout=file, stderr=file, cwd=ROOT)

    @property
    def pid(self):
        return self._process.pid

    @property
    def is_running(self):
        return self._process.poll() is None

    def wait_until_ready(self, graph):
        """Wait until its nodes have subscriptions."""
        n_nodes = 2 if self.name == "detector" else 1

        def is_ready():
            assert self.is_running, f"{self.name} ended with {self._process.returncode}: {self.log.read_text()[-2000:]}"
            return len(re.findall(r"\]: ready", self.log.read_text())) >= n_nodes

        graph.spin_until(is_ready, START_S)

    def usage(self):
        """Return what it has now, from Linux' ``/proc``."""
        folder = Path("/proc", str(self.pid))
        status = dict(re.findall(r"^(\w+):\s+(\d+)", (folder / "status").read_text(), re.MULTILINE))
        n_descriptors = len(list((folder / "fd").iterdir()))
        return Usage(int(status["VmRSS"]) / 1024, n_descriptors, int(status["Threads"]))

    def send(self, number):
        """Send a signal."""
        self._process.send_signal(number)

    def kill(self):
        """End it at once, as a crash would."""
        self._process.kill()
        self._process.wait()

    def end(self):
        """Ask it to end, and return its status; kill it where it does not."""
        self.send(signal.SIGCONT)
        self.send(signal.SIGINT)
        try:
            return self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.kill()
            return self._process.returncode


@contextmanager
def running(*processes):
    """End those that still run after the block."""
    try:
        yield processes
    finally:
        for process in processes:
            if process.is_running:
                process.end()
