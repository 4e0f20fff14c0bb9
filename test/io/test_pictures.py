"""Pictures of results: colours that tell right from wrong."""

from __future__ import annotations

import numpy as np

from lrtrav_ros.io import pictures
from lrtrav_ros.mapping.grid import FREE, OCCUPIED, UNKNOWN, Grid


def test_errors_are_told_by_colour():
    left = np.full((1, 5, 3), 100, np.uint8)
    mask = np.array([[255, 255, 0, 0, 255]], np.uint8)
    truth = np.array([[255, 0, 255, 0, 128]], np.uint8)
    right, wrong, missed, empty, ignored = pictures.error_picture(left, mask, truth)[0].astype(int)
    assert right[1] > right[2]  # green
    assert wrong[2] > wrong[1] > wrong[0]  # vermilion
    assert missed[0] > missed[1] > missed[2]  # blue
    assert len(set(empty)) == 1
    assert len(set(ignored)) == 1
    assert abs(ignored[0] - 128) < abs(empty[0] - 128)
    grey = pictures.error_picture(left[..., 0], mask, truth)[0].astype(int)
    assert np.array_equal(grey[1], wrong)


def test_truth_is_told_by_colour():
    left = np.full((1, 3, 3), 100, np.uint8)
    traversable, not_traversable, ignored = pictures.truth_picture(left, np.array([[255, 0, 128]], np.uint8))[0]
    assert traversable[1] > traversable[2]
    assert list(not_traversable) == [100, 100, 100]
    assert ignored[0] == ignored[1] == ignored[2] > 100


def test_grid_is_drawn_with_ahead_up_and_arcs():
    cells = np.full((40, 60), UNKNOWN, np.int8)  # 4 m wide, 6 m long
    cells[10:30, 20:60] = FREE
    cells[10:15, 40:42] = OCCUPIED  # 4 m ahead, on the right
    drawn = pictures.grid_picture(Grid(cells, 0.1, (0.0, -2.0)))
    assert drawn.shape == (60, 40, 3)
    free, occupied, unknown, arc = drawn[25, 15], drawn[18, 27], drawn[50, 20], drawn[9, 20]
    assert free[1] > free[2] == free[0]
    assert occupied[2] > 2 * occupied[1]
    assert len(set(unknown.tolist())) == 1
    assert arc[1] < free[1]
    assert np.all(drawn[18, 12] == free)  # on the left there is nothing


def test_grid_is_drawn_beside_the_overlay():
    grid = Grid(np.full((20, 30), FREE, np.int8), 0.1, (0.0, -1.0))
    picture = pictures.overlay_beside_grid(np.full((60, 80, 3), 9, np.uint8), grid)
    assert picture.shape == (60, 80 + 40, 3)
    assert np.all(picture[:, :80] == 9)
    low = pictures.overlay_beside_grid(np.full((10, 80, 3), 9, np.uint8), grid)
    assert low.shape == (30, 80 + 20, 3)
    assert np.all(low[10:20, :80] == 9)
    assert not low[:10, :80].any()
