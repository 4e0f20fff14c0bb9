"""Tests of u-v-disparity and the ground line, on scenes of known geometry."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, GroundConfig, settings_of
from lrtrav_ros.method.ground import (
    GROUND,
    LEAST_SLOPE,
    OBSTACLE,
    UNKNOWN,
    GroundLine,
    detect_ground,
    find_ground_line,
    obstacle_cells,
    select_cells,
    u_disparity,
    v_disparity,
)
from lrtrav_ros.numerics.thread_team import ThreadTeam

HEIGHT, WIDTH = 120, 200
CAMERA = StereoCamera(fx=150.0, cx=100.0, cy=55.0, baseline_m=0.3)


def plane_disparity(
    *, height_m: float = 0.9, pitch_deg: float = 5.0, roll_deg: float = 0.0, camera: StereoCamera = CAMERA
) -> NDArray[np.float32]:
    """Return the exact disparity of a flat ground; 0 above the horizon."""
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    normal = (math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll), math.sin(pitch))
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    inverse_depth = (normal[0] * x + normal[1] * y + normal[2]) / height_m
    return np.maximum(camera.fx * camera.baseline_m * inverse_depth, 0).astype(np.float32)


def with_box(
    disparity: NDArray[np.float32], *, depth_m: float = 5.0, height_m: float = 0.9, box_m: float = 0.6
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the scene with an upright box in the middle, seen by a camera that looks ahead, and where the box is."""
    box = np.zeros(disparity.shape, np.bool_)
    bottom = round(CAMERA.cy + CAMERA.fx * height_m / depth_m)
    top = round(CAMERA.cy + CAMERA.fx * (height_m - box_m) / depth_m)
    box[top:bottom, 80:120] = True
    return np.where(box, np.float32(CAMERA.fx * CAMERA.baseline_m / depth_m), disparity), box


def test_u_and_v_disparity_count_pixels() -> None:
    disparity = np.array([[0.0, 1.4, 1.6], [0.2, 2.0, 7.0]], np.float32)
    u = u_disparity(disparity, n_disparities=4)
    v = v_disparity(disparity, n_disparities=4)
    np.testing.assert_array_equal(u, [[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 0]])
    np.testing.assert_array_equal(v, [[0, 1, 1, 0], [0, 0, 1, 0]])


@pytest.mark.parametrize("noise_px", [0.0, 0.3])
@pytest.mark.parametrize(("height_m", "pitch_deg", "roll_deg"), [(0.9, 5, 0), (0.4, 0, 0), (1.7, -4, 3), (0.9, 12, -5)])
def test_geometry_of_a_flat_ground(height_m: float, pitch_deg: float, roll_deg: float, noise_px: float) -> None:
    disparity = plane_disparity(height_m=height_m, pitch_deg=pitch_deg, roll_deg=roll_deg)
    noise = np.random.default_rng(0).normal(0, noise_px, disparity.shape)
    noisy = np.where(disparity > 1, disparity + noise, 0).astype(np.float32)
    config = GroundConfig(max_step_m=0.13)  # as far as that off the ground, pixels have weight
    line = detect_ground(noisy, CAMERA, config).line
    assert line is not None
    assert line.camera_height_m(CAMERA) == pytest.approx(height_m, rel=0.02)
    assert math.degrees(line.pitch_rad(CAMERA)) == pytest.approx(pitch_deg, abs=0.5)  # 1.3 rows
    assert math.degrees(line.roll_rad(CAMERA)) == pytest.approx(roll_deg, abs=0.4)
    assert line.horizon_row(CAMERA.cx) == pytest.approx(
        CAMERA.cy - CAMERA.fx * math.tan(math.radians(pitch_deg)) / math.cos(math.radians(roll_deg)), abs=1.3
    )


def test_distance_of_a_row_is_measured_along_the_ground() -> None:
    pitch = math.radians(5)
    line = detect_ground(plane_disparity(), CAMERA).line
    assert line is not None
    row = CAMERA.cy + CAMERA.fx * math.tan(math.atan(0.9 / 4.0) - pitch)  # the row that sees the ground 4 m ahead
    assert line.distance_m(row, CAMERA) == pytest.approx(4.0, rel=0.01)
    assert line.distance_m(line.horizon_row(CAMERA.cx) - 1, CAMERA) == math.inf


def test_ground_is_all_below_the_horizon_and_obstacle_all_above() -> None:
    disparity = plane_disparity()
    found = detect_ground(disparity, CAMERA)
    assert (found.occupancy[disparity > 1.5] == GROUND).mean() > 0.999
    assert (found.occupancy[:40] == OBSTACLE).all()
    np.testing.assert_array_equal(found.mask == 255, found.occupancy == GROUND)


