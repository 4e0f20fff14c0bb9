"""Tests of bags: recordings of each format that rosbags writes here, whole, cut off and with faults."""

import dataclasses
import itertools
import re

import cv2
import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.bag_frames import FORMATS, StereoBag, write_stereo_bag
from lrtrav_ros.io.bag_reader import Recording
from lrtrav_ros.io.camera_info import VIRTUAL_BASELINE_M
from lrtrav_ros.io.dataset_folder import Frame

HEIGHT, WIDTH = 30, 41
START_NS = 1_700_000_000_000_000_000
CAMERA = StereoCamera(fx=50.5, fy=51.0, cx=18.25, cy=11.5, baseline_m=0.25)
ROS2 = get_typestore(Stores.ROS2_JAZZY)
ROS1 = get_typestore(Stores.ROS1_NOETIC)


def random_image(seed, channels=3):
    shape = (HEIGHT, WIDTH, 3) if channels == 3 else (HEIGHT, WIDTH)
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def make_frames(n=6, **inputs):
    """Return frames 0.1 s apart."""
    return [
        Frame(
            name=str(START_NS + i * 10**8),
            left=random_image(2 * i),
            camera=CAMERA,
            stamp_ns=START_NS + i * 10**8,
            **(inputs or {"right": random_image(2 * i + 1)}),
        )
        for i in range(n)
    ]


class Recorder:
    """Writes messages with the types of ROS 1 or ROS 2, as a recorder of that system does."""

    def __init__(self, path, kind="mcap", compression=None):
        self.path = path
        self.is_ros1 = kind == "rosbag1"
        self.store = ROS1 if self.is_ros1 else ROS2
        self.connections = {}
        if self.is_ros1:
            self.bag = rosbag1.Writer(path)
            self.bag.chunk_threshold = 20_000
            if compression:
                self.bag.set_compression(rosbag1.Writer.CompressionFormat[compression])
        else:
            self.bag = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[kind.upper()])
            if compression:
                storage = rosbag2.CompressionMode.STORAGE
                self.bag.set_compression(storage, rosbag2.CompressionFormat[compression])
        self.bag.open()

    def close(self):
        self.bag.close()

    def make(self, kind, **fields):
        return self.store.types[kind](**fields)

    def header(self, stamp_ns):
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        seq = {"seq": 7} if self.is_ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id="camera", **seq)

    def write(self, topic, message, time_ns):
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.bag.add_connection(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr
        self.bag.write(self.connections[topic], time_ns, serialize(message, kind))

    def image_message(self, image, stamp_ns, encoding, **fields):
        values = {
            "header": self.header(stamp_ns),
            "height": image.shape[0],
            "width": image.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": image.strides[0],
            "data": np.frombuffer(image.tobytes(), np.uint8),
        }
        return self.make("sensor_msgs/msg/Image", **{**values, **fields})

    def image(self, topic, image, stamp_ns, encoding="bgr8", *, delay_ns=0, **fields):
        self.write(topic, self.image_message(image, stamp_ns, encoding, **fields), stamp_ns + delay_ns)

    def compressed(self, topic, image, stamp_ns, text="bgr8; png compressed bgr8"):
        data = cv2.imencode(".png", image)[1].reshape(-1)
        header = self.header(stamp_ns)
        message = self.make("sensor_msgs/msg/CompressedImage", header=header, format=text, data=data)
        self.write(topic, message, stamp_ns)

    def region(self, height=0, width=0):
        kind = "sensor_msgs/msg/RegionOfInterest"
        return self.make(kind, x_offset=0, y_offset=0, height=height, width=width, do_rectify=False)

    def info(self, topic, stamp_ns, *, baseline_m=0.0, fx=CAMERA.fx, size=(HEIGHT, WIDTH)):
        matrices = {
            "d": np.zeros(5),
            "k": np.eye(3).reshape(-1),
            "r": np.eye(3).reshape(-1),
            "p": np.array([fx, 0, CAMERA.cx, -fx * baseline_m, 0, CAMERA.fy, CAMERA.cy, 0, 0, 0, 1, 0]),
        }
        message = self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp_ns),
            height=size[0],
            width=size[1],
            distortion_model="plumb_bob",
            **{name.upper() if self.is_ros1 else name: value for name, value in matrices.items()},
            binning_x=0,
            binning_y=0,
            roi=self.region(),
        )
        self.write(topic, message, stamp_ns)

    def infos(self, stamp_ns=START_NS, namespace=""):
        self.info(f"{namespace}/left/camera_info", stamp_ns)
        self.info(f"{namespace}/right/camera_info", stamp_ns, baseline_m=CAMERA.baseline_m)

    def disparity(self, topic, disparity, stamp_ns, *, min_disparity=0.0, f=60.0, t=0.5):
        message = self.make(
            "stereo_msgs/msg/DisparityImage",
            header=self.header(stamp_ns),
            image=self.image_message(disparity, stamp_ns, "32FC1"),
            f=f,
            valid_window=self.region(HEIGHT, WIDTH),
            min_disparity=min_disparity,
            max_disparity=64.0,
            delta_d=0.125,
            **{"T" if self.is_ros1 else "t": t},
        )
        self.write(topic, message, stamp_ns)


