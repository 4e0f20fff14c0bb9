"""Tests of what stands on the ground, lies below it or leaves no disparity, on scenes of known geometry.

The camera looks ahead from 1 m above a flat ground: what is h metres high and z metres away is seen in the row
60 + 500 (1 - h) / z, and has the disparity 60 / z.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, GroundConfig
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN, GroundLine, back_project, detect_ground

HEIGHT, WIDTH = 300, 400
CAMERA = StereoCamera(fx=500.0, cx=200.0, cy=60.0, baseline_m=0.12)
SLOPE = 0.12  # of the ground's disparity in pixels per row
LINE = GroundLine(SLOPE, -SLOPE * CAMERA.cy)
v, u = np.mgrid[:HEIGHT, :WIDTH]
plane = np.maximum(SLOPE * (v - CAMERA.cy), 0).astype(np.float32)
NEAR = plane >= 3  # up to 20 m
MIDDLE = abs(u - CAMERA.cx) < 50

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


def row(depth_m: float, height_m: float = 0.0) -> float:
    """Return the row [px] in which a height is seen at a depth."""
    return CAMERA.cy + CAMERA.fx * (1 - height_m) / depth_m


def with_face(
    disparity: Image, depth_m: float, *, top_m: float, bottom_m: float = 0.0, where: Mask = MIDDLE
) -> tuple[Image, Mask]:
    """Return the scene with an upright face, and where that is."""
    face = where & (v >= row(depth_m, top_m)) & (v < row(depth_m, bottom_m))
    return np.where(face, np.float32(60 / depth_m), disparity), face


def with_ditch(near_m: float, far_m: float, depth_m: float, *, where: Mask) -> tuple[Image, Mask]:
    """Return the ground with a ditch between two distances, of upright walls and a flat floor, and where that is."""
    with np.errstate(divide="ignore"):
        ground_m, floor_m = 60 / plane, (1 + depth_m) * 60 / plane
    ditch = where & (ground_m > near_m) & (ground_m < far_m)
    return np.where(ditch, 60 / np.minimum(floor_m, far_m), plane).astype(np.float32), ditch


def with_step_down(near_m: float, drop_m: float) -> tuple[Image, Mask]:
    """Return the ground that goes on lower from a distance on, and where it is lower."""
    lower = v < row(near_m)
    return np.where(lower, plane / np.float32(1 + drop_m), plane), lower


def noisy(disparity: Image, noise_px: float, seed: int = 0) -> Image:
    noise = np.random.default_rng(seed).normal(0, noise_px, disparity.shape)
    return np.where(disparity > 0, disparity + noise, 0).astype(np.float32)


def occupancy(disparity: Image, config: GroundConfig | None = None) -> NDArray[np.uint8]:
    """Return the occupancy over the ground's line, without obstacles of the u-disparity."""
    return back_project(disparity, np.zeros_like(disparity), LINE, CAMERA, config)


def share(found: NDArray[np.uint8], value: int, where: Mask) -> float:
    assert where.any()
    return float((found[where] == value).mean())


def last_row(found: NDArray[np.uint8]) -> int:
    """Return the last row with an obstacle in the middle column."""
    return int(np.flatnonzero(found[:, int(CAMERA.cx)] == OBSTACLE)[-1])


# Contact with the ground


@pytest.mark.parametrize("depth_m", [2.5, 3.0, 5.0])
@pytest.mark.parametrize("top_m", [0.4, 0.6, 0.9])
def test_what_stands_is_an_obstacle_down_to_its_contact_and_no_farther(depth_m: float, top_m: float) -> None:
    disparity, face = with_face(plane, depth_m, top_m=top_m)
    config = GroundConfig()
    found = occupancy(disparity, config)
    rows_left = (config.contact_margin * 60 / depth_m + config.noise_px) / SLOPE + 1
    assert share(found, OBSTACLE, face & (v < row(depth_m) - rows_left)) == 1
    assert share(found, GROUND, NEAR & ~face) == 1