def test_a_box_is_an_obstacle_and_its_foot_is_not_ground() -> None:
    disparity, box = with_box(plane_disparity(pitch_deg=0.0))
    found = detect_ground(disparity, CAMERA)
    rows = np.flatnonzero(box.any(axis=1))
    high = box.copy()
    high[rows[-1] - 2 :] = False  # 3 of 18 rows: margin and noise in which it touches the ground, at its disparity of 9
    assert (found.occupancy[high] == OBSTACLE).all()
    assert (found.occupancy[box] == GROUND).mean() <= 3 / 18
    assert (found.occupancy[~box & (disparity > 2)] == GROUND).mean() > 0.99


def test_obstacle_cells_of_the_u_disparity_hold_the_box_and_no_ground() -> None:
    disparity, box = with_box(plane_disparity(pitch_deg=0.0), depth_m=3.0, box_m=0.9)
    histogram = u_disparity(disparity, n_disparities=40)
    cells = obstacle_cells(histogram, CAMERA, n_rows=HEIGHT, config=GroundConfig())
    obstacles = select_cells(disparity, cells)
    assert (obstacles[box] > 0).mean() > 0.95
    assert (obstacles[~box] > 0).mean() < 0.02


def test_preset_paper_takes_the_obstacles_of_the_u_disparity() -> None:
    disparity, box = with_box(plane_disparity(pitch_deg=0.0), depth_m=3.0, box_m=0.9)
    found = detect_ground(disparity, CAMERA, config=Config.preset("paper").ground)
    np.testing.assert_array_equal(found.occupancy[box & (found.obstacle_disparity > 0)], OBSTACLE)
    assert found.line is not None
    assert found.line.tilt == 0


def test_votes_are_weighted_by_the_histogram() -> None:
    histogram = np.zeros((HEIGHT, 64), np.int32)
    rows = np.arange(60, HEIGHT)
    histogram[rows, np.rint(0.4 * (rows - 50)).astype(int)] = 50
    histogram[60:110, 30:60] = 1  # many more cells, with less in each
    line = find_ground_line(histogram, CAMERA, config=GroundConfig())
    assert line is not None
    assert line.slope == pytest.approx(0.4, rel=0.05)
    assert line.horizon_row(0) == pytest.approx(50, abs=3)


@pytest.mark.parametrize(
    "disparity",
    [
        pytest.param(np.zeros((HEIGHT, WIDTH), np.float32), id="no disparity"),
        pytest.param(np.full((HEIGHT, WIDTH), 20, np.float32), id="a wall"),
        pytest.param(np.flipud(plane_disparity()), id="a ceiling"),
        pytest.param(
            np.where(np.arange(HEIGHT)[:, None] == 90, np.float32(9), np.zeros((HEIGHT, WIDTH), np.float32)), id="a row"
        ),
        pytest.param(np.zeros((16, 16), np.float32), id="tiny"),
        pytest.param(np.ones((1, 1), np.float32), id="one pixel"),
    ],
)
def test_no_ground_in_sight_leaves_all_unknown(disparity: NDArray[np.float32]) -> None:
    found = detect_ground(np.ascontiguousarray(disparity), CAMERA)
    assert found.line is None
    assert (found.occupancy == UNKNOWN).all()
    assert not found.mask.any()


def test_holes_without_disparity_are_filled_up_to_their_size() -> None:
    disparity = plane_disparity()
    disparity[90:100, 50:60] = 0
    disparity[70:115, 120:165] = 0
    found = detect_ground(disparity, CAMERA, config=GroundConfig(max_hole_px=15))
    assert (found.occupancy[90:100, 50:60] == GROUND).all()
    assert (found.occupancy[80:105, 130:155] == UNKNOWN).all()


def test_things_that_stand_on_the_ground_do_not_lift_it() -> None:
    disparity = plane_disparity(pitch_deg=0.0)
    rng = np.random.default_rng(1)
    tufts = rng.random(disparity.shape) < 0.3
    disparity = np.where(tufts, disparity * 1.15, disparity).astype(np.float32)
    line = detect_ground(disparity, CAMERA).line
    assert line is not None
    assert line.camera_height_m(CAMERA) == pytest.approx(0.9, rel=0.02)


def test_line_of_one_image_is_independent_of_memory_layout() -> None:
    disparity = plane_disparity()
    view = np.asfortranarray(disparity)
    np.testing.assert_array_equal(detect_ground(view, CAMERA).occupancy, detect_ground(disparity, CAMERA).occupancy)


