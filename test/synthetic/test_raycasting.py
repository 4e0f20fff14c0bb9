"""Ray casting with scenes and cameras that cannot be."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.synthetic import raycasting
from lrtrav_ros.synthetic.raycasting import BOX, SKY, SOLID, Bins, RenderedView, Scene, View

ARRAYS = [name for name in Scene._fields if name != "bins"]


def scene() -> Scene:
    """Return a box 4 m ahead on flat ground, in one material, under the sun."""
    solid = [BOX, 0.0, 4.0, 0.5, 0.5, 0.5, 0.5, 1.0, 0.0, 2.0]
    bare = Scene(
        noise=np.full((256, 256), 0.5, np.float32),
        waves=np.zeros((1, 4)),
        path=np.zeros((1, 3)),
        layout=np.array([1.0, -1.0, 0.5, 0.1]),
        solids=np.array([solid]),
        materials=np.tile([0.1, 0.1, 0.1, 0.3, 0.3, 0.3, 0.5, 0.5, 0.0, 0.0], (3, 1)),
        sun=np.array([0.0, -0.6, 0.8]),
        light=np.ones((2, 3)),
        sky=np.full((4, 3), 0.5),
        weather=np.array([0.5, 0.05, 800.0]),
        shadows=np.zeros(4),
        bins=Bins(np.zeros(2, np.int32), np.zeros(0, np.int32), 1, 1),
    )
    return raycasting.with_shadows(bare)


def view() -> View:
    """Return a camera 1 m above the ground that looks ahead."""
    rotation = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return View(np.array([0.0, 0.0, 1.0]), rotation, 20.0, 11.5, 7.5, 24, 16)


def cast(scene: Scene, view: View, n_parts: int = 2) -> RenderedView:
    with ThreadPoolExecutor(1) as executor:
        picture, parts = raycasting.cast(scene, view, executor, n_parts)
        for part in parts:
            part.result()
    return picture


def replaced(name: str, array: NDArray[Any] | None) -> Scene:
    return scene()._replace(**{name: array})


def test_depth_of_box_and_ground() -> None:
    picture = cast(scene(), view())
    assert picture.surface[8, 11] == SOLID
    assert picture.depth_m[8, 11] == pytest.approx(3.5)
    assert picture.depth_m[15, 0] == pytest.approx(20 / 7.5)
    assert (picture.surface[:7] == SKY).all()
    assert np.isfinite(picture.colour).all()


def test_parts_and_memory_layout_do_not_matter() -> None:
    expected = cast(scene(), view())
    flipped = scene()._replace(
        **{name: np.flip(np.flip(getattr(scene(), name)).copy()) for name in ARRAYS},
    )
    for found in (cast(scene(), view(), 1), cast(scene(), view(), 40), cast(flipped, view())):
        for array, same in zip(found, expected, strict=True):
            np.testing.assert_array_equal(array, same)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_of_other_type_or_shape_are_refused(name: str) -> None:
    array = getattr(scene(), name)
    for other in (array.astype(np.float16), array.astype(int), array[None], array.ravel()[:2], array[..., :-1]):
        with pytest.raises(ValueError, match=f"scene.{name} is .*; give float"):
            cast(replaced(name, other), view())
        with pytest.raises(ValueError, match=f"scene.{name} is .*; give float"):
            raycasting.with_shadows(replaced(name, other))
    with pytest.raises(TypeError, match=f"scene.{name} is of type NoneType"):
        cast(replaced(name, None), view())


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(name: str, value: float) -> None:
    array = getattr(scene(), name).copy()
    array.flat[0] = value
    with pytest.raises(ValueError, match=f"scene.{name} holds values that are not finite"):
        cast(replaced(name, array), view())


@pytest.mark.parametrize("material", [-1, 3, 5e7])
def test_solids_of_materials_that_there_are_not(material: float) -> None:
    solids = scene().solids.copy()
    solids[0, 9] = material
    with pytest.raises(ValueError, match=r"scene.solids\[:, 9\] holds .*; give labels from 0 to 2"):
        cast(replaced("solids", solids), view())


def test_ground_has_three_materials() -> None:
    with pytest.raises(ValueError, match="scene has 2 materials; the ground alone needs 3"):
        cast(replaced("materials", scene().materials[:2]), view())


@pytest.mark.parametrize(
    "bins",
    [
        Bins(np.array([0, 9], np.int32), np.array([0], np.int32), 1, 1),
        Bins(np.array([-4, 1], np.int32), np.array([0], np.int32), 1, 1),
        Bins(np.array([0, 1], np.int32), np.array([7], np.int32), 1, 1),
        Bins(np.array([0, 1], np.int32), np.array([-1], np.int32), 1, 1),
        Bins(np.array([0, 1], np.int32), np.array([0], np.int32), 40, 50),
        Bins(np.array([0, 1]), np.array([0], np.int32), 1, 1),
        Bins(np.array([0, 1], np.int32), np.array([0.0]), 1, 1),
        Bins(np.array([0, 1], np.int32), np.array([0], np.int32), 0, 1),
    ],
)
def test_bins_that_do_not_fit_are_refused(bins: Bins) -> None:
    with pytest.raises(ValueError, match=r"scene.bins.\w+ .*; give"):
        cast(scene()._replace(bins=bins), view())


@pytest.mark.parametrize(
    "change",
    [
        {"origin": np.zeros(2)},
        {"origin": np.array([0.0, np.nan, 0.0])},
        {"rotation": np.zeros((3, 2))},
        {"rotation": np.eye(3, dtype=np.float32)},
        {"focal_px": 0.0},
        {"focal_px": np.inf},
        {"cx": np.nan},
        {"width": 0},
        {"height": -3},
    ],
)
def test_cameras_that_cannot_be_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"view.* (is|holds) .*; give"):
        cast(scene(), view()._replace(**change))


def test_there_is_at_least_one_part() -> None:
    with pytest.raises(ValueError, match="n_parts is 0; give at least 1"):
        cast(scene(), view(), 0)


def test_a_sun_below_the_horizon_is_refused() -> None:
    with pytest.raises(ValueError, match=r"sun is \[0.0, 0.6, -0.8\]; give a vector that points up"):
        raycasting.with_shadows(replaced("sun", np.array([0.0, 0.6, -0.8])))


def test_waves_and_path_of_other_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"waves is float64 \(2, 3\); give float64 \(n, 4\)"):
        raycasting.ground_height(np.zeros((2, 3)), 0.0, 0.0)
    with pytest.raises(ValueError, match=r"path is float64 \(2, 4\); give float64 \(n, 3\)"):
        raycasting.path_middle(np.zeros((2, 4)), 0.0)
