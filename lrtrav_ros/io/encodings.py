"""Image encodings: from the bytes of an image message to an array, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.frame import Image
from lrtrav_ros.io.image_files import decode_file
from lrtrav_ros.io.image_headers import check_pixels
from lrtrav_ros.io.rvl import decode_rvl
from lrtrav_ros.numerics.checks import check_array, check_count, check_type

Buffer: TypeAlias = bytes | bytearray | memoryview | NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class _Encoding:
    """Layout of the pixels of one encoding, and the OpenCV code that makes them grey or BGR.

    Blocks of `block_rows` x `block_columns` pixels share a colour; where they have two rows, the colours follow the
    brightness in rows of their own.
    """

    dtype: str
    channels: int = 1
    conversion: int | None = None
    block_rows: int = 1
    block_columns: int = 1

    def n_rows(self, height: int) -> int:
        """Return the number of rows of data of an image of this height in pixels."""
        return height * 3 // 2 if self.block_rows == 2 else height


# OpenCV names a Bayer pattern by the second and third pixel of its second row, ROS by the first four pixels.
_BAYER = {
    "bayer_rggb": cv2.COLOR_BayerBG2BGR,
    "bayer_bggr": cv2.COLOR_BayerRG2BGR,
    "bayer_gbrg": cv2.COLOR_BayerGR2BGR,
    "bayer_grbg": cv2.COLOR_BayerGB2BGR,
}
_ENCODINGS = {
    "mono8": _Encoding("u1"),
    "mono16": _Encoding("u2"),
    "bgr8": _Encoding("u1", 3),
    "rgb8": _Encoding("u1", 3, cv2.COLOR_RGB2BGR),
    "bgra8": _Encoding("u1", 4, cv2.COLOR_BGRA2BGR),
    "rgba8": _Encoding("u1", 4, cv2.COLOR_RGBA2BGR),
    "bgr16": _Encoding("u2", 3),
    "rgb16": _Encoding("u2", 3, cv2.COLOR_RGB2BGR),
    "bgra16": _Encoding("u2", 4, cv2.COLOR_BGRA2BGR),
    "rgba16": _Encoding("u2", 4, cv2.COLOR_RGBA2BGR),
    "yuv422": _Encoding("u1", 2, cv2.COLOR_YUV2BGR_UYVY, block_columns=2),
    "uyvy": _Encoding("u1", 2, cv2.COLOR_YUV2BGR_UYVY, block_columns=2),
    "yuv422_yuy2": _Encoding("u1", 2, cv2.COLOR_YUV2BGR_YUY2, block_columns=2),
    "yuyv": _Encoding("u1", 2, cv2.COLOR_YUV2BGR_YUY2, block_columns=2),
    "nv12": _Encoding("u1", 1, cv2.COLOR_YUV2BGR_NV12, block_rows=2, block_columns=2),
    "nv21": _Encoding("u1", 1, cv2.COLOR_YUV2BGR_NV21, block_rows=2, block_columns=2),
    "8UC1": _Encoding("u1"),
    "8UC3": _Encoding("u1", 3),
    "8UC4": _Encoding("u1", 4, cv2.COLOR_BGRA2BGR),
    "16UC1": _Encoding("u2"),
    "32FC1": _Encoding("f4"),
    **{f"{name}8": _Encoding("u1", 1, code) for name, code in _BAYER.items()},
    **{f"{name}16": _Encoding("u2", 1, code) for name, code in _BAYER.items()},
}
ENCODINGS = tuple(_ENCODINGS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EncodedImage:
    """The fields of a ``sensor_msgs/Image``, little-endian and without padding; `data` is flat uint8."""

    encoding: str
    height: int
    width: int
    step: int
    data: NDArray[np.uint8]


def decode_image(
    data: Buffer,
    *,
    encoding: str,
    height: int,
    width: int,
    step: int,
    is_bigendian: bool | int = False,
    max_pixels: int = MAX_PIXELS,
) -> Image:
    """Return the array that the fields of a ``sensor_msgs/Image`` describe.

    Parameters
    ----------
    data : bytes-like
        Bytes of the image, at least ``step * height``; half as many again for ``nv12`` and ``nv21``.
    encoding : str
        One of `ENCODINGS`.
    height, width : int
        Size in pixels.
    step : int
        Length of a row in bytes, padding included.
    is_bigendian : bool
        Whether the most significant byte of 16- and 32-bit pixels comes first.
    max_pixels : int
        Most pixels that the image may have.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray
        A contiguous copy in the machine's byte order: BGR for colour, YUV and Bayer encodings, else grey or depth;
        uint8, uint16 (encodings with 16 in their name) or float32 (``32FC1``). It is writable, as kernels want it.

    Raises
    ------
    ValueError
        If the encoding is unknown, a size is not positive, too large, or odd where pixels share their colour, `step` is
        too small for a row, or `data` is too short.
    """
    pixel = _ENCODINGS.get(encoding) if isinstance(encoding, str) else None
    if pixel is None:
        raise ValueError(f"image encoding is {encoding!r}; give one of {', '.join(ENCODINGS)}")
    height = check_count("image height", height, least=-(2**31))
    width = check_count("image width", width, least=-(2**31))
    step = check_count("image step", step, least=-(2**31))
    dtype = np.dtype(f"{'>' if is_bigendian else '<'}{pixel.dtype}")
    row_bytes, n_rows = width * pixel.channels * dtype.itemsize, pixel.n_rows(height)
    buffer = _flat(data)
    check_pixels("image", height=height, width=width, max_pixels=max_pixels)
    _check_blocks(encoding, pixel, height=height, width=width)
    _check_layout(buffer.size, n_rows=n_rows, width=width, step=step, row_bytes=row_bytes)
    rows = buffer[: step * n_rows].reshape(n_rows, step)[:, :row_bytes]
    # Conversion makes a copy of its own.
    is_to_copy = pixel.conversion is None and rows.flags.c_contiguous
    image = np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="), copy=is_to_copy)
    if pixel.channels > 1:
        image = image.reshape(height, width, pixel.channels)
    return image if pixel.conversion is None else cv2.cvtColor(image, pixel.conversion)


def _flat(data: Buffer) -> NDArray[np.uint8]:
    """Return bytes as an array."""
    if isinstance(data, np.ndarray):
        check_array("image data", data, np.uint8, ("n",), may_be_empty=True)
        return data
    try:
        return np.frombuffer(data, np.uint8)
    except (AttributeError, BufferError, TypeError, ValueError) as err:
        raise ValueError(f"image data is of type {type(data).__name__} ({err}); give contiguous bytes") from err


def decode_message(message: Any, *, max_pixels: int = MAX_PIXELS) -> Image:
    """Return the array of a ``sensor_msgs`` Image or CompressedImage, of rclpy or of rosbags.

    Parameters
    ----------
    message : sensor_msgs/Image or sensor_msgs/CompressedImage
        The message.
    max_pixels : int
        Most pixels that the image may have.

    Raises
    ------
    ValueError
        If the message is not whole, or its image larger; see `decode_image` and `decode_compressed`.
    """
    if hasattr(message, "format"):
        return decode_compressed(message.data, message.format, max_pixels=max_pixels)
    return decode_image(
        message.data,
        encoding=message.encoding,
        height=message.height,
        width=message.width,
        step=message.step,
        is_bigendian=message.is_bigendian,
        max_pixels=max_pixels,
    )


def _check_blocks(encoding: str, pixel: _Encoding, *, height: int, width: int) -> None:
    """Raise ValueError where an image's size is odd but its pixels share colours."""
    if height % pixel.block_rows or width % pixel.block_columns:
        block = f"{pixel.block_columns} x {pixel.block_rows}"
        raise ValueError(f"image is {width} x {height} pixels; {encoding} needs a multiple of {block}")


