"""Tests of `detect --output-bag`, through the command: the file against the folder that is written beside it."""

from __future__ import annotations

import resource
import signal

import numpy as np
import pytest
from recorded import CAMERA, FAST, HEIGHT, N_FRAMES, WIDTH, frames, write_dataset
from rosbags import rosbag1
from rosbags.highlevel import AnyReader

from lrtrav_ros.commands import run
from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.io.bag_writer import write_stereo_bag
from lrtrav_ros.io.encodings import decode_message
from lrtrav_ros.io.image_files import read_disparity, read_image
from lrtrav_ros.io.message_frames import disparity_in_pixels, header_stamp_ns
from lrtrav_ros.io.output_bag import OutputBag
from lrtrav_ros.io.zstd_files import zstd
from lrtrav_ros.mapping.ground_frame import GroundFrame

INPUTS = {"/left/image_rect", "/right/image_rect", "/left/camera_info", "/right/camera_info"}
IMAGES = {
    "short_range/mask",
    "short_range/occupancy",
    "long_range/mask",
    "long_range/occupancy",
    "long_range/confidence",
    "long_range/overlay",
    "depth",
    "segmentation/mask",
    "segmentation/confidence",
}
OTHERS = {"disparity", "short_range/ground_pose", "obstacles", "free", "long_range/grid", "segmentation/points"}


def detect(path, output, *options):
    return run("detect", [str(path), "--output", str(output), *FAST, *options])


def failure(capsys):
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1, printed
    return printed


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("input") / "bag"
    write_stereo_bag(path, frames(), frame_id="left_camera")
    return path


@pytest.fixture(scope="module")
def detected(bag, tmp_path_factory):
    """A folder that has what was found, as files and in out.mcap."""
    folder = tmp_path_factory.mktemp("detected")
    assert detect(bag, folder / "out", "--save", "all", "--output-bag", str(folder / "out.mcap")) == 0
    return folder


def messages(path):
    """Return times and messages of each topic, read by rosbags with the types that the file defines."""
    found = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            found.setdefault(connection.topic, []).append((time_ns, reader.deserialize(data, connection.msgtype)))
    return found


def test_it_has_all_inputs_and_outputs(bag, detected):
    found = messages(detected / "out.mcap")
    assert set(found) == INPUTS | {f"/{name}" for name in IMAGES | OTHERS} | {"/tf"}
    stamps = [frame.stamp_ns for frame in frames()]
    for topic, items in found.items():
        if topic != "/tf":
            assert [header_stamp_ns(message) for _, message in items] == stamps, topic
        assert [time_ns for time_ns, _ in items] == stamps, topic
    for name in IMAGES | {"disparity", "obstacles", "free", "segmentation/points"}:
        assert {message.header.frame_id for _, message in found[f"/{name}"]} == {"left_camera"}
    assert sorted(path.name for path in detected.iterdir()) == ["out", "out.mcap"]
    with BagReader(bag) as old, BagReader(detected / "out.mcap") as new:
        assert [message.data for message in old.messages()] == [message.data for message in new.messages(INPUTS)]
        assert new.problems == []


def test_images_are_those_of_the_folder(detected):
    found = messages(detected / "out.mcap")
    folders = {
        "short_range/mask": "short_range",
        "long_range/mask": "long_range",
        "long_range/occupancy": "occupancy",
        "long_range/confidence": "confidence",
    }
    for topic, folder in folders.items():
        for _, message in found[f"/{topic}"]:
            expected = read_image(detected / "out" / folder / f"{header_stamp_ns(message)}.png")
            assert message.encoding == "mono8"
            assert np.array_equal(decode_message(message), expected)
    for _, message in found["/short_range/occupancy"]:
        mask = read_image(detected / "out" / "short_range" / f"{header_stamp_ns(message)}.png")
        assert np.array_equal(decode_message(message) == 0, mask == 255)
    for _, message in found["/long_range/overlay"]:
        picture = read_image(detected / "out" / "overlay" / f"{header_stamp_ns(message)}.jpg")
        assert np.abs(decode_message(message).astype(float) - picture).mean() < 5  # the file is a JPEG
    for _, message in found["/disparity"]:
        expected = read_disparity(detected / "out" / "disparity" / f"{header_stamp_ns(message)}.png")
        assert np.allclose(disparity_in_pixels(message), expected, atol=1 / 256)
        assert (message.f, message.t) == pytest.approx((CAMERA.fx, CAMERA.baseline_m))


