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
from lrtrav_ros.numerics.checks import check_array, check_count, check_number, check_range, check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

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

MOST_COEFFICIENT = 1e15
"""No slope, intercept, tilt or bend of a ground line is as large; what is computed from them stays finite."""

LEAST_SLOPE = 1e-20
"""No slope of a ground line is as small, with any camera as high as 100 m; the height that follows from it is finite,
in single precision too."""

_MAX_DISPARITIES = 1024  # what is nearer is left to the plane
_MOST_ROWS = 2**16 - 1  # that uint16 counts
_MOST_BINS = 2**15  # of a histogram: no disparity is valid beyond
_SLOPE_STEP = 0.03  # relative step between the slopes of the Hough transform
_FIT_STEP_M = 0.1  # the fit begins without tilt and bend, and has to see ground that is off by as much
_SAMPLING = 3  # rows and columns between the pixels of the refit
_MAX_SHARE = 0.9  # of the camera's height: things as high as the camera have no disparity of their own
_MAX_LIFT = 0.25  # of the camera's height, while a line is remembered: more is another ground
_MAX_NOD_RAD = math.radians(10)
_LEAST_SEEN = 0.1  # of the pixels below the horizon: a blinded camera tells nothing
_FIRM_SUPPORT = 0.5  # of the pixels below the horizon, on a line: it is believed whatever was before
_MAX_CONTRADICTING = 0.05  # of the pixels below the horizon, below a line
_SIGNIFICANT_FACE = 3.8  # times the noise of outlying pixels; with Gaussian noise, 8 standard deviations
_SIGNIFICANT_DROP = 15.5  # times that of the lower quartile, 5 standard deviations: mismatches are above as a rule
_LEAST_DROP_PX = (3, 7)  # rows and columns
_LEAST_DROP_M = 0.2  # of width: what a wheel falls into
_LINK_PX = 7  # pieces of a drop beside each other are less far apart
_LEAST_BAND = 160  # rows or columns that are worth another thread's while


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
    TypeError, ValueError
        If a value is no number, not finite or absurdly large, or the slope is not above 0 or absurdly small.
    """

    slope: float
    intercept: float
    tilt: float = 0.0
    bend: float = 0.0

    def __post_init__(self) -> None:
        for name in ("slope", "intercept", "tilt", "bend"):
            value = check_number(name, getattr(self, name), most=MOST_COEFFICIENT)
            object.__setattr__(self, name, value)
        if self.slope < LEAST_SLOPE:
            raise ValueError(
                f"slope is {self.slope}; give a value above 0, at least {LEAST_SLOPE:g}, for ground is nearer in lower "
                "rows"
            )

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """Slope, intercept, tilt and bend, (4,) float64."""
        return np.array([self.slope, self.intercept, self.tilt, self.bend], np.float64)

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

        Raises
        ------
        TypeError, ValueError
            If `row` is neither a finite number nor such an array, of one or two axes.
        """
        check_type("camera", camera, StereoCamera)
        if isinstance(row, np.ndarray):
            check_array("row", row, np.float64, ("n",), ("H", "W"), may_be_empty=True)
            check_range("row", row, -MOST_COEFFICIENT, MOST_COEFFICIENT)
        else:
            row = check_number("row", row, most=MOST_COEFFICIENT)
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
    obstacle_cells : (D, W) ndarray of bool
        The cells of the u-disparity that obstacles fill.
    v_disparity : (H, D) ndarray of int32
        Number of pixels per row and disparity, without those of obstacles.
    is_line_remembered : bool
        Whether the line is that of a frame before, for this one shows too little ground.
    """

    disparity: NDArray[np.float32]
    occupancy: NDArray[np.uint8]
    line: GroundLine | None
    u_disparity: NDArray[np.uint16]
    obstacle_cells: NDArray[np.bool_]
    v_disparity: NDArray[np.int32]
    is_line_remembered: bool = False

    @property
    def obstacle_disparity(self) -> NDArray[np.float32]:
        """The disparity of pixels in obstacle cells, (H, W) ndarray of float32; 0 elsewhere. It is made at each use."""
        return select_cells(self.disparity, self.obstacle_cells)

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
    disparity: NDArray[np.float32],
    camera: StereoCamera,
    config: GroundConfig | None = None,
    *,
    before: GroundLine | None = None,
    team: ThreadTeam = ALONE,
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
    before : GroundLine, optional
        The ground line of a frame shortly before. It is taken where this one shows too little ground for a line of its
        own, or so little that its line has a camera at another height or pitch, and nothing that contradicts.
    team : ThreadTeam
        Threads that share the work; the result does not depend on their number.

    Returns
    -------
    ShortRange
        Without a ground line where too little ground is in sight.

    Raises
    ------
    TypeError, ValueError
        If `disparity` is not such an array, or has more than 65,535 rows.
    """
    config = _checked_config(config, camera, before)
    disparity = _checked("disparity", disparity)
    n_disparities = min(int(disparity.max()) + 2, _MAX_DISPARITIES)
    histogram = _count_columns(disparity, n_disparities, team)
    cells = obstacle_cells(histogram, camera, config, n_rows=disparity.shape[0])
    v_histogram = _count_rows(disparity, ~cells, team)
    line = find_ground_line(v_histogram, camera, config)
    if line is not None:
        line = _refit(line, disparity, camera, config)
    is_line_remembered = before is not None and _is_better(before, line, disparity, camera, config)
    line = before if is_line_remembered else line
    obstacles = None if config.min_obstacle_m else kernels.select(disparity, cells)
    return ShortRange(
        disparity=disparity,
        occupancy=_occupancy(disparity, obstacles, line, camera, config, team),
        line=line,
        u_disparity=histogram,
        obstacle_cells=cells,
        v_disparity=v_histogram,
        is_line_remembered=is_line_remembered,
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
        If `disparity` is not such an array, or has more than 65,535 rows, or `n_disparities` is no number above 0.
    """
    disparity = _checked("disparity", disparity)
    return _count_columns(disparity, check_count("n_disparities", n_disparities, most=_MOST_BINS), ALONE)


def _count_columns(disparity: NDArray[np.float32], n_disparities: int, team: ThreadTeam) -> NDArray[np.uint16]:
    """Return the u-disparity; raises ValueError where an image has more rows than it can count."""
    height, width = disparity.shape
    if height > _MOST_ROWS:
        raise ValueError(f"disparity has {height} rows; give at most {_MOST_ROWS}, as many as a u-disparity can count")
    histogram = np.empty((n_disparities, width), np.uint16)
    team.for_bands(
        lambda first, end: kernels.count_columns(disparity, first, end, histogram), width, least_rows=_LEAST_BAND
    )
    return histogram


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
    n_disparities = check_count("n_disparities", n_disparities, most=_MOST_BINS)
    return _count_rows(disparity, np.ones((n_disparities, disparity.shape[1]), np.bool_), ALONE)


def _count_rows(disparity: NDArray[np.float32], cells: NDArray[np.bool_], team: ThreadTeam) -> NDArray[np.int32]:
    """Return the v-disparity of the pixels in some cells (D, W) of the u-disparity."""
    height, counted = disparity.shape[0], cells.view(np.uint8)
    histogram = np.empty((height, cells.shape[0]), np.int32)
    team.for_bands(
        lambda first, end: kernels.count_rows(disparity, counted, first, end, histogram), height, least_rows=_LEAST_BAND
    )
    return histogram


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
    config = _checked_config(config, camera)
    check_array("histogram", histogram, np.uint16, ("D", "W"))
    n_rows = check_count("n_rows", n_rows)
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
    config = _checked_config(config, camera)
    check_array("histogram", histogram, np.int32, ("H", "D"))
    n_rows, n_disparities = histogram.shape
    reach = math.tan(math.radians(config.max_pitch_deg)) * camera.fy
    first = math.floor(camera.cy - reach)
    n_horizons = max(math.floor(min(camera.cy + reach, n_rows) - first) // kernels.HORIZON_STEP, 1)
    per_height = camera.baseline_m * camera.fx / camera.fy
    low = math.log(per_height / config.max_camera_height_m)
    high = math.log(per_height / min(config.min_camera_height_m, config.max_camera_height_m))
    n_slopes = math.ceil((high - low) / _SLOPE_STEP) + 1
    log_disparity = np.log(np.maximum(np.arange(n_disparities), 1))
    log_rows = np.log(np.maximum(np.arange(max(n_rows - first, 1)), 1))
    disparity_bins, row_bins = (log_disparity - low) / _SLOPE_STEP + 0.5, log_rows / _SLOPE_STEP
    histogram = np.ascontiguousarray(histogram)
    votes = kernels.vote(histogram, first, n_horizons, n_slopes, disparity_bins, row_bins)
    smooth = cv2.GaussianBlur(np.ascontiguousarray(votes.T, np.float32), (0, 0), 1.0)
    horizon, slope = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    if smooth[horizon, slope] <= 0:
        return None
    pixels_per_row = math.exp(low + float(slope) * _SLOPE_STEP)
    return GroundLine(pixels_per_row, -pixels_per_row * float(first + int(horizon) * kernels.HORIZON_STEP))


def _refit(
    line: GroundLine, disparity: NDArray[np.float32], camera: StereoCamera, config: GroundConfig
) -> GroundLine | None:
    """Return the line fitted to the pixels near it by Tukey's biweight; None where too few are near.

    Things stand on the ground and never hang below it, so the weight falls off sooner for pixels above it.
    """
    samples = np.ascontiguousarray(disparity[::_SAMPLING, ::_SAMPLING])
    fitted = np.array([line.slope, line.intercept, 0.0, 0.0])
    noise, relative = 2 * config.noise_px, max(config.max_step_m, _FIT_STEP_M) / line.camera_height_m(camera)
    found = kernels.fit(samples, _SAMPLING, fitted, SHAPES[config.shape], noise, relative, config.min_support)
    return (
        GroundLine(*fitted.tolist())
        if found and fitted[0] >= LEAST_SLOPE and np.abs(fitted).max() <= MOST_COEFFICIENT
        else None
    )


def _is_better(
    before: GroundLine,
    line: GroundLine | None,
    disparity: NDArray[np.float32],
    camera: StereoCamera,
    config: GroundConfig,
) -> bool:
    """Return whether the line of a frame shortly before suits a frame better than its own one, or than none.

    A camera that has pitched up since sees ground below that line, which contradicts it. One that has pitched down sees
    ground above it, and takes it for an obstacle.
    """
    if line is not None and not _is_another(line, before, camera):
        return False
    if line is not None and _shares(line, disparity, camera, config)[0] > _FIRM_SUPPORT:
        return False
    return _shares(before, disparity, camera, config)[1] <= _MAX_CONTRADICTING


def _is_another(line: GroundLine, before: GroundLine, camera: StereoCamera) -> bool:
    """Return whether a line is hardly that of the same ground a moment later; a wall's, most likely."""
    height = line.camera_height_m(camera) / before.camera_height_m(camera)
    pitch_rad = line.pitch_rad(camera) - before.pitch_rad(camera)
    return abs(math.log(height)) > math.log(1 + _MAX_LIFT) or abs(pitch_rad) > _MAX_NOD_RAD


def _shares(
    line: GroundLine, disparity: NDArray[np.float32], camera: StereoCamera, config: GroundConfig
) -> tuple[float, float]:
    """Return which shares of the pixels below the horizon are on a line and below it; 0 and 1 where few are seen."""
    expected = line.disparity(*disparity.shape)[::_SAMPLING, ::_SAMPLING]
    seen = disparity[::_SAMPLING, ::_SAMPLING]
    tolerance = 2 * config.noise_px + expected * min(config.max_step_m / line.camera_height_m(camera), _MAX_SHARE)
    is_below_horizon = expected > tolerance
    judged = is_below_horizon & (seen > 0)
    above = (seen - expected)[judged]
    if above.size <= _LEAST_SEEN * np.count_nonzero(is_below_horizon):
        return 0.0, 1.0
    tolerance = tolerance[judged]
    return float(np.mean(np.abs(above) <= tolerance)), float(np.mean(above < -tolerance))


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
    contact with the ground, the row where the ground has its disparity; so is what lies below the ground, where a wheel
    would fall into it.

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
    config = _checked_config(config, camera, line)
    disparity, obstacles = _checked("disparity", disparity), _checked("obstacles", obstacles)
    check_array("obstacles", obstacles, np.float32, disparity.shape)
    return _occupancy(disparity, obstacles, line, camera, config, ALONE)


def _occupancy(
    disparity: NDArray[np.float32],
    obstacles: NDArray[np.float32] | None,
    line: GroundLine | None,
    camera: StereoCamera,
    config: GroundConfig,
    team: ThreadTeam,
) -> NDArray[np.uint8]:
    """Return the occupancy image that `back_project` describes; `obstacles` are of use without `min_obstacle_m` alone.

    A thing at height h over a ground of disparity d, seen from height H, has the disparity ``d * H / (H - h)``.
    """
    if line is None:
        return np.full(disparity.shape, UNKNOWN, np.uint8)
    camera_height = line.camera_height_m(camera)
    step = min(config.max_step_m / camera_height, _MAX_SHARE)
    if config.min_obstacle_m or obstacles is None:
        return _occupancy_by_height(disparity, line, camera, step, config, team)
    occupancy = np.full(disparity.shape, UNKNOWN, np.uint8)
    kernels.classify(disparity, obstacles, line.coefficients, config.noise_px, step, occupancy)
    _fill_holes(occupancy, disparity, config.max_hole_px)
    return occupancy


def _occupancy_by_height(
    disparity: NDArray[np.float32],
    line: GroundLine,
    camera: StereoCamera,
    step: float,
    config: GroundConfig,
    team: ThreadTeam,
) -> NDArray[np.uint8]:
    """Return the occupancy image by the height of pixels; `step` is a share of the camera's height."""
    noise, coefficients, camera_height = config.noise_px, line.coefficients, line.camera_height_m(camera)
    top = _rows_above_horizon(line, disparity.shape, noise, margin=max(config.max_hole_px, *_LEAST_DROP_PX))
    whole = np.empty(disparity.shape, np.uint8)
    whole[:top] = OBSTACLE
    disparity, occupancy = disparity[top:], whole[top:]
    expected, below = np.empty(disparity.shape, np.float32), np.zeros(disparity.shape, np.uint8)
    typical, outlying = _noise_below(disparity, top, coefficients)
    stands = min(config.min_obstacle_m / camera_height, _MAX_SHARE)
    least_face = max(_SIGNIFICANT_FACE * outlying, 2 * noise)
    least_drop = max(_SIGNIFICANT_DROP * _plausible(typical, noise), noise)
    deep, margin = config.min_drop_m / camera_height, config.contact_margin

    def classify(first: int, end: int) -> None:
        """Classify the pixels of a band of columns."""
        kernels.classify_by_height(disparity, top, coefficients, noise, step, stands, first, end, expected, occupancy)
        if margin < 1:
            kernels.mark_faces(disparity, expected, noise, least_face, step, margin, first, end, occupancy)
        if deep:
            kernels.mark_drops(disparity, expected, occupancy, noise, least_drop, step, deep, first, end, below)

    team.for_bands(classify, disparity.shape[1], least_rows=_LEAST_BAND)
    if below.any():
        _mark_wide(below, expected, camera, occupancy)
    _fill_holes(occupancy, disparity, config.max_hole_px)
    return whole


def _mark_wide(
    below: NDArray[np.uint8], expected: NDArray[np.float32], camera: StereoCamera, occupancy: NDArray[np.uint8]
) -> None:
    """Mark drops among what is below the ground: all pieces beside each other that are as wide together as a wheel."""
    opened = cv2.morphologyEx(below, cv2.MORPH_OPEN, np.ones(_LEAST_DROP_PX, np.uint8))
    left, top, width, height = cv2.boundingRect(opened)
    if not width:
        return
    aside = _LINK_PX - 1
    part = np.s_[top : top + height, max(left - aside, 0) : left + width + aside]
    found = opened[part]
    linked = cv2.dilate(found, np.ones((1, _LINK_PX), np.uint8))
    labels, stats = cv2.connectedComponentsWithStats(linked, connectivity=8)[1:3]
    columns, rows, widths, heights = stats[1:, :4].T
    disparity = expected[part][rows + heights // 2, columns + widths // 2]
    wide = (widths - aside) * camera.baseline_m >= _LEAST_DROP_M * disparity
    occupancy[part][(found > 0) & np.append(False, wide)[labels]] = OBSTACLE


def _rows_above_horizon(line: GroundLine, shape: tuple[int, int], noise: float, *, margin: int) -> int:
    """Return how many rows lie above the horizon as a whole, but for a margin; a multiple of `_SAMPLING`."""
    highest = line.intercept + max(line.tilt * shape[1], 0.0)
    rows = min(max((-noise - highest) / line.slope - margin, 0), shape[0] - 1)  # OpenCV wants one at least
    return int(rows) // _SAMPLING * _SAMPLING


def _noise_below(disparity: NDArray[np.float32], top: int, coefficients: NDArray[np.float64]) -> tuple[float, float]:
    """Return lower quartile and 97th percentile of how far pixels below the ground are below it, in pixels.

    No thing is there, so that this is noise; but a ditch may be, which the quartile withstands.
    """
    residuals = kernels.residuals_below(disparity, top, coefficients, _SAMPLING)
    if not residuals.size:
        return 0.0, 0.0
    places = np.array([0.25, 0.97]) * (residuals.size - 1)
    low, high = np.floor(places).astype(int), np.ceil(places).astype(int)
    ordered = np.partition(residuals, (*low, *high))  # np.percentile takes three times as long
    typical, outlying = ordered[low] + (places - low) * (ordered[high] - ordered[low])
    return float(typical), float(outlying)


def _plausible(typical: float, noise: float) -> float:
    """Return what of the noise of typical pixels below the ground is noise: a ditch that is most of them is none."""
    return min(typical, noise / 2) if typical < noise else noise / 5


def _fill_holes(occupancy: NDArray[np.uint8], disparity: NDArray[np.float32], size: int) -> None:
    """Set ground in holes of the ground without disparity, up to `size` pixels."""
    if size > 1:
        ground = (occupancy == GROUND).astype(np.uint8)
        closed = cv2.morphologyEx(ground, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8))
        kernels.fill_holes(closed, disparity, occupancy)


def _checked_config(config: GroundConfig | None, camera: StereoCamera, line: GroundLine | None = None) -> GroundConfig:
    """Return the settings, the default ones for None, and check all that a function is given beside them and arrays."""
    config = GroundConfig() if config is None else config
    check_type("config", config, GroundConfig)
    check_type("camera", camera, StereoCamera)
    check_type("line", line, GroundLine, may_be_none=True)
    return config


def _checked(name: str, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a disparity image as kernels want it: contiguous, with 0 for what is no disparity."""
    check_array(name, disparity, np.float32, ("H", "W"))
    return np.ascontiguousarray(valid_disparity(disparity))
