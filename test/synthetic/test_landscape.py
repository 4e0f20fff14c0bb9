"""Landscapes: what a seed and a style put into a scene."""

import dataclasses

import numpy as np
import pytest

from lrtrav_ros.synthetic import raycasting
from lrtrav_ros.synthetic.landscape import make_scene
from lrtrav_ros.synthetic.scene_config import STYLES, SceneConfig


def test_seeds_choose_every_style():
    ground = {make_scene(SceneConfig(seed=seed, n_obstacles=0)).materials[0, 6] for seed in range(16)}
    assert len(ground) == 3  # forest and field both have a path of dirt


@pytest.mark.parametrize("style", STYLES)
def test_things_stand_beside_the_path_and_on_the_ground(style):
    config = SceneConfig(seed=7, style=style, n_frames=1, n_obstacles=60)
    scene = make_scene(config)
    assert scene.solids.shape[0] > 60
    assert (scene.solids[:, 4:7] > 0).all()
    assert set(scene.solids[:, 9]) <= set(range(3, len(scene.materials)))
    assert make_scene(dataclasses.replace(config, n_obstacles=0)).solids.shape == (0, 10)
    np.testing.assert_array_equal(scene.solids, make_scene(config).solids)


SUNNY = SceneConfig(seed=7, style="park", n_frames=1, n_obstacles=60)
LIGHTS = {"sun_elevation_deg": 12.0, "sun_hardness": 0.0, "dapple": 0.6, "exposure": 1.5}


def level_light(scene):
    """Light of sun and sky on level ground."""
    return scene.light[0] * scene.sun[2] + scene.light[1]


def test_light_leaves_the_geometry_alone():
    plain = make_scene(SUNNY)
    for field, value in LIGHTS.items():
        scene = make_scene(dataclasses.replace(SUNNY, **{field: value}))
        for name in ("noise", "waves", "path", "layout", "solids", "materials"):
            np.testing.assert_array_equal(getattr(scene, name), getattr(plain, name))


def test_level_ground_is_as_bright_in_any_light():
    plain = make_scene(SUNNY)
    for hardness in (1.0, 0.4, 0.0):
        for elevation in (0.0, 12.0, 80.0):
            changed = dataclasses.replace(SUNNY, sun_hardness=hardness, sun_elevation_deg=elevation)
            scene = make_scene(changed)
            np.testing.assert_allclose(level_light(scene), level_light(plain))
            shade = scene.light[1] / level_light(scene)
            assert (shade == 1).all() if hardness == 0 else (shade < 0.85).all()
    assert make_scene(dataclasses.replace(SUNNY, sun_hardness=0.4)).light[1, 1] > 2 * plain.light[1, 1]
    assert not make_scene(dataclasses.replace(SUNNY, sun_hardness=0.0)).light[0].any()


@pytest.mark.parametrize(("asked", "found"), [(12.0, 12.0), (90.0, 90.0), (0.2, 1.0)])
def test_the_sun_stands_where_it_is_asked_to(asked, found):
    plain, scene = (make_scene(dataclasses.replace(SUNNY, sun_elevation_deg=e)).sun for e in (0.0, asked))
    assert np.degrees(np.arcsin(min(scene[2], 1))) == pytest.approx(found)
    assert 28 < np.degrees(np.arcsin(plain[2])) < 55
    if asked < 90:
        assert np.arctan2(scene[0], scene[1]) == pytest.approx(np.arctan2(plain[0], plain[1]))


def pit_of(config):
    (row,) = make_scene(config).pits
    return row


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("drops", "shallowest", "deepest"), [("step", 0.2, 0.6), ("platform", 1.0, 1.5)])
def test_steps_and_platforms_end_the_ground_ahead_of_the_last_frame(drops, shallowest, deepest, seed):
    config = SceneConfig(seed=seed, drops=drops, n_frames=7, rate_hz=1.0, speed_m_s=2.0, n_obstacles=0)
    x, y, _, half_y, cos, sin, depth, _, _ = pit_of(config)
    path = make_scene(config).path

    def distance(ahead):
        """Return how far the path's middle is from the edge, which lies across the pit's own y axis."""
        return x * -sin + y * cos - half_y - (raycasting.path_middle(path, ahead) * -sin + ahead * cos)

    assert shallowest <= depth <= deepest
    assert min(distance(ahead) for ahead in np.linspace(0, 12, 25)) > 1.5
    assert 2.5 < distance(12.0) < 6.5
    assert distance(18.1) < 0


