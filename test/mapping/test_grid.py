"""The ground ahead as a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from sample_ground import CAMERA, HEIGHT, WIDTH, Box, Scene, line_of

from lrtrav_ros.config import MapsConfig
from lrtrav_ros.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid, ground_grid
from lrtrav_ros.method.ground import GROUND, OBSTACLE, GroundLine, back_project

CELL = 0.1
POSES = [{"height_m": 0.8}, {"height_m": 0.8, "pitch_deg": 15.0}, {"height_m": 1.1, "pitch_deg": 8.0, "roll_deg": -7.0}]
BOXES = (Box((3.0, 3.5), (0.4, 1.2), (0.0, 0.6)), Box((6.0, 7.0), (-2.5, -0.5), (0.0, 1.7)))
NO_OCCUPANCY = 255


@dataclass
class Near:
    """What the short range knows."""

    occupancy: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    line: GroundLine | None


def grid_of(scene: Scene, config: MapsConfig | None = None, occupancy: NDArray[np.uint8] | None = None) -> Grid:
    """Return the grid of a scene in which all is known."""
    seen = scene.occupancy() if occupancy is None else occupancy
    return ground_grid(seen, Near(seen, scene.disparity(), scene.line), CAMERA, config)


def middles(grid: Grid) -> NDArray[np.float64]:
    """Return x, y and 0 of the middles of the cells, (n_y, n_x, 3)."""
    n_y, n_x = grid.cells.shape
    y, x = np.mgrid[:n_y, :n_x] + 0.5
    x, y = x * grid.resolution_m + grid.origin_m[0], y * grid.resolution_m + grid.origin_m[1]
    return np.stack([x, y, np.zeros(x.shape)], axis=-1)


def value_at(grid: Grid, x: float, y: float) -> int:
    """Return the cell at a place."""
    row, column = math.floor((y - grid.origin_m[1]) / CELL), math.floor((x - grid.origin_m[0]) / CELL)
    return int(grid.cells[row, column])


@pytest.mark.parametrize("pose", POSES)
def test_obstacles_are_where_they_stand_and_hide_what_is_behind_them(pose: dict[str, float]) -> None:
    grid = grid_of(Scene(line_of(**pose), BOXES))
    places = middles(grid)
    distances = np.stack([box.distance(places) for box in BOXES])
    occupied, free = grid.cells == OCCUPIED, grid.cells == FREE
    assert distances.min(axis=0)[occupied].max() < 1.5 * CELL
    assert distances.min(axis=0)[free].min() > 0
    for box, count in zip(BOXES, (8, 18), strict=True):
        front = occupied & (np.abs(places[..., 0] - box.ahead[0]) < 1.5 * CELL) & (box.distance(places) < 1.5 * CELL)
        assert np.unique(np.nonzero(front)[0]).size >= count  # no gaps
    assert value_at(grid, 4.5, 1.2) == UNKNOWN  # behind the first
    assert value_at(grid, 2.8, 0.8) == value_at(grid, 4.5, 0.0) == value_at(grid, 5.7, -1.5) == FREE


@pytest.mark.parametrize("pose", POSES)
def test_free_is_what_is_seen_up_to_where_rows_are_too_long(pose: dict[str, float]) -> None:
    scene = Scene(line_of(**pose))
    grid = grid_of(scene, MapsConfig(length_m=15.0, width_m=8.0))
    assert not np.any(grid.cells == OCCUPIED)
    places = middles(grid)
    camera = scene.frame.to_camera(places)
    u = CAMERA.cx + CAMERA.fx * camera[..., 0] / camera[..., 2]
    v = CAMERA.cy + CAMERA.fy * camera[..., 1] / camera[..., 2]
    row_m = np.hypot(places[..., 0], scene.frame.height_m) ** 2 / (CAMERA.fy * scene.frame.height_m)
    margin = 0.6 * CELL * CAMERA.fx / camera[..., 2] + 2
    is_seen = (margin < u) & (u < WIDTH - margin) & (v < HEIGHT - 3 * margin) & (row_m < 0.4)
    assert is_seen.sum() > 1000
    assert np.all(grid.cells[is_seen] == FREE)
    is_unseen = (u < -1) | (u > WIDTH) | (v > HEIGHT) | (row_m > 0.6)
    assert np.all(grid.cells[is_unseen] == UNKNOWN)
    farther = grid_of(scene, MapsConfig(length_m=15.0, width_m=8.0, max_row_m=1.0))
    assert (farther.cells == FREE).sum() > 1.1 * (grid.cells == FREE).sum()


@pytest.mark.parametrize("bend", [12.0, -12.0])
def test_ground_that_bends_is_where_it_is(bend: float) -> None:
    flat = line_of(height_m=0.8, pitch_deg=10.0)
    line = GroundLine(flat.slope, flat.intercept, flat.tilt, bend)
    disparity = line.disparity(HEIGHT, WIDTH)
    occupancy = np.where(disparity > 0, np.uint8(GROUND), np.uint8(OBSTACLE))
    row = 75  # from here up all is a wall, and its distance is known
    wall = float(line.distance_m(row + 0.5, CAMERA))
    occupancy[: row + 1], disparity[: row + 1] = OBSTACLE, 0
    grid = ground_grid(occupancy, Near(occupancy, disparity, line), CAMERA)
    ahead = grid.cells[grid.cells.shape[0] // 2]
    assert np.flatnonzero(ahead == OCCUPIED) * CELL == pytest.approx(wall, abs=1.5 * CELL)
    assert wall - 0.9 < np.flatnonzero(ahead == FREE).max() * CELL < wall  # two rows
    without = float(flat.distance_m(row + 0.5, CAMERA))
    assert abs(without - wall) > 3 * CELL


def test_what_hangs_lower_than_the_clearance_is_occupied_and_hides() -> None:
    beam = Box((4.0, 4.3), (-1.0, 1.0), (1.0, 1.3))
    scene = Scene(line_of(height_m=0.8), (beam,))
    low, high = grid_of(scene), grid_of(scene, MapsConfig(clearance_m=0.9))
    assert value_at(low, 4.1, 0.0) == OCCUPIED
    assert value_at(low, 3.5, 0.0) == FREE
    assert value_at(low, 5.5, 0.0) == UNKNOWN
    assert not np.any(high.cells == OCCUPIED)
    assert value_at(high, 5.5, 0.0) == FREE


def test_crown_of_a_tree_is_occupied_before_its_trunk() -> None:
    trunk, crown = Box((6.0, 6.2), (-0.1, 0.1), (0.0, 2.0)), Box((5.0, 7.0), (-1.0, 1.0), (1.2, 2.0))
    grid = grid_of(Scene(line_of(height_m=0.8), (trunk, crown)))
    places = middles(grid)
    occupied = places[grid.cells == OCCUPIED]
    assert np.minimum(trunk.distance(occupied), crown.distance(occupied + np.array([0, 0, 1.5]))).max() < 1.5 * CELL
    assert value_at(grid, 5.0, 0.0) == OCCUPIED
    assert value_at(grid, 4.5, 0.0) == FREE


def test_rising_ground_is_not_occupied() -> None:
    scene = Scene(line_of(height_m=0.8), slope=0.15, slope_from=3.0)
    disparity = scene.disparity()
    nothing = np.zeros_like(disparity)
    occupancy = back_project(disparity, nothing, scene.line, CAMERA)
    rise = (occupancy == OBSTACLE) & np.isfinite(scene.depths()[0]) & (scene.depths()[0] < 10)
    assert rise.sum() > 1000
    grid = ground_grid(occupancy, Near(occupancy, disparity, scene.line), CAMERA)
    assert (grid.cells == FREE).sum() > 100
    assert not np.any(grid.cells == OCCUPIED)


def test_things_that_only_the_look_tells_stand_in_the_row_of_their_foot() -> None:
    scene = Scene(line_of(height_m=0.8))
    occupancy, disparity = scene.occupancy(), scene.disparity()
    row = 140
    far = float(scene.line.distance_m(row + 0.5, CAMERA))
    near = Near(
        np.where(scene.occupancy() == GROUND, np.uint8(255), np.uint8(100)), np.zeros_like(disparity), scene.line
    )
    occupancy[100 : row + 1, 120:180] = OBSTACLE
    grid = ground_grid(occupancy, near, CAMERA)
    x = middles(grid)[grid.cells == OCCUPIED][:, 0]
    assert x.size > 5
    assert x == pytest.approx(far, abs=1.5 * CELL)


def test_disparity_has_the_last_word() -> None:
    scene = Scene(line_of(height_m=0.8), (Box((3.0, 3.5), (-0.4, 0.4), (0.0, 0.6)),))
    truth, disparity = scene.occupancy(), scene.disparity()
    looks = np.full_like(truth, GROUND)  # as if the box looked like the ground
    grid = ground_grid(looks, Near(truth, disparity, scene.line), CAMERA)
    assert value_at(grid, 3.1, 0.0) != FREE
    assert value_at(grid, 4.5, 0.0) != FREE
    looks = np.full_like(truth, OBSTACLE)  # as if the ground looked like an obstacle
    grid = ground_grid(looks, Near(truth, disparity, scene.line), CAMERA)
    assert value_at(grid, 2.5, 0.0) == UNKNOWN
    assert value_at(grid, 3.0, 0.0) == OCCUPIED


def test_a_single_wrong_column_and_specks_are_no_obstacles_but_posts_are() -> None:
    scene = Scene(line_of(height_m=0.8), (Box((4.0, 4.06), (0.5, 0.56), (0.0, 1.0)),))
    occupancy, disparity = scene.occupancy(), scene.disparity()
    assert value_at(grid_of(scene), 4.0, 0.53) == OCCUPIED
    occupancy[150:200, 200] = OBSTACLE
    occupancy[170, 100:140] = OBSTACLE
    spoilt = ground_grid(occupancy, Near(occupancy, disparity, scene.line), CAMERA)
    places = middles(spoilt)[spoilt.cells == OCCUPIED]
    assert scene.boxes[0].distance(places).max() < 1.5 * CELL


def test_without_a_ground_line_all_is_unknown() -> None:
    occupancy, disparity = np.zeros((HEIGHT, WIDTH), np.uint8), np.zeros((HEIGHT, WIDTH), np.float32)
    grid = ground_grid(occupancy, Near(occupancy, disparity, None), CAMERA, MapsConfig(length_m=5.0, width_m=2.0))
    assert grid.cells.shape == (20, 50)
    assert grid.origin_m == (0.0, -1.0)
    assert np.all(grid.cells == UNKNOWN)


def test_arrays_are_left_as_they_are_and_may_be_read_only() -> None:
    scene = Scene(line_of(height_m=0.8), BOXES)
    occupancy, disparity = scene.occupancy(), scene.disparity()
    expected = grid_of(scene).cells
    for array in (occupancy, disparity):
        array.flags.writeable = False
    np.testing.assert_array_equal(
        ground_grid(occupancy, Near(occupancy, disparity, scene.line), CAMERA).cells, expected
    )


def test_image_has_ahead_up_and_left_to_the_left() -> None:
    cells = np.full((4, 6), UNKNOWN, np.int8)
    cells[0, 0], cells[3, 5] = FREE, OCCUPIED  # near on the right, far on the left
    image = Grid(cells, 0.1, (0.0, -0.2)).image
    assert (image.dtype, image.shape) == (np.uint8, (6, 4))
    assert image[5, 3] == 0
    assert image[0, 0] == 100
    assert (image == NO_OCCUPANCY).sum() == 22


def test_moving_a_grid_by_whole_cells_keeps_it() -> None:
    cells = np.random.default_rng(1).choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), (7, 12))
    moved = Grid(cells, 0.1, (0.0, -0.35)).in_frame(3.2, -1.05, 0.0)
    assert moved.origin_m == pytest.approx((3.2, -1.4))
    np.testing.assert_array_equal(moved.cells, cells)


def test_a_quarter_turn_swaps_the_axes() -> None:
    cells = np.random.default_rng(2).choice(np.array([FREE, OCCUPIED, UNKNOWN], np.int8), (6, 9))
    turned = Grid(cells, 0.1, (0.0, -0.3)).in_frame(0.0, 0.0, math.pi / 2)
    assert turned.origin_m == pytest.approx((-0.3, 0.0))
    np.testing.assert_array_equal(turned.cells, cells[::-1].T)


def test_a_turned_grid_keeps_what_is_occupied_and_calls_nothing_else_free() -> None:
    grid = grid_of(Scene(line_of(height_m=0.8), BOXES), MapsConfig(length_m=10.0, width_m=8.0))
    x, y, yaw = 2.03, -0.71, math.radians(30)
    turned = grid.in_frame(x, y, yaw)
    cos, sin = math.cos(yaw), math.sin(yaw)
    corner = np.array(turned.origin_m) / CELL
    np.testing.assert_allclose(corner, np.rint(corner), atol=1e-9)
    old, new = middles(grid)[grid.cells == OCCUPIED], middles(turned)
    expected = np.stack([cos * old[:, 0] - sin * old[:, 1] + x, sin * old[:, 0] + cos * old[:, 1] + y], axis=-1)
    rows, columns = np.floor((expected - turned.origin_m) / CELL).astype(int).T[::-1]
    assert np.all(turned.cells[rows, columns] == OCCUPIED)
    free = new[turned.cells == FREE][:, :2] - (x, y)
    back = np.stack([cos * free[:, 0] + sin * free[:, 1], cos * free[:, 1] - sin * free[:, 0]], axis=-1)
    rows, columns = np.floor((back - grid.origin_m) / CELL).astype(int).T[::-1]
    assert np.all(grid.cells[rows, columns] == FREE)
    share = (turned.cells == FREE).sum() / (grid.cells == FREE).sum()
    assert 0.95 < share < 1.05
    assert (turned.cells == OCCUPIED).sum() < 3 * (grid.cells == OCCUPIED).sum()


def test_what_is_no_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="give int8"):
        Grid(np.zeros((2, 3), np.uint8), 0.1, (0.0, 0.0))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"resolution_m is 0\.0; give"):
        Grid(np.zeros((2, 3), np.int8), 0.0, (0.0, 0.0))


def test_numbers_that_are_not_finite_are_refused() -> None:
    with pytest.raises(ValueError, match="give a finite number"):
        Grid(np.zeros((2, 3), np.int8), 0.1, (0.0, 0.0)).in_frame(math.nan, 0.0, 0.0)


def test_numbers_of_numpy_become_those_of_python() -> None:
    grid = Grid(np.zeros((2, 3), np.int8), np.float32(0.5), (np.int8(1), np.longdouble(2)))  # type: ignore[arg-type]
    moved = grid.in_frame(np.longdouble(1.5), np.int8(100), np.float16(0))  # type: ignore[arg-type]
    for value in (grid.resolution_m, *grid.origin_m, moved.resolution_m, *moved.origin_m):
        assert type(value) is float
    assert (moved.origin_m, moved.cells.shape) == ((2.5, 102.0), (2, 3))
