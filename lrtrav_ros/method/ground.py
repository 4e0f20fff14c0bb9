"""Short-range ground by u-v-disparity.

The ground line in the v-disparity image is found by a weighted Hough transform and refitted robustly; pixels on it are
traversable.

References
----------
.. [1] H. Lu et al., "Long Range Traversable Region Detection Based on Superpixels Clustering for Mobile Robots",
       IROS 2015, section II.
.. [2] R. Labayrade, D. Aubert and J.-P. Tarel, "Real time obstacle detection in stereovision on non flat road geometry
       through v-disparity representation", IV 2002.
.. [3] Z. Hu and K. Uchimura, "U-V-disparity: an efficient algorithm for stereovision based scene analysis", IV 2005.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import GroundConfig
from lrtrav_ros.frame import valid_disparity
from lrtrav_ros.method import _ground_kernels as kernels
from lrtrav_ros.numerics.checks import check_array, check_count, check_finite

GROUND = kernels.GROUND
"""Value of a traversable pixel in an occupancy image."""

OBSTACLE = kernels.OBSTACLE
"""Value of a pixel that is not traversable, or above the horizon."""

UNKNOWN = kernels.UNKNOWN
"""Value of a pixel about which nothing is known."""

NO_GROUND = "no ground line found"
"""The reason that results give for a frame without a ground line."""

SHAPES = {"line": 2, "plane": 3, "curved": 4}
"""Shapes of the ground (setting ``ground.shape``): how many of slope, intercept, tilt and bend are fitted."""

_MAX_DISPARITIES = 1024  # what is nearer is left to the plane
_SLOPE_STEP = 0.03  # relative step between the slopes of the Hough transform
_FIT_STEP_M = 0.1  # the fit begins without tilt and bend, and has to see ground that is off by as much
_SAMPLING = 3  # rows and columns between the pixels of the refit
_ITERATIONS = 20
_MIN_ROW_SPREAD = 0.01  # of the image's height: in fewer rows the slope is left open
_CONVERGED_PX = 1e-3
_MAX_SHARE = 0.9  # of the camera's height: things as high as the camera have no disparity of their own
_SIGNIFICANT_FACE = 3.8  # times the noise of outlying pixels; with Gaussian noise, 8 standard deviations
_SIGNIFICANT_DROP = 7.3  # times that of typical ones, 5 standard deviations: mismatches are above the ground as a rule
_CLEAR_PX = 4.0  # ground of less disparity says little about noise
_MAX_BELOW = 0.25  # of the ground's disparity: what is farther below is a drop or a mismatch
_LEAST_DROP_PX = (3, 7)  # rows and columns
_STIFFNESS = 1e-4  # of the bend: with little ground in sight it stays flat


@dataclass(frozen=True, slots=True)
class GroundLine:
    """The ground's disparity: ``line = slope * v + intercept + tilt * u``, and for a ground that bends what follows.

    Over ground with a constant vertical curvature, disparity d obeys ``d + bend / d = line``; the greater root is seen.

    Parameters
    ----------
    slope : float
        Disparity in pixels per row, above 0: baseline / camera height for a camera that looks ahead.
    intercept : float
        Disparity at row 0 and column 0, in pixels.
    tilt : float
        Disparity in pixels per column; 0 without roll.
    bend : float
        In square pixels; above 0 the ground falls away, and ends in a crest where the line is 2 sqrt(bend); 0 for flat
        ground.

    Raises
    ------
    ValueError
        If a value is not finite, or the slope is not above 0.
    """

    slope: float
    intercept: float
    tilt: float = 0.0
    bend: float = 0.0

    def __post_init__(self) -> None:
        check_finite("line", np.array([self.slope, self.intercept, self.tilt, self.bend]))
        if self.slope <= 0:
            raise ValueError(f"slope is {self.slope}; give a value above 0, for ground is nearer in lower rows")

    def disparity(self, height: int, width: int) -> NDArray[np.float32]:
        """Return the ground's disparity in an image.

        Parameters
        ----------
        height, width : int
            Size of the image in pixels.

        Returns
        -------
        (height, width) ndarray of float32
            Disparity in pixels; 0 from the horizon up.
        """
        rows = self.slope * np.arange(height) + self.intercept
        return self._bent(rows[:, None] + self.tilt * np.arange(width)).astype(np.float32)

    def horizon_row(self, column: float) -> float:
        """Return the row [px] at which the line's disparity vanishes in a column [px]."""
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
        """Return the distance ahead, along the ground, of what is seen in the principal column.

        Parameters
        ----------
        row : float or ndarray of float64
            One or several rows [px].
        camera : StereoCamera
            Calibration.

        Returns
        -------
        ndarray of float64
            Metres, in the shape of `row`; infinite from the horizon up.
        """
        row = np.asarray(row, np.float64)
        disparity = self._bent(self.slope * row + self.intercept + self.tilt * camera.cx)
        pitch = self.pitch_rad(camera)
        ahead = math.cos(pitch) - (row - camera.cy) / camera.fy * math.sin(pitch)
        with np.errstate(divide="ignore"):
            return np.where(disparity > 0, camera.fx * camera.baseline_m / disparity * ahead, np.inf)

    def _bent(self, line: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greater root d of ``d + bend / d = line``, 0 where there is none."""
        squared = line * line - 4 * self.bend
        return np.where((line > 0) & (squared > 0), (line + np.sqrt(np.maximum(squared, 0))) / 2, 0)

    def _at_centre(self, camera: StereoCamera) -> float:
        """Return the line's disparity at the principal point."""
        return self.slope * camera.cy + self.intercept + self.tilt * camera.cx


@dataclass(frozen=True, slots=True, eq=False)
class ShortRange:
    """Ground and obstacles of one frame, and the images of u-v-disparity that they were found in.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        The disparity that all of this was found in, in pixels; 0 for none.
    occupancy : (H, W) ndarray of uint8
        0 ground, 100 obstacle or above the horizon, 255 unknown.
    line : GroundLine or None
        The ground line; None where there is none, and then all is unknown.
    u_disparity : (D, W) ndarray of uint16
        Number of pixels per disparity and column.
    v_disparity : (H, D) ndarray of int32
        Number of pixels per row and disparity, without those of obstacles.
    obstacle_disparity : (H, W) ndarray of float32
        The disparity of pixels in obstacle cells of the u-disparity; 0 elsewhere.
    """

    disparity: NDArray[np.float32]
    occupancy: NDArray[np.uint8]
    line: GroundLine | None
    u_disparity: NDArray[np.uint16]
    v_disparity: NDArray[np.int32]
    obstacle_disparity: NDArray[np.float32]

    @property
    def mask(self) -> NDArray[np.uint8]:
        """Traversable pixels, (H, W) ndarray of uint8: 255 traversable, 0 not."""
        return traversable_mask(self.occupancy)


def traversable_mask(occupancy: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the traversable pixels of an occupancy image.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        0 ground, 100 obstacle, 255 unknown.

    Returns
    -------
    (H, W) ndarray of uint8
        255 for ground and 0 for all else.

    Raises
    ------
    TypeError, ValueError
        If `occupancy` is not such an array.
    """
    check_array("occupancy", occupancy, np.uint8, ("H", "W"))
    return np.where(occupancy == GROUND, np.uint8(255), np.uint8(0))


def detect_ground(
    disparity: NDArray[np.float32], camera: StereoCamera, config: GroundConfig | None = None
) -> ShortRange:
    """Find ground and obstacles in a disparity image.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none. Values that are no disparity (negative, NaN, infinite, absurdly large) count as none.
    camera : StereoCamera
        Calibration.
    config : GroundConfig, optional
        The height of obstacles, the mounting of the camera and the precision of disparity; the defaults suit a robot
        with a stereo camera.

    Returns
    -------
    ShortRange
        Without a ground line where too little ground is in sight.

    Raises
    ------
    TypeError, ValueError
        If `disparity` is not such an array.
    """
    config = config or GroundConfig()
    disparity = _checked("disparity", disparity)
    n_disparities = min(int(disparity.max()) + 2, _MAX_DISPARITIES)
    histogram = kernels.count_columns(disparity, n_disparities)
    obstacles = kernels.select(disparity, obstacle_cells(histogram, camera, config, n_rows=disparity.shape[0]))
    v_histogram = kernels.count_rows(disparity - obstacles, n_disparities)
    line = find_ground_line(v_histogram, camera, config)
    if line is not None:
        line = _refit(line, disparity, camera, config)
    return ShortRange(
        disparity=disparity,
        occupancy=_occupancy(disparity, obstacles, line, camera, config),
        line=line,
        u_disparity=histogram,
        v_disparity=v_histogram,
        obstacle_disparity=obstacles,
    )


def u_disparity(disparity: NDArray[np.float32], *, n_disparities: int) -> NDArray[np.uint16]:
    """Return the histogram of disparity per column.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none, as in `detect_ground`.
    n_disparities : int
        Number of bins D; disparities are rounded, and what exceeds D - 1 is left out.

    Returns
    -------
    (D, W) ndarray of uint16
        Number of pixels; none in bin 0.

    Raises
    ------
    TypeError, ValueError
        If `disparity` is not such an array, or `n_disparities` is no number above 0.
    """
    disparity = _checked("disparity", disparity)
    check_count("n_disparities", n_disparities)
    return kernels.count_columns(disparity, n_disparities)


def v_disparity(disparity: NDArray[np.float32], *, n_disparities: int) -> NDArray[np.int32]:
    """Return the histogram of disparity per row.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none, as in `detect_ground`.
    n_disparities : int
        Number of bins D; disparities are rounded, and what exceeds D - 1 is left out.

    Returns
    -------
    (H, D) ndarray of int32
        Number of pixels; none in bin 0.

    Raises
    ------
    TypeError, ValueError
        If `disparity` is not such an array, or `n_disparities` is no number above 0.
    """
    disparity = _checked("disparity", disparity)
    check_count("n_disparities", n_disparities)
    return kernels.count_rows(disparity, n_disparities)


def obstacle_cells(
    histogram: NDArray[np.uint16], camera: StereoCamera, config: GroundConfig | None = None, *, n_rows: int
) -> NDArray[np.bool_]:
    """Return the cells of a u-disparity that upright obstacles fill.

    An obstacle at disparity d covers ``height_m * d / baseline_m`` pixels of a column, whatever the focal length.

    Parameters
    ----------
    histogram : (D, W) ndarray of uint16
        A u-disparity.
    camera : StereoCamera
        Calibration.
    config : GroundConfig, optional
        `obstacle_height_m` and `min_obstacle_share` are used: raise them where low things are taken for obstacles.
    n_rows : int
        Height of the image in pixels.

    Returns
    -------
    (D, W) ndarray of bool

    Raises
    ------
    TypeError, ValueError
        If `histogram` is not such an array, or `n_rows` is no number above 0.
    """
    config = config or GroundConfig()
    check_array("histogram", histogram, np.uint16, ("D", "W"))
    check_count("n_rows", n_rows)
    rows_per_metre = camera.fy / camera.fx * np.arange(histogram.shape[0]) / camera.baseline_m
    least = np.maximum(config.obstacle_height_m * rows_per_metre, config.min_obstacle_share * n_rows)
    filled = (histogram > least[:, None]).astype(np.uint8)
    return cv2.morphologyEx(filled, cv2.MORPH_CLOSE, np.ones((3, 5), np.uint8)) > 0


def select_cells(disparity: NDArray[np.float32], cells: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the disparity of the pixels that lie in chosen cells of the u-disparity.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none, as in `detect_ground`.
    cells : (D, W) ndarray of bool
        The chosen cells.

    Returns
    -------
    (H, W) ndarray of float32
        0 for all other pixels.

    Raises
    ------
    TypeError, ValueError
        If an argument is not such an array, or the two differ in width.
    """
    disparity = _checked("disparity", disparity)
    check_array("cells", cells, np.bool_, ("D", disparity.shape[1]))
    return kernels.select(disparity, np.ascontiguousarray(cells))


def find_ground_line(
    histogram: NDArray[np.int32], camera: StereoCamera, config: GroundConfig | None = None
) -> GroundLine | None:
    """Find the ground correlation line in a v-disparity by a Hough transform over horizon and slope.

    Each cell votes with its count for all the lines through it that a ground can have.

    Parameters
    ----------
    histogram : (H, D) ndarray of int32
        A v-disparity.
    camera : StereoCamera
        Calibration.
    config : GroundConfig, optional
        `min_camera_height_m`, `max_camera_height_m` and `max_pitch_deg` are used: bounds of the camera's mounting,
        which are best set generously.

    Returns
    -------
    GroundLine or None
        None where no cell votes.

    Raises
    ------
    TypeError, ValueError
        If `histogram` is not such an array.
    """
    config = config or GroundConfig()
    check_array("histogram", histogram, np.int32, ("H", "D"))
    n_rows, n_disparities = histogram.shape
    reach = math.tan(math.radians(config.max_pitch_deg)) * camera.fy
    first = math.floor(camera.cy - reach)
    n_horizons = max(math.floor(min(camera.cy + reach, n_rows) - first) // kernels.HORIZON_STEP, 1)
    per_height = camera.baseline_m * camera.fx / camera.fy
    low = math.log(per_height / config.max_camera_height_m)
    high = math.log(per_height / min(config.min_camera_height_m, config.max_camera_height_m))
    n_slopes = math.ceil((high - low) / _SLOPE_STEP) + 1
    votes = np.zeros((n_horizons, n_slopes), np.float32)
    log_disparity = np.log(np.maximum(np.arange(n_disparities), 1))
    log_rows = np.log(np.maximum(np.arange(max(n_rows - first, 1)), 1))
    disparity_bins, row_bins = (log_disparity - low) / _SLOPE_STEP + 0.5, log_rows / _SLOPE_STEP
    kernels.vote(np.ascontiguousarray(histogram), votes, first, disparity_bins, row_bins)
    votes = cv2.GaussianBlur(votes, (0, 0), 1.0)
    horizon, slope = np.unravel_index(int(np.argmax(votes)), votes.shape)
    if votes[horizon, slope] <= 0:
        return None
    pixels_per_row = math.exp(low + float(slope) * _SLOPE_STEP)
    return GroundLine(pixels_per_row, -pixels_per_row * float(first + int(horizon) * kernels.HORIZON_STEP))


def _refit(
    line: GroundLine, disparity: NDArray[np.float32], camera: StereoCamera, config: GroundConfig
) -> GroundLine | None:
    """Return the line fitted to the pixels near it by Tukey's biweight; None where too few are near.

    Things stand on the ground and never hang below it, so the weight falls off sooner for pixels above it.
    """
    sampled = disparity[::_SAMPLING, ::_SAMPLING]
    v, u = np.nonzero(sampled)
    rows, columns = (_SAMPLING * v).astype(np.float64), (_SAMPLING * u).astype(np.float64)
    values = sampled[v, u].astype(np.float64)
    fitted = np.array([line.slope, line.intercept, 0.0, 0.0])
    noise, relative = 2 * config.noise_px, max(config.max_step_m, _FIT_STEP_M) / line.camera_height_m(camera)
    n_terms = SHAPES[config.shape]
    for _ in range(_ITERATIONS):
        near, below, normal, right = kernels.normal_equations(rows, columns, values, fitted, noise, relative)
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
    return GroundLine(*fitted.tolist()) if fitted[0] > 0 and np.isfinite(fitted).all() else None


def _row_spread(normal: NDArray[np.float64]) -> float:
    """Return the standard deviation of the rows that normal equations were made from."""
    mean = normal[0, 1] / normal[1, 1]
    return math.sqrt(max(normal[0, 0] / normal[1, 1] - mean * mean, 0.0))


def back_project(
    disparity: NDArray[np.float32],
    obstacles: NDArray[np.float32],
    line: GroundLine | None,
    camera: StereoCamera,
    config: GroundConfig | None = None,
) -> NDArray[np.uint8]:
    """Return which pixels are on the ground line.

    The tolerance is the disparity's noise plus what a step of `max_step_m` makes at the pixel's distance. Where noise
    hides a height of `min_obstacle_m`, nothing is taken for ground. What stands upright is an obstacle down to its
    contact with the ground, the row where the ground has its disparity; so is what lies below the ground.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none, as in `detect_ground`.
    obstacles : (H, W) ndarray of float32
        The disparity of obstacles that the u-disparity shows; 0 elsewhere.
    line : GroundLine or None
        The ground line; without one all is unknown.
    camera : StereoCamera
        Calibration.
    config : GroundConfig, optional
        `noise_px`, `max_step_m`, `min_obstacle_m`, `contact_margin`, `min_drop_m` and `max_hole_px` are used.

    Returns
    -------
    (H, W) ndarray of uint8
        0 ground, 100 obstacle or above the horizon, 255 unknown.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or the two differ in size.
    """
    config = config or GroundConfig()
    disparity, obstacles = _checked("disparity", disparity), _checked("obstacles", obstacles)
    check_array("obstacles", obstacles, np.float32, disparity.shape)
    return _occupancy(disparity, obstacles, line, camera, config)


def _occupancy(
    disparity: NDArray[np.float32],
    obstacles: NDArray[np.float32],
    line: GroundLine | None,
    camera: StereoCamera,
    config: GroundConfig,
) -> NDArray[np.uint8]:
    """Return the occupancy image that `back_project` describes.

    A thing at height h over a ground of disparity d, seen from height H, has the disparity ``d * H / (H - h)``.
    """
    occupancy = np.full(disparity.shape, UNKNOWN, np.uint8)
    if line is None:
        return occupancy
    coefficients = np.array([line.slope, line.intercept, line.tilt, line.bend])
    camera_height = line.camera_height_m(camera)
    step = min(config.max_step_m / camera_height, _MAX_SHARE)
    if not config.min_obstacle_m:
        kernels.classify(disparity, obstacles, coefficients, config.noise_px, step, occupancy)
        return _with_filled_holes(occupancy, disparity, config.max_hole_px)
    expected = kernels.ground_disparity(coefficients, *disparity.shape)
    stands = min(config.min_obstacle_m / camera_height, _MAX_SHARE)
    kernels.classify_by_height(disparity, expected, config.noise_px, step, stands, occupancy)
    typical, outlying = _noise_below(disparity, expected)
    least = max(_SIGNIFICANT_FACE * outlying, 2 * config.noise_px)
    if config.contact_margin < 1:
        kernels.mark_faces(disparity, expected, config.noise_px, least, step, config.contact_margin, occupancy)
    if config.min_drop_m:
        deep = config.min_drop_m / camera_height
        typical = min(typical, config.noise_px / 2)  # where a ditch is most of what is below, it is no noise
        below = kernels.drops(
            disparity,
            expected,
            occupancy,
            config.noise_px,
            max(_SIGNIFICANT_DROP * typical, config.noise_px),
            step,
            deep,
        )
        occupancy[cv2.morphologyEx(below, cv2.MORPH_OPEN, np.ones(_LEAST_DROP_PX, np.uint8)) > 0] = OBSTACLE
    return _with_filled_holes(occupancy, disparity, config.max_hole_px)


def _noise_below(disparity: NDArray[np.float32], expected: NDArray[np.float32]) -> tuple[float, float]:
    """Return median and 97th percentile of how far pixels below the ground are below it, in pixels.

    No thing is there, so that this is noise; but a ditch may be, which the median withstands.
    """
    sampled, ground = disparity[::_SAMPLING, ::_SAMPLING], expected[::_SAMPLING, ::_SAMPLING]
    below = ground - sampled
    residuals = below[(sampled > 0) & (ground > _CLEAR_PX) & (below > 0) & (below < _MAX_BELOW * ground)]
    return (float(np.median(residuals)), float(np.percentile(residuals, 97))) if residuals.size else (0.0, 0.0)


def _with_filled_holes(occupancy: NDArray[np.uint8], disparity: NDArray[np.float32], size: int) -> NDArray[np.uint8]:
    """Return occupancy with ground, set in place, in holes of the ground without disparity, up to `size` pixels."""
    if size > 1:
        ground = (occupancy == GROUND).astype(np.uint8)
        closed = cv2.morphologyEx(ground, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))
        kernels.fill_holes(closed, disparity, occupancy)
    return occupancy


def _checked(name: str, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a disparity image as kernels want it: contiguous, with 0 for what is no disparity."""
    check_array(name, disparity, np.float32, ("H", "W"))
    return np.ascontiguousarray(valid_disparity(disparity))