def test_margin_moves_the_contact_by_its_share_of_the_disparity() -> None:
    disparity, face = with_face(plane, 3.0, top_m=0.6)
    rows = [last_row(occupancy(disparity, GroundConfig(contact_margin=margin))) for margin in (0.0, 0.05, 0.1, 0.15)]
    per_margin = 60 / 3.0 / SLOPE  # rows that the ground's disparity needs to grow by all of the face's
    np.testing.assert_allclose(rows[0] - np.array(rows), per_margin * np.array([0, 0.05, 0.1, 0.15]), atol=1.01)
    assert np.flatnonzero(face.any(axis=1))[-1] - rows[0] <= GroundConfig().noise_px / SLOPE + 1


def test_the_greatest_margin_leaves_feet_as_ground() -> None:
    disparity, face = with_face(plane, 3.0, top_m=0.6)
    config = GroundConfig(contact_margin=1.0)
    found = occupancy(disparity, config)
    assert share(found, OBSTACLE, face & (v < row(3.0, config.min_obstacle_m) - 1)) == 1
    assert share(found, OBSTACLE, face & (v > row(3.0, config.min_obstacle_m) + 1)) == 0
    assert share(found, GROUND, face & (v > row(3.0, config.max_step_m))) == 1


def test_feet_are_found_through_noise() -> None:
    disparity, face = with_face(plane, 3.0, top_m=0.6)
    feet = face & (v > row(3.0, 0.3)) & (v < row(3.0, 0.08))
    found, without = (
        occupancy(noisy(disparity, 0.2), GroundConfig(contact_margin=margin))
        for margin in (GroundConfig().contact_margin, 1.0)
    )
    assert share(found, OBSTACLE, feet) > 0.9
    assert share(without, OBSTACLE, feet) < 0.1
    assert share(found, GROUND, NEAR & ~face) > 0.99


def test_ground_that_is_seen_beneath_a_crown_stays_ground() -> None:
    disparity, crown = with_face(plane, 3.0, top_m=1.2, bottom_m=0.7)
    found = occupancy(disparity)
    assert share(found, OBSTACLE, crown) == 1
    assert share(found, GROUND, NEAR & ~crown) == 1


def test_a_column_that_shows_something_clearly_farther_is_not_of_the_thing_above() -> None:
    behind, wall = with_face(plane, 5.0, top_m=0.9)
    disparity, crown = with_face(behind, 3.0, top_m=1.2, bottom_m=0.7)
    found = occupancy(disparity)
    assert share(found, OBSTACLE, crown) == 1
    ground = NEAR & ~crown & ~wall
    assert share(found, GROUND, ground) == 1
    assert (ground & MIDDLE & (v > row(5.0)) & (v < row(3.0))).any()  # above the crown's contact, had it one


@pytest.mark.parametrize(
    "noise_px",
    [
        0.1,
        0.4,
    ],
)
def test_disparity_that_grows_along_with_the_ground_is_no_face(noise_px: float) -> None:
    raised = MIDDLE & (v > 120) & (v < 200)
    found = occupancy(np.where(raised, plane + np.float32(1.2), plane), GroundConfig(noise_px=noise_px))
    assert share(found, OBSTACLE, raised) == 0
    assert share(found, GROUND, NEAR & ~raised) == 1


@pytest.mark.parametrize("grade", [0.02, -0.02])
def test_a_gentle_change_of_slope_is_neither_face_nor_drop(grade: float) -> None:
    sloped = v < row(3.0)  # from 3 m on, y = 1 - grade (z - 3)
    disparity = np.where(sloped, 60 / (1 + 3 * grade) * ((v - CAMERA.cy) / CAMERA.fx + grade), plane)
    disparity = np.maximum(disparity, 0).astype(np.float32)
    found = detect_ground(noisy(disparity, 0.1), CAMERA).occupancy
    assert share(found, OBSTACLE, disparity > 5) == 0
    assert share(found, GROUND, disparity > 5) > 0.99


# Small things, and noise


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("source", ["stereo", "depth"])
def test_a_brick_is_seen_at_3_m_without_speckles_on_the_ground(source: str, seed: int) -> None:
    config = GroundConfig()
    if source == "depth":
        config = GroundConfig(noise_px=config.depth_noise_px)
    disparity, brick = with_face(plane, 3.0, top_m=0.1, where=abs(u - CAMERA.cx) < CAMERA.fx * 0.1 / 3.0)
    found = detect_ground(noisy(disparity, 0.2, seed), CAMERA, config).occupancy
    assert brick.sum() == pytest.approx(0.1 * 0.2 * (CAMERA.fx / 3.0) ** 2, rel=0.1)
    assert share(found, OBSTACLE, brick) > 0.5
    ground = NEAR & ~brick
    assert share(found, OBSTACLE, ground) < 0.005
    assert share(found, GROUND, ground) > 0.97


