"""Synthetic sequences: that their truth is exact, that the images agree with it, and that a seed makes all of it."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from lrtrav_ros.synthetic.rendering import render_sequence
from lrtrav_ros.synthetic.scene_config import STYLES, SceneConfig

SMALL = SceneConfig(seed=5, width=160, height=120, n_frames=2, n_obstacles=60)
LEVEL = dataclasses.replace(SMALL, undulation_m=0.0, sway_deg=0.0, n_frames=1)


def first_frame(config):
    return next(iter(render_sequence(config)))


def plane_disparity(config):
    """Disparity of a flat ground, from the camera's height, pitch and roll."""
    camera = config.camera
    v, u = np.mgrid[0 : config.height, 0 : config.width]
    a, b = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fx
    p, r = math.radians(config.pitch_deg), math.radians(config.roll_deg)
    falling = a * math.sin(r) * math.cos(p) + b * math.cos(r) * math.cos(p) + math.sin(p)
    return np.maximum(camera.fx * camera.baseline_m / config.camera_height_m * falling, 0)


def images(frames):
    return [(item.frame.left.tobytes(), item.frame.right.tobytes(), item.truth.tobytes()) for item in frames]


def test_same_settings_give_same_images_on_any_number_of_threads():
    assert images(render_sequence(SMALL, n_threads=1)) == images(render_sequence(SMALL, n_threads=3))


def test_seeds_give_different_scenes_and_frames_differ():
    frames = list(render_sequence(SMALL))
    other = first_frame(dataclasses.replace(SMALL, seed=6))
    assert (frames[0].frame.left != other.frame.left).mean() > 0.9
    assert (frames[0].disparity != frames[1].disparity).mean() > 0.4


def test_frames_have_the_asked_size_types_and_times():
    frames = list(render_sequence(dataclasses.replace(SMALL, rate_hz=4.0)))
    assert len(frames) == 2
    assert frames[1].frame.stamp_ns - frames[0].frame.stamp_ns == 250_000_000
    for item in frames:
        assert item.frame.left.shape == item.frame.right.shape == (120, 160, 3)
        assert item.frame.left.dtype == item.frame.right.dtype == item.truth.dtype == np.uint8
        assert item.disparity.shape == item.truth.shape == (120, 160)
        assert item.disparity.dtype == np.float32
        assert item.frame.name == str(item.frame.stamp_ns)
        assert item.frame.camera == SMALL.camera


def test_flat_ground_is_a_line_in_v_disparity():
    config = dataclasses.replace(LEVEL, n_obstacles=0, pitch_deg=10.0)
    disparity = first_frame(config).disparity
    slope = config.baseline_m / config.camera_height_m * math.cos(math.radians(10))
    horizon = config.camera.cy - config.camera.fx * math.tan(math.radians(10))
    rows = np.arange(math.ceil(horizon), 120)
    np.testing.assert_allclose(disparity[rows], np.repeat(slope * (rows - horizon)[:, None], 160, axis=1), atol=1e-3)
    assert not disparity[: math.floor(horizon)].any()


@pytest.mark.parametrize(("pitch", "roll"), [(0.0, 0.0), (12.0, -7.0), (-3.0, 20.0)])
def test_pitch_and_roll_tilt_ground_and_horizon(pitch, roll):
    config = dataclasses.replace(LEVEL, n_obstacles=0, pitch_deg=pitch, roll_deg=roll)
    item = first_frame(config)
    expected = plane_disparity(config)
    np.testing.assert_allclose(item.disparity, expected, atol=1e-3)
    assert (item.truth[expected > 0] != 0).all()
    assert (item.truth[expected == 0] != 255).all()


def test_truth_is_the_ground_without_what_stands_on_it():
    item = first_frame(LEVEL)
    ground = np.abs(item.disparity - plane_disparity(LEVEL)) < 1e-3
    ground &= item.disparity > 0
    decided = item.truth != 128
    assert 0.3 < ground.mean() < 0.7
    assert (~ground & (item.disparity > 0)).mean() > 0.02
    assert (item.truth[decided] == np.where(ground, 255, 0)[decided]).mean() > 0.9999
    grown = cv2.dilate(ground.astype(np.uint8), np.ones((3, 3))) != cv2.erode(ground.astype(np.uint8), np.ones((3, 3)))
    assert (grown == ~decided).mean() > 0.999


@pytest.mark.parametrize("style", STYLES)
def test_images_agree_with_the_exact_disparity(style):
    config = SceneConfig(seed=2, style=style, width=320, height=240, n_frames=1, noise=0.0, exposure_difference=0.0)
    item = first_frame(config)
    v, u = np.mgrid[0:240, 0:320].astype(np.float32)

    def error(shift):
        warped = cv2.remap(item.frame.right, u - item.disparity - np.float32(shift), v, cv2.INTER_CUBIC)
        inside = (u - item.disparity > 2) & (u > 20) & (item.disparity > 2) & (item.truth == 255)
        return np.abs(warped.astype(float) - item.frame.left)[inside].mean()

    exact = error(0)
    assert exact < 4
    assert exact < 0.5 * min(error(-1), error(1))
    assert exact < min(error(-0.25), error(0.25))


def test_a_stereo_matcher_finds_the_exact_disparity():
    item = first_frame(SceneConfig(seed=2, width=320, height=240, n_frames=1))
    left, right = (cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (item.frame.left, item.frame.right))
    matched = cv2.StereoSGBM_create(0, 32, 5, 200, 800, 1, 0, 10).compute(left, right) / 16.0
    ground = (item.truth == 255) & (item.disparity > 2)
    ground[:, :40] = False
    found = ground & (matched > 0)
    assert found.sum() > 0.9 * ground.sum()
    assert (np.abs(matched - item.disparity)[found] > 1).mean() < 0.03


def test_right_image_is_brighter_by_the_exposure_difference():
    config = dataclasses.replace(SMALL, baseline_m=0.001, noise=0.0, exposure_difference=0.3)
    item = first_frame(config)
    medium = (item.frame.left > 60) & (item.frame.left < 180)
    assert np.median(item.frame.right[medium] / item.frame.left[medium]) == pytest.approx(1.3, abs=0.02)


def test_noise_grows_with_brightness():
    clean, noisy = (first_frame(dataclasses.replace(SMALL, noise=n)).frame.left.astype(float) for n in (0.0, 6.0))
    for low, high in ((30, 70), (130, 180)):
        chosen = (clean > low) & (clean < high)
        level = clean[chosen].mean()
        assert (noisy - clean)[chosen].std() == pytest.approx(6 * math.sqrt(0.3 + 0.7 / 128 * level), rel=0.06)


def test_shadows_only_darken():
    config = dataclasses.replace(SMALL, noise=0.0)
    with_shadows, without = (
        first_frame(dataclasses.replace(config, shadows=s)).frame.left.astype(int) for s in (True, False)
    )
    assert (with_shadows <= without).all()
    assert 0.005 < (with_shadows < without - 20).mean() < 0.5


def test_threads_must_be_positive():
    with pytest.raises(ValueError, match="n_threads is 0"):
        next(iter(render_sequence(SMALL, n_threads=0)))