def _check_layout(n_bytes: int, *, n_rows: int, width: int, step: int, row_bytes: int) -> None:
    """Raise ValueError where rows and data of an image do not fit each other."""
    if step < row_bytes:
        raise ValueError(f"image step is {step} bytes; a row of {width} pixels needs at least {row_bytes}")
    if n_bytes < step * n_rows:
        raise ValueError(f"image data has {n_bytes} bytes; {n_rows} rows of {step} bytes need {step * n_rows}")


def decode_compressed(
    data: Buffer,
    format: str,  # noqa: A002 - the field's name in the message
    *,
    max_pixels: int = MAX_PIXELS,
) -> Image:
    """Return the array that a ``sensor_msgs/CompressedImage`` holds.

    Parameters
    ----------
    data : bytes-like
        A JPEG or PNG file. Where `format` says ``compressedDepth``, 12 bytes of header and a PNG file, or for RVL
        width and height, 4 bytes each, and what `decode_rvl` takes.
    format : str
        As image_transport writes it: ``jpeg``, ``png``, ``rgb8; jpeg compressed bgr8``, ``16UC1; compressedDepth``,
        ``32FC1; compressedDepth rvl``.
    max_pixels : int
        Most pixels that the image may have.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray
        As from `decode_image`. Compressed depth comes as uint16 millimetres or float32 metres, 0 where there is none.

    Raises
    ------
    ValueError
        If the data is no whole JPEG or PNG file, or no whole depth image, or the image is larger.
    """
    encoding, _, compression = (part.strip() for part in format.partition(";"))
    if "compressedDepth" in format:
        return _decode_compressed_depth(bytes(data), encoding, is_rvl="rvl" in compression, max_pixels=max_pixels)
    image = decode_file(bytes(data), f"compressed image of format {format!r}", max_pixels=max_pixels)
    pixel = _ENCODINGS.get(encoding)
    if image.ndim == 2 and pixel is not None and encoding.startswith("bayer_"):
        return cv2.cvtColor(image, pixel.conversion)
    # image_transport says "compressed bgr8" where it swapped RGB before compressing; elsewhere it did not.
    return cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if "compressed rgb" in compression and image.ndim == 3 else image


