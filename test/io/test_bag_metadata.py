"""metadata.yaml of ROS 2 bags, hostile ones above all."""

import os
import time

import pytest

from lrtrav_ros.io import bag_metadata
from lrtrav_ros.io.bag_metadata import read_metadata

WHOLE = """\
rosbag2_bagfile_information:
  relative_file_paths: [../../etc/a.mcap, /etc/b.mcap]
  topics_with_message_count:
  - topic_metadata: {name: /left, type: sensor_msgs/msg/Image}
    message_count: 7
"""
DOUBLING = "k0: &k0 {x: 1}\n" + "\n".join(f"k{i + 1}: &k{i + 1} {{<<: [*k{i}, *k{i}]}}" for i in range(40))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "metadata.yaml"


def test_files_are_known_by_their_names_alone(file):
    file.write_text(WHOLE)
    metadata = read_metadata(file)
    assert metadata.names == ("a.mcap", "b.mcap")
    assert metadata.counts == (("/left", 7),)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xe9: 1",
        b"[" * 100_000,
        b"rosbag2_bagfile_information:\n  relative_file_paths: &r [*r]\n",
        WHOLE.replace("7", "9" * 5000).encode(),
        WHOLE.replace("7", ".nan").encode(),
        WHOLE.replace("7", ".inf").encode(),
        WHOLE.replace("7", "x").encode(),
        WHOLE.replace("7", "0x" + "f" * 5000).encode(),
        WHOLE.replace("7", "1" + ":1" * 100_000).encode(),
        WHOLE.replace("/left", "[/left]").encode(),
        WHOLE.replace("../../etc/a.mcap", "5").encode(),
        b"a: 2001-02-30\n" + WHOLE.encode(),
        b"? [a]\n: 1\n",
        b"!!python/object/apply:os.system ['true']\n",
    ],
)
def test_damaged_metadata_are_refused(content, file):
    start = time.process_time()
    file.write_bytes(content)
    with pytest.raises(ValueError, match=r"."):
        read_metadata(file)
    assert time.process_time() - start < 20


def test_doubling_aliases_take_no_time(file):
    file.write_text(f"{DOUBLING}\n{WHOLE}")
    start = time.process_time()
    with pytest.raises(ValueError, match="2002:merge"):
        read_metadata(file)
    assert time.process_time() - start < 20


def test_topic_named_by_lists_that_alias_each_other_takes_no_memory(file):
    lists = "\n".join(["a0: &a0 [x, x]", *(f"a{i + 1}: &a{i + 1} [*a{i}, *a{i}]" for i in range(60))])
    file.write_text(f"{lists}\n{WHOLE.replace('/left', '*a60')}")
    with pytest.raises(ValueError, match="a topic's name is no text"):
        read_metadata(file)


def test_only_small_regular_files_are_read(file, monkeypatch):
    os.mkfifo(file)
    with pytest.raises(ValueError, match="no regular file"):
        read_metadata(file)
    file.unlink()
    file.symlink_to("/dev/zero")
    with pytest.raises(ValueError, match="no regular file"):
        read_metadata(file)
    file.unlink()
    file.write_text(WHOLE)
    monkeypatch.setattr(bag_metadata, "_MAX_BYTES", 100)
    with pytest.raises(ValueError, match="larger than 100 bytes"):
        read_metadata(file)
