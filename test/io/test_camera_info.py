"""Calibration messages of raw pairs: what they rectify, in each window of the sensor, and what is refused."""

import math
import re
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from raw_cameras import HEIGHT, WIDTH, calibrations, lens, pair, texture

from lrtrav_ros.io.camera_info import check_calibration, is_distorted, raw_pair_of, unseen_of
from lrtrav_ros.rectification import Rectification


def infos(raw, *, binning=1, roi=(0, 0, 0, 0), **changed):
    """Return the CameraInfo of both cameras; `roi` is left, top, width and height."""
    region = SimpleNamespace(**dict(zip(("x_offset", "y_offset", "width", "height"), roi, strict=True)))
    header = SimpleNamespace(frame_id="camera")
    window = {"header": header, "binning_x": binning, "binning_y": binning, "roi": region}
    return [SimpleNamespace(**{**window, **fields, **changed}) for fields in calibrations(raw)]


def difference(image, other):
    """Return the greatest difference of grey levels where both show something."""
    # Beside what no raw pixel shows, pixels are half black.
    shown = [np.pad(each, 3) for each in (image, other)]
    both = np.logical_and(*[cv2.erode(each, np.ones((7, 7)))[3:-3, 3:-3] > 0 for each in shown])
    assert both.mean() > 0.8
    return np.abs(image.astype(int) - other)[both].max()


@pytest.mark.parametrize("model", ["plumb_bob of 5", "rational_polynomial of 8", "equidistant"])
def test_camera_info_is_the_calibration(model):
    raw = pair(model)
    assert raw_pair_of(*infos(raw)) == raw


@pytest.mark.parametrize("model", ["plumb_bob of 5", "rational_polynomial of 8", "equidistant"])
def test_a_region_of_interest_is_the_same_part_of_both(model):
    raw, image = pair(model), texture(channels=1)
    left, top, width, height = 40, 24, 200, 120
    whole = Rectification(raw).rectify(image, image)
    part = image[top : top + height, left : left + width]
    of_part = raw_pair_of(*infos(raw, roi=(left, top, width, height)))
    for one, other in zip(Rectification(of_part).rectify(part, part), whole, strict=True):
        assert one.shape == (height, width)
        assert difference(one, other[top : top + height, left : left + width]) <= 1


@pytest.mark.parametrize("model", ["plumb_bob of 5", "equidistant"])
def test_binned_images_are_rectified_as_every_second_pixel(model):
    raw, image = pair(model), cv2.GaussianBlur(texture(channels=1), (0, 0), 4)
    whole = Rectification(raw).rectify(image, image)
    binned = np.ascontiguousarray(image[::2, ::2])
    of_binned = raw_pair_of(*infos(raw, binning=2))
    assert (of_binned.camera.width, of_binned.camera.height) == (WIDTH // 2, HEIGHT // 2)
    assert of_binned.camera.baseline_m == pytest.approx(raw.camera.baseline_m)
    for one, other in zip(Rectification(of_binned).rectify(binned, binned), whole, strict=True):
        assert difference(one, np.ascontiguousarray(other[::2, ::2])) <= 4


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"distortion_model": "fov"},
            "CameraInfo of 'camera' cannot rectify: distortion model 'fov' is not supported; give",
        ),
        ({"k": np.zeros(9)}, r"CameraInfo of 'camera' cannot rectify: fx is 0.0; give a positive number"),
        ({"d": np.zeros(3)}, "distortion has 3 coefficients"),
        ({"r": np.zeros(9)}, "CameraInfo of 'camera' cannot rectify: R is .* give a rotation matrix"),
        ({"p": np.zeros(12)}, r"P\[0\] = 0 and P\[3\] = 0, thus no baseline"),
        ({"width": 0, "height": 0}, "has no size; let the driver fill in width and height"),
    ],
)
def test_a_camera_that_is_not_calibrated_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        raw_pair_of(*infos(pair(), **changed))


@pytest.mark.parametrize(
    "window", [{"roi": (200, 0, WIDTH - 100, HEIGHT)}, {"roi": (0, 1, WIDTH - 1, HEIGHT)}, {"binning": 100_000}]
)
def test_a_window_that_is_not_on_the_sensor_is_refused(window):
    with pytest.raises(ValueError, match=f"'camera' has a sensor of {WIDTH} x {HEIGHT} pixels, of which images show"):
        raw_pair_of(*infos(pair(), **window))


@pytest.mark.parametrize("model", ["none", "plumb_bob of 5", "equidistant"])
def test_unseen_pixels_are_those_of_the_left_rectified_image(model):
    raw = pair(model)
    expected = Rectification(raw).unseen
    np.testing.assert_array_equal(unseen_of(infos(raw)[0], (HEIGHT, WIDTH, 3)), expected)


def test_unseen_pixels_of_another_size_are_not_sought():
    with pytest.raises(ValueError, match=f"for {WIDTH} x {HEIGHT} pixels, but the image is {WIDTH} x {HEIGHT - 1}"):
        unseen_of(infos(pair())[0], (HEIGHT - 1, WIDTH))


def test_cameras_of_different_windows_are_refused():
    left, _ = infos(pair())
    _, right = infos(pair(), roi=(0, 0, 100, 100))
    with pytest.raises(ValueError, match="the right one for 100 x 100 pixels"):
        raw_pair_of(left, right)


def test_distortion_is_told_from_none():
    assert is_distorted(infos(pair())[0])
    assert not is_distorted(infos(pair("none"))[0])
    assert not is_distorted(infos(pair(), d=np.zeros(5))[0])
    assert lens("none").distortion == ()


P = [300.0, 0.0, 160.0, 0.0, 0.0, 300.0, 120.0, 0.0, 0.0, 0.0, 1.0, 0.0]


def rectified_info(**changed):
    """Return a CameraInfo of 320 x 240 pixels, with some elements of P changed: ``p3`` is the fourth."""
    p = [changed.get(f"p{i}", value) for i, value in enumerate(P)]
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    header = SimpleNamespace(frame_id="camera")
    return SimpleNamespace(header=header, width=320, height=240, p=p, roi=roi, binning_x=0, binning_y=0)


@pytest.mark.parametrize(
    ("changed", "options", "message"),
    [
        ({"p0": 0.0}, {}, "fx is 0.0"),
        ({"p5": math.nan}, {}, "fy is nan"),
        ({"p6": -5e8}, {}, "cy is -500000000.0"),
        ({"p5": 0.0}, {"has_focal_length": False}, "is not calibrated"),
        ({"p3": 0.0}, {"is_right": True}, "P[3] = 0, thus no baseline"),
        ({"p3": -5e8}, {"is_right": True}, "baseline_m is 1666666.6"),
    ],
)
def test_a_calibration_is_checked_on_its_own(changed, options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        check_calibration(rectified_info(**changed), **options)


def test_calibrations_that_pass():
    check_calibration(rectified_info())
    check_calibration(rectified_info(p0=0.0), has_focal_length=False)  # a disparity image brings its own
    check_calibration(rectified_info(p3=-30.0, p5=0.0), is_right=True)  # of which the baseline alone is used
    for raw in infos(pair("equidistant")):
        check_calibration(raw, is_raw=True, is_right=float(raw.p[3]) < 0)


@pytest.mark.parametrize("changed", [{"distortion_model": "fov"}, {"r": [0.0] * 9}])
def test_a_raw_calibration_that_cannot_rectify_does_not_pass(changed):
    with pytest.raises(ValueError, match="cannot rectify"):
        check_calibration(infos(pair("equidistant"), **changed)[0], is_raw=True)