@pytest.fixture
def recorder(tmp_path):
    """A recorder of an MCAP bag, which `read` closes."""
    return Recorder(tmp_path / "bag")


@pytest.fixture(params=FORMATS)
def any_recorder(request, tmp_path):
    return Recorder(tmp_path / "bag", request.param)


def read(recorder, **options):
    """Close the recorder; return its bag's frames and problems."""
    recorder.close()
    with StereoBag(recorder.path, **options) as bag:
        return list(bag.frames()), bag.problems


def record_pairs(recorder, n):
    """Record calibration and `n` pairs, 1 ns apart."""
    recorder.infos()
    for i in range(n):
        recorder.image("/left/image_rect", random_image(i), START_NS + i)
        recorder.image("/right/image_rect", random_image(i), START_NS + i)


def storage_file(path):
    """Return the file that holds the messages of a bag."""
    return path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")


def assert_same(frame, written):
    assert (frame.name, frame.stamp_ns) == (written.name, written.stamp_ns)
    for field in ("left", "right", "disparity", "depth_m"):
        value, expected = getattr(frame, field), getattr(written, field)
        assert (value is None) == (expected is None)
        if value is not None:
            assert value.dtype == expected.dtype
            assert np.array_equal(value, expected)


@pytest.mark.parametrize("kind", FORMATS)
def test_frames_come_back(kind, tmp_path):
    frames = make_frames()
    write_stereo_bag(tmp_path / "bag", frames, format=kind)
    with StereoBag(tmp_path / "bag") as bag:
        assert (len(bag), bag.source) == (6, "stereo")
        result = list(bag.frames())
        assert bag.problems == []
    for frame, written in zip(result, frames, strict=True):
        assert_same(frame, written)
        assert dataclasses.astuple(frame.camera) == pytest.approx(dataclasses.astuple(CAMERA))
    assert [file.name for file in tmp_path.iterdir()] == ["bag"]


@pytest.mark.parametrize("key", ["disparity", "depth_m"])
def test_disparity_and_depth_frames_come_back(key, tmp_path):
    values = random_image(9, channels=1).astype(np.float32) / 7
    values[3:9, 4:30] = 0
    frames = make_frames(2, **{key: values})
    write_stereo_bag(tmp_path / "bag", frames)
    with StereoBag(tmp_path / "bag") as bag:
        assert bag.source == key.removesuffix("_m")
        result = list(bag.frames())
        for frame, written in zip(result, frames, strict=True):
            assert_same(frame, written)
            assert dataclasses.astuple(frame.camera) == pytest.approx(dataclasses.astuple(CAMERA))


def test_recordings_of_any_system_are_read(any_recorder):
    any_recorder.infos()
    any_recorder.image("/left/image_rect", random_image(1), START_NS)
    any_recorder.image("/right/image_rect", random_image(2), START_NS)
    (frame,), problems = read(any_recorder)
    assert problems == []
    assert np.array_equal(frame.left, random_image(1))
    assert np.array_equal(frame.right, random_image(2))
    assert frame.name == str(START_NS)
    assert dataclasses.astuple(frame.camera) == pytest.approx(dataclasses.astuple(CAMERA))


