"""Image encodings and image files: from the bytes of a message or file to an array, and back."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

Image: TypeAlias = NDArray[Any]
Buffer: TypeAlias = bytes | bytearray | memoryview | NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class _Encoding:
    """How the pixels of one encoding lie in memory, and the OpenCV code that makes them grey or BGR."""

    dtype: str
    channels: int = 1
    conversion: int | None = None


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
    "8UC1": _Encoding("u1"),
    "8UC3": _Encoding("u1", 3),
    "16UC1": _Encoding("u2"),
    "32FC1": _Encoding("f4"),
    **{f"{name}8": _Encoding("u1", 1, code) for name, code in _BAYER.items()},
    **{f"{name}16": _Encoding("u2", 1, code) for name, code in _BAYER.items()},
}
ENCODINGS = tuple(_ENCODINGS)

DISPARITY_SCALE = 256.0
"""Disparity files hold 16-bit integers: disparity in pixels times this, 0 for none."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EncodedImage:
    """The fields of a ``sensor_msgs/Image``, little-endian and without padding; `data` is flat uint8."""

    encoding: str
    height: int
    width: int
    step: int
    data: NDArray[np.uint8]


def decode_image(
    data: Buffer, *, encoding: str, height: int, width: int, step: int, is_bigendian: bool | int = False
) -> Image:
    """Return the array that the fields of a ``sensor_msgs/Image`` describe.

    Parameters
    ----------
    data
        Bytes of the image, at least ``step * height``.
    encoding
        One of `ENCODINGS`.
    height, width
        Size in pixels.
    step
        Length of a row in bytes, padding included.
    is_bigendian
        Whether the most significant byte of 16- and 32-bit pixels comes first.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray
        A contiguous, writable copy in the machine's byte order: BGR for colour and Bayer encodings, else grey or
        depth; uint8, uint16 (``mono16``, ``16UC1``, ``bayer_*16``) or float32 (``32FC1``).

    Raises
    ------
    ValueError
        If the encoding is unknown, a size is not positive, `step` is too small for a row, or `data` is too short.
    """
    pixel = _ENCODINGS.get(encoding)
    if pixel is None:
        raise ValueError(f"image encoding is {encoding!r}; give one of {', '.join(ENCODINGS)}")
    dtype = np.dtype(f"{'>' if is_bigendian else '<'}{pixel.dtype}")
    row_bytes = width * pixel.channels * dtype.itemsize
    buffer = np.frombuffer(data, np.uint8)
    _check_layout(buffer.size, height=height, width=width, step=step, row_bytes=row_bytes)
    rows = buffer[: step * height].reshape(height, step)[:, :row_bytes]
    image = np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="))
    if pixel.channels > 1:
        image = image.reshape(height, width, pixel.channels)
    return image if pixel.conversion is None else cv2.cvtColor(image, pixel.conversion)


def decode_message(message: Any) -> Image:
    """Return the array of a ``sensor_msgs`` Image or CompressedImage, of rclpy or of rosbags.

    Raises
    ------
    ValueError
        If the message is not whole; see `decode_image` and `decode_compressed`.
    """
    if hasattr(message, "format"):
        return decode_compressed(message.data, message.format)
    return decode_image(
        message.data,
        encoding=message.encoding,
        height=message.height,
        width=message.width,
        step=message.step,
        is_bigendian=message.is_bigendian,
    )


def _check_layout(n_bytes: int, *, height: int, width: int, step: int, row_bytes: int) -> None:
    """Raise ValueError where the sizes of an image do not fit each other."""
    if height <= 0 or width <= 0:
        raise ValueError(f"image is {width} x {height} pixels (width x height); both must be positive")
    if step < row_bytes:
        raise ValueError(f"image step is {step} bytes; a row of {width} pixels needs at least {row_bytes}")
    if n_bytes < step * height:
        raise ValueError(f"image data has {n_bytes} bytes; {height} rows of {step} bytes need {step * height}")