def test_noise_that_is_greater_than_it_is_said_to_be_makes_no_obstacles() -> None:
    found = detect_ground(noisy(plane, 0.8), CAMERA, GroundConfig(noise_px=0.2)).occupancy
    assert share(found, OBSTACLE, NEAR & (plane > 6)) < 0.005


def test_the_horizon_is_uncertain_by_the_noise() -> None:
    nothing = np.zeros((HEIGHT, WIDTH), np.float32)
    for noise_px in (0.3, 1.1):
        found = occupancy(nothing, GroundConfig(noise_px=noise_px, max_hole_px=0))
        rows = math.floor(noise_px / SLOPE)  # above the horizon, in row 60
        assert share(found, OBSTACLE, v < 60 - rows - 1) == 1
        assert share(found, UNKNOWN, v > 60 - rows) == 1


# Drops


PIT, ACROSS = abs(u - 200) < 70, u >= 0


@pytest.mark.parametrize(
    ("where", "noise_px"),
    [
        pytest.param(PIT, 0.1, id="a pit"),
        pytest.param(PIT, 0.2, id="a pit, noise"),
        pytest.param(PIT, 0.0, id="a pit, exact"),
        pytest.param(ACROSS, 0.0, id="across the way, exact"),
        pytest.param(ACROSS, 0.1, id="across the way"),
        pytest.param(ACROSS, 0.2, id="across the way, noise"),
    ],
)
def test_a_ditch_is_an_obstacle(where: Mask, noise_px: float) -> None:
    disparity, ditch = with_ditch(4.0, 5.0, 0.4, where=where)
    deep = ditch & (plane > 1.2 * disparity)  # 0.2 m below the ground, for a camera at 1 m
    found = detect_ground(noisy(disparity, noise_px), CAMERA).occupancy
    assert share(found, OBSTACLE, deep) > 0.9
    assert share(found, GROUND, deep) == 0
    assert share(found, OBSTACLE, NEAR & ~ditch) < 0.005
    assert share(found, GROUND, NEAR & ~ditch) > 0.97


@pytest.mark.parametrize("drop_m", [0.4, 1.0])
def test_ground_beyond_a_step_down_is_an_obstacle(drop_m: float) -> None:
    disparity, lower = with_step_down(3.0, drop_m)
    found = occupancy(noisy(disparity, 0.1))
    assert share(found, OBSTACLE, lower & (disparity > 3)) > 0.99
    assert share(found, GROUND, ~lower) == 1
    without = occupancy(noisy(disparity, 0.1), GroundConfig(min_drop_m=0.0))
    assert share(without, OBSTACLE, lower & (disparity > 3)) == 0
    assert share(without, GROUND, ~lower) == 1


def test_what_is_less_deep_than_the_least_drop_is_none() -> None:
    disparity, lower = with_step_down(3.0, 0.4)
    beyond = lower & (v < row(3.0) - 30)  # nearer to the edge it may be taken for upright, as a ditch's far wall is
    for min_drop_m, expected in ((0.3, 1), (0.6, 0)):
        found = occupancy(noisy(disparity, 0.1), GroundConfig(min_drop_m=min_drop_m))
        assert share(found, OBSTACLE, beyond & (disparity > 3)) == pytest.approx(expected, abs=0.01)


def test_beyond_an_edge_behind_which_nothing_is_seen_there_is_no_ground() -> None:
    beyond = (v < row(4.0)) & (v > CAMERA.cy)
    found = occupancy(np.where(beyond, np.float32(0), plane))
    assert share(found, GROUND, beyond) == 0
    assert share(found, GROUND, NEAR & ~beyond) == 1


def test_mismatches_without_a_rim_of_ground_are_no_drop() -> None:
    patch, hole = MIDDLE & (v > 150) & (v < 170), MIDDLE & (v > 135) & (v < 185)
    found = occupancy(np.where(patch, np.float32(5), np.where(hole, np.float32(0), plane)))
    assert share(found, OBSTACLE, hole) == 0
    assert share(found, GROUND, NEAR & ~hole) == 1


