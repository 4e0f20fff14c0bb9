"""RVL, the lossless compression of depth images that image_transport offers beside PNG."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.io._rvl_kernels import decode_runs
from lrtrav_ros.io.image_headers import check_pixels


def decode_rvl(data: bytes, *, height: int, width: int, max_pixels: int = MAX_PIXELS) -> NDArray[np.uint16]:
    """Return the depth image that RVL data hold.

    The image's pixels, row by row, are runs of zeros and of others in turn. The length of each run, and the difference
    of each pixel that is not 0 to the one before, are numbers of 3 bits a nibble, the lowest first, whose fourth bit
    says that more follow; differences come with their sign in the lowest bit. Eight nibbles make a word.

    Parameters
    ----------
    data : bytes
        Words of 32 bits, little-endian, each of them with its first nibble in the highest bits.
    height, width : int
        Size in pixels.
    max_pixels : int
        Most pixels that the image may have.

    Returns
    -------
    (height, width) ndarray of uint16

    Raises
    ------
    ValueError
        If the size is not positive or larger, or the data are not such an image.

    References
    ----------
    A. D. Wilson, "Fast Lossless Depth Image Compression", ISS 2017, https://doi.org/10.1145/3132272.3134144
    """
    check_pixels("RVL image", height=height, width=width, max_pixels=max_pixels)
    words = np.frombuffer(data, "<u4", len(data) // 4).astype(np.uint32)
    depth = np.zeros(height * width, np.uint16)
    n_decoded = decode_runs(words, depth)
    if n_decoded != depth.size:
        raise ValueError(
            f"RVL image of {width} x {height} pixels: {len(data)} bytes are damaged or cut off after {n_decoded} pixels"
        )
    return depth.reshape(height, width)
