"""Ray casting with scenes and cameras that cannot be."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.synthetic import raycasting
from lrtrav_ros.synthetic.raycasting import BOX, GROUND, PIT, SKY, SOLID, Bins, RenderedView, Scene, View

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
        canopy=np.array([8.0, 0.6, 0.5]),
        pits=np.array([[0.0, 200.0, 1.0, 1.0, 1.0, 0.0, 0.5, 2.0, -1.0]]),
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


def with_pits(*pits: list[float], waves: NDArray[np.float64] | None = None) -> Scene:
    """Return a scene with nothing but ground and pits, in clear air without crowns."""
    return raycasting.with_shadows(
        scene()._replace(
            pits=np.array(pits).reshape(-1, 9),
            waves=np.zeros((1, 4)) if waves is None else waves,
            solids=np.zeros((0, 10)),
            weather=np.array([0.5, 0.05, 1e9]),
            canopy=np.zeros(3),
        )
    )


def world_points(picture: RenderedView, camera: View) -> NDArray[np.float64]:
    """Return what each pixel shows, (H, W, 3), from its depth."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = np.stack(((u - camera.cx) / camera.focal_px, (v - camera.cy) / camera.focal_px, np.ones(v.shape)), axis=-1)
    return camera.origin + picture.depth_m[..., None] * (rays @ camera.rotation.T)


def lowered(places: NDArray[np.float64], scene: Scene, margin_m: float = 0.0) -> NDArray[np.float64]:
    """Return the height of the ground with its pits, made smaller by a margin, at places (..., 2)."""
    height = np.zeros(places.shape[:-1])
    for a, b, phase, amplitude in scene.waves:
        height += amplitude * np.sin(a * places[..., 0] + b * places[..., 1] + phase)
    for x, y, half_x, half_y, cos, sin, depth, _, _ in scene.pits:
        a, b = places[..., 0] - x, places[..., 1] - y
        inside = (abs(cos * a + sin * b) < half_x - margin_m) & (abs(cos * b - sin * a) < half_y - margin_m)
        height -= depth * inside
    return height


def replaced(name: str, array: NDArray[Any] | None) -> Scene:
    return scene()._replace(**{name: array})


def test_depth_of_box_and_ground() -> None:
    picture = cast(scene(), view())
    assert picture.surface[8, 11] == SOLID
    assert picture.depth_m[8, 11] == pytest.approx(3.5)
    assert picture.depth_m[15, 0] == pytest.approx(20 / 7.5)
    assert (picture.surface[:7] == SKY).all()
    assert np.isfinite(picture.colour).all()


def test_height_is_that_of_a_solid_over_the_ground_or_the_pit_below() -> None:
    picture = cast(scene(), view())
    assert picture.height_m[8, 11] == pytest.approx(1 - 3.5 * 0.5 / 20)
    assert not picture.height_m[picture.surface != SOLID].any()
    in_pit = cast(scene()._replace(pits=np.array([[0.0, 4.0, 3.0, 2.0, 1.0, 0.0, 0.4, 2.0, 2.0]])), view())
    assert in_pit.height_m[8, 11] == pytest.approx(1.4 - 3.5 * 0.5 / 20)
    waves = np.array([[0.0, 0.7, 0.4, 0.1]])
    on_waves = cast(scene()._replace(waves=waves), view())
    ground = 0.1 * np.sin(0.7 * 3.5 + 0.4)
    assert on_waves.height_m[8, 11] == pytest.approx(1 - 3.5 * 0.5 / 20 - ground)