def test_small_mismatches_are_no_drop() -> None:
    patch = (v % 40 < 2) & (u % 40 < 4) & NEAR
    found = occupancy(np.where(patch, plane / 2, plane).astype(np.float32))
    assert share(found, OBSTACLE, NEAR) == 0


def across_m(width_m: float, depth_m: float) -> Mask:
    """Return the columns in the middle that something so wide fills at a depth."""
    return abs(u - CAMERA.cx) * depth_m / CAMERA.fx < width_m / 2


@pytest.mark.parametrize(
    ("width_m", "expected"), [(0.12, 0), (0.17, 0), pytest.param(0.25, 1, id="a wheel's"), (0.3, 1)]
)
def test_a_drop_is_as_wide_as_a_wheel(width_m: float, expected: int) -> None:
    disparity, ditch = with_ditch(4.0, 5.0, 0.4, where=across_m(width_m, 4.3))
    deep = ditch & (plane > 1.2 * disparity)
    found = occupancy(noisy(disparity, 0.1))
    assert share(found, OBSTACLE, deep) == pytest.approx(expected, abs=0.02)
    assert share(found, OBSTACLE, NEAR & ~ditch) < 0.001


@pytest.mark.parametrize(("gap_px", "expected"), [(3, 1), (20, 0)])
def test_pieces_of_a_drop_beside_each_other_count_together(gap_px: int, expected: int) -> None:
    aside = abs(u - CAMERA.cx) - gap_px / 2  # two pieces of 0.13 m, with ground between them
    disparity, ditch = with_ditch(4.0, 5.0, 0.4, where=(aside > 0) & (aside < 0.13 * CAMERA.fx / 4.3))
    deep = ditch & (plane > 1.2 * disparity)
    found = occupancy(disparity)
    assert share(found, OBSTACLE, deep) == pytest.approx(expected, abs=0.02)
    assert share(found, GROUND, NEAR & ~ditch) == 1


@pytest.mark.parametrize("seed", [0, 1])
def test_what_ends_behind_nearer_ground_is_no_drop(seed: int) -> None:
    spot = MIDDLE & (v > row(4.0)) & (v < row(3.0))
    found = occupancy(noisy(np.where(spot, np.float32(9), plane), 0.1, seed))
    assert share(found, OBSTACLE, spot) == 0
    assert share(found, GROUND, NEAR & ~spot) == 1
    wall = MIDDLE & (v > row(60 / 9)) & (v < row(3.0))  # as much disparity, up to the ground that has it too
    found = occupancy(noisy(np.where(wall, np.float32(9), plane), 0.1, seed))
    assert share(found, OBSTACLE, wall & (plane > 9.5)) > 0.98


