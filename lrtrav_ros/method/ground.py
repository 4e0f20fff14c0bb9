"""Short-range ground by u-v-disparity.

The ground line in the v-disparity image is found by a weighted Hough transform and refitted robustly; pixels on it are
traversable. Lu et al., IROS 2015, section II; Labayrade et al., IV 2002 (v-disparity); Hu and Uchimura, IV 2005
(u-v-disparity).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import GroundConfig

GROUND = 0
OBSTACLE = 100
UNKNOWN = 255

NO_GROUND = "no ground line found"
"""What results say of a frame in which there is none."""

_MAX_DISPARITIES = 1024  # what is nearer is left to the plane
_HORIZON_STEP = 2  # rows between the horizons of the Hough transform
_SLOPE_STEP = 0.03  # relative step between its slopes
_MIN_DISPARITY = 3  # nearer to the horizon, rounding leaves the slope open
_SAMPLING = 3  # rows and columns between the pixels of the refit
_ITERATIONS = 20
_MAX_STEEPNESS = 3.0
_MIN_ROW_SPREAD = 0.01  # of the image's height: in fewer rows the slope is left open
_CONVERGED_PX = 1e-3
_STIFFNESS = 1e-4  # of the bend: with little ground in sight it stays flat
_ABOVE = 1.75  # residuals count more above the ground than below it: all that is not ground stands on it


@dataclass(frozen=True, slots=True)
class GroundLine:
    """The ground's disparity: ``line = slope * v + intercept + tilt * u``, and for a ground that bends what follows.

    Over ground with a constant vertical curvature, disparity d obeys ``d + bend / d = line``; the greater root is seen.

    Attributes
    ----------
    slope
        Disparity in pixels per row, above 0: baseline / camera height for a camera that looks ahead.
    intercept
        Disparity at row 0 and column 0, in pixels.
    tilt
        Disparity in pixels per column; 0 without roll.
    bend
        In square pixels; above 0 the ground falls away, and ends in a crest where the line is 2 sqrt(bend); 0 for flat
        ground.
    """

    slope: float
    intercept: float
    tilt: float = 0.0
    bend: float = 0.0

    def disparity(self, height: int, width: int) -> NDArray[np.float32]:
        """Return the ground's disparity (height, width) in pixels; 0 from the horizon up."""
        rows = self.slope * np.arange(height) + self.intercept
        return self._bent(rows[:, None] + self.tilt * np.arange(width)).astype(np.float32)

    def _bent(self, line: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greater root d of ``d + bend / d = line``, 0 where there is none."""
        squared = line * line - 4 * self.bend
        return np.where((line > 0) & (squared > 0), (line + np.sqrt(np.maximum(squared, 0))) / 2, 0)

    def horizon_row(self, column: float) -> float:
        """Return the row at which the line's disparity vanishes."""
        return -(self.intercept + self.tilt * column) / self.slope

    def pitch_rad(self, camera: StereoCamera) -> float:
        """Return the camera's pitch against the ground in radians, positive where it looks down."""
        return math.atan2(self._at_centre(camera), math.hypot(self.slope * camera.fy, self.tilt * camera.fx))

    def roll_rad(self, camera: StereoCamera) -> float:
        """Return the camera's roll against the ground in radians, positive where the right side hangs lower."""
        return math.atan2(self.tilt * camera.fx, self.slope * camera.fy)

    def camera_height_m(self, camera: StereoCamera) -> float:
        """Return the camera's height above the ground in metres."""
        per_metre = math.hypot(self.slope * camera.fy, self.tilt * camera.fx, self._at_centre(camera))
        return camera.baseline_m * camera.fx / per_metre

    def distance_m(self, row: NDArray[np.float64] | float, camera: StereoCamera) -> NDArray[np.float64]:
        """Return how far ahead on the ground `row` is, at the principal column; infinite from the horizon up."""
        row = np.asarray(row, np.float64)
        disparity = self._bent(self.slope * row + self.intercept + self.tilt * camera.cx)
        pitch = self.pitch_rad(camera)
        ahead = math.cos(pitch) - (row - camera.cy) / camera.fy * math.sin(pitch)
        with np.errstate(divide="ignore"):
            return np.where(disparity > 0, camera.fx * camera.baseline_m / disparity * ahead, np.inf)

    def _at_centre(self, camera: StereoCamera) -> float:
        """Return the line's disparity at the principal point."""
        return self.slope * camera.cy + self.intercept + self.tilt * camera.cx


@dataclass(frozen=True, slots=True)
class ShortRange:
    """What u-v-disparity finds in one frame of (H, W) pixels and D disparities.

    Attributes
    ----------
    occupancy
        uint8 (H, W): 0 ground, 100 obstacle or above the horizon, 255 unknown.
    line
        The ground line; None where there is none, and then all is unknown.
    u_disparity
        uint16 (D, W): number of pixels per disparity and column.
    v_disparity
        int32 (H, D): number of pixels per row and disparity, without those of obstacles.
    obstacle_disparity
        float32 (H, W): the disparity of pixels in obstacle cells of the u-disparity; 0 elsewhere.
    """

    occupancy: NDArray[np.uint8]
    line: GroundLine | None
    u_disparity: NDArray[np.uint16]
    v_disparity: NDArray[np.int32]
    obstacle_disparity: NDArray[np.float32]

    @property
    def mask(self) -> NDArray[np.uint8]:
        """Traversable pixels, uint8 (H, W): 255 traversable, 0 not."""
        return traversable_mask(self.occupancy)


def traversable_mask(occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return 255 where `occupancy` is ground and 0 elsewhere."""
    return np.where(occupancy == GROUND, np.uint8(255), np.uint8(0))


def detect_ground(
    disparity: NDArray[np.float32],
    camera: StereoCamera,
    config: GroundConfig = GroundConfig(),  # noqa: B008 - frozen
) -> ShortRange:
    """Find ground and obstacles in a disparity image.

    Parameters
    ----------
    disparity
        float32 (H, W) in pixels; 0 where there is none.

    Raises
    ------
    ValueError
        If `disparity` is not a two-dimensional float32 array with pixels.
    """
    if disparity.ndim != 2 or disparity.size == 0 or disparity.dtype != np.float32:
        raise ValueError(f"disparity is {disparity.dtype} {disparity.shape}; give float32 (height, width), not empty")
    disparity = np.ascontiguousarray(disparity)
    n_disparities = min(int(disparity.max()) + 2, _MAX_DISPARITIES)
    histogram = u_disparity(disparity, n_disparities=n_disparities)
    cells = obstacle_cells(histogram, camera, n_rows=disparity.shape[0], config=config)
    obstacles = select_cells(disparity, cells)
    v_histogram = v_disparity(np.where(obstacles > 0, np.float32(0), disparity), n_disparities=n_disparities)
    line = find_ground_line(v_histogram, camera, config=config)
    if line is not None:
        line = _refit(line, disparity, camera, config)
    return ShortRange(
        occupancy=back_project(disparity, obstacles, line, camera, config=config),
        line=line,
        u_disparity=histogram,
        v_disparity=v_histogram,
        obstacle_disparity=obstacles,
    )


def u_disparity(disparity: NDArray[np.float32], *, n_disparities: int) -> NDArray[np.uint16]:
    """Return the histogram of disparity per column, uint16 (`n_disparities`, W)."""
    histogram = np.zeros((n_disparities, disparity.shape[1]), np.uint16)
    _count_columns(disparity, histogram)
    return histogram


def v_disparity(disparity: NDArray[np.float32], *, n_disparities: int) -> NDArray[np.int32]:
    """Return the histogram of disparity per row, int32 (H, `n_disparities`)."""
    histogram = np.zeros((disparity.shape[0], n_disparities), np.int32)
    _count_rows(disparity, histogram)
    return histogram


def obstacle_cells(
    histogram: NDArray[np.uint16], camera: StereoCamera, *, n_rows: int, config: GroundConfig
) -> NDArray[np.bool_]:
    """Return the cells (D, W) of a u-disparity that upright obstacles fill.

    An obstacle at disparity d covers ``height_m * d / baseline_m`` pixels of a column, whatever the focal length.
    """
    rows_per_metre = camera.fy / camera.fx * np.arange(histogram.shape[0]) / camera.baseline_m
    least = np.maximum(config.obstacle_height_m * rows_per_metre, config.min_obstacle_share * n_rows)
    filled = (histogram > least[:, None]).astype(np.uint8)
    return cv2.morphologyEx(filled, cv2.MORPH_CLOSE, np.ones((3, 5), np.uint8)) > 0


def select_cells(disparity: NDArray[np.float32], cells: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return `disparity` where its cell of the u-disparity is set, and 0 elsewhere."""
    selected = np.zeros_like(disparity)
    _select(disparity, cells, selected)
    return selected


def find_ground_line(histogram: NDArray[np.int32], camera: StereoCamera, *, config: GroundConfig) -> GroundLine | None:
    """Find the ground correlation line in a v-disparity (H, D) by a Hough transform over horizon and slope.

    Each cell votes with its count for all the lines through it that a ground can have: the camera's height and
    pitch are within the configured bounds. None is returned where no cell votes.
    """
    n_rows, n_disparities = histogram.shape
    reach = math.tan(math.radians(config.max_pitch_deg)) * camera.fy
    first = math.floor(camera.cy - reach)
    n_horizons = max(math.floor(min(camera.cy + reach, n_rows) - first) // _HORIZON_STEP, 1)
    per_height = camera.baseline_m * camera.fx / camera.fy
    low = math.log(per_height / config.max_camera_height_m)
    high = math.log(per_height / min(config.min_camera_height_m, config.max_camera_height_m))
    n_slopes = math.ceil((high - low) / _SLOPE_STEP) + 1
    votes = np.zeros((n_horizons, n_slopes), np.float32)
    log_disparity = np.log(np.maximum(np.arange(n_disparities), 1))
    log_rows = np.log(np.maximum(np.arange(max(n_rows - first, 1)), 1))
    _vote(histogram, votes, first, (log_disparity - low) / _SLOPE_STEP + 0.5, log_rows / _SLOPE_STEP)
    votes = cv2.GaussianBlur(votes, (0, 0), 1.0)
    horizon, slope = np.unravel_index(int(np.argmax(votes)), votes.shape)
    if votes[horizon, slope] <= 0:
        return None
    pixels_per_row = math.exp(low + float(slope) * _SLOPE_STEP)
    return GroundLine(pixels_per_row, -pixels_per_row * float(first + int(horizon) * _HORIZON_STEP))


def _refit(
    line: GroundLine, disparity: NDArray[np.float32], camera: StereoCamera, config: GroundConfig
) -> GroundLine | None:
    """Return the line fitted to the pixels near it by Tukey's biweight; None where too few are near.

    Things stand on the ground and never hang below it, so the weight falls off sooner for pixels above it.
    """
    sampled = disparity[::_SAMPLING, ::_SAMPLING]
    rows, columns = np.nonzero(sampled)
    samples = [np.asarray(part, np.float64) for part in (rows * _SAMPLING, columns * _SAMPLING, sampled[rows, columns])]
    fitted = np.array([line.slope, line.intercept, 0.0, 0.0])
    noise, relative = 2 * config.noise_px, config.max_step_m / line.camera_height_m(camera)
    n_terms = {"line": 2, "plane": 3, "curved": 4}[config.shape]
    for _ in range(_ITERATIONS):
        near, below, normal, right = _normal_equations(*samples, fitted, noise, relative)
        if (
            near < max(config.min_support * below, n_terms)
            or _row_spread(normal) < _MIN_ROW_SPREAD * disparity.shape[0]
        ):
            return None
        normal, right = normal[:n_terms, :n_terms], right[:n_terms]
        stiffness = normal[1, 1] * np.array([1e-9, 0.0, 1e-6 * disparity.shape[1] ** 2, _STIFFNESS])[:n_terms]
        right -= stiffness * np.array([0.0, 0.0, 0.0, fitted[3]])[:n_terms]
        change = np.linalg.solve(normal + np.diag(stiffness), right)
        fitted[:n_terms] += change
        if abs(change[0]) * disparity.shape[0] + abs(change[1]) < _CONVERGED_PX:
            break
    return GroundLine(*fitted.tolist()) if fitted[0] > 0 else None


def _row_spread(normal: NDArray[np.float64]) -> float:
    """Return the standard deviation of the rows that normal equations were made from."""
    mean = normal[0, 1] / normal[1, 1]
    return math.sqrt(max(normal[0, 0] / normal[1, 1] - mean * mean, 0.0))


def back_project(
    disparity: NDArray[np.float32],
    obstacles: NDArray[np.float32],
    line: GroundLine | None,
    camera: StereoCamera,
    *,
    config: GroundConfig,
) -> NDArray[np.uint8]:
    """Return which pixels are on the ground line, uint8 (H, W) as in `ShortRange.occupancy`.

    The tolerance is the disparity's noise and what `max_step_m` makes at the pixel's distance. A thing at height h over
    a ground of disparity d, seen from height H, has the disparity ``d * H / (H - h)``.
    """
    occupancy = np.full(disparity.shape, UNKNOWN, np.uint8)
    if line is None:
        return occupancy
    camera_height = line.camera_height_m(camera)
    step = min(config.max_step_m / camera_height, 0.9)
    stands = min(config.min_obstacle_m / camera_height, 0.9) if config.min_obstacle_m else math.inf
    coefficients = np.array([line.slope, line.intercept, line.tilt, line.bend])
    _classify(disparity, obstacles, coefficients, config.noise_px, step, stands, occupancy)
    if config.max_hole_px > 1:
        _fill_holes(occupancy, disparity, config.max_hole_px)
    return occupancy


def _fill_holes(occupancy: NDArray[np.uint8], disparity: NDArray[np.float32], size: int) -> None:
    """Set to ground, in place, what has no disparity and lies in holes of the ground up to `size` pixels."""
    ground = (occupancy == GROUND).astype(np.uint8)
    closed = cv2.morphologyEx(ground, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))
    occupancy[(closed > 0) & (disparity <= 0) & (occupancy == UNKNOWN)] = GROUND


@numba.njit(cache=True, nogil=True)
def _count_columns(disparity, histogram):  # type: ignore[no-untyped-def]
    """Add each disparity, rounded, to its column of the histogram (D, W)."""
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = int(disparity[v, u] + 0.5)
            if 0 < d < histogram.shape[0]:
                histogram[d, u] += 1


@numba.njit(cache=True, nogil=True)
def _count_rows(disparity, histogram):  # type: ignore[no-untyped-def]
    """Add each disparity, rounded, to its row of the histogram (H, D)."""
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = int(disparity[v, u] + 0.5)
            if 0 < d < histogram.shape[1]:
                histogram[v, d] += 1


@numba.njit(cache=True, nogil=True)
def _select(disparity, cells, selected):  # type: ignore[no-untyped-def]
    """Copy the disparities whose cell (D, W) is set."""
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = int(disparity[v, u] + 0.5)
            if 0 < d < cells.shape[0] and cells[d, u]:
                selected[v, u] = disparity[v, u]


@numba.njit(cache=True, nogil=True)
def _vote(histogram, votes, first, disparity_bins, row_bins):  # type: ignore[no-untyped-def]
    """Let each cell (v, d) vote for horizon and slope: log slope = log d - log(v - horizon)."""
    for v in range(max(first, 0), histogram.shape[0]):
        for d in range(_MIN_DISPARITY, histogram.shape[1]):
            count = histogram[v, d]
            if count > 0:
                for i in range(votes.shape[0]):
                    below = v - first - i * _HORIZON_STEP
                    if below <= 0:
                        break
                    k = disparity_bins[d] - row_bins[below]
                    if 0 <= k < votes.shape[1]:
                        votes[i, int(k)] += count


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz", "nnan", "ninf"})
def _normal_equations(rows, columns, values, fitted, noise, relative):  # type: ignore[no-untyped-def]
    """Return pixels near the ground and below its horizon, and the normal equations of a Gauss-Newton step.

    The loop has no branches and sums numbers of one type, so that the compiler vectorises it: six times as fast.
    """
    slope, intercept, tilt, bend = fitted
    near = below = n00 = n01 = n02 = n03 = n11 = n12 = n13 = n22 = n23 = n33 = r0 = r1 = r2 = r3 = 0.0
    for i in range(values.size):
        v, u = rows[i], columns[i]
        line = slope * v + intercept + tilt * u
        root = np.sqrt(max(line * line - 4 * bend, 1e-6))
        expected = (line + root) / 2
        counts = 1.0 if expected > noise else 0.0
        expected = max(expected, 1e-6)
        inverse = 1 / (noise + relative * expected)
        difference = values[i] - expected
        residual = difference * inverse
        residual = residual * _ABOVE if residual > 0 else residual
        biweight = max(1 - residual * residual, 0.0) * counts
        below += counts
        near += 1.0 if biweight > 0 else 0.0
        weight = (biweight * inverse) ** 2
        g1 = min(expected / root, _MAX_STEEPNESS)  # at a crest it grows without bounds
        g0, g2, g3 = g1 * v, g1 * u, -g1 / expected
        n00 += weight * g0 * g0
        n01 += weight * g0 * g1
        n02 += weight * g0 * g2
        n03 += weight * g0 * g3
        n11 += weight * g1 * g1
        n12 += weight * g1 * g2
        n13 += weight * g1 * g3
        n22 += weight * g2 * g2
        n23 += weight * g2 * g3
        n33 += weight * g3 * g3
        weight *= difference
        r0 += weight * g0
        r1 += weight * g1
        r2 += weight * g2
        r3 += weight * g3
    normal = np.array([[n00, n01, n02, n03], [n01, n11, n12, n13], [n02, n12, n22, n23], [n03, n13, n23, n33]])
    return near, below, normal, np.array([r0, r1, r2, r3])


@numba.njit(cache=True, nogil=True)
def _classify(disparity, obstacles, coefficients, noise, step, stands, occupancy):  # type: ignore[no-untyped-def]
    """Write ground and obstacle pixels; `step` and `stands` are heights as shares of the camera's height."""
    slope, intercept, tilt, bend = coefficients
    for v in range(disparity.shape[0]):
        for u in range(disparity.shape[1]):
            d = disparity[v, u]
            line = slope * v + intercept + tilt * u
            squared = line * line - 4 * bend
            if line <= 0 or squared <= 0 or (stands == np.inf and obstacles[v, u] > 0):
                occupancy[v, u] = OBSTACLE
            elif d > 0:
                expected = (line + np.sqrt(squared)) / 2
                if d - expected > max(noise, stands * d):
                    occupancy[v, u] = OBSTACLE
                if expected > noise and abs(d - expected) < noise + step * expected:
                    occupancy[v, u] = GROUND