def test_depth_of_a_ditch() -> None:
    """A ditch from 2 to 5 m ahead, 0.5 m deep: its bottom from row 14 up, its far wall, and ground behind."""
    picture = cast(with_pits([0.0, 3.5, 50.0, 1.5, 1.0, 0.0, 0.5, 2.0, 2.0]), view())
    rows = (np.arange(8, 16) - 7.5) / 20
    expected = np.where(1 / rows > 5, 1 / rows, np.minimum(1.5 / rows, 5))
    np.testing.assert_allclose(picture.depth_m[8:, 11], expected)
    assert picture.surface[8:, 11].tolist() == [GROUND] * 4 + [PIT] * 4
    assert [round(depth, 2) for depth in expected] == [40.0, 13.33, 8.0, 5.71, 5.0, 5.0, 4.62, 4.0]


@pytest.mark.parametrize("height", [0.4, 1.0, 4.0])
def test_rays_end_where_they_first_meet_the_ground_with_its_pits(height: float) -> None:
    cos, sin = np.cos(0.4), np.sin(0.4)
    pits = [
        [0.3, 4.0, 2.0, 0.4, cos, sin, 0.6, 2.0, 2.0],
        [-1.5, 8.0, 0.3, 3.0, cos, -sin, 0.4, 2.0, -1.0],
        [1e6 * sin, 12.0 + 1e6 * cos, 1e6, 1e6, cos, -sin, 1.2, 2.0, 1.0],
    ]
    world = with_pits(*pits, waves=np.array([[0.3, 0.6, 0.2, 0.1], [-0.2, 0.25, 1.0, 0.06]]))
    camera = view()._replace(origin=np.array([0.0, 0.0, height]), focal_px=60.0, cx=39.5, cy=8.5, width=80, height=60)
    picture = cast(world, camera)
    points = world_points(picture, camera)
    near = (picture.depth_m > 0) & (picture.depth_m < 60)
    assert (picture.surface[near] == PIT).mean() > 0.01

    level, floor = (lowered(points[..., :2], world._replace(pits=pits)) for pits in (world.pits[:0], world.pits))
    ground = near & (picture.surface == GROUND)
    np.testing.assert_allclose(points[ground, 2], floor[ground], atol=1e-5)
    np.testing.assert_allclose(floor[ground], level[ground])
    shrunk = lowered(points[..., :2], world, 1e-6)
    bottom = near & (picture.surface == PIT) & (abs(points[..., 2] - floor) < 1e-5)
    wall = near & (picture.surface == PIT) & ~bottom
    assert bottom.sum() >= 10
    assert wall.sum() >= 10
    grown = lowered(points[..., :2], world, -1e-6)
    assert (shrunk[wall] != grown[wall]).all()  # on the edge of a pit
    assert ((points[wall, 2] < level[wall]) & (points[wall, 2] > grown[wall])).all()

    for share in np.linspace(0.01, 0.999, 300):
        before = camera.origin + share * (points[near] - camera.origin)
        assert (before[:, 2] > lowered(before[:, :2], world, 1e-6) - 1e-5).all()


def test_the_rim_of_a_pit_hides_sun_and_sky() -> None:
    """The sun stands behind the camera at 53 degrees: a pit 1 m deep is in the shade up to 0.75 m beyond its rim."""
    edge = [0.0, 1e6 + 4.0, 1e6, 1e6, 1.0, 0.0, 1.0, 2.0, 2.0]
    camera = view()._replace(origin=np.array([0.0, 0.0, 10.0]), height=100, focal_px=30.0)
    picture = cast(with_pits(edge), camera)
    y = 11 * 30.0 / (np.arange(100) - 7.5)
    in_pit = picture.surface[:, 11] == PIT
    shaded, sunny = (picture.colour[in_pit & chosen, 11, 0] for chosen in (y < 4.7, (y > 4.8) & (y < 20)))
    assert shaded.size >= 1
    assert sunny.size >= 5
    np.testing.assert_allclose(sunny, sunny[0], rtol=1e-3)
    np.testing.assert_allclose(shaded, sunny[0] / 1.8, rtol=1e-3)  # 1 of the sky, and of the sun 0.8

    ditch = [0.0, 4.0, 50.0, 0.25, 1.0, 0.0, 1.0, 2.0, 2.0]
    picture = cast(with_pits(ditch), camera)
    below = -world_points(picture, camera)[..., 2]
    wall = (picture.surface == PIT) & (below > 0.7) & (below < 0.99)  # above 0.67 m the sun reaches it
    assert wall.sum() >= 10
    dim = 0.6 * 0.25 / (0.25 + below[wall])  # a wall faces 0.6 of the sky; the ditch leaves a share of it
    np.testing.assert_allclose(picture.colour[wall][:, 0], dim * shaded[0], rtol=0.02)


