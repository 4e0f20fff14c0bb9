"""The checks of arrays: what passes, and the words that refuse the rest."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.numerics.checks import (
    check_array,
    check_count,
    check_distances,
    check_finite,
    check_image,
    check_labels,
    check_number,
    check_rotation,
    check_stamp,
    check_type,
    is_rotation,
)


@pytest.mark.parametrize("array", [np.zeros((4, 6), np.uint8), np.zeros((1, 1, 3), np.uint8)])
def test_arrays_of_a_wanted_shape_pass(array: NDArray[np.uint8]) -> None:
    array.flags.writeable = False
    check_array("image", array[::-1], np.uint8, ("H", "W"), ("H", "W", 3))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((4, 6), np.uint16), "image is uint16 (4, 6); give uint8 or float32 (H, W) or (5,), not empty"),
        (np.zeros(4, np.uint8), "image is uint8 (4,); give uint8 or float32 (H, W) or (5,), not empty"),
        (np.zeros((4, 0), np.uint8), "image is uint8 (4, 0); give uint8 or float32 (H, W) or (5,), not empty"),
        (np.zeros((), np.uint8), "image is uint8 (); give uint8 or float32 (H, W) or (5,), not empty"),
        (np.zeros(5, ">f4"), "image is >f4 (5,); give uint8 or float32 (H, W) or (5,), not empty"),
    ],
)
def test_other_arrays_are_refused_with_what_is_wanted(array: NDArray[np.generic], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        check_array("image", array, (np.uint8, np.float32), ("H", "W"), (5,))


def test_what_is_no_array_is_a_wrong_type() -> None:
    with pytest.raises(TypeError, match=r"^image is of type list; give a NumPy array of uint8 \(H, W\), not empty$"):
        check_array("image", [[1, 2]], np.uint8, ("H", "W"))


def test_a_name_stands_for_one_size() -> None:
    check_array("matrix", np.zeros((3, 3)), np.float64, ("n", "n"))
    with pytest.raises(ValueError, match=r"matrix is float64 \(3, 4\); give float64 \(n, n\)"):
        check_array("matrix", np.zeros((3, 4)), np.float64, ("n", "n"))


def test_empty_arrays_pass_where_they_may() -> None:
    check_array("solids", np.zeros((0, 10)), np.float64, ("n", 10), may_be_empty=True)
    with pytest.raises(ValueError, match=r"solids is float64 \(0, 9\); give float64 \(n, 10\)$"):
        check_array("solids", np.zeros((0, 9)), np.float64, ("n", 10), may_be_empty=True)


def test_images_are_grey_or_bgr() -> None:
    check_image("left", np.zeros((4, 6), np.uint8))
    check_image("left", np.zeros((4, 6, 3), np.uint8))
    with pytest.raises(ValueError, match=r"left is uint8 \(4, 6, 4\); give uint8 \(H, W\) or \(H, W, 3\), not empty"):
        check_image("left", np.zeros((4, 6, 4), np.uint8))


@pytest.mark.parametrize(("label", "passes"), [(-1, False), (0, True), (4, True), (5, False)])
def test_labels_are_in_range(label: int, passes: bool) -> None:
    labels = np.array([[0, 1, label]], np.int32)
    if passes:
        check_labels("superpixels", labels, 5)
    else:
        with pytest.raises(ValueError, match=f"superpixels holds {label}; give labels from 0 to 4"):
            check_labels("superpixels", labels, 5)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_are_finite(value: float) -> None:
    check_finite("waves", np.zeros((0, 4)))
    with pytest.raises(ValueError, match="waves holds values that are not finite"):
        check_finite("waves", np.array([1.0, value]))


def test_distances_are_square_and_not_negative() -> None:
    check_distances("distances", np.zeros((0, 0)))
    check_distances("distances", np.array([[0, 2.5], [2.5, 0]]))
    with pytest.raises(ValueError, match=r"distances holds values from -2\.5 to 2\.5; give finite distances from 0 up"):
        check_distances("distances", np.array([[0, -2.5], [2.5, 0]]))


@pytest.mark.parametrize("count", [1, 7, np.int64(3)])
def test_counts_pass(count: int) -> None:
    check_count("n_rows", count)


@pytest.mark.parametrize("kind", [int, np.int8, np.uint8, np.int64, np.uint64])
def test_counts_and_times_come_back_as_those_of_python(kind: type[int]) -> None:
    for found in (check_count("n_rows", kind(3)), check_stamp(kind(3))):
        assert type(found) is int
        assert found == 3


@pytest.mark.parametrize("kind", [int, float, np.int8, np.uint64, np.float16, np.float32, np.float64, np.longdouble])
def test_numbers_come_back_as_those_of_python(kind: type[float]) -> None:
    found = check_number("share", kind(3))
    assert type(found) is float
    assert found == 3


@pytest.mark.parametrize("check", [check_count, check_number])
def test_lengths_of_time_are_no_numbers(check: Any) -> None:
    with pytest.raises(TypeError, match=r"^x is \w+\.timedelta64\(5,'s'\); give a .*number$"):
        check("x", np.timedelta64(5, "s"))


@pytest.mark.parametrize(("count", "error"), [(0, ValueError), (-2, ValueError), (2.0, TypeError), (True, TypeError)])
def test_other_counts_are_refused(count: int, error: type[Exception]) -> None:
    with pytest.raises(error, match=f"^n_rows is {count}; give "):
        check_count("n_rows", count)


def test_counts_have_bounds() -> None:
    check_count("halvings", 0, least=0, most=3)
    with pytest.raises(ValueError, match=r"^halvings is 4; give 0 to 3$"):
        check_count("halvings", 4, least=0, most=3)


@pytest.mark.parametrize("number", [0, -1.5, np.float32(2), np.int64(3), 1e308])
def test_numbers_pass(number: float) -> None:
    check_number("share", number)


@pytest.mark.parametrize(
    ("number", "error"),
    [
        *((value, ValueError) for value in (np.nan, -np.inf, 10**400, np.longdouble("1e4000"))),
        *((True, TypeError), ("1", TypeError)),
    ],
)
def test_other_numbers_are_refused(number: float, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"^share is .*; give a (finite )?number$"):
        check_number("share", number)


@pytest.mark.parametrize("number", [0, -2, 101])
def test_numbers_have_bounds(number: float) -> None:
    check_number("height_m", 100, above=0, most=100)
    with pytest.raises(ValueError, match=f"^height_m is {number}; give a finite number above 0, at most 100$"):
        check_number("height_m", number, above=0, most=100)


def test_times_have_64_bits() -> None:
    check_stamp(-(2**63))
    with pytest.raises(ValueError, match=r"^stamp_ns is 9223372036854775808; give "):
        check_stamp(2**63)
    with pytest.raises(TypeError, match=r"^stamp_ns is 1.0; give a whole number"):
        check_stamp(1.0)


def test_types_are_told() -> None:
    check_type("line", None, str, may_be_none=True)
    check_type("line", "x", str)
    with pytest.raises(TypeError, match=r"^line is of type dict; give str or None$"):
        check_type("line", {}, str, may_be_none=True)
    with pytest.raises(TypeError, match=r"^line is of type NoneType; give str$"):
        check_type("line", None, str)


@pytest.mark.parametrize(
    ("matrix", "error", "message"),
    [
        (np.eye(2), ValueError, "turn"),
        (np.eye(3, dtype=np.float32), ValueError, "turn"),
        ([[1.0]], TypeError, "turn"),
        (np.full((3, 3), np.nan), ValueError, "not finite"),
        (2 * np.eye(3), ValueError, "give an orthonormal matrix of determinant 1"),
        (np.diag([1.0, 1.0, -1.0]), ValueError, "give an orthonormal matrix of determinant 1"),
    ],
)
def test_what_does_not_turn_is_no_rotation(matrix: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        check_rotation("turn", matrix)


def test_a_turn_is_a_rotation() -> None:
    check_rotation("turn", np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))


def test_what_turns_may_be_rounded_and_then_so_may_its_inverse() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        for rounded in (turn.astype(np.float32).astype(np.float64), turn.round(6)):
            check_rotation("turn", rounded)
        for size in (4e-6, 8e-6, 2e-5):
            bent = turn + rng.uniform(-size, size, (3, 3))
            assert is_rotation(bent) == is_rotation(np.ascontiguousarray(bent.T))
        assert not is_rotation(bent * (1 + 4e-5))


@pytest.mark.parametrize("value", [1e200, -1.7e308, 3.0])
def test_what_is_much_too_large_to_turn_is_refused_without_overflow(value: float) -> None:
    for matrix in (np.full((3, 3), value), np.diag([1.0, 1.0, value])):
        with pytest.raises(ValueError, match="give an orthonormal matrix"):
            check_rotation("turn", matrix)
