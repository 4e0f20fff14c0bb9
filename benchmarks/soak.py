#!/usr/bin/env python3
"""Whether the nodes keep running as they began: frames at full speed, with all that happens to nodes in days.

    python benchmarks/soak.py
    python benchmarks/soak.py --frames 100000 --executable detector

Frames of 160 x 120 pixels go over DDS to the nodes in processes of their own, two at a time; one may take the place of
the one before, but the newest has to be answered by its mask. Every 50 frames parameters change; in each 1,000 frames
somebody subscribes to the maps for a while, the nodes are deactivated and activated again, and a process is stopped and
goes on. After a quarter of the frames and after half of them a process is killed and started anew. After the first
1,000 frames of a process its memory may grow by less than 5 MB, its descriptors not at all and its threads by no more
than the two of pools, and the masks of the same frames are the same at the start and at the end. The exit status is 1
where one of these does not hold.
"""

from __future__ import annotations

import argparse
import itertools
import os
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[1] / "test" / folder) for folder in ("nodes", "")]

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("ROS_LOG_DIR", tempfile.mkdtemp(prefix="soak_"))

from lrtrav_ros.nodes.shared_memory import IMAGES_PROFILE, use_segment  # noqa: E402

use_segment(IMAGES_PROFILE)

import rclpy  # noqa: E402
from lifecycle_msgs.msg import Transition  # noqa: E402
from lifecycle_msgs.srv import ChangeState  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from node_process import NodeProcess, Usage  # noqa: E402
from rcl_interfaces.srv import SetParametersAtomically  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from ros_graph import N_DISPARITIES, Graph, camera_info, image, stereo_pair  # noqa: E402
from sensor_msgs.msg import Image, PointCloud2  # noqa: E402
from std_srvs.srv import Empty  # noqa: E402

from lrtrav_ros.io.message_frames import header_stamp_ns  # noqa: E402

MASK = "long_range/mask"
WARM_UP = 1_000  # frames
MAX_GROWTH_MB = 5.0
PERIOD = 50  # frames between two changes of parameters
RECOVERY_S = 20.0
POOLED_THREADS = 2  # of OpenCV and of the matcher: they come and go with the parameters
PERIOD_NS = 100_000_000
N_PAIRS = 8
SAME = 24  # frames whose masks are compared
EXECUTABLES = {"nodes": ("short_range_node", "long_range_node"), "detector": ("detector",)}
START = {
    "short_range": {
        "stereo.matcher": "bm",
        "stereo.n_disparities": N_DISPARITIES,
        "source.max_depth_m": 0.0,
        "ground.memory_s": 0.5,
        "threads": 0,
    },
    "long_range": {
        "superpixels.n_superpixels": 40,
        "extension.rule": "propagation",
        "features.texture": "wld",
        "memory.frames": 5,
        "clustering.k": 10,
    },
}
CHANGES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("short_range", {"stereo.matcher": "sgbm"}),
    ("long_range", {"superpixels.n_superpixels": 80}),
    ("short_range", {"stereo.matcher": "elas"}),
    ("long_range", {"extension.rule": "evidence"}),
    ("short_range", {"stereo.n_disparities": 64}),
    ("long_range", {"features.texture": "ltp", "extension.rule": "area"}),
    ("short_range", {"threads": 1}),
    ("long_range", {"memory.frames": 0, "extension.rule": "propagation"}),
    ("short_range", {"source.max_depth_m": 10.0, "threads": 2}),
    ("long_range", START["long_range"]),
    ("short_range", START["short_range"]),
)
MAPS = (("long_range/grid", OccupancyGrid), ("short_range/obstacles", PointCloud2), ("long_range/overlay", Image))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=20_000, help="at least 4,000 (20000)")
    parser.add_argument(
        "--executable", choices=EXECUTABLES, default="nodes", help="a process for each node, or one for both (nodes)"
    )
    args = parser.parse_args()
    if args.frames < 4 * WARM_UP:
        parser.error(f"--frames is {args.frames}; give at least {4 * WARM_UP}")
    rclpy.init(args=[])
    try:
        problems = Soak(args.executable, args.frames).run()
    finally:
        rclpy.try_shutdown()
    print("\n".join(problems) or "all as it began")
    return 1 if problems else 0