def test_segmentation_and_depth_are_those_of_the_other_outputs(detected):
    found = messages(detected / "out.mcap")
    near = found["/long_range/occupancy"], found["/long_range/confidence"], found["/disparity"]
    outputs = (found[f"/{name}"] for name in ("segmentation/mask", "segmentation/confidence", "depth"))
    clouds = found["/segmentation/points"]
    for items in zip(*near, *outputs, clouds, strict=True):
        *images, cloud = (message for _, message in items)
        occupancy, confidence = map(decode_message, images[:2])
        mask, sure, depth_m = map(decode_message, images[3:])
        disparity = disparity_in_pixels(images[2])
        for value, number in ((0, 1), (100, 2), (255, 0)):
            assert np.array_equal(occupancy == value, mask == number)
        assert np.array_equal(sure, confidence)
        assert images[3].step == WIDTH
        assert np.array_equal(depth_m > 0, disparity > 0)
        assert np.allclose(depth_m * disparity, CAMERA.fx * CAMERA.baseline_m * (disparity > 0), rtol=1e-5)
        assert (cloud.height, cloud.width, cloud.row_step) == (HEIGHT, WIDTH, 12 * WIDTH)
        z = cloud.data.view("<f4").reshape(HEIGHT, WIDTH, 3)[..., 2]
        free = (mask == 1) & (disparity > 0)
        assert free.sum() > 100
        assert np.allclose(z[free], depth_m[free])


def test_maps_are_in_the_ground_frame(detected):
    found = messages(detected / "out.mcap")
    for _, message in found["/long_range/grid"]:
        assert message.header.frame_id == "left_camera_ground"
        assert (message.info.width, message.info.height) == (300, 200)
        assert message.info.resolution == pytest.approx(0.1)
        assert (message.info.origin.position.x, message.info.origin.position.y) == (0, -10)
        assert message.info.origin.orientation.w == 1
        cells = message.data.reshape(200, 300)
        assert set(np.unique(cells)) <= {-1, 0, 100}
        assert (cells[90:110, 20:100] == 0).any()  # the road ahead, 2 to 10 m
    for (_, pose), (_, transform) in zip(found["/short_range/ground_pose"], found["/tf"], strict=True):
        (stamped,) = transform.transforms
        assert (pose.header.frame_id, stamped.header.frame_id) == ("left_camera_ground", "left_camera")
        assert stamped.child_frame_id == "left_camera_ground"
        turned, place = pose.pose.orientation, stamped.transform
        assert np.allclose(
            [turned.x, turned.y, turned.z, turned.w],
            [-place.rotation.x, -place.rotation.y, -place.rotation.z, place.rotation.w],
        )
        height = pose.pose.position.z
        assert np.hypot(np.hypot(place.translation.x, place.translation.y), place.translation.z) == pytest.approx(
            height
        )
        assert place.translation.y > 0.9 * height  # the ground is below: y of the optical frame points down


def test_points_are_those_of_the_ground(detected):
    found = messages(detected / "out.mcap")
    poses = {header_stamp_ns(message): message.pose for _, message in found["/short_range/ground_pose"]}
    n_obstacles = 0
    for topic in ("/free", "/obstacles"):
        for _, message in found[topic]:
            assert [(field.name, field.offset, field.datatype) for field in message.fields] == [
                ("x", 0, 7),
                ("y", 4, 7),
                ("z", 8, 7),
            ]
            assert (message.height, message.point_step, message.row_step) == (1, 12, 12 * message.width)
            points = message.data.view("<f4").reshape(-1, 3)
            above = height_above(points, poses[header_stamp_ns(message)])
            if topic == "/free":
                assert len(points) > 50
                assert np.abs(above).max() < 0.2
            else:
                n_obstacles += len(points)
                assert above.min() > -0.5  # the pose is that of the plane below the camera, and the road bends
                assert above.max() < 2.5
    assert n_obstacles > 0


def height_above(points, pose):
    """Return heights over the ground of points in the camera's frame."""
    from scipy.spatial.transform import Rotation

    turned = pose.orientation
    rotation = Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).as_matrix()
    return GroundFrame(rotation, pose.position.z).from_camera(points.astype(float))[:, 2]