def test_a_single_file_is_a_recording(tmp_path):
    for kind in ("mcap", "sqlite3"):
        write_stereo_bag(tmp_path / kind, make_frames(2), format=kind)
        with StereoBag(storage_file(tmp_path / kind)) as bag:
            assert [frame.name for frame in bag.frames()] == [frame.name for frame in make_frames(2)]


@pytest.mark.parametrize("share", [0.95, 0.5])
@pytest.mark.parametrize("kind", FORMATS)
def test_a_bag_that_is_cut_off_yields_what_is_left(kind, share, tmp_path):
    frames = make_frames(40)
    write_stereo_bag(tmp_path / "bag", frames, format=kind)
    file = storage_file(tmp_path / "bag")
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * share)])
    with StereoBag(tmp_path / "bag") as bag:
        result = list(bag.frames())
        assert "damaged or not finished" in bag.problems[0]
        assert any("cut off or damaged" in problem for problem in bag.problems[1:])
    assert 40 * share - 4 <= len(result) <= 40 * share + 2
    for frame, written in zip(result, frames, strict=False):
        assert_same(frame, written)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_a_recording_without_metadata_is_read(kind, tmp_path):
    write_stereo_bag(tmp_path / "bag", make_frames(3), format=kind)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    with StereoBag(tmp_path / "bag") as bag:
        assert len(list(bag.frames())) == len(bag) == 3
        assert len(bag.problems) == 1


@pytest.mark.parametrize(("kind", "compression"), [("rosbag1", "BZ2"), ("rosbag1", "LZ4"), ("mcap", "ZSTD")])
def test_compressed_chunks_are_recovered(kind, compression, tmp_path):
    recorder = Recorder(tmp_path / "bag", kind, compression)
    record_pairs(recorder, 40)
    recorder.close()
    file = storage_file(recorder.path)
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with StereoBag(recorder.path, max_stamp_difference_s=0) as bag:
        frames = list(bag.frames())
    assert 10 <= len(frames) <= 25
    for i, frame in enumerate(frames):
        assert np.array_equal(frame.left, random_image(i))


def test_a_damaged_chunk_costs_its_own_messages_only(tmp_path):
    recorder = Recorder(tmp_path / "bag", "rosbag1")
    record_pairs(recorder, 40)
    recorder.close()
    data = bytearray(recorder.path.read_bytes())
    middle = data.index(random_image(20).tobytes())
    data[middle - 200 : middle] = b"\xff" * 200
    recorder.path.write_bytes(data)
    with StereoBag(recorder.path, max_stamp_difference_s=0) as bag:
        found = [frame.stamp_ns - START_NS for frame in bag.frames()]
        assert "damaged" in bag.problems[0]
    assert set(found) >= {*range(15), *range(25, 40)}
    assert 20 not in found
    assert found == sorted(set(found))


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no such recording"):
        StereoBag(tmp_path / "nothing.bag")
    (tmp_path / "text.bag").write_text("text")
    for path in (tmp_path, tmp_path / "text.bag"):
        with pytest.raises(ValueError, match="is no recording"):
            StereoBag(path)


def test_a_bag_without_the_topics_says_what_it_has(recorder):
    recorder.infos()
    recorder.image("/left/image_rect", random_image(1), START_NS)
    recorder.close()
    with pytest.raises(
        ValueError, match=r"needed .* left/image_rect, right/image_rect, .* there are .*/right/camera_info \("
    ):
        StereoBag(recorder.path)


def test_topics_are_found_under_a_namespace(recorder):
    recorder.infos(namespace="/robot/stereo")
    recorder.image("/robot/stereo/left/image_rect_color", random_image(1), START_NS)
    recorder.image("/robot/stereo/right/image_raw", random_image(2), START_NS)
    recorder.image("/other/left/image_rect", random_image(3), START_NS)
    (frame,), problems = read(recorder)
    assert np.array_equal(frame.left, random_image(1))
    assert np.array_equal(frame.right, random_image(2))
    assert len(problems) == 1
    assert "/robot/stereo/right/image_raw is taken for rectified" in problems[0]