def _decode_compressed_depth(data: bytes, encoding: str, *, is_rvl: bool, max_pixels: int) -> Image:
    """Return 16UC1 as it is; 32FC1 is stored as a / depth + b, after a header of one integer, a and b."""
    header, rest = data[:12], data[12:]
    if len(header) < 12 or encoding not in ("16UC1", "32FC1"):
        raise ValueError(f"compressed depth of encoding {encoding!r} and {len(data)} bytes; give 16UC1 or 32FC1")
    if is_rvl:
        image: Image = _decode_sized_rvl(rest, max_pixels)
    else:
        image = decode_file(rest, "compressed depth", max_pixels=max_pixels)
    if encoding == "16UC1":
        return image
    scale, offset = np.frombuffer(header, "<f4", offset=4)
    depth = np.zeros(image.shape, np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):  # what is not finite counts as none
        np.divide(scale, image - offset, out=depth, where=image > 0)
    return depth


def _decode_sized_rvl(data: bytes, max_pixels: int) -> NDArray[np.uint16]:
    """Return the image of RVL data after its width and height."""
    if len(data) < 8:
        raise ValueError(f"compressed depth has {len(data)} bytes after its header; RVL begins with width and height")
    width, height = (int(size) for size in np.frombuffer(data, "<u4", 2))
    return decode_rvl(data[8:], height=height, width=width, max_pixels=max_pixels)


def encode_image(image: Image) -> EncodedImage:
    """Return `image` as the fields of a ``sensor_msgs/Image``.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray
        uint8 becomes ``mono8`` or ``bgr8``, uint16 ``mono16`` and float32 ``32FC1``.

    Raises
    ------
    TypeError, ValueError
        If it is no array, or no encoding fits the array's shape and type.
    """
    check_type("image", image, np.ndarray)
    names = {("u1", 2): "mono8", ("u1", 3): "bgr8", ("u2", 2): "mono16", ("f4", 2): "32FC1"}
    name = names.get((image.dtype.str[1:], image.ndim))
    if name is None or image.size == 0 or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(
            f"image of shape {image.shape} and type {image.dtype}; "
            "give (H, W) uint8, uint16 or float32, or (H, W, 3) uint8"
        )
    little = np.ascontiguousarray(image, image.dtype.newbyteorder("<"))
    height, width = image.shape[:2]
    data = little.reshape(-1).view(np.uint8)
    return EncodedImage(encoding=name, height=height, width=width, step=data.size // height, data=data)
