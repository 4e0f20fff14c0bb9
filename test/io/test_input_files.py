"""Files of others: what is no regular file or too large is refused at once, and never opened."""

import os

import pytest

from lrtrav_ros.evaluation.truth.kitti_road import read_calibration
from lrtrav_ros.evaluation.truth.mat_arrays import read_arrays
from lrtrav_ros.io.dataset_folder import read_camera
from lrtrav_ros.io.image_files import read_image
from lrtrav_ros.io.input_files import read_bytes, read_text
from lrtrav_ros.io.parameter_file import read_parameter_file

READERS = (read_bytes, read_text, read_arrays, read_calibration, read_camera, read_image, read_parameter_file)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)
def test_pipes_devices_and_folders_are_refused_at_once(tmp_path, reader):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/zero")
    (tmp_path / "folder").mkdir()
    for name, kind in (("pipe", "a pipe"), ("device", "a device"), ("folder", "a folder")):
        with pytest.raises(ValueError, match=f"{name}: is no regular file but {kind}; give a file"):
            reader(tmp_path / name)


def test_content_is_read_through_links(tmp_path):
    (tmp_path / "file").write_bytes("höhe\r\n".encode())
    (tmp_path / "link").symlink_to("file")
    assert read_bytes(tmp_path / "link") == "höhe\r\n".encode()
    assert read_text(tmp_path / "link", max_bytes=7) == "höhe\r\n"


def test_files_that_are_too_large_are_refused_before_they_are_read(tmp_path):
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(ValueError, match="sparse: has 1099511627776 bytes; give a file of at most 1073741824"):
        read_bytes(tmp_path / "sparse")


def test_text_that_is_not_utf8_is_refused_with_its_place(tmp_path):
    (tmp_path / "file").write_bytes(b"abc\xe4")
    with pytest.raises(ValueError, match=r"file: is no text in UTF-8 \(unexpected end of data at byte 3\)"):
        read_text(tmp_path / "file")
