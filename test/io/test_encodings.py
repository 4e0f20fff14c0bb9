"""Encodings against images made by hand."""

import cv2
import numpy as np
import pytest
from rvl_writer import rvl_of

from lrtrav_ros.io.encodings import ENCODINGS, decode_compressed, decode_image, encode_image

HEIGHT, WIDTH = 20, 27


@pytest.fixture
def bgr():
    return np.random.default_rng(3).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


@pytest.fixture
def grey(bgr):
    return np.ascontiguousarray(bgr[..., 1])


def decode(image, name, **fields):
    """Decode an array's bytes as a message's; `fields` replace those that describe it."""
    values = {"encoding": name, "height": image.shape[0], "width": image.shape[1], "step": image.strides[0]}
    return decode_image(image.tobytes(), **{**values, **fields})


@pytest.mark.parametrize(
    ("encoding", "channels"),
    [
        ("bgr8", [0, 1, 2]),
        ("8UC3", [0, 1, 2]),
        ("rgb8", [2, 1, 0]),
        ("bgra8", [0, 1, 2, 1]),
        ("8UC4", [0, 1, 2, 1]),
        ("rgba8", [2, 1, 0, 1]),
        ("bgr16", [0, 1, 2]),
        ("rgb16", [2, 1, 0]),
        ("bgra16", [0, 1, 2, 1]),
        ("rgba16", [2, 1, 0, 1]),
    ],
)
def test_colour_becomes_bgr(bgr, encoding, channels):
    pixels = bgr.astype(np.uint16) * 259 if encoding.endswith("16") else bgr
    result = decode(np.ascontiguousarray(pixels[..., channels]), encoding)
    assert result.dtype == pixels.dtype
    assert np.array_equal(result, pixels)
    assert result.flags.c_contiguous
    assert result.flags.writeable


@pytest.mark.parametrize(
    ("encoding", "dtype"),
    [("mono8", "u1"), ("8UC1", "u1"), ("mono16", "u2"), ("16UC1", "u2"), ("32FC1", "f4")],
)
@pytest.mark.parametrize("order", ["<", ">"])
def test_single_channel_of_either_byte_order(grey, encoding, dtype, order):
    image = (grey.astype(np.float32) * 1.5).astype(dtype)
    result = decode(image.astype(f"{order}{dtype}"), encoding, is_bigendian=int(order == ">"))
    assert result.dtype == np.dtype(dtype)
    assert result.dtype.isnative
    assert np.array_equal(result, image)


def test_rows_may_be_padded(bgr):
    rows = np.full((HEIGHT, WIDTH * 3 + 5), 77, np.uint8)
    rows[:, : WIDTH * 3] = bgr.reshape(HEIGHT, -1)
    fields = {"encoding": "bgr8", "height": HEIGHT, "width": WIDTH, "step": WIDTH * 3 + 5}
    assert np.array_equal(decode_image(memoryview(rows.tobytes()), **fields), bgr)
    assert np.array_equal(decode_image(rows.reshape(-1), **fields), bgr)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("order", ["<", ">"])
def test_padding_and_byte_order_change_no_encoding(encoding, order):
    height, width = 6, 10
    dtype = "f4" if encoding == "32FC1" else "u2" if "16" in encoding else "u1"
    channels = 4 if encoding[-2:] in ("a8", "C4") or "a16" in encoding else 3 if encoding[:3] in ("bgr", "rgb") else 1
    channels = 3 if encoding == "8UC3" else 2 if "yuy" in encoding or encoding in ("yuv422", "uyvy") else channels
    n_rows = height * 3 // 2 if encoding.startswith("nv") else height
    values = np.random.default_rng(5).integers(0, 256, (n_rows, width * channels)).astype(dtype)
    whole = decode_image(values.tobytes(), encoding=encoding, height=height, width=width, step=values.strides[0])
    padded = np.full((n_rows, values.shape[1] + 3), 99, f"{order}{dtype}")
    padded[:, :-3] = values
    fields = {"height": height, "width": width, "step": padded.strides[0], "is_bigendian": order == ">"}
    result = decode_image(padded.tobytes(), encoding=encoding, **fields)
    assert result.dtype.isnative
    assert np.array_equal(result, whole)
    with pytest.raises(ValueError, match=f"{n_rows} rows of {padded.strides[0]} bytes need {padded.nbytes}"):
        decode_image(padded.tobytes()[:-1], encoding=encoding, **fields)