class Soak:
    """One run; the figures of each process begin anew where it is started anew."""

    def __init__(self, executable: str, n_frames: int) -> None:
        self._n_frames = n_frames
        self._folder = Path(tempfile.mkdtemp(prefix="soak_"))
        self._graph = Graph(namespace="soak", settings={})
        self._processes = {name: self._start(name, 0) for name in EXECUTABLES[executable]}
        self._first: dict[str, Usage] = {}
        self._pairs = [stereo_pair(seed) for seed in range(N_PAIRS)]
        self._stamps = itertools.count(1_700_000_000_000_000_000, PERIOD_NS)
        self._in_flight: list[int] = []
        self._masks: dict[int, bytes] = {}
        self._subscriptions: list[Any] = []
        self._problems: list[str] = []
        self._n_sent = 0
        self._n_dropped = 0
        self._most_lost = 0
        self._begin_s = 0.0

    def run(self) -> list[str]:
        """Return what did not hold, in sentences; nothing where all did."""
        try:
            self._wait()
            self._graph.tester.create_subscription(Image, MASK, self._take, 50)
            self._graph.spin_until(lambda: self._graph.tester.count_publishers(MASK) > 0)
            self._await_nodes()
            before = self._same_masks()
            self._print_heading()
            for n in range(WARM_UP, self._n_frames + 1, WARM_UP):
                self._thousand()
                self._look(n)
                for name, share in zip(self._processes, (4, 2), strict=False):
                    if n == self._n_frames // share // WARM_UP * WARM_UP:
                        self._restart(name)
            if self._same_masks() != before:
                self._problems.append("the masks of the same frames are others than at the start")
        finally:
            for process in self._processes.values():
                if process.is_running:
                    process.end()
        for process in self._processes.values():
            if "Traceback" in process.log.read_text():
                self._problems.append(f"{process.name} logged a traceback, see {process.log}")
        self._graph.close()
        print(f"after an interruption {self._most_lost} frames at most were lost before one was answered, 0.5 s apart")
        return self._problems

    def _start(self, name: str, n: int) -> NodeProcess:
        settings = {key: value for part in START.values() for key, value in part.items()}
        parameters = [part for key, value in settings.items() for part in ("-p", f"{key}:={value}")]
        return NodeProcess(name, self._folder / f"{name}_{n}.log", "-r", "__ns:=/soak", *parameters)

    def _wait(self) -> None:
        for process in self._processes.values():
            process.wait_until_ready(self._graph)

    def _thousand(self) -> None:
        """Send frames, and let happen what does in days."""
        for step in range(WARM_UP // PERIOD):
            self._change(*CHANGES[step % len(CHANGES)])
            if step == 5:
                self._subscribe()
            if step == 10:
                self._unsubscribe()
            if step == 13:
                self._stop_and_go()
            if step == 15:
                for node in START:
                    self._reactivate(node)
            self._send(PERIOD)
        for node, settings in START.items():
            self._change(node, settings)
        self._send(N_PAIRS)  # what was made for other parameters is given up

    def _send(self, n: int, *, n_waiting: int = 1) -> None:
        """Send frames while so many wait for their masks, and wait for that of the last."""
        for _ in range(n):
            stamp = next(self._stamps)
            self._in_flight.append(stamp)
            self._publish(self._pairs[self._n_sent % N_PAIRS], stamp)
            self._n_sent += 1
            self._await(n_waiting)
        self._await(0)

    def _publish(self, pair: Any, stamp: int) -> None:
        n_left = len(self._processes)  # the nodes of one process share the left image
        self._graph.publish("left/camera_info", camera_info())
        self._graph.publish("right/camera_info", camera_info(right=True))
        self._graph.publish("right/image_rect", image(pair[1], stamp))
        self._graph.publish("left/image_rect", image(pair[0], stamp), n_subscriptions=n_left)

    def _await(self, n: int) -> None:
        """Wait until so many frames at most are in flight."""
        try:
            self._graph.spin_until(lambda: len(self._in_flight) <= n)
        except AssertionError:
            self._problems.append(f"no mask for {len(self._in_flight)} frames about frame {self._n_sent}")
            self._in_flight.clear()

    def _take(self, message: Image) -> None:
        stamp = header_stamp_ns(message)
        if stamp in self._in_flight:
            older = self._in_flight.index(stamp)
            self._n_dropped += older
            del self._in_flight[: older + 1]
            self._masks[stamp] = bytes(message.data)
        while len(self._masks) > SAME:
            del self._masks[next(iter(self._masks))]

    def _same_masks(self) -> list[bytes]:
        """Return the masks of the same frames from the same state on: nodes remember frames."""
        for node in START:
            self._graph.call(Empty, f"{node}/reset", Empty.Request())
        self._n_sent += -self._n_sent % N_PAIRS
        self._masks.clear()
        self._send(SAME, n_waiting=0)
        return list(self._masks.values())

    def _change(self, node: str, settings: dict[str, Any]) -> None:
        request = SetParametersAtomically.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in settings.items()]
        )
        result = self._graph.call(SetParametersAtomically, f"{node}/set_parameters_atomically", request).result
        if not result.successful:
            self._problems.append(f"{node} refuses {settings}: {result.reason}")

    def _subscribe(self) -> None:
        for topic, kind in MAPS:
            self._subscriptions.append(self._graph.tester.create_subscription(kind, topic, lambda message: None, 1))

    def _unsubscribe(self) -> None:
        for subscription in self._subscriptions:
            self._graph.tester.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _reactivate(self, node: str) -> None:
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
            request = ChangeState.Request(transition=Transition(id=transition))
            if not self._graph.call(ChangeState, f"{node}/change_state", request).success:
                self._problems.append(f"{node} refuses transition {transition}")
        self._await_nodes()

    def _stop_and_go(self) -> None:
        """Stop a process while frames come, as a busy computer does, and let it go on."""
        process = next(iter(self._processes.values()))
        process.send(signal.SIGSTOP)
        for pair in self._pairs:
            self._publish(pair, next(self._stamps))
        process.send(signal.SIGCONT)
        self._await_nodes()

    def _restart(self, name: str) -> None:
        """Kill a process, and start it anew."""
        self._processes[name].kill()
        self._processes[name] = self._start(name, self._n_sent)
        self._wait()
        self._first.pop(name, None)
        print(f"{name} is killed and started anew")
        self._await_nodes()

    def _await_nodes(self) -> None:
        """Wait until frames go through: nodes find each other's topics some time after they are made."""
        end_s, n_lost = time.monotonic() + RECOVERY_S, 0
        while time.monotonic() < end_s:
            stamp = next(self._stamps)
            self._in_flight = [stamp]
            self._publish(self._pairs[0], stamp)
            try:
                self._graph.spin_until(lambda: not self._in_flight, 0.5)
            except AssertionError:
                n_lost += 1
            else:
                self._most_lost = max(self._most_lost, n_lost)
                return
        self._problems.append(f"no mask within {RECOVERY_S:g} s of an interruption, about frame {self._n_sent}")

    def _print_heading(self) -> None:
        self._begin_s = time.monotonic()
        print(f"{'frame':>7} {'dropped':>7} {'Hz':>6}  " + "  ".join(f"{name:>38}" for name in self._processes))

    def _look(self, n: int) -> None:
        """Print what the processes have, and compare it with what they had after their first frames."""
        rate = WARM_UP / (time.monotonic() - self._begin_s)
        usages = {name: process.usage() for name, process in self._processes.items()}
        texts = "  ".join(f"{usage!s:>38}" for usage in usages.values())
        print(f"{n:7} {self._n_dropped:7} {rate:6.1f}  {texts}", flush=True)
        for name, usage in usages.items():
            first = self._first.setdefault(name, usage)
            if usage.rss_mb - first.rss_mb >= MAX_GROWTH_MB:
                self._problems.append(f"{name}: memory grew from {first.rss_mb:.1f} to {usage.rss_mb:.1f} MB at {n}")
            is_same = usage.n_descriptors == first.n_descriptors
            if not is_same or abs(usage.n_threads - first.n_threads) > POOLED_THREADS:
                self._problems.append(f"{name}: was {first}, is {usage} at frame {n}")
        self._begin_s = time.monotonic()


if __name__ == "__main__":
    sys.exit(main())
