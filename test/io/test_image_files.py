"""Image files that are whole or not, and files that are never half written."""

import re

import cv2
import numpy as np
import pytest
from damaged_files import refusal, truncated, variants

from lrtrav_ros.io.image_files import read_disparity, read_image, write_disparity, write_image

HEIGHT, WIDTH = 20, 27


@pytest.fixture
def bgr():
    return np.random.default_rng(3).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


@pytest.fixture
def grey(bgr):
    return np.ascontiguousarray(bgr[..., 1])


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_files_that_are_cut_off_or_no_image_are_refused(bgr, suffix, tmp_path):
    whole = cv2.imencode(suffix, bgr)[1].tobytes()
    path = tmp_path / f"image{suffix}"
    for data in (whole[: len(whole) // 2], b"no image", b""):
        path.write_bytes(data)
        with pytest.raises(ValueError, match=rf"image\{suffix}: {len(data)} bytes that cannot be read"):
            read_image(path)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_damaged_png_files_are_refused(bgr, dtype, tmp_path):
    path = tmp_path / "image.png"
    for damaged in variants(cv2.imencode(".png", bgr.astype(dtype))[1].tobytes(), n_flips=60, step=100):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"image\.png"):
            read_image(path)


def test_damaged_jpeg_files_are_refused_or_read_as_what_they_say(bgr, tmp_path):
    path = tmp_path / "image.jpg"
    for damaged in variants(cv2.imencode(".jpg", bgr)[1].tobytes(), n_flips=60, step=100):
        path.write_bytes(damaged)
        assert re.match(f"{path}|$", refusal(read_image, path))  # JPEG has no checksums
    for cut in truncated(cv2.imencode(".jpg", bgr)[1].tobytes(), step=20):
        path.write_bytes(cut)
        assert refusal(read_image, path)


def test_files_come_back(bgr, grey, tmp_path):
    for image in (bgr, grey, grey.astype(np.uint16) * 200):
        write_image(tmp_path / "new" / "image.png", image)
        result = read_image(tmp_path / "new" / "image.png")
        assert result.dtype == image.dtype
        assert np.array_equal(result, image)
    with pytest.raises(FileNotFoundError):
        read_image(tmp_path / "missing.png")


def test_alpha_is_dropped(bgr, tmp_path):
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", np.dstack([bgr, bgr[..., 0]]))[1].tobytes())
    assert np.array_equal(read_image(tmp_path / "a.png"), bgr)


def test_formats_that_cannot_hold_an_image_are_refused(grey, tmp_path):
    for name, image in (("a.jpg", grey.astype(np.uint16)), ("a.png", grey.astype(np.float32)), ("a.xyz", grey)):
        with pytest.raises(ValueError, match=f"{name}.*give .png"):
            write_image(tmp_path / name, image)
    assert list(tmp_path.iterdir()) == []


def test_images_too_wide_for_jpeg_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"wide\.jpg: an image of shape \(1, 70000\) cannot be encoded"):
        write_image(tmp_path / "wide.jpg", np.zeros((1, 70_000), np.uint8))
    assert list(tmp_path.iterdir()) == []


def test_disparity_files_hold_256ths_of_a_pixel(tmp_path):
    disparity = np.array([[0, 1 / 256, 63.4], [300, np.nan, -4]], np.float32)
    write_disparity(tmp_path / "d.png", disparity)
    expected = [[0, 1 / 256, 16230 / 256], [65535 / 256, 0, 0]]
    assert read_disparity(tmp_path / "d.png").tolist() == expected
    write_image(tmp_path / "grey.png", np.zeros((4, 6), np.uint8))
    with pytest.raises(ValueError, match="16 bits"):
        read_disparity(tmp_path / "grey.png")