@pytest.mark.parametrize(("noise_px", "expected"), [(0.05, 1), (0.3, 0)])
def test_a_drop_stands_out_from_the_noise_that_is_there(noise_px: float, expected: int) -> None:
    rng = np.random.default_rng(4)
    coarse = np.kron(rng.normal(0, noise_px, (HEIGHT // 10, WIDTH // 10)), np.ones((10, 10)))  # as matching leaves it
    disparity, ditch = with_ditch(6.0, 7.0, 0.4, where=ACROSS)
    found = occupancy((disparity + coarse).astype(np.float32))
    deep = ditch & (plane > 1.1 * disparity)
    assert (plane - disparity)[deep].max() < 1.6
    assert (share(found, OBSTACLE, deep) > 0.9) == bool(expected)
    assert share(found, OBSTACLE, NEAR & (plane > 5) & ~ditch) == 0


@pytest.mark.parametrize("noise_px", [0.0, 0.1])
def test_a_step_that_takes_up_most_of_the_view_is_found(noise_px: float) -> None:
    disparity, lower = with_step_down(2.6, 0.3)
    found = occupancy(noisy(disparity, noise_px))
    assert lower[NEAR].mean() > 0.5
    assert share(found, OBSTACLE, lower & (plane > 15)) > 0.95


def test_ground_that_falls_away_gently_is_no_drop() -> None:
    curvature_per_m = 0.005  # it is 0.25 m lower at 10 m, and 1 m at 20 m
    bend = 60**2 * curvature_per_m / 2
    line = SLOPE * (v - CAMERA.cy)
    squared = line**2 - 4 * bend
    seen = (line > 0) & (squared > 0)
    disparity = np.where(seen, (line + np.sqrt(np.maximum(squared, 0))) / 2, 0).astype(np.float32)
    found = detect_ground(noisy(disparity, 0.1), CAMERA).occupancy
    assert share(found, OBSTACLE, disparity > 4) == 0
    assert share(found, GROUND, disparity > 4) > 0.99


# Holes without disparity


def test_a_hole_in_the_ground_is_filled_but_not_one_above_an_obstacle() -> None:
    column = abs(u - 200) < 6
    box, face = with_face(plane, 3.0, top_m=0.3, where=column)
    hole = column & (v >= row(3.0, 0.3) - 11) & (v < row(3.0, 0.3))  # right above it
    for disparity, expected in ((plane, GROUND), (box, UNKNOWN)):
        found = occupancy(np.where(hole, np.float32(0), disparity))
        assert share(found, expected, hole) == 1
    assert share(found, OBSTACLE, face & (v < 215)) == 1


@pytest.mark.parametrize(
    ("width", "foot"),
    [
        pytest.param(9, 20, id="a post"),
        pytest.param(60, 3, id="a wall"),
        pytest.param(5, 3, id="a post to its foot"),
    ],
)
def test_a_wall_without_texture_is_not_filled_as_ground(width: int, foot: int) -> None:
    wall, face = with_face(plane, 3.0, top_m=0.9, where=abs(u - 200) <= width // 2 + 3)
    inside = face & (abs(u - 200) <= width // 2) & (v > row(3.0, 0.9) + 8) & (v < row(3.0) - foot)
    disparity = np.where(inside, np.float32(0), wall)  # it has disparity at its outline alone
    for found in (occupancy(disparity), detect_ground(disparity, CAMERA).occupancy):
        assert share(found, GROUND, inside) == 0
        assert share(found, OBSTACLE, face & ~inside & (v < row(3.0) - 20)) > 0.95
        assert share(found, GROUND, NEAR & ~face) > 0.99


# The letter of the paper


def test_preset_paper_is_as_it_was() -> None:
    disparity, _ = with_face(plane, 3.0, top_m=0.9)
    disparity, _ = with_face(disparity, 5.0, top_m=0.3, where=abs(u - 320) < 30)
    disparity[120:140, 40:80] /= 2  # below the ground
    disparity[200:206, 300:306] = 0
    found = detect_ground(noisy(disparity, 0.3, seed=5), CAMERA, Config.preset("paper").ground)
    assert found.line is not None
    assert (found.line.slope, found.line.intercept) == pytest.approx((0.1201315, -7.2102576), rel=1e-5)
    counts = [int((found.occupancy == value).sum()) for value in (GROUND, OBSTACLE, UNKNOWN)]
    assert counts == pytest.approx([75541, 39128, 5331], abs=5)  # found before feet, drops and holes were looked for


@pytest.mark.parametrize("n_rows", [0, 1, 48])
def test_rows_above_the_horizon_change_nothing_below(n_rows: int) -> None:
    disparity, _ = with_ditch(4.0, 6.0, 0.5, where=MIDDLE)
    disparity, _ = with_face(disparity, 3.0, top_m=0.9, where=u < 100)
    disparity[:, ::7] = 0
    higher = np.concatenate([np.full((n_rows, WIDTH), 9, np.float32), disparity])
    lower = disparity[42:]  # 18 rows remain above the horizon
    # the same ground from another row on, in numbers of few digits
    found, expected = (
        back_project(image, np.zeros_like(image), GroundLine(0.125, -0.125 * horizon), CAMERA)
        for image, horizon in ((higher, n_rows + 60), (lower, 18))
    )
    assert (found[: n_rows + 42] == OBSTACLE).all()
    assert {*np.unique(expected).tolist()} == {GROUND, OBSTACLE, UNKNOWN}
    np.testing.assert_array_equal(found[n_rows + 42 :], expected)


@pytest.mark.parametrize("intercept", [-36.0, -1e6])
def test_an_image_above_the_horizon_is_an_obstacle(intercept: float) -> None:
    line = GroundLine(SLOPE, intercept)
    assert (back_project(plane, np.zeros_like(plane), line, CAMERA) == OBSTACLE).all()
