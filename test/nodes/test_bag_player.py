"""Replaying bags of every format into the nodes, in a process of its own."""

import dataclasses
import re
import signal
import sys
import time

import pytest

pytest.importorskip("rclpy")

import itertools

from recorded import write_compressed_bag
from ros_graph import CAMERA, N_DISPARITIES, Graph, process_starter, signal_at, stereo_pair
from rosbags import rosbag1
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image

from lrtrav_ros import Config, Detector
from lrtrav_ros.commands import run
from lrtrav_ros.frame import Frame
from lrtrav_ros.io import zstd_files
from lrtrav_ros.io.bag_writer import write_stereo_bag
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.message_frames import header_stamp_ns
from lrtrav_ros.io.topics import COMPRESSED_TYPE, IMAGE_TYPE, INFO_TYPE
from lrtrav_ros.nodes.bag_player import ReplayOptions, published_names
from lrtrav_ros.nodes.long_range_node import LongRangeNode
from lrtrav_ros.nodes.short_range_node import ShortRangeNode

SETTINGS = {"stereo.n_disparities": N_DISPARITIES, "superpixels.n_superpixels": 40}
PERIOD_NS = 100_000_000
START_NS = 1_700_000_000_000_000_000
STAMPS = [START_NS + i * PERIOD_NS for i in range(5)]
# Best effort may lose what `replay` publishes just before it ends.
RELIABLE = "qos_overrides./{}/{}/image_rect{}.subscription.reliability"
COMMAND = "import sys; from lrtrav_ros.commands import run; sys.exit(run('replay', sys.argv[1:]))"


@pytest.fixture(scope="module")
def graph(ros):
    reliable = {RELIABLE.format("replay", side, ""): "reliable" for side in ("left", "right")}
    graph = Graph(LongRangeNode, ShortRangeNode, namespace="replay", settings={**SETTINGS, **reliable})
    graph.listen(Image, "short_range/mask")
    graph.listen(Image, "long_range/mask")
    yield graph
    graph.close()


@pytest.fixture
def left_images(graph):
    """Collect the left images that are replayed, and when they came."""
    received = []
    subscription = graph.tester.create_subscription(
        Image,
        "left/image_rect",
        lambda message: received.append((header_stamp_ns(message), time.monotonic(), message)),
        50,
    )
    graph.received["long_range/mask"].clear()
    yield received
    graph.tester.destroy_subscription(subscription)


def frames():
    left, right = stereo_pair()
    return [Frame(name=str(s), left=left, right=right, camera=CAMERA, stamp_ns=s) for s in STAMPS]


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    paths = {"mcap": folder / "mcap", "sqlite3": folder / "sqlite3", "rosbag1": folder / "ros1.bag"}
    for name, path in paths.items():
        write_stereo_bag(path, frames(), format=name)
    return paths


@pytest.fixture
def start(graph):
    """Start a replay; end it where the test did not."""
    with process_starter() as start_command:
        yield lambda *arguments, namespace="/replay", code=COMMAND: start_command(
            sys.executable, "-c", code, *map(str, arguments), "--ros-args", "-r", f"__ns:={namespace}"
        )


def finished(graph, process):
    """Wait for the end of a process; return exit status, output and errors, whatever time it took to be discovered."""
    graph.spin_until(lambda: process.poll() is not None)
    output, errors = process.communicate()
    lines = errors.splitlines(keepends=True)
    return process.returncode, output, "".join(line for line in lines if not line.startswith("waiting for subscribers"))


@pytest.mark.parametrize("name", ["mcap", "sqlite3", "rosbag1"])
def test_bags_of_every_format_reach_the_nodes(graph, left_images, bags, start, name):
    status, output, errors = finished(graph, start(bags[name]))
    assert (status, errors) == (0, "")
    assert output.startswith("published 20 messages on 4 topics in ")
    graph.at("long_range/mask", STAMPS[-1])
    assert [stamp for stamp, _, _ in left_images] == STAMPS
    assert all((decode_message(message) == stereo_pair()[0]).all() for _, _, message in left_images)


def test_compressed_images_of_a_compressed_bag_give_the_same_masks(ros, start, tmp_path):
    path = tmp_path / "bag"
    write_compressed_bag(path, frames())
    (file,) = path.glob("*.mcap")
    compressed = path / f"{file.name}.zstd"
    with zstd_files.zstd.ZstdFile(compressed, "wb") as stream:
        stream.write(file.read_bytes())
    file.unlink()
    (path / "metadata.yaml").unlink()
    settings = {**SETTINGS, "memory.frames": 0}
    reliable = {RELIABLE.format("replay_compressed", side, "/compressed"): "reliable" for side in ("left", "right")}
    compressing = {**settings, **reliable, "source.compressed": True}
    graph = Graph(LongRangeNode, ShortRangeNode, namespace="replay_compressed", settings=compressing)
    try:
        graph.listen(Image, "short_range/mask")
        graph.listen(Image, "long_range/mask")
        status, _, errors = finished(graph, start(compressed, namespace="/replay_compressed"))
        assert (status, errors) == (0, "")
        found = Detector(Config().updated(settings), CAMERA).detect(*stereo_pair())
        assert (decode_message(graph.at("short_range/mask", STAMPS[-1])) == found.short_range.mask).all()
        assert (decode_message(graph.at("long_range/mask", STAMPS[-1])) == found.long_range.mask).all()
        assert (found.short_range.mask == 255).any()
    finally:
        graph.close()