def test_topics_may_be_named(recorder):
    recorder.info("/a/camera_info", START_NS)
    recorder.info("/b/camera_info", START_NS, baseline_m=CAMERA.baseline_m)
    recorder.image("/a/picture", random_image(1), START_NS)
    recorder.image("/b/picture", random_image(2), START_NS)
    topics = {"left/image_rect": "/a/picture", "right/image_rect": "b/picture"}
    (frame,), problems = read(recorder, topics=topics)
    assert problems == []
    assert np.array_equal(frame.right, random_image(2))
    for wrong, message in (
        ({"left/image_rect": "/a/nothing"}, "no topic '/a/nothing' of type sensor_msgs/msg/Image .* there are /a/cam"),
        ({"left/image_rect": "/a/camera_info"}, "no topic '/a/camera_info' of type sensor_msgs/msg/Image"),
        ({"left": "/a/picture"}, "'left' is no input"),
    ):
        with pytest.raises(ValueError, match=message):
            StereoBag(recorder.path, topics=wrong)


def test_compressed_images_are_read(any_recorder):
    any_recorder.infos()
    any_recorder.compressed("/left/image_rect/compressed", random_image(1), START_NS)
    any_recorder.compressed("/right/image_rect/compressed", random_image(2, 1), START_NS, "mono8; png compressed ")
    (frame,), problems = read(any_recorder)
    assert problems == []
    assert np.array_equal(frame.left, random_image(1))
    assert np.array_equal(frame.right, random_image(2, 1))