def test_the_file_is_an_indexed_and_compressed_mcap_with_types(detected):
    data = (detected / "out.mcap").read_bytes()
    assert data.startswith(b"\x89MCAP0\r\n")
    assert data.endswith(b"\x89MCAP0\r\n")
    assert data[17:25] == b"\x04\0\0\0ros2"  # the profile, in the first record
    assert b"ros2msg" in data
    assert b"MSG: std_msgs/Header" in data
    assert int.from_bytes(data[-28:-20], "little") > 0  # where the summary begins
    with AnyReader([detected / "out.mcap"]) as reader:
        chunks = reader.readers[0].storage.chunks
        assert len(chunks) > 1
        assert {chunk.compression for chunk in chunks} == {"zstd"}
        assert reader.message_count == N_FRAMES * (len(INPUTS) + len(IMAGES | OTHERS) + 1)


def test_processes_write_the_same(bag, detected, tmp_path):
    path = tmp_path / "deep" / "out.mcap"
    assert detect(bag, tmp_path / "out", "--output-bag", str(path), "--jobs", "2") == 0
    assert path.read_bytes() == (detected / "out.mcap").read_bytes()


def test_a_bag_of_ros1_is_converted_with_all_its_topics(detected, tmp_path):
    bag = tmp_path / "bag.bag"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rosbag1.Writer, "close", close_with_others(rosbag1.Writer.close))
        write_stereo_bag(bag, frames(), format="rosbag1", frame_id="left_camera")
    assert detect(bag, tmp_path / "out", "--output-bag", str(tmp_path / "out.mcap")) == 0
    found, expected = messages(tmp_path / "out.mcap"), messages(detected / "out.mcap")
    assert set(found) == set(expected) | {"/own", "/range"}
    for topic in expected:
        for (time_ns, message), (other_ns, other) in zip(found[topic], expected[topic], strict=True):
            assert time_ns == other_ns
            assert repr(message) == repr(other)
    ((_, own),) = found["/own"]
    assert (own.a, own.header.frame_id, own.b) == (5, "abc", 2.5)
    ((_, distance),) = found["/range"]  # ROS 2 added a field to this type
    assert (distance.max_range, distance.range) == (9, 2)


def close_with_others(close):
    """Return a writer's close that writes messages of other topics before."""

    def close_after(self):
        header = b"\7\0\0\0\1\0\0\0\2\0\0\0\3\0\0\0abc"
        own = self.add_connection(
            "own", "own_msgs/msg/Own", msgdef="Header header\nuint8 a\nfloat64 b\n", md5sum="0" * 32
        )
        self.write(own, 3, header + b"\x05" + np.float64(2.5).tobytes())
        text = "Header header\nuint8 radiation_type\nfloat32 fov\nfloat32 min_range\nfloat32 max_range\nfloat32 range\n"
        other = self.add_connection("/range", "sensor_msgs/msg/Range", msgdef=text, md5sum="1" * 32)
        self.write(other, 4, header + b"\x01" + np.array([0.5, 1, 9, 2], "<f4").tobytes())
        close(self)

    return close_after


def test_what_was_found_before_is_replaced(detected, tmp_path, capsys):
    path = tmp_path / "again.mcap"
    assert detect(detected / "out.mcap", tmp_path / "out", "--output-bag", str(path)) == 0
    assert f"{path}: /long_range/mask is replaced by what was found now" in capsys.readouterr().err
    found, expected = messages(path), messages(detected / "out.mcap")
    assert set(found) == set(expected)
    assert {topic: len(items) for topic, items in found.items() if topic != "/tf"} == {
        topic: N_FRAMES for topic in expected if topic != "/tf"
    }


def test_a_topic_of_unknown_type_is_left_out(bag, tmp_path, capsys):
    from rosbags import rosbag2

    path = tmp_path / "bag"
    with pytest.MonkeyPatch.context() as patch:
        close = rosbag2.Writer.close

        def close_after(self):
            own = self.add_connection(
                "/own", "own_msgs/msg/Own", msgdef="nonsense here now", rihs01="RIHS01_" + "0" * 64
            )
            self.write(own, frames()[0].stamp_ns, b"\0\1\0\0")
            close(self)

        patch.setattr(rosbag2.Writer, "close", close_after)
        write_stereo_bag(path, frames()[:1])
    assert detect(path, tmp_path / "out", "--output-bag", str(tmp_path / "out.mcap")) == 0
    assert "/own is left out: type own_msgs/msg/Own is not known" in capsys.readouterr().err
    assert "/own" not in messages(tmp_path / "out.mcap")


