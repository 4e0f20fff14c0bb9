"""Calibration messages of raw pairs: what they rectify, in each window of the sensor, and what is refused."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from raw_cameras import HEIGHT, WIDTH, calibrations, lens, pair, texture

from lrtrav_ros.io.camera_info import is_distorted, raw_pair_of, unseen_of
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
    np.testing.assert_array_equal(unseen_of(infos(raw)[0]), expected)


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
