"""The executables as processes: signals, exit status, errors; and what surrounds them."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time
from ros_graph import ROOT, Graph, process_starter, signal_at
from rosgraph_msgs.msg import Clock

from lrtrav_ros.nodes import shared_memory

COMMAND = "import sys; from lrtrav_ros.commands import run; sys.exit(run(sys.argv[1], sys.argv[2:]))"
FAST = ["-p", "stereo.matcher:=bm"]
# What comes before the command: a signal to itself when a module is imported, and one from before the start.
AT_IMPORT = """
import os, sys
sys.addaudithook(lambda event, args: event == "import" and args[0] == {module!r} and os.kill(os.getpid(), {number:d}))
"""
HELD_BACK = """
import os, signal
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
os.kill(os.getpid(), signal.SIGINT)
"""


@pytest.fixture(scope="module")
def graph(ros):
    graph = Graph(namespace="process", settings={})
    yield graph
    graph.close()


@pytest.fixture
def start():
    """Start an executable; end it where the test did not."""
    with process_starter() as start_command:
        yield lambda name, *ros_args, code=COMMAND: start_command(
            sys.executable, "-c", code, name, "--ros-args", "-r", "__ns:=/process", *ros_args
        )


@pytest.mark.parametrize(
    ("name", "nodes", "signals"),
    [
        ("detector", ["short_range", "long_range"], [signal.SIGINT]),
        ("short_range_node", ["short_range"], [signal.SIGTERM]),
        ("long_range_node", ["long_range"], [signal.SIGINT, signal.SIGINT, signal.SIGTERM]),
    ],
)
def test_nodes_run_until_a_signal_and_end_well(graph, start, name, nodes, signals):
    process = start(name, *FAST)
    graph.received["/diagnostics"].clear()

    def seen():
        statuses = [status for array in graph.received["/diagnostics"] for status in array.status]
        names = {status.name for status in statuses if status.hardware_id.startswith("/process/")}
        return {name for name in names if name.endswith(": frames")}

    graph.spin_until(lambda: seen() == {f"{node}: frames" for node in nodes})
    if name == "long_range_node":
        check_diagnostics(graph)
    for number in signals:
        process.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.05)
    graph.spin_until(lambda: process.poll() is not None)
    _, errors = process.communicate()
    assert process.returncode == 0
    assert errors.count("ready") == len(nodes)
    assert "Traceback" not in errors


def check_diagnostics(graph):
    """Check that diagnostics of the long-range node come once a second."""

    def arrays():
        return [
            array for array in graph.received["/diagnostics"] if array.status[0].hardware_id == "/process/long_range"
        ]

    graph.spin_until(lambda: len(arrays()) >= 3)
    times = [array.header.stamp.sec + array.header.stamp.nanosec / 1e9 for array in arrays()[:3]]
    assert 1.0 < times[2] - times[0] < 6.0  # two seconds, or what a busy machine makes of them


@pytest.mark.parametrize(
    ("module", "number"),
    [
        ("lrtrav_ros.nodes.process", signal.SIGINT),  # the first that the command imports
        ("numba", signal.SIGTERM),
    ],
)
def test_a_signal_while_it_imports_ends_it_well(start, module, number):
    """Before that Python itself starts, and is killed by a signal as any program of it is."""
    check_ends_well(start("detector", code=f"{AT_IMPORT.format(module=module, number=number)}{COMMAND}"))


def test_a_signal_that_came_during_a_restart_ends_it_well(start):
    check_ends_well(start("detector", code=f"{HELD_BACK}{COMMAND}"))


def test_a_signal_while_nodes_are_made_ends_it_well(start):
    process = start("detector", *FAST)
    errors = process.stderr.readline()
    assert "long_range]: ready" in errors  # and the short range is not
    process.send_signal(signal.SIGINT)
    check_ends_well(process)


@pytest.mark.parametrize(
    ("file", "function"),
    [
        ("nodes/short_range_node.py", "__init__"),  # between two nodes
        ("rclpy/node.py", "create_publisher"),  # within one
    ],
)
def test_a_signal_at_any_step_of_making_nodes_ends_it_well(start, file, function):
    check_ends_well(start("detector", *FAST, code=f"{signal_at(file, function)}{COMMAND}"))


def test_a_time_that_rclpy_cannot_take_ends_no_node(graph, start):
    process = start("short_range_node", *FAST, "-p", "use_sim_time:=true")

    def statuses():
        arrays = graph.received["/diagnostics"]
        return [array for array in arrays if array.status[0].hardware_id == "/process/short_range"]

    for _ in range(3):
        graph.received["/diagnostics"].clear()
        graph.spin_until(statuses)
        graph.publish("/clock", Clock(clock=Time(sec=-1)))
    process.send_signal(signal.SIGTERM)
    errors = check_ends_well(process)
    assert "rclpy cannot take a message: Seconds value must not be negative" in errors


SHUT_DOWN_TWICE = """
import rclpy
from rclpy.context import Context
from lrtrav_ros.nodes.ros_shutdown import ros_shut_down

