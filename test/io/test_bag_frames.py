"""Frames of bags: recordings of each format that rosbags writes here, and with faults."""

import dataclasses
import itertools
import re

import numpy as np
import pytest
from raw_cameras import calibrations, pair, texture
from recorder import (
    CAMERA,
    HEIGHT,
    ROS2,
    START_NS,
    WIDTH,
    make_frames,
    random_image,
    read,
    record_pairs,
    storage_file,
)

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import SourceConfig
from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_writer import write_stereo_bag
from lrtrav_ros.io.camera_info import VIRTUAL_BASELINE_M
from lrtrav_ros.io.recording import open_recording
from lrtrav_ros.rectification import Rectification


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
    any_recorder.compressed("/right/image_rect/compressed", random_image(2), START_NS, "png")
    (frame,), problems = read(any_recorder)
    assert problems == []
    assert np.array_equal(frame.left, random_image(1))
    assert np.array_equal(frame.right, random_image(2))


def test_16_bit_images_come_as_they_are(any_recorder):
    images = [random_image(seed, channels=1).astype(np.uint16) * 13 for seed in (1, 2)]
    any_recorder.infos()
    any_recorder.image("/left/image_rect", images[0], START_NS, "mono16")
    any_recorder.image("/right/image_rect", images[1].byteswap(), START_NS, "mono16", is_bigendian=1)
    (frame,), problems = read(any_recorder)
    assert problems == []
    assert np.array_equal(frame.left, images[0])
    assert np.array_equal(frame.right, images[1])


def test_disparity_images_bring_focal_length_and_baseline(any_recorder):
    disparity = random_image(4, channels=1).astype(np.float32) / 8 - 1
    any_recorder.info("/left/camera_info", START_NS)
    any_recorder.image("/left/image_rect", random_image(1), START_NS)
    any_recorder.disparity("/disparity", disparity, START_NS, min_disparity=2.0)
    (frame,), problems = read(any_recorder)
    assert problems == []
    assert np.array_equal(frame.disparity, np.where(disparity >= 2, disparity, 0))
    assert frame.camera == StereoCamera(
        fx=60.0, fy=CAMERA.fy, cx=CAMERA.cx, cy=CAMERA.cy, baseline_m=0.5, width=WIDTH, height=HEIGHT
    )


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


def test_one_late_image_keeps_no_other_from_pairing(recorder):
    recorder.infos()
    for order, (side, i) in enumerate(itertools.product(("left", "right"), (0, 1, -5))):  # in the order of arrival
        delay_ns = 10**9 + order * 10**6 - i * 10**8
        recorder.image(f"/{side}/image_rect", random_image(i + 10), START_NS + i * 10**8, delay_ns=delay_ns)
    frames, problems = read(recorder)
    assert problems == []
    assert [(frame.stamp_ns - START_NS) // 10**8 for frame in frames] == [0, 1, -5]


def test_reasons_why_no_images_pair_are_told(recorder):
    recorder.infos()
    for side in ("left", "right"):
        images = recorder.bag.add_connection(f"/{side}/image_rect", "sensor_msgs/msg/Image", typestore=recorder.store)
        for i in range(3):
            recorder.bag.write(images, START_NS + i, b"\0\1\0\0\7")
    recorder.close()
    message = (
        r"bag: no images pair; .*message on /left/image_rect at \d+ ns skipped .cannot be read.* \(and 2 more like it\)"
    )
    with StereoBag(recorder.path) as bag, pytest.raises(ValueError, match=message):
        list(bag.frames())


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
        2: {"encoding": "yuv411"},
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
            bag.problems,
            [(1, "image data has 10 bytes"), (2, "'yuv411'"), (3, "the right image is 41 x 29")],
            strict=True,
        ):
            assert f"skipped frame {START_NS + i}: " in problem
            assert text in problem


def test_a_message_that_cannot_be_read_is_skipped(recorder):
    record_pairs(recorder, 3)
    recorder.bag.write(recorder.connections["/left/image_rect"], START_NS + 5, b"\0\1\0\0\0\0")
    frames, problems = read(recorder, max_stamp_difference_s=0)
    assert len(frames) == 3
    assert "message on /left/image_rect at 1700000000000000005 ns skipped (cannot be read" in problems[0]


