"""Tests of the calibration."""

from __future__ import annotations

import numpy as np
import pytest

from lrtrav_ros.camera import StereoCamera

CAMERA = {"fx": 700.0, "cx": 320.0, "cy": 240.0, "baseline_m": 0.5}


def test_depth_and_disparity_are_inverse_and_none_stays_none() -> None:
    camera = StereoCamera(**CAMERA)
    disparity = np.array([[0, 1, 35, 350]], np.float32)
    depth = camera.depth_m(disparity)
    np.testing.assert_allclose(depth, [[0, 350, 10, 1]])
    np.testing.assert_allclose(camera.disparity(depth), disparity)


def test_depth_that_is_not_finite_is_none() -> None:
    depth = np.array([[np.nan, np.inf, -1.0, 0.0]], np.float32)
    np.testing.assert_array_equal(StereoCamera(**CAMERA).disparity(depth), np.zeros((1, 4), np.float32))


def test_fy_is_fx_where_fy_is_not_given() -> None:
    assert StereoCamera(**CAMERA).fy == 700
    assert StereoCamera(**CAMERA, fy=650.0).fy == 650


@pytest.mark.parametrize("name", ["fx", "fy", "cx", "cy", "baseline_m"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), "7", True])
def test_values_that_are_no_finite_numbers(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=f"{name} is .*; give a finite number"):
        StereoCamera(**{**CAMERA, name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["fx", "fy", "baseline_m"])
@pytest.mark.parametrize("value", [0.0, -3.0])
def test_values_that_are_not_positive(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} is {value}; give a positive number"):
        StereoCamera(**{**CAMERA, name: value})


@pytest.mark.parametrize("name", ["fx", "fy", "cx", "cy"])
def test_values_that_no_camera_has(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 1e\\+30; give pixels, at most 100000 of them"):
        StereoCamera(**{**CAMERA, name: 1e30})


def test_size_is_given_as_a_whole() -> None:
    with pytest.raises(ValueError, match="width is 640, height None; give both or none"):
        StereoCamera(**CAMERA, width=640)
    with pytest.raises(ValueError, match="height is 0; give a whole number of pixels"):
        StereoCamera(**CAMERA, width=640, height=0)


def test_a_size_that_no_camera_has() -> None:
    with pytest.raises(ValueError, match="images are 60000 x 60000; give a size of at most 67108864 pixels"):
        StereoCamera(**CAMERA, width=60_000, height=60_000)