def late(context):
    "Shut down as rclpy does, and just before as a signal does."
    with context.handle:
        context.handle.shutdown()
        context.handle.shutdown()

Context.try_shutdown = late
rclpy.init()
with ros_shut_down():
    assert rclpy.ok()
assert not rclpy.ok()
"""


def test_a_signal_while_ros_is_shut_down_ends_it_well(start):
    check_ends_well(start("", code=SHUT_DOWN_TWICE))


def check_ends_well(process):
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0
    assert "Traceback" not in errors
    return errors


@pytest.mark.parametrize(
    ("ros_args", "reason"),
    [
        (["--params-file", "nothing.yaml"], "nothing.yaml"),
        (["-p", "use_sim_time:=3"], "use_sim_time"),
        (
            ["-p", "qos_overrides./process/left/image_rect.subscription.reliability:=magic"],
            "a parameter qos_overrides./process/left/image_rect… does not fit: Unexpected QoS override",
        ),
    ],
)
def test_wrong_parameters_end_with_status_2(start, ros_args, reason):
    _, errors = (process := start("short_range_node", *ros_args)).communicate(timeout=300)
    assert process.returncode == 2
    assert reason in errors.splitlines()[-1]
    assert "Traceback" not in errors


@pytest.mark.parametrize("name", ["detector", "short_range_node", "long_range_node", "replay"])
def test_help_does_not_import_ros(name):
    code = "import atexit, sys; atexit.register(lambda: print({'rclpy', 'numpy'} & set(sys.modules))); " + COMMAND
    result = subprocess.run(
        [sys.executable, "-c", code, name, "--help"], capture_output=True, cwd=ROOT, text=True, timeout=300, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith(f"usage: {name}")
    assert result.stdout.endswith("set()\n")


@pytest.mark.parametrize(
    ("profile", "segment"),
    [(shared_memory.IMAGES_PROFILE, 64 * 2**20), (shared_memory.DETECTOR_PROFILE, 16 * 2**20)],
)
def test_profiles_take_the_place_of_each_other(monkeypatch, profile, segment):
    monkeypatch.setattr(shared_memory, "_has_room", lambda: True)
    other = shared_memory.profile_file("fastdds.xml")
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(other))
    shared_memory.use_segment(profile)
    file = Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"])
    assert f"<segment_size>{segment}</segment_size>" in file.read_text()


def test_profile_is_used_unless_the_user_has_one(monkeypatch):
    monkeypatch.setattr(shared_memory, "_has_room", lambda: True)
    for name in shared_memory._VARIABLES:
        monkeypatch.delenv(name, raising=False)
    shared_memory.use_segment(shared_memory.IMAGES_PROFILE)
    assert Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"]) == ROOT / "config" / "fastdds.xml"
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "mine.xml")
    shared_memory.use_segment(shared_memory.IMAGES_PROFILE)
    assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == "mine.xml"


def test_small_shared_memory_keeps_the_stock_segment(monkeypatch):
    monkeypatch.setattr(shared_memory, "_has_room", lambda: False)
    for name in shared_memory._VARIABLES:
        monkeypatch.delenv(name, raising=False)
    shared_memory.use_segment(shared_memory.IMAGES_PROFILE)
    assert not set(shared_memory._VARIABLES) & set(os.environ)