def test_stamps_that_are_not_set_give_one_frame_only(recorder):
    recorder.infos()
    for i in range(3):
        recorder.image("/left/image_rect", random_image(i), 0, delay_ns=i)
        recorder.image("/right/image_rect", random_image(i), 0, delay_ns=i)
    frames, problems = read(recorder)
    assert [frame.name for frame in frames] == ["0"]
    (problem,) = problems
    assert problem.endswith("frame 0: another frame has this header stamp (and 1 more like it)")


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
    assert "the calibration is for 640 x 480 pixels, but the image is 41 x 30" in problems[0]


def test_missing_calibration_is_an_error(recorder):
    recorder.image("/left/image_rect", random_image(1), START_NS)
    recorder.image("/right/image_rect", random_image(2), START_NS)
    for side in ("left", "right"):
        topic, kind = f"/{side}/camera_info", "sensor_msgs/msg/CameraInfo"
        recorder.connections[topic] = recorder.bag.add_connection(topic, kind, typestore=ROS2)
    recorder.close()
    with StereoBag(recorder.path) as bag, pytest.raises(ValueError, match="/left/camera_info has no message"):
        next(bag.frames())


def record_raw_pair(recorder, raw, *, write, topic):
    """Record a pair of one calibration, its images by `write`."""
    for i, (side, fields) in enumerate(zip(("left", "right"), calibrations(raw), strict=True)):
        recorder.info_of(f"/robot/{side}/camera_info", START_NS, **fields)
        write(f"/robot/{side}/{topic}", texture(i), START_NS)


@pytest.mark.parametrize("model", ["plumb_bob of 5", "rational_polynomial of 8", "equidistant"])
def test_raw_pairs_are_rectified(any_recorder, model):
    raw = pair(model)
    record_raw_pair(any_recorder, raw, write=any_recorder.image, topic="image_raw")
    (frame,), problems = read(any_recorder, rectify=True)
    assert problems == []
    left, right = Rectification(raw).rectify(texture(0), texture(1))
    assert np.array_equal(frame.left, left)
    assert np.array_equal(frame.right, right)
    assert frame.camera == raw.camera


@pytest.mark.parametrize("topic", ["image_raw/compressed", "image_color/compressed"])
def test_compressed_raw_pairs_are_rectified_alike(recorder, topic):
    raw = pair()
    record_raw_pair(recorder, raw, write=recorder.compressed, topic=topic)
    recorder.close()
    with open_recording(recorder.path, SourceConfig(rectify=True)) as bag:
        (frame,) = bag.frames()
        assert np.array_equal(frame.left, Rectification(raw).rectify(texture(0), texture(1))[0])
        assert bag.problems == []


def test_raw_images_are_preferred_where_they_are_to_be_rectified(recorder):
    record_raw_pair(recorder, pair(), write=recorder.image, topic="image_raw")
    for side in ("left", "right"):
        recorder.image(f"/robot/{side}/image_rect", texture(7), START_NS)
    recorder.close()
    with StereoBag(recorder.path) as bag:
        assert bag.left_topic == "/robot/left/image_rect"
    with StereoBag(recorder.path, rectify=True) as bag:
        assert bag.left_topic == "/robot/left/image_raw"
        assert len(bag) == 1


def test_raw_images_that_are_not_rectified_are_named(recorder):
    record_raw_pair(recorder, pair(), write=recorder.image, topic="image_raw")
    (frame,), problems = read(recorder)
    assert np.array_equal(frame.left, texture(0))
    assert len(problems) == 2
    for side, problem in zip(("left", "right"), problems, strict=True):
        assert f"/robot/{side}/image_raw is taken for rectified, though its CameraInfo has distortion" in problem
        assert "source.rectify=true" in problem


def test_a_pair_without_raw_images_cannot_be_rectified(recorder):
    record_pairs(recorder, 1)
    recorder.close()
    with pytest.raises(
        ValueError, match="needed in one namespace are left/image_raw, right/image_raw, left/camera_info"
    ):
        StereoBag(recorder.path, rectify=True)


def test_a_lens_of_another_model_is_reported(recorder):
    for side, fields in zip(("left", "right"), calibrations(pair()), strict=True):
        recorder.info_of(f"/{side}/camera_info", START_NS, **{**fields, "distortion_model": "fov"})
        recorder.image(f"/{side}/image_raw", texture(), START_NS)
    frames, problems = read(recorder, rectify=True)
    assert frames == []
    assert (
        f"skipped frame {START_NS}: CameraInfo of 'camera' cannot rectify: distortion model 'fov' is not" in problems[0]
    )
