"""Pictures of results, for the eye: all are BGR uint8 (H, W, 3)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.frame import to_grey, valid_disparity
from lrtrav_ros.mapping.grid import FREE, OCCUPIED, Grid
from lrtrav_ros.method.ground import GROUND, OBSTACLE
from lrtrav_ros.numerics.checks import check_array, check_image, check_labels, check_type

_SHORT_COLOUR = (60, 200, 60)
_LONG_COLOUR = (220, 170, 40)
_OBSTACLE_COLOUR = (60, 60, 230)
_BORDER_COLOUR = (0, 230, 255)
_IGNORED_COLOUR = (128, 128, 128)
_FREE_COLOUR = (150, 215, 150)
_UNKNOWN_COLOUR = (170, 170, 170)
_ARC_M = 5.0
_INTEGERS = (np.int8, np.uint8, np.int16, np.uint16, np.int32, np.uint32, np.int64, np.uint64)
_MOST_LABELS = 2**26  # no camera has as many pixels
# Vermilion and blue, which can be told apart whatever colours one sees.
_WRONG_COLOUR = (0, 94, 213)
_MISSED_COLOUR = (210, 114, 0)


def overlay(
    left: NDArray[np.uint8], short_range: NDArray[np.uint8], long_range: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Return the left image with short-range ground in green, its extension in blue and obstacles in red.

    Parameters
    ----------
    left : (H, W) or (H, W, 3) ndarray of uint8
        Left image, BGR or grey.
    short_range, long_range : (H, W) ndarray of uint8
        Occupancy of either range: 0 ground or free, 100 obstacle, 255 unknown.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    _check_images(left, short_range=short_range, long_range=long_range)
    picture = colour_image(left)
    _tint(picture, short_range == OBSTACLE, _OBSTACLE_COLOUR, 0.3)
    _tint(picture, (long_range == GROUND) & (short_range != GROUND), _LONG_COLOUR, 0.5)
    _tint(picture, (long_range == GROUND) & (short_range == GROUND), _SHORT_COLOUR, 0.5)
    return picture


def colour_image(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a copy of a BGR or grey image as BGR.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8

    Raises
    ------
    TypeError, ValueError
        If an array is not as above.
    """
    check_image("image", image)
    return cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image.copy()