@pytest.mark.parametrize("seed", range(6))
def test_a_ditch_crosses_the_way_and_others_run_along_it(seed):
    config = SceneConfig(seed=seed, style="road", drops="ditch", n_frames=7, rate_hz=1.0, speed_m_s=2.0, n_obstacles=0)
    scene = make_scene(config)
    across, along = scene.pits[0], scene.pits[1:]
    assert 16 <= across[1] <= 18
    assert scene.layout[0] + 0.5 <= across[2] <= scene.layout[0] + 1.5
    assert len(along) >= 4
    assert 0.3 <= 2 * across[3] <= 1.0
    assert ((along[:, 2] >= 0.15) & (along[:, 2] <= 0.5)).all()
    assert ((scene.pits[:, 6] >= 0.3) & (scene.pits[:, 6] <= 0.8)).all()
    middles = np.array([raycasting.path_middle(scene.path, y) for y in along[:, 1]])
    assert (abs(along[:, 0] - middles) > scene.layout[0]).all()
    corners = np.stack([along[:, 1] - along[:, 3], along[:, 1] + along[:, 3]])
    assert (abs(corners - across[1]).min(axis=0) > 1.0).all()


def test_nothing_hangs_over_a_drop():
    config = SceneConfig(seed=4, style="park", drops="platform", n_frames=1, n_obstacles=150)
    scene, before = make_scene(config), make_scene(dataclasses.replace(config, drops="none"))
    x, y, _, half_y, cos, sin, depth, _, _ = pit_of(config)
    inside = half_y - abs(cos * (scene.solids[:, 2] - y) - sin * (scene.solids[:, 1] - x))
    level = {(*row[:3], *row[4:]): row[3] for row in before.solids}
    fallen = np.array([level[(*row[:3], *row[4:])] - row[3] for row in scene.solids])
    low = scene.solids[:, 3] - scene.solids[:, 6] < 0.5 - depth * (inside > 0)
    assert 0.5 * len(before.solids) < len(scene.solids) < len(before.solids)
    assert 0.1 < (inside > 0).mean() < 1
    np.testing.assert_allclose(fallen[low], np.where(inside > 0, depth, 0)[low], atol=1e-9)
    assert (abs(inside[low]) > np.hypot(scene.solids[low, 4], scene.solids[low, 5])).mean() > 0.99


def test_small_things_stand_on_the_path_ahead_of_each_frame():
    config = SceneConfig(seed=3, style="road", n_frames=6, rate_hz=2.0, n_small_things=12, n_obstacles=0)
    scene = make_scene(config)
    assert len(scene.solids) == 12
    sizes = 2 * scene.solids[:, 4:7]
    bricks = scene.solids[:, 0] == raycasting.BOX
    assert 0 < bricks.sum() < 12
    np.testing.assert_allclose(np.sort(sizes[bricks], axis=1), np.tile((0.1, 0.1, 0.2), (bricks.sum(), 1)))
    assert (sizes[~bricks].max(axis=1) <= 0.3).all()
    middles = np.array([raycasting.path_middle(scene.path, y) for y in scene.solids[:, 2]])
    assert (abs(scene.solids[:, 1] - middles) < 0.8 * scene.layout[0]).all()
    for camera_y in np.arange(6) * 1.25:
        ahead = scene.solids[:, 2] - camera_y
        assert ((ahead > 2) & (ahead < 5)).sum() >= 1
    ground = [raycasting.ground_height(scene.waves, x, y) for x, y in scene.solids[:, 1:3]]
    np.testing.assert_allclose(scene.solids[:, 3] - scene.solids[:, 6], np.subtract(ground, 0.01))


def test_drops_and_small_things_leave_all_else_where_it_was():
    config = SceneConfig(seed=5, n_frames=2, n_obstacles=60)
    plain = make_scene(config)
    changed = make_scene(dataclasses.replace(config, n_small_things=5, drops="step"))
    for name in ("noise", "waves", "path", "layout", "materials", "sun", "light", "weather"):
        np.testing.assert_array_equal(getattr(changed, name), getattr(plain, name))
    with_small = make_scene(dataclasses.replace(config, n_small_things=5))
    np.testing.assert_array_equal(with_small.solids[: len(plain.solids)], plain.solids)
    assert len(with_small.solids) == len(plain.solids) + 5