def test_16_bit_images_are_scaled_alike(any_recorder):
    images = [random_image(seed, channels=1).astype(np.uint16) * 13 for seed in (1, 2)]
    any_recorder.infos()
    any_recorder.image("/left/image_rect", images[0], START_NS, "mono16")
    any_recorder.image("/right/image_rect", images[1].byteswap(), START_NS, "mono16", is_bigendian=1)
    (frame,), problems = read(any_recorder)
    assert problems == []
    assert np.array_equal(frame.left, images[0] // 16)  # 3315 at most: 12 bits
    assert np.array_equal(frame.right, images[1] // 16)


def test_disparity_images_bring_focal_length_and_baseline(any_recorder):
    disparity = random_image(4, channels=1).astype(np.float32) / 8 - 1
    any_recorder.info("/left/camera_info", START_NS)
    any_recorder.image("/left/image_rect", random_image(1), START_NS)
    any_recorder.disparity("/disparity", disparity, START_NS, min_disparity=2.0)
    (frame,), problems = read(any_recorder)
    assert problems == []
    assert np.array_equal(frame.disparity, np.where(disparity >= 2, disparity, 0))
    assert frame.camera == StereoCamera(fx=60.0, fy=CAMERA.fy, cx=CAMERA.cx, cy=CAMERA.cy, baseline_m=0.5)


@pytest.mark.parametrize(("dtype", "encoding", "scale"), [(np.uint16, "16UC1", 1000), (np.float32, "32FC1", 1)])
def test_depth_images_are_in_metres(recorder, dtype, encoding, scale):
    depth = (random_image(4, channels=1).astype(np.float32) * scale / 10).astype(dtype)
    recorder.info("/camera/left/camera_info", START_NS)
    recorder.image("/camera/left/image_rect", random_image(1), START_NS)
    recorder.image("/camera/depth/image_rect", depth, START_NS + 10**6, encoding)
    (frame,), problems = read(recorder)
    assert problems == []
    assert frame.depth_m == pytest.approx(depth / scale)
    assert frame.camera.baseline_m == VIRTUAL_BASELINE_M


def test_the_preferred_source_is_taken(recorder):
    recorder.infos()
    recorder.image("/left/image_rect", random_image(1), START_NS)
    recorder.image("/right/image_rect", random_image(2), START_NS)
    recorder.image("/depth/image_rect", np.full((HEIGHT, WIDTH), 2000, np.uint16), START_NS, "16UC1")
    recorder.close()
    for source, expected in (("stereo", "stereo"), ("disparity", "stereo"), ("depth", "depth")):
        with StereoBag(recorder.path, source=source) as bag:
            assert bag.source == expected
            (frame,) = bag.frames()
            assert (frame.right is None, frame.depth_m is None) == (expected != "stereo", expected != "depth")
    with pytest.raises(ValueError, match="'lidar'; choose one of"):
        StereoBag(recorder.path, source="lidar")


def test_images_pair_by_header_stamp(recorder):
    recorder.infos()
    for i in range(5):
        stamp_ns = START_NS + i * 10**8
        recorder.image("/left/image_rect", random_image(i), stamp_ns)
        # Received after the next left image, and stamped 3 ms later.
        recorder.image("/right/image_rect", random_image(i + 50), stamp_ns + 3_000_000, delay_ns=150_000_000)
    recorder.image("/left/image_rect", random_image(7), START_NS + 10**9)
    frames, problems = read(recorder)
    assert len(frames) == 5
    for i, frame in enumerate(frames):
        assert frame.stamp_ns == START_NS + i * 10**8
        assert np.array_equal(frame.right, random_image(i + 50))
    assert len(problems) == 1
    assert "/left/image_rect: 1 of 6 without partner, last stamp 1700000001000000000 ns" in problems[0]


def test_stamps_that_never_pair_are_an_error(recorder):
    recorder.infos()
    for i in range(40):
        recorder.image("/left/image_rect", random_image(1), START_NS + i * 10**8)
        recorder.image("/right/image_rect", random_image(2), START_NS + i * 10**8 + 6_000_000)
    recorder.close()
    with (
        StereoBag(recorder.path) as bag,
        pytest.raises(ValueError, match=r"no images pair; /left/image_rect: 40 of 40 without partner.* by 0\.005 s"),
    ):
        list(bag.frames())
    with StereoBag(recorder.path, max_stamp_difference_s=0.007) as bag:
        assert len(list(bag.frames())) == 40


def test_a_frame_that_cannot_be_used_is_skipped(any_recorder):
    any_recorder.infos()
    faults = {
        1: {"data": np.zeros(10, np.uint8)},
        2: {"encoding": "yuv422"},
        3: {"height": HEIGHT - 1},
    }
    for i in range(5):
        any_recorder.image("/left/image_rect", random_image(i), START_NS + i)
        any_recorder.image("/right/image_rect", random_image(i), START_NS + i, **faults.get(i, {}))
    any_recorder.close()
    with StereoBag(any_recorder.path, max_stamp_difference_s=0) as bag:
        assert [frame.stamp_ns - START_NS for frame in bag.frames()] == [0, 4]
        assert (bag.n_skipped, len(bag.problems)) == (3, 3)
        for problem, (i, text) in zip(
            bag.problems, [(1, "image data has 10 bytes"), (2, "'yuv422'"), (3, "the partner is 41 x 29")], strict=True
        ):
            assert f"skipped frame {START_NS + i}: " in problem
            assert text in problem


def test_a_message_that_cannot_be_read_is_skipped(recorder):
    record_pairs(recorder, 3)
    recorder.bag.write(recorder.connections["/left/image_rect"], START_NS + 5, b"\0\1\0\0\0\0")
    frames, problems = read(recorder, max_stamp_difference_s=0)
    assert len(frames) == 3
    assert "message on /left/image_rect at 1700000000000000005 ns: cannot be read" in problems[0]


def test_stamps_that_are_not_set_give_one_frame_only(recorder):
    recorder.infos()
    for i in range(3):
        recorder.image("/left/image_rect", random_image(i), 0, delay_ns=i)
        recorder.image("/right/image_rect", random_image(i), 0, delay_ns=i)
    frames, problems = read(recorder)
    assert [frame.name for frame in frames] == ["0"]
    assert len(problems) == 2
    assert "frame 0: another frame has this header stamp" in problems[0]


def test_the_newest_calibration_counts_even_if_the_first_is_late(recorder):
    for i in range(4):
        recorder.image("/left/image_rect", random_image(i), START_NS + i)
        recorder.image("/right/image_rect", random_image(i), START_NS + i)
        if i in (1, 2):
            recorder.info("/left/camera_info", START_NS + i, fx=100.0 * i)
            recorder.info("/right/camera_info", START_NS + i, baseline_m=0.1 * i)
    frames, problems = read(recorder, max_stamp_difference_s=0)
    assert problems == []
    assert [frame.camera.fx for frame in frames] == [100, 100, 100, 200]
    assert [frame.camera.baseline_m for frame in frames] == pytest.approx([0.1, 0.1, 0.1, 0.2])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"baseline_m": 0.0}, "thus no baseline"),
        ({"baseline_m": -0.1}, "thus no baseline"),
        ({"baseline_m": 0.1, "fx": 0.0}, r"P\[0\] = 0"),
    ],
)
def test_cameras_that_are_not_calibrated_are_reported(recorder, fields, message):
    recorder.info("/left/camera_info", START_NS)
    recorder.info("/right/camera_info", START_NS, **fields)
    recorder.image("/left/image_rect", random_image(1), START_NS)
    recorder.image("/right/image_rect", random_image(2), START_NS)
    frames, problems = read(recorder)
    assert frames == []
    assert len(problems) == 1
    assert re.search(rf"skipped frame {START_NS}: .*{message}", problems[0])


