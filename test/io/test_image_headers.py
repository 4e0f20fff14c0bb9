"""What a PNG or JPEG promises is known before it is decoded, and nothing else is decoded."""

from __future__ import annotations

import struct
import time
import zlib

import cv2
import numpy as np
import pytest

from lrtrav_ros.io.encodings import decode_compressed, decode_image
from lrtrav_ros.io.image_files import decode_file
from lrtrav_ros.io.image_headers import checked_file

HEIGHT, WIDTH = 18, 40
SIGNATURE = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def bgr():
    return np.random.default_rng(5).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(*, height=HEIGHT, width=WIDTH, pixels=b"", extra=b""):
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return SIGNATURE + header + extra + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")


def segment(code, data):
    return struct.pack(">BBH", 0xFF, code, len(data) + 2) + data


@pytest.mark.parametrize(
    ("data", "format_"),
    [
        (png(height=20000, width=20000), "png"),
        (bytes(12) + png(height=20000, width=20000), "16UC1; compressedDepth"),
        (bytes(12) + struct.pack("<II", 20000, 20000), "16UC1; compressedDepth rvl"),
    ],
)
def test_images_that_are_too_large_are_refused_by_their_header(data, format_):
    start = time.process_time()
    with pytest.raises(ValueError, match=r"20000 x 20000 pixels .*; source.max_pixels allows 67108864"):
        decode_compressed(data, format_)
    assert time.process_time() - start < 0.5


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_the_bound_is_on_the_number_of_pixels(bgr, suffix):
    data = cv2.imencode(suffix, bgr)[1].tobytes()
    assert decode_compressed(data, "bgr8", max_pixels=HEIGHT * WIDTH).shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(ValueError, match=f"{WIDTH} x {HEIGHT} pixels .* allows {HEIGHT * WIDTH - 1}"):
        decode_compressed(data, "bgr8", max_pixels=HEIGHT * WIDTH - 1)


def test_raw_images_are_bounded_too(bgr):
    fields = {"encoding": "bgr8", "height": HEIGHT, "width": WIDTH, "step": 3 * WIDTH}
    assert np.array_equal(decode_image(bgr.tobytes(), **fields, max_pixels=HEIGHT * WIDTH), bgr)
    with pytest.raises(ValueError, match=r"source.max_pixels allows 100"):
        decode_image(bgr.tobytes(), **fields, max_pixels=100)


@pytest.mark.parametrize(
    ("name", "suffix"),
    [("TIFF", ".tiff"), ("WebP", ".webp"), ("BMP", ".bmp"), ("PNM, PAM or PFM", ".ppm"), ("Sun raster", ".ras")],
)
def test_other_formats_are_refused_by_name(bgr, name, suffix):
    data = cv2.imencode(suffix, bgr)[1].tobytes()
    with pytest.raises(ValueError, match=f"image: {len(data)} bytes of {name}, which is not read; give a PNG or JPEG"):
        decode_file(data, "image")


@pytest.mark.parametrize("data", [b"GIF89a", b"v/1\x01", b"#?RADIANCE\n", b"\0\0\0\x0cjP  ", b"MM\0*", b"\xff\x0a"])
def test_formats_that_not_every_opencv_writes_are_refused_too(data):
    with pytest.raises(ValueError, match="which is not read; give a PNG or JPEG"):
        decode_file(data, "image")


def test_compressed_texts_of_a_png_are_not_unpacked():
    text = chunk(b"zTXt", b"key\0\0" + zlib.compress(bytes(7_900_000), 9))
    pixels = b"".join(b"\0" + bytes([row] * WIDTH) for row in range(HEIGHT))
    data = png(pixels=pixels, extra=40 * text)
    assert len(checked_file(data, "image").data) == len(data) - 40 * len(text)
    start = time.process_time()
    assert np.array_equal(decode_file(data, "image"), np.repeat(np.arange(HEIGHT), WIDTH).reshape(HEIGHT, WIDTH))
    assert time.process_time() - start < 1  # unpacked, they take some 6 s


def test_a_png_with_transparency_and_colour_profile_is_as_before(bgr):
    bgra = np.dstack([bgr, np.full((HEIGHT, WIDTH), 77, np.uint8)])
    data = cv2.imencode(".png", bgra)[1].tobytes()
    end = len(SIGNATURE) + 25
    extra = chunk(b"gAMA", struct.pack(">I", 45455)) + chunk(b"iCCP", b"p\0\0" + zlib.compress(bytes(200)))
    assert np.array_equal(decode_file(data[:end] + extra + data[end:], "image"), bgr)


@pytest.mark.parametrize(
    "data",
    [
        png()[:20],
        png()[:-12],
        png(extra=chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 0, 0, 0, 0))),
        SIGNATURE + chunk(b"IEND", b""),
        SIGNATURE + chunk(b"IHDR", b"") + chunk(b"IEND", b""),
        SIGNATURE + struct.pack(">I4s", 2**32 - 1, b"IHDR"),
        png(extra=70_000 * chunk(b"tEXt", b"")),
    ],
)
def test_a_png_that_is_none_is_refused(data):
    with pytest.raises(ValueError, match="cannot be read as an image; give a whole PNG or JPEG"):
        checked_file(data, "image")


@pytest.mark.parametrize("options", [[], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 2]])
def test_the_size_of_a_jpeg_is_the_decoders(bgr, options):
    thumbnail = cv2.imencode(".jpg", bgr[:8, :8])[1].tobytes()
    data = cv2.imencode(".jpg", bgr, options)[1].tobytes()
    more = b"\xff\xff\xff" + segment(0xE1, b"Exif\0\0" + thumbnail)[1:] + b"\xff\0\xff\0" + segment(0xFE, b"\xff\xc0\0")
    file = checked_file(data[:2] + more + data[2:], "image")
    assert (file.height, file.width) == (HEIGHT, WIDTH)
    assert np.array_equal(decode_file(file.data, "image"), decode_file(data, "image"))


def test_a_jpeg_of_two_sizes_is_refused(bgr):
    data = cv2.imencode(".jpg", bgr)[1].tobytes()
    sized = data.index(b"\xff\xc0")
    n_bytes = 2 + int.from_bytes(data[sized + 2 : sized + 4], "big")
    twice = data[:sized] + data[sized : sized + n_bytes] + data[sized:]
    with pytest.raises(ValueError, match="cannot be read as an image"):
        checked_file(twice, "image")
    with pytest.raises(ValueError, match="cannot be read as an image"):
        checked_file(data[:sized] + data[sized + n_bytes :], "image")  # and none


def test_a_jpeg_of_many_scans_is_refused(bgr):
    data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    last = data[data.rindex(b"\xff\xda") : -2]
    assert decode_file(data[:-2] + 5 * last + b"\xff\xd9", "image").shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(ValueError, match="cannot be read as an image"):
        decode_file(data[:-2] + 50 * last + b"\xff\xd9", "image")
