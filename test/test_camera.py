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


@pytest.mark.parametrize("changes", [{"fx": 64_001.0}, {"fy": 2.0}, {"cy": -64_001.0}, {"cx": 64_001.0}])
def test_values_that_no_camera_of_the_images_size_has(changes: dict[str, float]) -> None:
    name = next(iter(changes))
    values = {**CAMERA, "fy": 700.0, **changes}
    with pytest.raises(ValueError, match=f"{name} is .* pixels for images of 640 x 480, which no camera has"):
        StereoCamera(**values, width=640, height=480)
    with pytest.raises(ValueError, match=f"{name} is .* pixels for images of 640 x 480, which no camera has"):
        StereoCamera(**values).check_size((480, 640, 3))


def test_a_small_part_of_a_long_lens_is_a_camera() -> None:
    StereoCamera(fx=20_000.0, cx=-3000.0, cy=1500.0, baseline_m=0.5, width=400, height=300)


def test_a_baseline_that_no_vehicle_has() -> None:
    with pytest.raises(ValueError, match=r"baseline_m is 1000000000.0; give metres, at most 1000 of them"):
        StereoCamera(**{**CAMERA, "baseline_m": 1e9})
