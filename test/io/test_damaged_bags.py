"""Bags that were cut off or damaged, of each format."""

from collections import Counter

import numpy as np
import pytest
from damaged_files import holed, swapped, variants
from recorder import START_NS, Recorder, assert_same, make_frames, random_image, record_pairs, storage_file
from small_bags import N_MESSAGES, SMALL_BAGS

from lrtrav_ros.io.bag_frames import StereoBag
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.io.bag_writer import FORMATS, write_stereo_bag


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


def read_all(path):
    """Return what a bag holds and its problems, of messages and frames; None and the error where it is refused."""
    try:
        with BagReader(path) as reader:
            messages = Counter((message.topic, message.time_ns, message.data) for message in reader.messages())
            problems = reader.problems
        with StereoBag(path) as bag:
            list(bag.items())
    except (OSError, ValueError) as err:
        return None, [f"{type(err).__name__}: {err}"]
    return messages, problems


@pytest.mark.parametrize("kind", SMALL_BAGS)
def test_every_damage_is_told_or_does_no_harm(kind, tmp_path):
    """All messages, or fewer and it is said, or an error that names the bag; nothing altered that has a checksum.

    Far more are tried by benchmarks/damaged_inputs.py.
    """
    bag = SMALL_BAGS[kind](tmp_path)
    data = bag.file.read_bytes()
    whole, problems = read_all(bag.path)
    assert (whole.total(), problems) == (N_MESSAGES, [])
    step = len(data) // 3
    damaged = [*variants(data, n_flips=8, step=step), *holed(data, step=step), swapped(data, 0)]
    for variant in damaged:
        bag.file.write_bytes(variant)
        messages, problems = read_all(bag.path)
        if messages is None:
            assert str(bag.path) in problems[0]
            assert "Unicode" not in problems[0]
            continue
        if not problems:
            assert messages == whole or (not bag.has_checksums and messages.total() == whole.total())
        if bag.has_checksums:
            assert messages <= whole
