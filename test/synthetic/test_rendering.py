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


@pytest.mark.parametrize(
    "light",
    [
        {"sun_hardness": 0.0},
        {"sun_hardness": 0.5},
        {"sun_elevation_deg": 12.0},
        {"dapple": 0.6},
        {"exposure": 1.5},
        {"sun_elevation_deg": 90.0, "dapple": 1.0},
    ],
)
def test_light_changes_the_image_and_nothing_that_is_true(light):
    lit, plain = first_frame(dataclasses.replace(SMALL, **light)), first_frame(SMALL)
    for name in ("disparity", "truth", "height_m"):
        np.testing.assert_array_equal(getattr(lit, name), getattr(plain, name))
    assert (lit.frame.left != plain.frame.left).mean() > 0.2


def test_flat_light_casts_no_shadows():
    config = dataclasses.replace(SMALL, noise=0.0, sun_hardness=0.0)
    with_shadows, without = (first_frame(dataclasses.replace(config, shadows=s)).frame.left for s in (True, False))
    np.testing.assert_array_equal(with_shadows, without)
    ground = first_frame(SMALL).truth == 255
    sunny = first_frame(dataclasses.replace(SMALL, noise=0.0, shadows=False)).frame.left
    assert np.median(with_shadows[ground]) == pytest.approx(np.median(sunny[ground]), abs=3)


def test_a_lower_sun_casts_longer_shadows():
    def shaded(elevation):
        config = dataclasses.replace(SMALL, style="road", noise=0.0, sun_elevation_deg=elevation)
        with_shadows, without = (
            first_frame(dataclasses.replace(config, shadows=s)).frame.left.astype(int) for s in (True, False)
        )
        return (with_shadows < without - 10)[first_frame(config).truth == 255].mean()

    assert shaded(12.0) > 1.5 * shaded(55.0) > 0


def test_dapple_is_dark_for_metres_with_sharp_edges():
    config = dataclasses.replace(SMALL, seed=31, style="road", width=320, height=240, noise=0.0, shadows=False)
    plain, dappled = (first_frame(dataclasses.replace(config, dapple=d)) for d in (0.0, 0.6))
    ground = (plain.truth == 255) & (plain.disparity > 3)
    share = dappled.frame.left.astype(float).mean(axis=2) / plain.frame.left.astype(float).mean(axis=2)
    dark, sunny = share[ground] < 0.7, share[ground] > 0.95
    assert 0.15 < dark.mean() < 0.85
    assert sunny.mean() > 0.1
    assert dark.mean() + sunny.mean() > 0.85  # little between: edges are sharp


def test_overexposure_doubles_the_light_with_each_stop_and_clips():
    plain, over = (
        first_frame(dataclasses.replace(SMALL, seed=31, style="park", noise=0.0, exposure=e)) for e in (0.0, 1.0)
    )
    ground = plain.truth == 255
    before, after = plain.frame.left[ground].astype(float), over.frame.left[ground].astype(float)
    medium = (before > 60) & (before < 150)
    assert np.median(after[medium] / before[medium]) == pytest.approx(2 ** (1 / 2.2), abs=0.02)
    white = first_frame(dataclasses.replace(SMALL, seed=31, style="park", noise=0.0, exposure=1.5)).frame.left
    assert (white[ground] == 255).any(axis=1).mean() > 0.3
    assert not (plain.frame.left[ground] == 255).any()


def test_heights_are_those_of_what_stands_on_the_ground():
    item = first_frame(LEVEL)
    expected = plane_disparity(LEVEL)
    assert item.height_m.dtype == np.float32
    assert not item.height_m[(item.truth == 255) | (item.disparity == 0)].any()
    # Over flat ground, a point's height is the camera's height less what its ray has fallen at its depth.
    solid = (item.truth == 0) & (item.disparity > 0)
    depth_m = SMALL.camera.fx * SMALL.baseline_m / item.disparity[solid]
    camera, pitch = LEVEL.camera, math.radians(LEVEL.pitch_deg)
    v = np.mgrid[0:120, 0:160][0][solid]
    height = LEVEL.camera_height_m - depth_m * ((v - camera.cy) / camera.fx * math.cos(pitch) + math.sin(pitch))
    np.testing.assert_allclose(item.height_m[solid], height, atol=1e-3)
    assert item.height_m.max() > 2
    assert (expected[solid] < item.disparity[solid] + 1e-3).all()


@pytest.mark.parametrize(("drops", "share"), [("ditch", 0.005), ("step", 0.02), ("platform", 0.02)])
def test_what_lies_below_a_drop_is_not_traversable(drops, share):
    config = dataclasses.replace(LEVEL, n_obstacles=0, width=320, height=240, drops=drops)
    item, plain = first_frame(config), plane_disparity(config)
    lower = (plain > item.disparity + 1e-3) & (plain > 0)
    assert lower.mean() > share
    assert not (item.truth[lower] == 255).any()
    level = (plain > 0) & ~lower
    assert not (item.truth[level] == 0).any()
    assert not item.height_m.any()
    boundary = cv2.morphologyEx(level.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
    assert ((item.truth == 128) == boundary).mean() > 0.9998


@pytest.mark.parametrize("drops", ["ditch", "step", "platform"])
def test_images_agree_with_the_disparity_of_drops(drops):
    config = SceneConfig(
        seed=2, width=320, height=240, n_frames=1, noise=0.0, exposure_difference=0.0, drops=drops, n_obstacles=0
    )
    item = first_frame(config)
    v, u = np.mgrid[0:240, 0:320].astype(np.float32)
    chosen = (item.truth == 0) & (item.disparity > 1) & (u > 20)
    assert chosen.sum() > 300

    def error(shift):
        warped = cv2.remap(item.frame.right, u - item.disparity - np.float32(shift), v, cv2.INTER_CUBIC)
        return np.abs(warped.astype(float) - item.frame.left)[chosen].mean()

    assert error(0) < min(error(-1), error(1), 6)


def test_small_things_are_obstacles_of_their_height():
    config = dataclasses.replace(LEVEL, style="road", n_obstacles=0, n_small_things=8, width=320, height=240)
    item = first_frame(config)
    things = (item.truth == 0) & (item.disparity > 0)
    assert 0.001 < things.mean() < 0.05
    assert 0.1 < item.height_m.max() < 0.3


def test_threads_must_be_positive():
    with pytest.raises(ValueError, match="n_threads is 0"):
        next(iter(render_sequence(SMALL, n_threads=0)))