def test_namespace_and_frame_are_those_of_the_inputs(tmp_path):
    bag = tmp_path / "bag"
    with pytest.MonkeyPatch.context() as patch:
        for name in ("LEFT_IMAGE", "RIGHT_IMAGE", "LEFT_INFO", "RIGHT_INFO"):
            value = getattr(__import__("lrtrav_ros.io.topics", fromlist=[name]), name)
            patch.setattr(f"lrtrav_ros.io.bag_writer.{name}", f"robot/front/{value}")
        write_stereo_bag(bag, frames()[:1], frame_id="optical")
    assert detect(bag, tmp_path / "out", "--output-bag", str(tmp_path / "out.mcap")) == 0
    found = messages(tmp_path / "out.mcap")
    assert "/robot/front/long_range/grid" in found
    assert "/tf" in found
    assert found["/robot/front/free"][0][1].header.frame_id == "optical"


def test_disparity_that_is_an_input_is_copied(tmp_path):
    bag = tmp_path / "bag"
    write_stereo_bag(bag, frames("disparity"))
    assert detect(bag, tmp_path / "out", "--output-bag", str(tmp_path / "out.mcap")) == 0
    with BagReader(bag) as old, BagReader(tmp_path / "out.mcap") as new:
        assert [m.data for m in old.messages(["/disparity"])] == [m.data for m in new.messages(["/disparity"])]


def test_an_input_that_is_called_as_an_output_is_copied(tmp_path):
    bag = tmp_path / "bag"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lrtrav_ros.io.bag_writer.DEPTH_IMAGE", "depth")
        write_stereo_bag(bag, frames("depth")[:1])
    options = ["--remap", "/depth:=depth/image_rect", "--output-bag", str(tmp_path / "out.mcap")]
    assert detect(bag, tmp_path / "out", *options) == 0
    with BagReader(bag) as old, BagReader(tmp_path / "out.mcap") as new:
        assert [m.data for m in old.messages(["/depth"])] == [m.data for m in new.messages(["/depth"])]


@pytest.mark.parametrize(
    ("is_folder", "name", "message"),
    [
        (True, "out.mcap", "is a dataset folder, which has no messages; give a rosbag"),
        (False, "out.bag", "give a file that ends in .mcap"),
        (False, "bag/out.mcap", "is in the input"),
    ],
)
def test_wrong_usage_is_refused_before_the_work(is_folder, name, message, tmp_path, capsys):
    path = tmp_path / "bag"
    if is_folder:
        write_dataset(path, frames()[:1])
    else:
        write_stereo_bag(path, frames()[:1])
    assert detect(path, tmp_path / "out", "--output-bag", str(tmp_path / name)) == 2
    assert message in failure(capsys)
    assert not (tmp_path / "out").exists()


def test_several_inputs_are_refused(bag, tmp_path, capsys):
    options = ["--output", str(tmp_path / "out"), "--output-bag", str(tmp_path / "out.mcap")]
    assert run("detect", [str(bag), str(bag / "bag.mcap"), *options]) == 2
    assert "is for one input; run detect for each of the 2 inputs" in failure(capsys)


def test_a_file_that_exists_is_replaced_only_with_overwrite(bag, detected, tmp_path, capsys):
    path = tmp_path / "out.mcap"
    path.write_bytes(b"old")
    assert detect(bag, tmp_path / "out", "--output-bag", str(path)) == 1
    assert f"{path} exists; choose another name or give --overwrite" in failure(capsys)
    assert path.read_bytes() == b"old"
    assert detect(bag, tmp_path / "out", "--output-bag", str(path), "--overwrite") == 0
    assert path.read_bytes() == (detected / "out.mcap").read_bytes()


