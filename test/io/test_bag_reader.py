"""Messages of bags of either ROS."""

import resource
from pathlib import Path

import numpy as np
import pytest
from recorder import CAMERA, HEIGHT, ROS2, START_NS, WIDTH, Recorder, random_image, storage_file
from rosbags import rosbag1

from lrtrav_ros.io.bag_reader import BagReader


def test_messages_are_those_of_ros2(any_recorder):
    any_recorder.infos()
    any_recorder.image("/left/image_rect", random_image(1), START_NS, delay_ns=5)
    any_recorder.image("/right/image_rect", random_image(2), START_NS, delay_ns=9)
    any_recorder.close()
    with BagReader(any_recorder.path) as reader:
        assert reader.topics["/left/image_rect"] == "sensor_msgs/msg/Image"
        assert reader.counts["/right/camera_info"] == 1
        assert (reader.start_ns, reader.end_ns) == (START_NS, START_NS + 9)
        assert [message.time_ns - START_NS for message in reader.messages()] == [0, 0, 5, 9]
        assert list(reader.messages([])) == []
        assert list(reader.messages({})) == []
        (late,) = reader.messages(start_ns=START_NS + 6)
        assert late.topic == "/right/image_rect"
        (info,) = reader.messages(["/right/camera_info"])
        image = ROS2.deserialize_cdr(late.data, late.type)
        assert np.array_equal(image.data.reshape(HEIGHT, WIDTH, 3), random_image(2))
        assert image.header.frame_id == "camera"
        assert ROS2.deserialize_cdr(info.data, info.type).p[3] == -CAMERA.fx * CAMERA.baseline_m


def test_types_of_ones_own_are_converted(tmp_path):
    bag = rosbag1.Writer(tmp_path / "own.bag")
    with bag:
        own = bag.add_connection(
            "own", "own_msgs/msg/Own", msgdef="Header header\nuint8 a\nfloat64 b\n", md5sum="0" * 32
        )
        bag.write(own, 3, b"\7\0\0\0\1\0\0\0\2\0\0\0\3\0\0\0abc" + b"\x05" + np.float64(2.5).tobytes())
    with BagReader(tmp_path / "own.bag") as reader:
        (message,) = reader.messages()
        assert (message.topic, message.type) == ("own", "own_msgs/msg/Own")
        assert reader.problems == []
    # In CDR: stamp, string with its end, one byte, and a double on a multiple of 8.
    assert message.data[4:20] == b"\1\0\0\0\2\0\0\0\4\0\0\0abc\0"
    assert message.data[20] == 5
    assert message.data[28:36] == np.float64(2.5).tobytes()


def test_error_at_the_end_of_opening_closes_the_files(tmp_path, monkeypatch):
    recorder = Recorder(tmp_path / "bag")
    recorder.infos()
    recorder.close()

    def failing(self, metadata):
        raise ValueError("contradiction")

    monkeypatch.setattr(BagReader, "_compare_counts", failing)
    n_open = len(list(Path("/dev/fd").iterdir()))
    with pytest.raises(ValueError, match="contradiction") as raised:
        BagReader(recorder.path)
    assert len(list(Path("/dev/fd").iterdir())) == n_open
    assert raised.traceback  # which refers to the reader: it was closed, and not only forgotten


def test_recording_of_more_files_than_may_be_open_raises_the_limit(tmp_path):
    recorder = Recorder(tmp_path / "one")
    recorder.infos()
    recorder.close()
    bag = tmp_path / "bag"
    bag.mkdir()
    for i in range(60):
        (bag / f"{i}.mcap").write_bytes(storage_file(recorder.path).read_bytes())
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(list(Path("/dev/fd").iterdir())) + 30, before[1]))
    try:
        with BagReader(bag) as reader:
            assert reader.problems == []
            assert len(list(reader.messages())) == 120
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_recording_of_more_files_than_can_be_allowed_is_refused(tmp_path, monkeypatch):
    recorder = Recorder(tmp_path / "bag")
    recorder.infos()
    recorder.close()
    monkeypatch.setattr("resource.getrlimit", lambda _: (3, 4))
    with pytest.raises(OSError, match=r"it has 1 files, and this process may open 4; allow \d+, as with `ulimit"):
        BagReader(recorder.path)