def superpixel_picture(left: NDArray[np.uint8], superpixels: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """Return the left image with the borders of the superpixels.

    Parameters
    ----------
    left : (H, W) or (H, W, 3) ndarray of uint8
        Left image, BGR or grey.
    superpixels : (H, W) ndarray of int
        The superpixel of each pixel.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    check_image("left", left)
    check_array("superpixels", superpixels, _INTEGERS, left.shape[:2])
    picture = colour_image(left)
    border = np.zeros(superpixels.shape, np.bool_)
    border[:, 1:] |= superpixels[:, 1:] != superpixels[:, :-1]
    border[1:] |= superpixels[1:] != superpixels[:-1]
    picture[border] = _BORDER_COLOUR
    return picture


def label_picture(labels: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """Return each label in a colour of its own; neighbouring numbers differ clearly.

    Parameters
    ----------
    labels : (H, W) ndarray of int
        From 0 up.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above.
    """
    check_array("labels", labels, _INTEGERS, ("H", "W"))
    check_labels("labels", labels, _MOST_LABELS)
    hue = (np.arange(int(labels.max()) + 1) * 0.618034 % 1 * 180).astype(np.uint8)
    hsv = np.stack([hue, np.full_like(hue, 150), np.full_like(hue, 230)], axis=-1)
    return cv2.cvtColor(hsv[None], cv2.COLOR_HSV2BGR)[0][labels]


def disparity_picture(disparity: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return disparity from blue (far) to red (near); black where there is none.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels, 0 for none.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above.
    """
    disparity = valid_disparity(disparity)
    top = float(np.percentile(disparity, 99.5)) or 1.0
    picture = cv2.applyColorMap((disparity / top * 255).clip(0, 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    picture[disparity <= 0] = 0
    return picture


def histogram_picture(histogram: NDArray[np.integer[Any]]) -> NDArray[np.uint8]:
    """Return a u- or v-disparity; its counts are shown by their logarithm.

    Parameters
    ----------
    histogram : (H, W) ndarray of int
        The counts.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above.
    """
    check_array("histogram", histogram, _INTEGERS, ("H", "W"))
    check_labels("histogram", histogram, 2**31)
    logarithm = np.log1p(histogram.astype(np.float32))
    return colour_image((logarithm / max(float(logarithm.max()), 1e-6) * 255).astype(np.uint8))


def grid_picture(grid: Grid) -> NDArray[np.uint8]:
    """Return a grid, ahead up: free cells in green, occupied ones in red, unknown ones in grey, and an arc every 5 m.

    Parameters
    ----------
    grid : Grid
        The map.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above.
    """
    check_type("grid", grid, Grid)
    values = grid.image
    picture = np.full((*values.shape, 3), _UNKNOWN_COLOUR, np.uint8)
    picture[values == FREE] = _FREE_COLOUR
    n_x, n_y = values.shape
    x = grid.origin_m[0] + (n_x - 0.5 - np.arange(n_x)) * grid.resolution_m
    y = grid.origin_m[1] + (n_y - 0.5 - np.arange(n_y)) * grid.resolution_m
    distance = np.hypot(x[:, None], y)
    is_arc = np.abs(distance - _ARC_M * np.maximum(np.rint(distance / _ARC_M), 1)) < 0.6 * grid.resolution_m
    _tint(picture, is_arc, (0, 0, 0), 0.25)
    picture[values == OCCUPIED] = _OBSTACLE_COLOUR
    return picture


def overlay_beside_grid(overlay_picture: NDArray[np.uint8], grid: Grid) -> NDArray[np.uint8]:
    """Return an overlay with the grid on its right, as high as the overlay or, where that is less, as its own cells.

    Parameters
    ----------
    overlay_picture : (H, W, 3) ndarray of uint8
        From `overlay`.
    grid : Grid
        The map of the same frame.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above.
    """
    check_array("overlay", overlay_picture, np.uint8, ("H", "W", 3))
    drawn = grid_picture(grid)
    height = max(len(overlay_picture), len(drawn))
    width = round(drawn.shape[1] * height / len(drawn))
    drawn = np.asarray(cv2.resize(drawn, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)
    missing = height - len(overlay_picture)
    framed = np.pad(overlay_picture, ((missing // 2, missing - missing // 2), (0, 0), (0, 0)))
    return np.hstack([framed, drawn])


def truth_picture(left: NDArray[np.uint8], truth: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the left image with traversable ground in green and ignored or unknown pixels in grey.

    Parameters
    ----------
    left : (H, W) or (H, W, 3) ndarray of uint8
        Left image, BGR or grey.
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 ignored.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    _check_images(left, truth=truth)
    picture = colour_image(left)
    _tint(picture, truth == 255, _SHORT_COLOUR, 0.5)
    _tint(picture, truth == 128, _IGNORED_COLOUR, 0.7)
    return picture


def error_picture(left: NDArray[np.uint8], mask: NDArray[np.uint8], truth: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the left image, pale, with false positives in vermilion and missed ground in blue.

    Parameters
    ----------
    left : (H, W) or (H, W, 3) ndarray of uint8
        Left image, BGR or grey.
    mask : (H, W) ndarray of uint8
        255 traversable, 0 not.
    truth : (H, W) ndarray of uint8
        255 traversable, 0 not, 128 ignored, which is grey.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    _check_images(left, mask=mask, truth=truth)
    picture = colour_image((to_grey(left) // 2 + 110).astype(np.uint8))
    found, traversable, counted = mask > 127, truth == 255, truth != 128
    _tint(picture, ~counted, _IGNORED_COLOUR, 0.7)
    _tint(picture, found & traversable, _SHORT_COLOUR, 0.25)
    _tint(picture, found & ~traversable & counted, _WRONG_COLOUR, 0.8)
    _tint(picture, ~found & traversable, _MISSED_COLOUR, 0.8)
    return picture


def stages_picture(
    left: NDArray[np.uint8],
    *,
    short_range: NDArray[np.uint8],
    superpixels: NDArray[np.integer[Any]],
    clusters: NDArray[np.integer[Any]],
    long_range: NDArray[np.uint8],
    truth: NDArray[np.uint8],
) -> NDArray[np.uint8]:
    """Return the stages as in the paper's figure 1, and the truth, in two rows of three pictures.

    Parameters
    ----------
    left : (H, W) or (H, W, 3) ndarray of uint8
        Left image, BGR or grey.
    short_range, long_range : (H, W) ndarray of uint8
        Occupancy of either range: 0 ground or free, 100 obstacle, 255 unknown.
    superpixels, clusters : (H, W) ndarray of int
        Labels of each pixel.
    truth : (H, W) ndarray of uint8
        See `truth_picture`.

    Raises
    ------
    TypeError, ValueError
        If an array is not as above, or two differ in size.
    """
    _check_images(left, short_range=short_range, long_range=long_range, truth=truth)
    check_array("clusters", clusters, _INTEGERS, left.shape[:2])
    stages = [
        ("left image", colour_image(left)),
        ("short range", overlay(left, short_range, short_range)),
        ("superpixels", superpixel_picture(left, superpixels)),
        ("clusters", label_picture(clusters)),
        ("long range", overlay(left, short_range, long_range)),
        ("truth", truth_picture(left, truth)),
    ]
    titled = [_titled(picture, title) for title, picture in stages]
    return np.vstack([np.hstack(titled[:3]), np.hstack(titled[3:])])


def _check_images(left: NDArray[np.uint8], **images: NDArray[np.uint8]) -> None:
    """Check the left image, and others (H, W) of uint8 and its size, by their names."""
    check_image("left", left)
    for name, image in images.items():
        check_array(name, image, np.uint8, left.shape[:2])


def _titled(picture: NDArray[np.uint8], title: str) -> NDArray[np.uint8]:
    picture = picture.copy()
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.8
    (width, height), _ = cv2.getTextSize(title, font, scale, 1)
    cv2.rectangle(picture, (0, 0), (width + 20, height + 20), (0, 0, 0), cv2.FILLED)
    cv2.putText(picture, title, (10, height + 10), font, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def _tint(picture: NDArray[np.uint8], where: NDArray[np.bool_], colour: tuple[int, int, int], strength: float) -> None:
    """Mix `colour` into a part of the picture, in place."""
    mixed = picture[where] * (1 - strength) + np.array(colour) * strength
    picture[where] = mixed.astype(np.uint8)