def test_it_may_lie_in_the_output_folder(bag, detected, tmp_path):
    path = tmp_path / "out" / "out.mcap"
    for options in ([], ["--overwrite"]):
        assert detect(bag, tmp_path / "out", "--output-bag", str(path), *options) == 0
        assert path.read_bytes() == (detected / "out.mcap").read_bytes()
        assert len(list((tmp_path / "out" / "long_range").iterdir())) == N_FRAMES


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_nothing_unfinished_or_temporary_stays(number, status, bag, tmp_path, monkeypatch):
    temporary, path, compressed = tmp_path / "temporary", tmp_path / "out.mcap", tmp_path / "bag.mcap.zstd"
    temporary.mkdir()
    path.write_bytes(b"old")
    compressed.write_bytes(zstd.compress((bag / "bag.mcap").read_bytes()))
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    before = []

    def interrupted(self, outputs):
        before.extend(item.suffix for item in tmp_path.iterdir())
        before.extend(item.name for item in temporary.glob("lrtrav_ros_*/*"))
        signal.raise_signal(number)

    monkeypatch.setattr("lrtrav_ros.io.output_bag.OutputBag.write", interrupted)
    try:
        ended = detect(compressed, tmp_path / "out", "--output-bag", str(path), "--overwrite")
    except SystemExit as err:
        ended = err.code
    assert ended == status
    assert {".tmp", "0.mcap"} <= set(before)
    assert path.read_bytes() == b"old"
    assert {item.name for item in tmp_path.iterdir()} == {"temporary", "out.mcap", "bag.mcap.zstd", "out"}
    assert list(temporary.iterdir()) == []


def test_without_ground_there_are_no_pose_and_no_points(tmp_path):
    from lrtrav_ros.frame import Frame

    image = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    bag = tmp_path / "bag"
    write_stereo_bag(bag, [Frame(name="a", left=image, right=image, camera=CAMERA, stamp_ns=7)])
    assert detect(bag, tmp_path / "out", "--output-bag", str(tmp_path / "out.mcap")) == 0
    found = messages(tmp_path / "out.mcap")
    assert not {"/tf", "/short_range/ground_pose"} & set(found)
    assert (found["/free"][0][1].width, found["/obstacles"][0][1].width) == (0, 0)
    assert (found["/long_range/grid"][0][1].data == -1).all()


def test_rectified_images_stand_beside_raw_ones(tmp_path):
    bag = tmp_path / "bag"
    with pytest.MonkeyPatch.context() as patch:
        for side in ("LEFT", "RIGHT"):
            patch.setattr(f"lrtrav_ros.io.bag_writer.{side}_IMAGE", f"front/{side.lower()}/image_raw")
            patch.setattr(f"lrtrav_ros.io.bag_writer.{side}_INFO", f"front/{side.lower()}/camera_info")
        write_stereo_bag(bag, frames()[:1])
    options = ["--set", "source.rectify=true", "--output-bag", str(tmp_path / "out.mcap")]
    assert detect(bag, tmp_path / "out", *options) == 0
    found = messages(tmp_path / "out.mcap")
    ((_, raw),), ((_, rectified),) = found["/front/left/image_raw"], found["/front/left/image_rect"]
    assert rectified.header == raw.header
    # Without distortion they are the same, but perhaps at the very edge.
    pixels = [decode_message(message)[2:-2, 2:-2] for message in (raw, rectified)]
    assert np.array_equal(*pixels)


def test_a_damaged_bag_is_copied_as_far_as_it_is_intact(tmp_path):
    bag = tmp_path / "cut.mcap"
    write_stereo_bag(tmp_path / "bag", frames())
    data = (tmp_path / "bag" / "bag.mcap").read_bytes()
    bag.write_bytes(data[: len(data) * 6 // 10])
    assert detect(bag, tmp_path / "out", "--output-bag", str(tmp_path / "out.mcap")) == 1
    found = messages(tmp_path / "out.mcap")
    n = len(list((tmp_path / "out" / "long_range").iterdir()))
    assert 1 <= n < N_FRAMES
    assert len(found["/long_range/grid"]) == n
    assert len(found["/left/camera_info"]) >= n


def end_with_a_full_disk(path, bag):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with OutputBag(path, bag):
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
            raise ValueError("why")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_full_disk_does_not_hide_why_a_run_ended(tmp_path):
    write_stereo_bag(tmp_path / "bag", frames())
    with StereoBag(tmp_path / "bag") as bag, pytest.raises(ValueError, match="why"):
        end_with_a_full_disk(tmp_path / "out.mcap", bag)
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
