"""The ground ahead as a grid of cells that are free, occupied or unknown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MapsConfig
from lrtrav_ros.frame import valid_disparity
from lrtrav_ros.mapping import _grid_kernels as kernels
from lrtrav_ros.mapping._settings import checked_settings
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.slopes import with_slopes
from lrtrav_ros.method.ground import GroundLine
from lrtrav_ros.numerics.checks import check_array, check_number, check_type

FREE = kernels.FREE
"""Value of a cell in which nothing but ground is seen."""

OCCUPIED = kernels.OCCUPIED
"""Value of a cell in which an obstacle stands, or hangs too low."""

UNKNOWN = kernels.UNSEEN
"""Value of a cell that is hidden, out of sight, or beyond what the image resolves."""

_FARTHEST_M = 1e9  # farther than anything on earth: cells can be counted up to there
_MOST_CELLS = 1e6  # a metre


@runtime_checkable
class NearGround(Protocol):
    """Ground and obstacles of the short range, such as `ShortRange`.

    Attributes
    ----------
    occupancy : (H, W) ndarray of uint8
        0 ground, 100 obstacle or above the horizon, 255 unknown.
    disparity : (H, W) ndarray of float32
        In pixels; 0 for none.
    line : GroundLine or None
        The ground line; None where there is none.
    """

    @property
    def occupancy(self) -> NDArray[np.uint8]: ...
    @property
    def disparity(self) -> NDArray[np.float32]: ...
    @property
    def line(self) -> GroundLine | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A map of the ground, laid out as a ``nav_msgs/OccupancyGrid``.

    Parameters
    ----------
    cells : (n_y, n_x) ndarray of int8
        0 free, 100 occupied, -1 unknown; x grows along rows and y from row to row.
    resolution_m : float
        Size of a cell in metres.
    origin_m : (float, float)
        x and y of the outer corner of the first cell, in metres.

    Raises
    ------
    TypeError, ValueError
        If the cells are not such an array, or have no size.
    """

    cells: NDArray[np.int8]
    resolution_m: float
    origin_m: tuple[float, float]

    def __post_init__(self) -> None:
        check_array("cells", self.cells, np.int8, ("n_y", "n_x"))
        resolution_m = check_number("resolution_m", self.resolution_m, above=1 / _MOST_CELLS, most=_MOST_CELLS)
        if not isinstance(self.origin_m, tuple) or len(self.origin_m) != 2:
            raise TypeError(f"origin_m is {self.origin_m!r}; give a tuple of x and y")
        x, y = (
            check_number(f"{name} of the origin", value, most=_FARTHEST_M)
            for name, value in zip(("x", "y"), self.origin_m, strict=True)
        )
        object.__setattr__(self, "resolution_m", resolution_m)
        object.__setattr__(self, "origin_m", (x, y))

    @property
    def image(self) -> NDArray[np.uint8]:
        """The grid as a picture, uint8 (n_x, n_y): x up and y to the left; 0 free, 100 occupied, 255 unknown."""
        return np.ascontiguousarray(self.cells[::-1, ::-1].T).view(np.uint8)

    def in_frame(self, x_m: float, y_m: float, yaw_rad: float) -> Grid:
        """Return this grid, drawn anew along the axes of another frame of the same plane.

        A cell is occupied where a part of an occupied one is in it, and free where its middle is free and no part of it
        is occupied.

        Parameters
        ----------
        x_m, y_m : float
            Where the origin of this grid's frame is in the other one, in metres.
        yaw_rad : float
            By how much it is turned to the left there, in radians.

        Returns
        -------
        Grid
            Large enough to hold this one; its corner is at whole multiples of the cells' size.

        Raises
        ------
        ValueError
            If a number is not finite.
        """
        x_m = check_number("x_m", x_m, most=_FARTHEST_M)
        y_m = check_number("y_m", y_m, most=_FARTHEST_M)
        yaw_rad = check_number("yaw_rad", yaw_rad, most=_FARTHEST_M)
        cos, sin, size = math.cos(yaw_rad), math.sin(yaw_rad), self.resolution_m
        n_y, n_x = self.cells.shape
        corners = np.array(self.origin_m) + size * np.array([(0, 0), (n_x, 0), (0, n_y), (n_x, n_y)])
        turned = corners @ np.array([[cos, sin], [-sin, cos]]) + (x_m, y_m)
        # What is a whole number of cells but for rounding takes no cell more.
        first = np.floor(turned.min(axis=0) / size + 1e-6).astype(int)
        end = np.ceil(turned.max(axis=0) / size - 1e-6).astype(int)
        n_columns, n_rows = (end - first).tolist()
        cells = np.full((n_rows, n_columns), UNKNOWN, np.int8)
        # Places in cells: those of the new grid, turned and moved, are those of this one.
        offset = (first * size - (x_m, y_m)) @ np.array([[cos, -sin], [sin, cos]]) - self.origin_m
        x, y = (offset / size).tolist()
        kernels.resample(np.require(self.cells, requirements=("C", "W")), cos, sin, x, y, cells)
        return Grid(cells, size, (float(first[0] * size), float(first[1] * size)))