def test_calibration_of_another_size_is_reported(recorder):
    recorder.info("/left/camera_info", START_NS, size=(480, 640))
    recorder.info("/right/camera_info", START_NS, baseline_m=0.1)
    recorder.image("/left/image_rect", random_image(1), START_NS)
    recorder.image("/right/image_rect", random_image(2), START_NS)
    frames, problems = read(recorder)
    assert frames == []
    assert "CameraInfo is for 640 x 480 pixels, but the left image is 41 x 30" in problems[0]


def test_missing_calibration_is_an_error(recorder):
    recorder.image("/left/image_rect", random_image(1), START_NS)
    recorder.image("/right/image_rect", random_image(2), START_NS)
    for side in ("left", "right"):
        topic, kind = f"/{side}/camera_info", "sensor_msgs/msg/CameraInfo"
        recorder.connections[topic] = recorder.bag.add_connection(topic, kind, typestore=ROS2)
    recorder.close()
    with StereoBag(recorder.path) as bag, pytest.raises(ValueError, match="/left/camera_info has no message"):
        next(bag.frames())


def test_writing_replaces_nothing_and_leaves_nothing_half_done(tmp_path):
    path = tmp_path / "bag"
    with pytest.raises(ValueError, match="'zip'; choose one of mcap, sqlite3, rosbag1"):
        write_stereo_bag(path, [], format="zip")
    unstamped = dataclasses.replace(make_frames(1)[0], stamp_ns=None)
    with pytest.raises(ValueError, match="has no stamp"):
        write_stereo_bag(path, itertools.chain(make_frames(2), [unstamped]))
    assert list(tmp_path.iterdir()) == []
    write_stereo_bag(path, make_frames(1))
    with pytest.raises(FileExistsError, match="exists; remove it"):
        write_stereo_bag(path, make_frames(2))
    with StereoBag(path) as bag:
        assert len(bag) == 1


def test_messages_are_those_of_ros2(any_recorder):
    any_recorder.infos()
    any_recorder.image("/left/image_rect", random_image(1), START_NS, delay_ns=5)
    any_recorder.image("/right/image_rect", random_image(2), START_NS, delay_ns=9)
    any_recorder.close()
    with Recording(any_recorder.path) as recording:
        assert recording.topics["/left/image_rect"] == "sensor_msgs/msg/Image"
        assert recording.counts["/right/camera_info"] == 1
        assert (recording.start_ns, recording.end_ns) == (START_NS, START_NS + 9)
        assert [message.time_ns - START_NS for message in recording.messages()] == [0, 0, 5, 9]
        (late,) = recording.messages(start_ns=START_NS + 6)
        assert late.topic == "/right/image_rect"
        (info,) = recording.messages(["/right/camera_info"])
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
    with Recording(tmp_path / "own.bag") as recording:
        (message,) = recording.messages()
        assert (message.topic, message.type) == ("own", "own_msgs/msg/Own")
        assert recording.problems == []
    # In CDR: stamp, string with its end, one byte, and a double on a multiple of 8.
    assert message.data[4:20] == b"\1\0\0\0\2\0\0\0\4\0\0\0abc\0"
    assert message.data[20] == 5
    assert message.data[28:36] == np.float64(2.5).tobytes()
