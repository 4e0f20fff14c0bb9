"""RVL against an encoder of the tests' own, and data that are damaged."""

import re

import numpy as np
import pytest
from rvl_writer import rvl_of

from lrtrav_ros.io.rvl import decode_rvl

HEIGHT, WIDTH = 11, 17


@pytest.fixture
def depth():
    """A slope with holes, a step, and values that differ by all that 16 bits allow."""
    depth = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH) * 7 + 1
    depth[3:6, 4:9] = 0
    depth[7:, 10:] += 4000
    depth[9, 1:4] = 65535, 1, 65535
    return depth


def test_by_hand():
    # Runs of 2 zeros and 3 others, 5 = 0b101 -> 10, which takes two nibbles, then -1 -> 1 and 0; a run of 1 zero.
    words = np.array([0x23A11010], "<u4")
    assert decode_rvl(words.tobytes(), height=2, width=3).tolist() == [[0, 0, 5], [4, 4, 0]]


def test_images_come_back(depth):
    for image in (depth, depth[:, 4:9], depth[3:5, 4:7], np.zeros((5, 3), np.uint16), np.ones((1, 1), np.uint16)):
        assert np.array_equal(decode_rvl(rvl_of(image), height=image.shape[0], width=image.shape[1]), image)


def test_data_that_are_cut_off_are_refused(depth):
    data = rvl_of(depth)
    for n in range(0, len(data) - 3, 4):
        with pytest.raises(ValueError, match=f"17 x 11 pixels: {n} bytes are damaged or cut off after"):
            decode_rvl(data[:n], height=HEIGHT, width=WIDTH)


def test_any_data_give_an_image_or_an_error(depth):
    rng = np.random.default_rng(2)
    refusals = []
    for _ in range(500):
        data = bytearray(rvl_of(depth[:4])) if rng.random() < 0.7 else bytearray(rng.bytes(64))
        for position in rng.integers(0, len(data), 3):
            data[position] ^= int(rng.integers(1, 256))
        try:
            assert decode_rvl(bytes(data), height=4, width=WIDTH).shape == (4, WIDTH)
        except ValueError as err:
            refusals.append(str(err))
    assert len(refusals) > 100
    assert all(re.search(r"17 x 4 pixels: \d+ bytes are damaged", text) for text in refusals)


@pytest.mark.parametrize(
    "numbers",
    [
        "1F",  # one zero, and more others than there are pixels
        "0211",  # a pixel below 0
        "02EFFFF71",  # a pixel above 65535
        "00000000",  # runs of nothing
        "FFFFFFFFFFFFFFFF",  # a number without an end
    ],
)
def test_what_no_encoder_writes_is_refused(numbers):
    words = [int(numbers[i : i + 8].ljust(8, "0"), 16) for i in range(0, len(numbers), 8)]
    with pytest.raises(ValueError, match=r"3 x 2 pixels: .* damaged or cut off after"):
        decode_rvl(np.array(words, "<u4").tobytes(), height=2, width=3)


@pytest.mark.parametrize(("height", "width"), [(0, 3), (3, -1), (2**32 - 1, 2**32 - 1), (2**20, 100)])
def test_absurd_sizes_are_refused(height, width):
    with pytest.raises(ValueError, match=f"RVL image is {width} x {height} pixels"):
        decode_rvl(bytes(8), height=height, width=width)