def decode_compressed(data: Buffer, format: str) -> Image:  # noqa: A002 - the field's name in the message
    """Return the array that a ``sensor_msgs/CompressedImage`` holds.

    Parameters
    ----------
    data
        A JPEG or PNG file; after 12 bytes of header where `format` says ``compressedDepth``.
    format
        As image_transport writes it: ``jpeg``, ``png``, ``rgb8; jpeg compressed bgr8``, ``16UC1; compressedDepth``.

    Returns
    -------
    (height, width) or (height, width, 3) ndarray
        As from `decode_image`. Compressed depth comes as uint16 millimetres or float32 metres, 0 where there is none.

    Raises
    ------
    ValueError
        If the data is no whole JPEG or PNG file.
    """
    encoding, _, compression = (part.strip() for part in format.partition(";"))
    if "compressedDepth" in format:
        return _decode_compressed_depth(bytes(data), encoding)
    image = _decode_file(bytes(data), f"compressed image of format {format!r}")
    pixel = _ENCODINGS.get(encoding)
    if image.ndim == 2 and pixel is not None and encoding.startswith("bayer_"):
        return cv2.cvtColor(image, pixel.conversion)
    # image_transport says "compressed bgr8" where it swapped RGB before compressing; elsewhere it did not.
    return cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if "compressed rgb" in compression and image.ndim == 3 else image


def _decode_compressed_depth(data: bytes, encoding: str) -> Image:
    """Return 16UC1 as it is; 32FC1 is stored as a + b / depth, after a header of one integer, a and b."""
    header, file = data[:12], data[12:]
    if len(header) < 12 or encoding not in ("16UC1", "32FC1"):
        raise ValueError(f"compressed depth of encoding {encoding!r} and {len(data)} bytes; give 16UC1 or 32FC1 as PNG")
    image = _decode_file(file, "compressed depth (RVL is not supported; use png)")
    if encoding == "16UC1":
        return image
    scale, offset = np.frombuffer(header, "<f4", offset=4)
    depth = np.zeros(image.shape, np.float32)
    np.divide(scale, image - offset, out=depth, where=image > 0)
    return depth


def encode_image(image: Image) -> EncodedImage:
    """Return `image` as the fields of a ``sensor_msgs/Image``.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray
        uint8 becomes ``mono8`` or ``bgr8``, uint16 ``mono16`` and float32 ``32FC1``.

    Raises
    ------
    ValueError
        If no encoding fits the array's shape and type.
    """
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


def as_8bit(image: Image, *, like: Image | None = None) -> NDArray[np.uint8]:
    """Return a grey or colour image with 8 bits per channel.

    A camera of 10 or 12 bits fills only a part of its 16: the significant bits of the brightest pixel are kept, so that
    the result is `image` divided by a power of two, 1 .. 256. No pixel is scaled up.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8 or uint16
    like
        The image whose brightest pixel counts; `image` itself by default. Give the left image with the right one, so
        that both are scaled alike; what is brighter is cut to 255.

    Raises
    ------
    ValueError
        If the image has another type.
    """
    if image.dtype == np.uint8:
        return image
    if image.dtype != np.uint16:
        raise ValueError(f"image has type {image.dtype}; give uint8 or uint16")
    bits = int((image if like is None else like).max()).bit_length()
    return np.minimum(image >> max(bits - 8, 0), 255).astype(np.uint8)


def depth_in_metres(image: Image) -> NDArray[np.float32]:
    """Return a depth image (uint16 in millimetres, float32 in metres) as metres, 0 where there is no depth.

    Raises
    ------
    ValueError
        If the image is not (H, W) of uint16 or float32.
    """
    if image.ndim != 2 or image.dtype not in (np.uint16, np.float32):
        raise ValueError(f"depth image has shape {image.shape} and type {image.dtype}; give 16UC1 [mm] or 32FC1 [m]")
    if image.dtype == np.uint16:
        return image.astype(np.float32) / np.float32(1000)
    return np.where(np.isfinite(image) & (image > 0), image, np.float32(0))


