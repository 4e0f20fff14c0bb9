"""Points as the bytes of messages."""

from __future__ import annotations

import numpy as np
import pytest

from lrtrav_ros.io.point_clouds import FIELDS, FLOAT32, encode_points


def test_a_list_of_points_is_one_row() -> None:
    points = np.array([[1.5, -2, 3], [4, 5, 6.25]], np.float32)
    encoded = encode_points(points)
    assert (encoded.height, encoded.width, encoded.point_step, encoded.row_step) == (1, 2, 12, 24)
    assert encoded.is_dense
    assert encoded.data.dtype == np.uint8
    assert encoded.data.tobytes() == np.array([1.5, -2, 3, 4, 5, 6.25], "<f4").tobytes()
    assert dict(FIELDS) == {"x": 0, "y": 4, "z": 8}
    assert FLOAT32 == 7


def test_an_image_of_points_is_organised() -> None:
    points = np.arange(2 * 5 * 3, dtype=np.float32).reshape(2, 5, 3)
    points[1, 2] = np.nan
    encoded = encode_points(points)
    assert (encoded.height, encoded.width, encoded.row_step, len(encoded.data)) == (2, 5, 60, 120)
    assert not encoded.is_dense
    np.testing.assert_array_equal(encoded.data.view("<f4").reshape(2, 5, 3), points)
    assert not encode_points(np.array([[np.inf, 0, 0]], np.float32)).is_dense


def test_parts_of_larger_arrays_are_written_as_they_look() -> None:
    points = np.arange(60, dtype=np.float32).reshape(10, 6)[::2, ::2]
    np.testing.assert_array_equal(encode_points(points).data.view("<f4").reshape(5, 3), points)


def test_there_may_be_no_points() -> None:
    encoded = encode_points(np.empty((0, 3), np.float32))
    assert (encoded.height, encoded.width, encoded.row_step, len(encoded.data)) == (1, 0, 0, 0)
    assert encoded.is_dense


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.zeros((2, 4), np.float32), np.zeros(3, np.float32)])
def test_other_arrays_are_refused(points: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"give float32 \(N, 3\) or float32 \(H, W, 3\)|give float32 \(N, 3\) or"):
        encode_points(points)