# Grey, and blue, green and red, as BT.601 has them: Y, U (Cb), V (Cr), and BGR.
YUV = {
    (126, 128, 128): (128, 128, 128),
    (41, 240, 110): (255, 0, 0),
    (145, 54, 34): (0, 255, 0),
    (81, 90, 240): (0, 0, 255),
}


@pytest.mark.parametrize("encoding", ["yuv422", "uyvy", "yuv422_yuy2", "yuyv", "nv12", "nv21"])
@pytest.mark.parametrize("colour", YUV)
def test_yuv_becomes_bgr(encoding, colour):
    y, u, v = colour
    height, width = 4, 6
    if encoding.startswith("nv"):
        rows = np.full((height * 3 // 2, width), y, np.uint8)
        rows[height:] = [u, v] * 3 if encoding == "nv12" else [v, u] * 3
    else:
        pair = [y, u, y, v] if "yuy" in encoding else [u, y, v, y]
        rows = np.array([pair * 3] * height, np.uint8)
    result = decode_image(rows.tobytes(), encoding=encoding, height=height, width=width, step=rows.shape[1])
    assert result.shape == (height, width, 3)
    assert np.abs(result.astype(int) - YUV[colour]).max() <= 3


@pytest.mark.parametrize(
    ("encoding", "size", "message"),
    [
        ("yuv422", (4, 7), "image is 7 x 4 pixels; yuv422 needs a multiple of 2 x 1"),
        ("yuyv", (4, 7), "image is 7 x 4 pixels; yuyv needs a multiple of 2 x 1"),
        ("nv12", (4, 7), "image is 7 x 4 pixels; nv12 needs a multiple of 2 x 2"),
        ("nv21", (5, 6), "image is 6 x 5 pixels; nv21 needs a multiple of 2 x 2"),
    ],
)
def test_odd_sizes_are_refused_where_pixels_share_colours(encoding, size, message):
    with pytest.raises(ValueError, match=message):
        decode_image(bytes(1000), encoding=encoding, height=size[0], width=size[1], step=2 * size[1])


@pytest.mark.parametrize(("depth", "dtype"), [("8", np.uint8), ("16", np.uint16)])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_pattern_is_of_the_first_four_pixels(pattern, depth, dtype):
    colour = {"b": 30, "g": 120, "r": 250}
    mosaic = np.empty((HEIGHT, WIDTH), dtype)
    for index, letter in enumerate(pattern):
        mosaic[index // 2 :: 2, index % 2 :: 2] = colour[letter]
    result = decode(mosaic, f"bayer_{pattern}{depth}")
    assert result.dtype == dtype
    assert np.array_equal(result, np.broadcast_to(np.array([30, 120, 250], dtype), (HEIGHT, WIDTH, 3)))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"encoding": "yuv411"}, "'yuv411'; give one of mono8"),
        ({"height": 0}, "27 x 0 pixels"),
        ({"width": 0}, "0 x 20 pixels"),
        ({"width": -3}, "-3 x 20 pixels"),
        ({"step": WIDTH * 3 - 1}, "step is 80 bytes; a row of 27 pixels needs at least 81"),
        ({"step": WIDTH * 3 + 1}, "1620 bytes; 20 rows of 82 bytes need 1640"),
        ({"height": HEIGHT + 1}, "1620 bytes; 21 rows of 81 bytes need 1701"),
    ],
)
def test_fields_that_do_not_fit_are_refused(bgr, fields, message):
    with pytest.raises(ValueError, match=message):
        decode(bgr, "bgr8", **fields)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_encode_is_the_inverse_of_decode(grey, dtype):
    image = grey.astype(dtype)
    encoded = encode_image(image[:, ::2])
    assert (encoded.height, encoded.width, encoded.step) == (HEIGHT, 14, 14 * image.itemsize)
    result = decode_image(
        encoded.data, encoding=encoded.encoding, height=encoded.height, width=encoded.width, step=encoded.step
    )
    assert result.dtype == dtype
    assert np.array_equal(result, image[:, ::2])


