"""Rectification: a pair of raw images as one in which rows match, by the calibration of both lenses.

Lenses follow OpenCV's two models: radial and tangential distortion (``plumb_bob``, ``rational_polynomial``), and
``equidistant``, the fisheye model of Kannala and Brandt.

References
----------
J. Kannala, S. S. Brandt: A generic camera model and calibration method for conventional, wide-angle, and fish-eye
lenses. IEEE TPAMI 28 (2006), 1335-1340. https://doi.org/10.1109/TPAMI.2006.153
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.frame import Image
from lrtrav_ros.numerics.checks import check_array, check_type

Rotation: TypeAlias = tuple[float, ...]
"""A rotation matrix, row by row."""

_EQUIDISTANT = "equidistant"
_ALIASES = {"radtan": "plumb_bob", "radial-tangential": "plumb_bob", "fisheye": _EQUIDISTANT}
_UNDISTORTED = ("", "none")
_N_COEFFICIENTS = {"plumb_bob": (4, 5, 8, 12, 14), "rational_polynomial": (4, 5, 8, 12, 14), _EQUIDISTANT: (4,)}

_MAX_SIZE_PX = 2**15 - 1  # of cv2.remap
_ORTHOGONAL = 1e-3  # what rounded text leaves of it
_MAX_COEFFICIENT = 1e6  # of distortion; those of rational models go to some thousands
_MAX_ANGLE = math.radians(89.0)  # no plane shows more
_MAX_VIEW = math.radians(65.0)  # what lies farther off the axis is stretched too much to be of use
_N_ANGLES = 20_000
_OUTSIDE = np.float32(-10)
_LEAST_SHIFT_M = 1e-6  # between two cameras: squares of what is much smaller vanish, those of its inverse overflow


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """Size, focal lengths, principal point and distortion of a camera's raw images.

    Parameters
    ----------
    width, height : int
        Size of the images in pixels.
    fx, fy, cx, cy : float
        Focal lengths and principal point in pixels.
    distortion_model : str
        ``plumb_bob`` (or ``radtan``, ``radial-tangential``), ``rational_polynomial``, ``equidistant`` (or ``fisheye``);
        empty or ``none`` for a lens without distortion.
    distortion : tuple of float
        Coefficients in OpenCV's order: k1, k2, p1, p2, k3, k4 .. k6, s1 .. s4, tx, ty, as many as there are of 4, 5, 8,
        12 and 14; k1 .. k4 of an equidistant lens; none for a lens without distortion.

    Raises
    ------
    ValueError
        If a value is not finite or not positive where it must be, or the distortion does not fit its model.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion_model: str = ""
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.fy is None:  # which a camera would take
            raise ValueError("fy is None; give a finite number")
        camera = StereoCamera(
            fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy, baseline_m=1.0, width=self.width, height=self.height
        )
        for name in ("fx", "fy", "cx", "cy"):
            object.__setattr__(self, name, getattr(camera, name))
        if self.width is None or max(self.width, self.height) > _MAX_SIZE_PX:
            raise ValueError(f"images of {self.width} x {self.height} pixels; give a size up to {_MAX_SIZE_PX} pixels")
        check_type("distortion_model", self.distortion_model, str)
        name = _ALIASES.get(self.distortion_model, self.distortion_model)
        if not isinstance(self.distortion, Sequence) or not all(map(_is_finite, self.distortion)):
            raise ValueError(f"distortion is {self.distortion!r}; give finite numbers")
        if any(abs(value) > _MAX_COEFFICIENT for value in self.distortion):
            raise ValueError(f"distortion is {self.distortion!r}; give numbers up to {_MAX_COEFFICIENT:g}")
        distortion = tuple(map(float, self.distortion))
        if name in _UNDISTORTED and not any(distortion):
            name, distortion = "plumb_bob", ()
        if name not in _N_COEFFICIENTS:
            raise ValueError(f"distortion model {name!r} is not supported; give {', '.join(_N_COEFFICIENTS)}")
        if distortion and len(distortion) not in _N_COEFFICIENTS[name]:
            counts = " or ".join(map(str, _N_COEFFICIENTS[name]))
            raise ValueError(f"distortion has {len(distortion)} coefficients; {name} has {counts}")
        object.__setattr__(self, "distortion_model", name)
        object.__setattr__(self, "distortion", distortion)

    @property
    def is_equidistant(self) -> bool:
        """Whether it is a fisheye lens; one without coefficients has an ideal one's distortion."""
        return self.distortion_model == _EQUIDISTANT

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The camera matrix K, (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """The distortion as OpenCV takes it, with zeros for a lens that has none."""
        return np.array(self.distortion or (0.0,) * 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class RawPair:
    """Calibration of a pair of raw images, and of the rectified pair that is made of them.

    Parameters
    ----------
    left, right : Lens
        The two lenses.
    left_rotation, right_rotation : tuple of 9 float
        R of each, row by row: rectified = R @ raw, for directions in the cameras' optical frames.
    camera : StereoCamera
        The rectified pair, with the size of its images.

    Raises
    ------
    ValueError
        If a rotation is none, or `camera` has no size.
    """

    left: Lens
    right: Lens
    left_rotation: Rotation
    right_rotation: Rotation
    camera: StereoCamera

    def __post_init__(self) -> None:
        check_type("left", self.left, Lens)
        check_type("right", self.right, Lens)
        check_type("camera", self.camera, StereoCamera)
        for name in ("left_rotation", "right_rotation"):
            object.__setattr__(self, name, checked_rotation(name, getattr(self, name)))
        if self.camera.width is None:
            raise ValueError("the rectified camera has no size; give width and height")


def raw_pair(left: Lens, right: Lens, *, rotation: Sequence[float], translation_m: Sequence[float]) -> RawPair:
    """Return the calibration of a pair of which lenses and pose are known; rectified images have the left one's size.

    The cameras share the rotation between them, and the baseline becomes the direction of rows. A camera alone would
    have the focal length at which its image fills the view at the middles of all sides, 65 degrees off the axis at
    most; the pair has the shorter of both. It is the choice of OpenCV 4 for fisheye pairs (``balance`` 0, principal
    points equal), here for every lens and with every version.

    Parameters
    ----------
    left, right : Lens
        The two lenses.
    rotation : sequence of 9 float
        Row by row, as stereo calibration gives it: right = `rotation` @ left + `translation_m`.
    translation_m : sequence of 3 float
        In metres; for a camera to the right it is about (-baseline, 0, 0).

    Raises
    ------
    ValueError
        If `rotation` is none, or the right camera is not to the right of the left one.
    """
    check_type("left", left, Lens)
    check_type("right", right, Lens)
    matrix = _matrix(checked_rotation("rotation", rotation))
    shift = np.array(_checked_translation(translation_m))
    left_rotation, right_rotation = _row_rotations(matrix, shift)
    views = _view(left, left_rotation), _view(right, right_rotation)
    return RawPair(
        left=left,
        right=right,
        left_rotation=_rotation(left_rotation),
        right_rotation=_rotation(right_rotation),
        camera=StereoCamera(
            fx=min(view.focal for view in views),
            cx=(views[0].cx + views[1].cx) / 2,
            cy=(views[0].cy + views[1].cy) / 2,
            baseline_m=float(np.linalg.norm(shift)),
            width=left.width,
            height=left.height,
        ),
    )


def checked_rotation(name: str, values: Sequence[float]) -> Rotation:
    """Return 9 numbers as a rotation; raises ValueError, with the name, where they are none."""
    if isinstance(values, (Sequence, np.ndarray)) and len(values) == 9 and all(map(_is_finite, values)):
        matrix = _matrix(values).clip(-2, 2)  # no rotation has such numbers, and their squares may be infinite
        if np.allclose(matrix @ matrix.T, np.eye(3), rtol=0, atol=_ORTHOGONAL) and np.linalg.det(matrix) > 0:
            return _rotation(matrix)
    shown = list(values) if isinstance(values, (Sequence, np.ndarray)) else values
    raise ValueError(f"{name} is {shown!r}; give a rotation matrix of 9 numbers, row by row")


class Rectification:
    """Rectifies pairs of one calibration; its maps are computed once.

    Pixels of the rectified images that the raw ones do not show are 0.

    Parameters
    ----------
    pair : RawPair
        The calibration.

    Attributes
    ----------
    pair : RawPair
        The calibration; its `camera` is that of the rectified images.
    unseen : (H, W) ndarray of bool or None
        Which pixels of the left rectified image the raw one does not show; None where it shows all.

    Raises
    ------
    ValueError
        If one of the rectified images would show nothing.
    """

    def __init__(self, pair: RawPair) -> None:
        check_type("pair", pair, RawPair)
        self.pair = pair
        left, right = (
            _Maps.of(lens, rotation, pair.camera)
            for lens, rotation in ((pair.left, pair.left_rotation), (pair.right, pair.right_rotation))
        )
        if left.unseen.all() or right.unseen.all():
            side = "left" if left.unseen.all() else "right"
            raise ValueError(
                f"the rectified {side} image would show nothing; calibrate the pair, so that R and P fit it"
            )
        self._left_maps, self._right_maps = left.fixed, right.fixed
        self.unseen = left.unseen if left.unseen.any() else None

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Return the rectified images.

        Parameters
        ----------
        left, right : (H, W) or (H, W, 3) ndarray of uint8 or uint16
            Raw images, grey or BGR, of the size that their lens is calibrated for.

        Raises
        ------
        TypeError, ValueError
            If an image is not such an array, or of another size.
        """
        return (
            _rectified("left image", left, self.pair.left, self._left_maps),
            _rectified("right image", right, self.pair.right, self._right_maps),
        )


@lru_cache(maxsize=4)
def rectification(pair: RawPair) -> Rectification:
    """Return the rectification of a calibration; that of the last few is kept."""
    return Rectification(pair)


@lru_cache(maxsize=4)
def unseen_pixels(lens: Lens, rotation: Rotation, camera: StereoCamera) -> NDArray[np.bool_] | None:
    """Return which pixels of the rectified image a raw one does not show, as `Rectification` does for the left one.

    Parameters
    ----------
    lens : Lens
        Of the raw image.
    rotation : tuple of 9 float
        Its R, row by row.
    camera : StereoCamera
        The rectified image's, with its size.

    Returns
    -------
    (H, W) ndarray of bool or None
        None where it shows all.
    """
    unseen = _Maps.of(lens, rotation, camera).unseen
    return unseen if unseen.any() else None


def _rectified(name: str, image: Image, lens: Lens, maps: tuple[Image, Image]) -> Image:
    check_array(name, image, (np.uint8, np.uint16), ("H", "W"), ("H", "W", 3))
    if image.shape[:2] != (lens.height, lens.width):
        raise ValueError(
            f"the calibration is for {lens.width} x {lens.height} pixels, but the {name} is "
            f"{image.shape[1]} x {image.shape[0]}; calibrate for this size"
        )
    return cv2.remap(
        np.ascontiguousarray(image), *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Maps:
    """The maps of `cv2.remap` for one camera, and which pixels they have no source for.

    Attributes
    ----------
    fixed : pair of ndarray
        In 32nds of a pixel: the same images with each version of OpenCV.
    unseen : (H, W) ndarray of bool
    """

    fixed: tuple[Image, Image]
    unseen: NDArray[np.bool_]

    @classmethod
    def of(cls, lens: Lens, rotation: Rotation, camera: StereoCamera) -> _Maps:
        """Return the maps that make rectified images out of raw ones."""
        compute = cv2.fisheye.initUndistortRectifyMap if lens.is_equidistant else cv2.initUndistortRectifyMap
        turn = _matrix(rotation)
        projection = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], np.float64)
        size = camera.width, camera.height
        maps = compute(lens.matrix, lens.coefficients, turn, projection, size, cv2.CV_32FC1)
        is_seen = _is_seen(lens, np.linalg.inv(projection @ turn), size)
        x, y = (np.where(is_seen & (abs(values) <= _MAX_SIZE_PX), values, _OUTSIDE) for values in maps)
        unseen = (x < 0) | (x > lens.width - 1) | (y < 0) | (y > lens.height - 1)
        return cls(cv2.convertMaps(x, y, cv2.CV_16SC2), unseen)


def _is_seen(lens: Lens, unprojection: NDArray[np.floating[Any]], size: tuple[Any, Any]) -> NDArray[np.bool_]:
    """Return whether the lens model holds in the direction of each pixel, (H, W).

    Beyond the angle up to which distortion grows, polynomials turn back and would show the image's inside again.
    """
    u, v = np.arange(size[0]), np.arange(size[1])[:, None]
    x, y, z = (row[0] * u + row[1] * v + row[2] for row in unprojection)
    angles, _ = _profile(lens)
    return np.arctan2(np.hypot(x, y), z) < angles[-1]


@lru_cache(maxsize=8)
def _profile(lens: Lens) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angles to the optical axis, and how far from it the lens shows them, as long as that grows."""
    angles = np.linspace(0, _MAX_ANGLE, _N_ANGLES)
    k = lens.coefficients
    if lens.is_equidistant:
        radii = angles * (1 + _polynomial(angles**2, k[:4]))
    else:
        squares = np.tan(angles) ** 2
        k = np.concatenate([k, np.zeros(8 - min(k.size, 8))])
        radii = np.tan(angles) * (1 + _polynomial(squares, k[[0, 1, 4]])) / (1 + _polynomial(squares, k[5:8]))
    is_growing = np.diff(radii) > 0
    n = _N_ANGLES if is_growing.all() else int(np.argmin(is_growing)) + 1
    return angles[:n], radii[:n]


def _polynomial(x: NDArray[np.float64], coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return c0 x + c1 x^2 + …"""
    return sum((c * x ** (i + 1) for i, c in enumerate(coefficients)), np.zeros(x.size))


def _row_rotations(
    rotation: NDArray[np.float64], shift: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return R of both cameras: half of what lies between them, then the baseline onto the x axis."""
    half = cv2.Rodrigues(cv2.Rodrigues(rotation)[0] / 2)[0]
    direction = half.T @ shift / np.linalg.norm(shift)
    if direction[0] > -math.sqrt(0.5):
        raise ValueError(
            f"translation_m is {tuple(shift.tolist())}, so the right camera is not to the right of the left one; give "
            "the pose by which right = rotation @ left + translation_m, in metres"
        )
    axis = np.cross(direction, (-1.0, 0.0, 0.0))
    sine = float(np.linalg.norm(axis))
    turn = cv2.Rodrigues(axis / sine * math.asin(min(sine, 1.0)) if sine > 0 else axis)[0]
    return turn @ half, turn @ half.T


@dataclass(frozen=True, slots=True)
class _View:
    """Focal length and principal point in pixels."""

    focal: float
    cx: float
    cy: float


def _view(lens: Lens, rotation: NDArray[np.float64]) -> _View:
    """Return the view that brings the middles of the raw image's sides onto the sides of one as large."""
    w, h = lens.width, lens.height
    middles = np.array([[w / 2, 0], [w, h / 2], [w / 2, h], [0, h / 2]])
    x, y = _directions(lens, rotation, middles).T
    aspect = lens.fx / lens.fy
    y = y * aspect
    cx, cy = x.mean() * aspect, y.mean() / aspect  # sic: OpenCV 4
    half_width, half_height = w / 2, h / 2 * aspect
    focal = max(
        half_width / (cx - x.min()),
        half_width / (x.max() - cx),
        half_height / (cy - y.min()),
        half_height / (y.max() - cy),
    )
    return _View(float(focal / aspect), float(half_width - cx * focal), float((half_height - cy * focal) / aspect))


def _directions(lens: Lens, rotation: NDArray[np.float64], pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where raw pixels (N, 2) lie on the rectified plane at depth 1; tangential distortion is neglected."""
    angles, radii = _profile(lens)
    distorted = (pixels - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    radius = np.linalg.norm(distorted, axis=1)
    grown = np.tan(np.minimum(np.interp(radius, radii, angles), _MAX_VIEW)) / np.maximum(radius, 1e-12)
    rays = np.column_stack([distorted * grown[:, None], np.ones(len(pixels))]) @ rotation.T
    return rays[:, :2] / rays[:, 2:]


def _is_finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _checked_translation(values: Sequence[float]) -> tuple[float, ...]:
    if (
        not isinstance(values, (Sequence, np.ndarray))
        or len(values) != 3
        or not all(map(_is_finite, values))
        or not _LEAST_SHIFT_M <= max(map(abs, values)) <= 1 / _LEAST_SHIFT_M
    ):
        raise ValueError(f"translation_m is {values!r}; give three finite numbers, not all 0, in metres")
    return tuple(map(float, values))


def _matrix(rotation: Sequence[float]) -> NDArray[np.float64]:
    return np.array(rotation, np.float64).reshape(3, 3)


def _rotation(matrix: NDArray[np.float64]) -> Rotation:
    return tuple(map(float, matrix.reshape(-1)))