@pytest.mark.parametrize("disparity", [np.zeros((0, 5), np.float32), np.zeros((4, 5)), np.zeros((4, 5, 3), np.float32)])
def test_what_is_no_disparity_image_is_refused(disparity: NDArray[np.float32]) -> None:
    with pytest.raises(ValueError, match=r"disparity is .*; give float32 \(H, W\), not empty"):
        detect_ground(disparity, CAMERA)


def test_ground_line_disparity_has_rows_first() -> None:
    found = GroundLine(2.0, 3.0, 0.5).disparity(2, 3)
    np.testing.assert_allclose(found, [[3, 3.5, 4], [5, 5.5, 6]])
    np.testing.assert_array_equal(GroundLine(2.0, -9.0).disparity(2, 3), 0)


@pytest.mark.parametrize("curvature_per_m", [0.001, -0.001])
def test_ground_that_bends(curvature_per_m: float) -> None:
    v = np.arange(HEIGHT)[:, None]
    line = CAMERA.baseline_m / 0.9 * (v - CAMERA.cy)  # of the flat ground below the camera
    bend = CAMERA.fx**2 * CAMERA.baseline_m**2 * curvature_per_m / 2 / 0.9  # from y = 0.9 + curvature / 2 z^2
    squared = line**2 - 4 * bend
    exact = np.where((line > 0) & (squared > 0), (line + np.sqrt(np.maximum(squared, 0))) / 2, 0)
    disparity = np.repeat(exact, WIDTH, axis=1).astype(np.float32)
    fitted = detect_ground(disparity, CAMERA, config=GroundConfig(noise_px=0.2)).line
    assert fitted is not None
    assert fitted.bend == pytest.approx(bend, rel=0.2)
    flat = detect_ground(disparity, CAMERA, config=GroundConfig(noise_px=0.2, shape="plane")).line
    assert flat is not None
    far = (disparity > 0.5) & (disparity < 4)
    error = np.abs(fitted.disparity(HEIGHT, WIDTH) - disparity)[far].mean()
    assert error < 0.25 * np.abs(flat.disparity(HEIGHT, WIDTH) - disparity)[far].mean()


@pytest.mark.parametrize("n_threads", [2, 3])
@pytest.mark.parametrize("preset", ["robust", "paper"])
def test_the_number_of_threads_changes_nothing(preset: str, n_threads: int) -> None:
    camera = StereoCamera(fx=400.0, cx=250.0, cy=90.0, baseline_m=0.3)
    v, u = np.mgrid[:327, :501]
    noise = np.random.default_rng(0).normal(0, 0.2, v.shape)
    disparity = np.where(v > 92, 0.3 * (v - 90) + 0.004 * u + noise, 0).astype(np.float32)
    disparity[100:180, 200:260] = 30
    disparity[150:190, 300:340] = 0
    config = Config.preset(preset).ground
    alone, together = (detect_ground(disparity, camera, config, team=ThreadTeam(n)) for n in (1, n_threads))
    assert alone.line is not None
    assert together.line == alone.line
    for name in ("occupancy", "u_disparity", "v_disparity", "obstacle_cells", "obstacle_disparity"):
        np.testing.assert_array_equal(getattr(together, name), getattr(alone, name), err_msg=name)


def test_v_disparity_leaves_out_the_obstacles() -> None:
    disparity, _ = with_box(plane_disparity(pitch_deg=0.0), depth_m=3.0, box_m=0.9)
    found = detect_ground(disparity, CAMERA)
    obstacles = found.obstacle_disparity
    assert (obstacles > 0).sum() > 1000
    n_disparities = found.v_disparity.shape[1]
    np.testing.assert_array_equal(found.v_disparity, v_disparity(disparity - obstacles, n_disparities=n_disparities))


def test_disparities_are_rounded_half_up() -> None:
    below_half = np.nextafter(np.float32(0.5), np.float32(0))
    values = np.array([[below_half, 0.5, 1.4999999, 1.5, 2.5, 3.4999998, 3.5, 40000]], np.float32)[:, [*range(8), 3]]
    np.testing.assert_array_equal(v_disparity(values, n_disparities=4), [[0, 2, 2, 2]])