def test_encodings_that_are_written(bgr):
    names = [encode_image(image).encoding for image in (bgr, bgr[..., 0], bgr[..., 0].astype(np.uint16))]
    assert names == ["bgr8", "mono8", "mono16"]
    assert set(names) < set(ENCODINGS)
    for image in (bgr.astype(np.float64), bgr[..., :2], bgr[:0]):
        with pytest.raises(ValueError, match=r"give \(H, W\)"):
            encode_image(image)


def test_compressed_colour_and_grey(bgr, grey):
    png = cv2.imencode(".png", bgr)[1].tobytes()
    assert np.array_equal(decode_compressed(png, "png"), bgr)
    assert np.array_equal(decode_compressed(png, "rgb8; png compressed bgr8"), bgr)
    assert np.array_equal(decode_compressed(png, "rgb8; png compressed rgb8"), bgr[..., ::-1])
    assert np.array_equal(decode_compressed(cv2.imencode(".png", grey)[1], "mono8; png compressed"), grey)
    flat = np.full((HEIGHT, WIDTH, 3), (40, 90, 200), np.uint8)
    jpeg = decode_compressed(cv2.imencode(".jpg", flat)[1].tobytes(), "bgr8; jpeg compressed bgr8")
    assert np.abs(jpeg.astype(int) - flat).max() <= 3


def test_compressed_depth():
    millimetres = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH) * 100
    png = cv2.imencode(".png", millimetres)[1].tobytes()
    assert np.array_equal(decode_compressed(bytes(12) + png, "16UC1; compressedDepth png"), millimetres)
    header = np.array([0, 0, 0], "<f4")
    header[1:] = 1000, 50  # depth = 1000 / (value - 50)
    metres = decode_compressed(header.tobytes() + png, "32FC1; compressedDepth")
    assert metres[0, 0] == 0
    assert metres[0, 3] == pytest.approx(1000 / 250)
    with pytest.raises(ValueError, match="'bgr8' and 3 bytes"):
        decode_compressed(b"abc", "bgr8; compressedDepth")


def test_compressed_depth_in_rvl(grey):
    millimetres = grey.astype(np.uint16) * 200
    size = np.array([WIDTH, HEIGHT], "<u4").tobytes()
    data = bytes(12) + size + rvl_of(millimetres)
    assert np.array_equal(decode_compressed(data, "16UC1; compressedDepth rvl"), millimetres)
    header = np.array([0, 1000, 50], "<f4").tobytes()  # depth = 1000 / (value - 50)
    metres = decode_compressed(header + data[12:], "32FC1; compressedDepth rvl")
    assert metres.dtype == np.float32
    assert np.array_equal(metres > 0, millimetres > 50)
    valid = millimetres > 50
    assert metres[valid] == pytest.approx(1000 / (millimetres[valid] - 50.0))
    for cut, message in (
        (18, "RVL begins with width and height"),
        (200, "27 x 20 pixels: 180 bytes are damaged or cut"),
    ):
        with pytest.raises(ValueError, match=message):
            decode_compressed(data[:cut], "16UC1; compressedDepth rvl")


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_compressed_images_that_are_cut_off_or_none_are_refused(bgr, suffix):
    whole = cv2.imencode(suffix, bgr)[1].tobytes()
    for data in (whole[: len(whole) // 2], b"no image", b""):
        with pytest.raises(ValueError, match="cannot be read as an image"):
            decode_compressed(data, "jpeg")
