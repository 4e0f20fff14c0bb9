"""The headers of PNG and JPEG files, read before a decoder makes memory for what they promise.

A file of some kilobytes can promise an image of gigabytes, or keep a decoder busy for minutes. What is given to the
decoder is known to be of one of the two formats, whole, of a bounded size, and without the parts that cost time and
say nothing about pixels.

References
----------
PNG: ISO/IEC 15948. JPEG: ISO/IEC 10918-1, annex B.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass

import numpy as np

from lrtrav_ros.config import MAX_PIXELS

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_OTHERS = {
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",
    b"MM\0+": "TIFF",
    b"RIFF": "WebP",
    b"BM": "BMP",
    b"GIF8": "GIF",
    b"v/1\x01": "OpenEXR",
    b"#?RADIANCE": "Radiance HDR",
    b"#?RGBE": "Radiance HDR",
    b"\0\0\0\x0cjP  ": "JPEG 2000",
    b"\xff\x4f\xff\x51": "JPEG 2000",
    b"\0\0\0\x0cJXL ": "JPEG XL",
    b"\xff\x0a": "JPEG XL",
    b"\x59\xa6\x6a\x95": "Sun raster",
    **{b"P%c" % kind: "PNM, PAM or PFM" for kind in b"1234567Ff"},
}

# Of a PNG: all that its pixels depend on. Others, such as compressed texts, take up to 0.15 s each.
_PIXEL_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")
_MAX_CHUNKS = 2**16  # more than 500 MB of the usual 8 kB

# Of a JPEG: a byte after 0xff that is neither 0xff, which fills, nor 0, which makes it one of the data.
_MARKER = re.compile(rb"\xff([^\xff\0])")
_ALONE = (0x01, *range(0xD0, 0xD8))  # markers without a segment
_SIZES = tuple(code for code in range(0xC0, 0xD0) if code not in (0xC4, 0xC8, 0xCC))  # start of frame
_START, _END, _SCAN = 0xD8, 0xD9, 0xDA
_MAX_SCANS = 32  # each goes over the whole image; progressive images have about 10


@dataclass(frozen=True, slots=True, eq=False)
class CheckedFile:
    """A PNG or JPEG that may be decoded.

    Parameters
    ----------
    data : bytes
        What to give to the decoder.
    height, width : int
        Size in pixels.
    """

    data: bytes
    height: int
    width: int


def checked_file(data: bytes, name: str, *, max_pixels: int = MAX_PIXELS) -> CheckedFile:
    """Return the bytes of a PNG or JPEG file for the decoder, and the size of its image.

    Parameters
    ----------
    data : bytes
        The file.
    name : str
        Stands in messages.
    max_pixels : int
        Most pixels that the image may have.

    Raises
    ------
    ValueError
        If it is of another format, damaged or cut off, or the image is larger.
    """
    for magic, other in _OTHERS.items():
        if data.startswith(magic):
            raise ValueError(f"{name}: {len(data)} bytes of {other}, which is not read; give a PNG or JPEG")
    file = None
    if data.startswith(_PNG):
        file = _checked_png(data)
    elif data.startswith(_JPEG):
        file = _checked_jpeg(data)
    if file is None:
        raise ValueError(f"{name}: {len(data)} bytes that cannot be read as an image; give a whole PNG or JPEG")
    check_pixels(name, height=file.height, width=file.width, max_pixels=max_pixels)
    return file


def check_pixels(name: str, *, height: int, width: int, max_pixels: int = MAX_PIXELS) -> None:
    """Raise ValueError where an image has no pixels, or more than `max_pixels`."""
    if height <= 0 or width <= 0:
        raise ValueError(f"{name} is {width} x {height} pixels (width x height); both must be positive")
    if height * width > max_pixels:
        raise ValueError(
            f"{name} is {width} x {height} pixels (width x height); source.max_pixels allows {max_pixels}, "
            f"and {MAX_PIXELS} at most"
        )


def _checked_png(data: bytes) -> CheckedFile | None:
    """Return a PNG's size and the chunks that make its pixels; None where it is damaged or cut off."""
    kept, at, view = [memoryview(_PNG)], len(_PNG), memoryview(data)
    for i in range(_MAX_CHUNKS):
        n_bytes, kind = struct.unpack(">I4s", data[at : at + 8].ljust(8, b"\0"))
        start, at = at, at + 12 + n_bytes  # length, kind and checksum besides
        if at > len(data) or (kind == b"IHDR") != (i == 0) or (i == 0 and n_bytes != 13):
            return None
        if kind in _PIXEL_CHUNKS:
            kept.append(view[start:at])
        if kind == b"IEND":
            width, height = struct.unpack(">II", kept[1][8:16])
            is_all = len(kept) == i + 2  # the usual case, without a copy
            return CheckedFile(data if is_all else b"".join(kept), height, width)
    return None


def _checked_jpeg(data: bytes) -> CheckedFile | None:
    """Return a JPEG as it is, and its size; None where it is damaged, cut off or of too many scans.

    The decoder, which fills the missing rest of an image with grey, takes the one size that comes before the first
    scan: those of thumbnails are inside of segments.
    """
    height, width, at = 0, 0, len(_JPEG) - 1
    while (found := _MARKER.search(data, at)) is not None:
        code, at = found[1][0], found.end()
        if code in _ALONE:
            continue
        segment = data[at : at + 7]
        if len(segment) < 7 or code in (_START, _END) or (code in _SIZES and height):
            return None
        if code in _SIZES:
            height, width = struct.unpack(">HH", segment[3:])
        elif code == _SCAN:
            end = data.rfind(b"\xff\xd9", at)
            is_whole = end > 0 and data.find(b"\xff\xda", end) < 0
            is_taken = height and is_whole and _n_scans(data, at) < _MAX_SCANS
            return CheckedFile(data, height, width) if is_taken else None
        at += max(int.from_bytes(segment[:2], "big"), 2)
    return None


def _n_scans(data: bytes, start: int) -> int:
    """Return how many markers of scans there are from a place on, which two bytes at least follow."""
    # `bytes.count` takes five times as long.
    halves = (np.frombuffer(data, "<u2", (len(data) - at) // 2, at) for at in (start, start + 1))
    return sum(int(np.count_nonzero(half == 0xDAFF)) for half in halves)