def test_crowns_shade_the_asked_share_of_places() -> None:
    x, y = np.meshgrid(np.arange(-6, 6, 0.25), np.arange(0, 40, 0.25))
    places = np.stack((x.ravel(), y.ravel()), axis=1)
    noise = np.random.default_rng(2).random((256, 256), np.float32)
    bare = with_pits()._replace(noise=noise)
    # From above: a pixel every 0.25 m of the ground between 0 and 40 m.
    down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    camera = View(np.array([-6.0, 0.0, 40.0]), down, 160.0, 0.0, 159.0, 48, 160)
    plain = cast(bare, camera).colour[..., 0]
    for share in (0.0, 0.3, 0.8):
        crowned = raycasting.with_canopy(bare, places, share, height_m=8.0, sky_share=0.5)
        assert crowned.canopy[[0, 2]].tolist() == [8.0, 0.5]
        dimmed = cast(crowned, camera).colour[..., 0] / plain
        assert (dimmed < 0.999).mean() == pytest.approx(share, abs=0.02)
        assert dimmed.max() <= 1
        if share:
            assert dimmed.min() == pytest.approx(0.5 / 1.8, abs=0.01)  # half the sky's light, none of the sun's
            assert (dimmed < 0.6).mean() > 0.4 * share


def test_canopies_that_cannot_be_are_refused() -> None:
    places = np.zeros((3, 2))
    with pytest.raises(ValueError, match=r"share is 1.5; give 0 to 1"):
        raycasting.with_canopy(scene(), places, 1.5, height_m=8.0, sky_share=0.5)
    with pytest.raises(ValueError, match=r"places is float64 \(3, 3\); give float64 \(n, 2\)"):
        raycasting.with_canopy(scene(), np.zeros((3, 3)), 0.5, height_m=8.0, sky_share=0.5)
    with pytest.raises(ValueError, match=r"sun is .*; give a vector that points up"):
        raycasting.with_canopy(replaced("sun", np.array([0.0, 1.0, 0.0])), places, 0.5, height_m=8.0, sky_share=0.5)


@pytest.mark.parametrize(("column", "material"), [(7, 3.0), (7, -1.0), (8, 3.0)])
def test_pits_of_materials_that_there_are_not(column: int, material: float) -> None:
    pits = scene().pits.copy()
    pits[0, column] = material
    with pytest.raises(ValueError, match=rf"scene.pits\[:, {column}\] holds {material:.0f}; give labels from 0 to 2"):
        cast(replaced("pits", pits), view())


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
    with pytest.raises(ValueError, match=f"scene.{name} holds values .*; give "):
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
    with pytest.raises(ValueError, match="n_parts is 0; give 1 to"):
        cast(scene(), view(), 0)


def test_a_sun_below_the_horizon_is_refused() -> None:
    with pytest.raises(ValueError, match=r"sun is \[0.0, 0.6, -0.8\]; give a vector that points up"):
        raycasting.with_shadows(replaced("sun", np.array([0.0, 0.6, -0.8])))


def test_waves_and_path_of_other_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"waves is float64 \(2, 3\); give float64 \(n, 4\)"):
        raycasting.ground_height(np.zeros((2, 3)), 0.0, 0.0)
    with pytest.raises(ValueError, match=r"path is float64 \(2, 4\); give float64 \(n, 3\)"):
        raycasting.path_middle(np.zeros((2, 4)), 0.0)
