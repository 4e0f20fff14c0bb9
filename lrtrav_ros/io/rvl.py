"""RVL, the lossless compression of depth images that image_transport offers beside PNG."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.io._rvl_kernels import decode_runs

_MAX_PIXELS = 2**26
"""No depth camera has as many; a damaged size asks for no more memory than this."""


def decode_rvl(data: bytes, *, height: int, width: int) -> NDArray[np.uint16]:
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

    Returns
    -------
    (height, width) ndarray of uint16

    Raises
    ------
    ValueError
        If the size is not positive or absurdly large, or the data are not such an image.

    References
    ----------
    A. D. Wilson, "Fast Lossless Depth Image Compression", ISS 2017, https://doi.org/10.1145/3132272.3134144
    """
    if height <= 0 or width <= 0 or height * width > _MAX_PIXELS:
        raise ValueError(f"RVL image of {width} x {height} pixels (width x height); give up to {_MAX_PIXELS} in all")
    words = np.frombuffer(data, "<u4", len(data) // 4).astype(np.uint32)
    depth = np.zeros(height * width, np.uint16)
    n_decoded = decode_runs(words, depth)
    if n_decoded != depth.size:
        raise ValueError(
            f"RVL image of {width} x {height} pixels: {len(data)} bytes are damaged or cut off after {n_decoded} pixels"
        )
    return depth.reshape(height, width)