def valid_disparity(image: Image, min_disparity: float) -> NDArray[np.float32]:
    """Return the image of a ``stereo_msgs/DisparityImage`` (H, W) as disparity in pixels, 0 where there is none.

    Pixels below `min_disparity` are invalid, and so are those that are not finite or not positive.

    Raises
    ------
    ValueError
        If the image is not (H, W) of float32.
    """
    if image.ndim != 2 or image.dtype != np.float32:
        raise ValueError(f"disparity image has shape {image.shape} and type {image.dtype}; give 32FC1")
    valid = np.isfinite(image) & (image > 0) & (image >= min_disparity)
    return np.where(valid, image, np.float32(0))


def read_image(path: str | os.PathLike[str]) -> Image:
    """Return the image in a file, as it is stored but for an alpha channel, which is dropped.

    Returns
    -------
    (H, W) or (H, W, 3) ndarray of uint8 or uint16
        Grey or BGR.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file holds no whole image of 8 or 16 bits per channel.
    """
    return _decode_file(Path(path).read_bytes(), str(path))


def write_image(path: str | os.PathLike[str], image: Image) -> None:
    """Write an image in the format of the path's suffix, and never a part of one: see `write_bytes`.

    Parameters
    ----------
    path
        ``.png`` (uint8 or uint16) or ``.jpg`` (uint8); missing folders are made.
    image : (H, W) or (H, W, 3) ndarray
        Grey or BGR.

    Raises
    ------
    ValueError
        If the format cannot hold the image.
    """
    write_bytes(path, encode_file(path, image))


def encode_file(path: str | os.PathLike[str], image: Image) -> bytes:
    """Return the bytes of the file that `write_image` writes.

    Raises
    ------
    ValueError
        If the format cannot hold the image.
    """
    path = Path(path)
    known = {".png": ("uint8", "uint16"), ".jpg": ("uint8",), ".jpeg": ("uint8",)}.get(path.suffix.lower(), ())
    if image.dtype.name not in known or image.ndim not in (2, 3):
        raise ValueError(
            f"{path}: an image of shape {image.shape} and type {image.dtype} does not fit this file name; "
            "give .png with uint8 or uint16, or .jpg with uint8"
        )
    return bytes(cv2.imencode(path.suffix.lower(), image)[1].tobytes())


def read_disparity(path: str | os.PathLike[str], *, scale: float = DISPARITY_SCALE) -> NDArray[np.float32]:
    """Return the (H, W) disparity in pixels (or another quantity that was multiplied by `scale`) of a 16-bit file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not a grey image of 16 bits.
    """
    image = read_image(path)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise ValueError(f"{path}: has shape {image.shape} and type {image.dtype}; give a grey PNG of 16 bits")
    return image.astype(np.float32) / np.float32(scale)


def write_disparity(path: str | os.PathLike[str], disparity: NDArray[np.float32]) -> None:
    """Write an (H, W) disparity in pixels (or depth in metres) as 16-bit PNG: see `scaled_disparity`."""
    write_image(path, scaled_disparity(disparity))


def scaled_disparity(disparity: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return disparity in pixels (or depth in metres) times 256, as files hold it; what exceeds 16 bits is 65535."""
    scaled = np.rint(np.nan_to_num(disparity, posinf=0, neginf=0) * DISPARITY_SCALE)
    return np.clip(scaled, 0, 65535).astype(np.uint16)


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file under a temporary name beside it, then give it its name: a finished file is never half replaced."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _decode_file(data: bytes, name: str) -> Image:
    """Return the grey or BGR image of a file's bytes; `name` stands in messages."""
    image = None
    if _is_whole(data):
        with contextlib.suppress(cv2.error):
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError(f"{name}: {len(data)} bytes that cannot be read as an image; give a whole PNG or JPEG")
    if image.ndim == 3 and image.shape[2] == 4:
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2BGR)
    if image.dtype not in (np.uint8, np.uint16) or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(
            f"{name}: image of shape {image.shape} and type {image.dtype}; give grey or colour, 8 or 16 bits"
        )
    return image


def _is_whole(data: bytes) -> bool:
    """Whether a JPEG or PNG has its end: OpenCV fills the missing rest of one that is cut off with grey."""
    if data.startswith(b"\x89PNG"):
        return data.rfind(b"IEND") > 0
    if data.startswith(b"\xff\xd8"):
        return data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda")
    return bool(data)
