"""Image files: PNG and JPEG, as arrays."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.frame import Image
from lrtrav_ros.io.atomic_files import write_bytes
from lrtrav_ros.io.image_headers import checked_file
from lrtrav_ros.io.input_files import read_bytes
from lrtrav_ros.numerics.checks import check_array, check_type

DISPARITY_SCALE = 256.0
"""Disparity files hold 16-bit integers: disparity in pixels times this, 0 for none."""


def read_image(path: str | os.PathLike[str], *, max_pixels: int = MAX_PIXELS) -> Image:
    """Return the image in a file, as it is stored but for an alpha channel, which is dropped.

    Parameters
    ----------
    path : path
        A PNG or JPEG.
    max_pixels : int
        Most pixels that it may have.

    Returns
    -------
    (H, W) or (H, W, 3) ndarray of uint8 or uint16
        Grey or BGR.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file holds no whole image of 8 or 16 bits per channel, or a larger one.
    """
    return decode_file(read_bytes(path), str(path), max_pixels=max_pixels)


def write_image(path: str | os.PathLike[str], image: Image) -> None:
    """Write an image in the format of the path's suffix, and never a part of one: see `write_bytes`.

    Parameters
    ----------
    path : path
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
    TypeError, ValueError
        If it is no array, or the format cannot hold the image.
    """
    path = Path(path)
    check_type("image", image, np.ndarray)
    known = {".png": ("uint8", "uint16"), ".jpg": ("uint8",), ".jpeg": ("uint8",)}.get(path.suffix.lower(), ())
    if image.dtype.name not in known or not image.dtype.isnative or image.ndim not in (2, 3):
        raise ValueError(
            f"{path}: an image of shape {image.shape} and type {image.dtype} does not fit this file name; "
            "give .png with uint8 or uint16, or .jpg with uint8"
        )
    try:
        encoded, data = cv2.imencode(path.suffix.lower(), np.ascontiguousarray(image))
    except cv2.error as err:
        raise ValueError(
            f"{path}: an image of shape {image.shape} cannot be encoded ({err.err}); give (H, W) or (H, W, 3)"
        ) from err
    if not encoded:
        raise ValueError(f"{path}: an image of shape {image.shape} cannot be encoded; JPEG takes up to 65,500 pixels")
    return bytes(data.tobytes())


def read_disparity(
    path: str | os.PathLike[str], *, scale: float = DISPARITY_SCALE, max_pixels: int = MAX_PIXELS
) -> NDArray[np.float32]:
    """Return the (H, W) disparity in pixels (or another quantity that was multiplied by `scale`) of a 16-bit file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not a grey image of 16 bits, or one of more than `max_pixels` pixels.
    """
    image = read_image(path, max_pixels=max_pixels)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise ValueError(f"{path}: has shape {image.shape} and type {image.dtype}; give a grey PNG of 16 bits")
    return image.astype(np.float32) / np.float32(scale)


def write_disparity(path: str | os.PathLike[str], disparity: NDArray[np.float32]) -> None:
    """Write an (H, W) disparity in pixels (or depth in metres) as 16-bit PNG: see `scaled_disparity`."""
    write_image(path, scaled_disparity(disparity))


def scaled_disparity(disparity: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Return disparity in pixels (or depth in metres) times 256, as files hold it; what exceeds 16 bits is 65535.

    Raises TypeError or ValueError if it is no (H, W) array of float32 or float64.
    """
    check_array("disparity", disparity, (np.float32, np.float64), ("H", "W"))
    valid = np.clip(np.nan_to_num(disparity, posinf=0, neginf=0), 0, 65536)
    return np.minimum(np.rint(valid * DISPARITY_SCALE), 65535).astype(np.uint16)


def decode_file(data: bytes, name: str, *, max_pixels: int = MAX_PIXELS) -> Image:
    """Return the image that the bytes of a PNG or JPEG file hold, as `read_image` does.

    Parameters
    ----------
    name : str
        Stands in messages.
    max_pixels : int
        Most pixels that the image may have; the header tells, before memory is made for them.

    Raises
    ------
    ValueError
        If they are no whole image of 8 or 16 bits per channel, or a larger one.
    """
    file, image = checked_file(data, name, max_pixels=max_pixels), None
    with contextlib.suppress(cv2.error):
        image = cv2.imdecode(np.frombuffer(file.data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape[:2] != (file.height, file.width):
        raise ValueError(f"{name}: {len(data)} bytes that cannot be read as an image; give a whole PNG or JPEG")
    if image.ndim == 3 and image.shape[2] == 4:
        image = cv2.cvtColor(image, cv2.COLOR_BGRA2BGR)
    if image.dtype not in (np.uint8, np.uint16) or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(
            f"{name}: image of shape {image.shape} and type {image.dtype}; give grey or colour, 8 or 16 bits"
        )
    return image