@pytest.mark.parametrize(("cy", "max_pitch_deg"), [(55.0, 45.0), (20.0, 60.0), (150.0, 10.0), (400.0, 20.0)])
@pytest.mark.parametrize("height", [121, 120, 7])
def test_the_line_is_the_one_with_most_votes(height: int, cy: float, max_pitch_deg: float) -> None:
    rng = np.random.default_rng(height)
    histogram = np.where(rng.random((height, 30)) < 0.2, rng.integers(0, 50, (height, 30)), 0).astype(np.int32)
    camera = StereoCamera(fx=150.0, cx=100.0, cy=cy, baseline_m=0.3)
    config = GroundConfig(max_pitch_deg=max_pitch_deg)
    assert find_ground_line(histogram, camera, config) == line_by_votes(histogram, camera, config)


@pytest.mark.parametrize("seed", [10, 11])
def test_rows_far_below_the_horizon_vote_in_runs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    histogram = np.zeros((2400, 200), np.int32)
    histogram[-1, 130:] = np.where(rng.random(70) < 0.3, rng.integers(0, 50, 70), 0)
    camera, config = StereoCamera(fx=150.0, cx=100.0, cy=0.0, baseline_m=0.3), GroundConfig(max_pitch_deg=20.0)
    assert find_ground_line(histogram, camera, config) == line_by_votes(histogram, camera, config)


def line_by_votes(histogram: NDArray[np.int32], camera: StereoCamera, config: GroundConfig) -> GroundLine | None:
    """Return the line that most cells of a v-disparity vote for, each for all horizons, one after the other."""
    reach = math.tan(math.radians(config.max_pitch_deg)) * camera.fy
    first = math.floor(camera.cy - reach)
    low = math.log(camera.baseline_m / config.max_camera_height_m)
    n_slopes = math.ceil((math.log(camera.baseline_m / config.min_camera_height_m) - low) / 0.03) + 1
    n_horizons = max(math.floor(min(camera.cy + reach, len(histogram)) - first) // 2, 1)
    votes = np.zeros((n_horizons, n_slopes), np.float32)
    for v, d in zip(*np.nonzero(histogram), strict=True):
        for i in range(n_horizons):
            below = v - first - 2 * i
            if d >= 3 and v >= first and below > 0:
                slope = (np.log(d) - low) / 0.03 + 0.5 - np.log(below) / 0.03
                if 0 <= slope < n_slopes:
                    votes[i, int(slope)] += histogram[v, d]
    votes = cv2.GaussianBlur(votes, (0, 0), 1.0)
    horizon, best = np.unravel_index(int(np.argmax(votes)), votes.shape)
    slope = math.exp(low + 0.03 * float(best))
    return GroundLine(slope, -slope * float(first + 2 * int(horizon))) if votes.max() > 0 else None


@pytest.mark.parametrize("slope", [5e-324, 1e-310, 9e-21, 0.0, -1.0])
def test_slopes_that_no_ground_has_are_refused(slope: float) -> None:
    with pytest.raises(ValueError, match=r"^slope is .*; give a value above 0, at least 1e-20, for ground is nearer"):
        GroundLine(slope, 0.0)


def test_the_least_slope_leaves_the_height_finite_and_no_camera_needs_a_lesser_one() -> None:
    wide = StereoCamera(fx=1e5, fy=1e-6, cx=0.0, cy=0.0, baseline_m=1000.0)
    assert GroundLine(LEAST_SLOPE, 0.0).camera_height_m(wide) < np.finfo(np.float32).max
    narrow = StereoCamera(fx=1e-6, fy=1e5, cx=0.0, cy=0.0, baseline_m=1e-6)
    highest_m = settings_of(GroundConfig)["max_camera_height_m"].maximum
    assert highest_m is not None
    assert narrow.baseline_m * narrow.fx / narrow.fy / highest_m > LEAST_SLOPE


@pytest.mark.parametrize("kind", [int, np.int8, np.float16, np.longdouble])
def test_coefficients_are_floats_of_python(kind: type[float]) -> None:
    line = GroundLine(kind(2), kind(-3), kind(0), kind(1))
    assert line == GroundLine(2.0, -3.0, 0.0, 1.0)
    assert {type(value) for value in (line.slope, line.intercept, line.tilt, line.bend)} == {float}


def test_an_image_with_more_rows_than_can_be_counted_is_refused() -> None:
    disparity = np.full((2**16, 2), 5, np.float32)
    assert u_disparity(disparity[1:], n_disparities=7)[5].tolist() == [2**16 - 1] * 2
    for refused in (lambda: u_disparity(disparity, n_disparities=7), lambda: detect_ground(disparity, CAMERA)):
        with pytest.raises(ValueError, match=r"^disparity has 65536 rows; give at most 65535, as many as"):
            refused()