def ground_grid(
    occupancy: NDArray[np.uint8], near: NearGround, camera: StereoCamera, config: MapsConfig | None = None
) -> Grid:
    """Project the traversable region and the obstacles onto the ground.

    A thing stands where its face is: the disparity of its lowest part tells, and the row of its foot where there is
    none. It hides what is behind it. Parts of things that are nearer than their foot, as crowns, are where they are,
    unless they hang higher than `clearance_m`; ground that is seen below those that hang lower is unknown. A cell is
    free where nothing but ground is seen in it; disparity has the last word on what is ground, and ground that rises
    (`with_slopes`), of which the fitted line does not tell where it is, is unknown.

    Parameters
    ----------
    occupancy : (H, W) ndarray of uint8
        Long range: 0 free, 100 occupied, 255 unknown.
    near : NearGround
        Short range of the same image: occupancy, disparity and ground line. Without a line all is unknown.
    camera : StereoCamera
        Calibration.
    config : MapsConfig, optional
        Size of the grid and its cells, `max_row_m` and `clearance_m`.

    Returns
    -------
    Grid
        In the `GroundFrame`: x ahead from 0, y to the left; the camera's foot point is in the middle of the near edge.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    check_type("near", near, NearGround)
    config = checked_settings(config, near.line, camera)
    check_array("occupancy", occupancy, np.uint8, ("H", "W"))
    check_array("near.occupancy", near.occupancy, np.uint8, occupancy.shape)
    check_array("near.disparity", near.disparity, np.float32, occupancy.shape)
    n_x, n_y = (max(round(size / config.cell_m), 1) for size in (config.length_m, config.width_m))
    half_width = n_y * config.cell_m / 2
    cells = np.full((n_y, n_x), UNKNOWN, np.int8)
    if near.line is not None:
        layout = kernels.Layout(config.cell_m, half_width, config.max_row_m, config.clearance_m)
        _fill(cells, occupancy, near, _view(near.line, camera), layout, camera, config)
    return Grid(cells, config.cell_m, (0.0, -half_width))


def _view(line: GroundLine, camera: StereoCamera) -> kernels.View:
    """Return a camera and the ground as kernels take them."""
    frame = GroundFrame.of(line, camera)
    # Whole numbers would have a kernel compiled anew.
    return kernels.View(
        fx=float(camera.fx),
        fy=float(camera.fy),
        cx=float(camera.cx),
        cy=float(camera.cy),
        focal_baseline=float(camera.fx * camera.baseline_m),
        height=float(frame.height_m),
        rotation=frame.rotation,
        slope=float(line.slope),
        intercept=float(line.intercept),
        tilt=float(line.tilt),
        bend=float(line.bend),
    )


def _fill(
    cells: NDArray[np.int8],
    occupancy: NDArray[np.uint8],
    near: NearGround,
    view: kernels.View,
    layout: kernels.Layout,
    camera: StereoCamera,
    config: MapsConfig,
) -> None:
    """Fill the cells."""
    # Numba compiles kernels anew for read-only arrays, which those of messages may be.
    short_range = np.require(near.occupancy, requirements=("C", "W"))
    disparity = np.require(valid_disparity(near.disparity), requirements=("C", "W"))
    rising = with_slopes(short_range, disparity, near.line, camera, config)
    sure = np.array(occupancy, order="C")
    feet, hanging = np.zeros(cells.shape, np.int32), np.zeros(cells.shape, np.int32)
    kernels.find_things(short_range, rising, disparity, view, layout, sure, feet, hanging)
    kernels.fill_cells(sure, view, layout, feet, hanging, cells)
