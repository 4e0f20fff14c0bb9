"""Landscapes: what a seed and a style put into a scene."""

import dataclasses

import numpy as np
import pytest

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