@pytest.mark.parametrize(
    ("number", "file", "function", "status"),
    [
        (signal.SIGTERM, "io/zstd_files.py", "decompress_file", 143),
        (signal.SIGINT, "io/bag_reader.py", "_compare_counts", 130),
        (signal.SIGTERM, "rclpy/node.py", "__init__", 0),
        (signal.SIGINT, "rclpy/node.py", "create_publisher", 0),
    ],
)
def test_a_signal_leaves_nothing_temporary(start, bags, tmp_path, monkeypatch, number, file, function, status):
    (plain,) = bags["sqlite3"].glob("*.db3")
    bag = tmp_path / "a.db3.zstd"
    bag.write_bytes(zstd_files.zstd.compress(plain.read_bytes()))
    (temporary := tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    _, errors = (process := start(bag, code=f"{signal_at(file, function, number)}{COMMAND}")).communicate(timeout=300)
    assert (process.returncode, errors) == (status, "")
    assert not list(temporary.iterdir())


def test_a_loop_jumps_back_in_time_and_goes_on_until_a_signal(graph, left_images, bags, start):
    process = start(bags["mcap"], "--loop", "--clock")
    clock = []
    subscription = graph.tester.create_subscription(Clock, "/clock", clock.append, 10)

    def rounds():
        stamps = [header_stamp_ns(message) for message in graph.received["long_range/mask"]]
        return sum(later < earlier for earlier, later in itertools.pairwise(stamps))

    graph.spin_until(lambda: rounds() >= 2 and clock)
    graph.tester.destroy_subscription(subscription)
    process.send_signal(signal.SIGINT)
    status, _, errors = finished(graph, process)
    assert (status, errors) == (0, "")
    times = [message.clock.sec * 10**9 + message.clock.nanosec for message in clock]
    assert all(STAMPS[0] <= time_ns <= STAMPS[-1] for time_ns in times)


def test_a_long_gap_is_told(graph, left_images, start, tmp_path):
    *before, last = frames()
    late = dataclasses.replace(last, stamp_ns=last.stamp_ns + 10**12)
    write_stereo_bag(tmp_path / "bag", [*before, late])
    process = start(tmp_path / "bag")
    graph.spin_until(lambda: STAMPS[3] in map(header_stamp_ns, graph.received["long_range/mask"]))
    process.send_signal(signal.SIGINT)
    errors = finished(graph, process)[2]
    assert errors.startswith("the next message comes in ")
    assert errors.endswith(" s, unless the bag's times are damaged\n")


def test_a_part_at_another_rate_under_other_names(graph, left_images, bags, start):
    infos = []
    subscription = graph.tester.create_subscription(CameraInfo, "other", infos.append, 10)
    arguments = ["--start", 0.1, "--duration", 0.3, "--rate", 0.5, "--remap", "/left/camera_info:=other"]
    status, output, errors = finished(graph, start(bags["mcap"], *arguments))
    graph.tester.destroy_subscription(subscription)
    assert (status, errors) == (0, "")
    assert output.startswith("published 12 messages on 4 topics in ")
    assert [stamp for stamp, _, _ in left_images] == STAMPS[1:4]
    assert [header_stamp_ns(info) for info in infos] == STAMPS[1:4]
    # Two periods at half the speed take 4 of the bag's.
    assert float(re.search(r" in (\S+) s$", output, re.MULTILINE)[1]) >= 4 * PERIOD_NS / 1e9


def test_what_can_be_read_of_a_truncated_bag_is_played(graph, bags, start, tmp_path):
    whole = next(bags["mcap"].glob("*.mcap")).read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole[: len(whole) * 2 // 3])
    status, output, errors = finished(graph, start(path, "--no-wait"))
    assert status == 1
    assert "cut.mcap: damaged or not finished" in errors
    assert errors.endswith(f"{path}: is damaged; what could be read of it is published\n")
    n_published = int(output.split()[1])
    assert 8 <= n_published < 16


@pytest.mark.parametrize(
    ("status", "arguments", "reason"),
    [
        (1, ["nothing.mcap"], "replay: nothing.mcap: there is no such recording"),
        (2, ["{mcap}", "--rate", "0"], "replay: rate is 0; give a number above 0"),
        (2, ["{mcap}", "--start", "nan"], "replay: start is nan"),
        (2, ["{mcap}", "--remap", "/left"], "replay: --remap /left: write FROM:=TO"),
        (1, ["{mcap}", "--remap", "/cam0:=elsewhere"], "has no topic '/cam0' to remap; there are /left/camera_info"),
    ],
)
def test_errors_before_ros_starts_are_one_line(capsys, bags, status, arguments, reason):
    assert run("replay", [argument.format(**bags) for argument in arguments]) == status
    output, errors = capsys.readouterr()
    assert (output, errors.count("\n")) == ("", 1)
    assert reason in errors


@pytest.mark.parametrize(
    ("status", "arguments", "reason"),
    [
        (2, ["{mcap}", "--remap", "/left/image_rect:=bad name"], "'bad name' is not a name for a topic"),
        (2, ["{mcap}", "--ros-args", "--foo"], "replay: wrong ROS arguments: "),
        (1, ["{mcap}", "--start", "9"], "lasts 0.400 s; start at 9 s is behind its end"),
    ],
)
def test_errors_are_one_line(graph, bags, start, status, arguments, reason):
    found, output, errors = finished(graph, start(*(argument.format(**bags) for argument in arguments)))
    assert (found, output, errors.count("\n")) == (status, "", 1)
    assert reason in errors


@pytest.mark.parametrize("all_topics", [False, True])
def test_a_type_that_is_not_installed_ends_the_replay_with_its_name(graph, start, tmp_path, all_topics):
    bag = tmp_path / "own.bag"
    with rosbag1.Writer(bag) as writer:
        own = writer.add_connection("/own", "own_msgs/msg/Own", msgdef="uint8 a\n", md5sum="0" * 32)
        writer.write(own, 3, b"\5")
    options = ["--all"] if all_topics else ["--remap", "/own:=/mine"]
    status, output, errors = finished(graph, start(str(bag), "--no-wait", *options))
    assert (status, output) == (1, "")
    assert "its type own_msgs/msg/Own is not installed" in errors
    reason = "no topic has a type that is installed" if all_topics else "install the ROS package own_msgs"
    assert errors.endswith(f"{reason}\n")


def test_published_names():
    types = {
        "/robot/left/image_raw/compressed": COMPRESSED_TYPE,
        "/robot/right/image_raw/compressed": COMPRESSED_TYPE,
        "/robot/left/camera_info": INFO_TYPE,
        "/robot/right/camera_info": INFO_TYPE,
        "/tf": "tf2_msgs/msg/TFMessage",
    }
    inputs = {
        "/robot/left/image_raw/compressed": "left/image_rect/compressed",
        "/robot/right/image_raw/compressed": "right/image_rect/compressed",
        "/robot/left/camera_info": "left/camera_info",
        "/robot/right/camera_info": "right/camera_info",
    }
    assert published_names(types, ReplayOptions()) == inputs
    raw = {topic: name.replace("image_rect", "image_raw") for topic, name in inputs.items()}
    assert published_names(types, ReplayOptions(raw=True)) == raw
    assert published_names(types, ReplayOptions(all_topics=True)) == {**inputs, "/tf": "/tf"}
    assert published_names(types, ReplayOptions(remap={"/tf": "/old_tf"})) == {**inputs, "/tf": "/old_tf"}
    assert published_names({"/a": IMAGE_TYPE}, ReplayOptions(remap={"/a": "b"})) == {"/a": "b"}
    with pytest.raises(ValueError, match="lacks topics for frames"):
        published_names({"/a": IMAGE_TYPE}, ReplayOptions())


@pytest.mark.parametrize("has_calibration", [True, False])
def test_depth_comes_with_its_own_calibration(has_calibration):
    types = {
        "/cam/left/image_rect": IMAGE_TYPE,
        "/cam/left/camera_info": INFO_TYPE,
        "/cam/depth/image_rect": IMAGE_TYPE,
        **({"/cam/depth/camera_info": INFO_TYPE} if has_calibration else {}),
    }
    names = {topic: topic.removeprefix("/cam/") for topic in types}
    assert published_names(types, ReplayOptions(source="depth")) == names


def test_a_topic_that_is_remapped_to_an_input_takes_its_part():
    types = {
        "/cam0/image": IMAGE_TYPE,
        "/cam1/image": IMAGE_TYPE,
        "/cam0/camera_info": INFO_TYPE,
        "/cam1/camera_info": INFO_TYPE,
    }
    remap = {"/cam0/image": "left/image_rect", "/cam1/image": "/right/image_rect"}
    assert published_names(types, ReplayOptions(remap=remap)) == {
        "/cam0/image": "left/image_rect",
        "/cam1/image": "right/image_rect",
        "/cam0/camera_info": "left/camera_info",
        "/cam1/camera_info": "right/camera_info",
    }
