"""Standing obstacles, and those that a mask misses."""

import cv2
import numpy as np
import pytest

from lrtrav_ros.evaluation.scoring.obstacles import ObstacleCounts, ObstacleScores, StandingObstacles

SHAPE = (50, 80)  # 0.1 % are 4 pixels


def truth_with(*boxes):
    """All ground, but for boxes (top, bottom, left, right) of obstacles."""
    truth = np.full(SHAPE, 255, np.uint8)
    for top, bottom, left, right in boxes:
        truth[top:bottom, left:right] = 0
    return truth


def free(*boxes):
    """A mask that calls these boxes free and nothing else."""
    return np.where(truth_with(*boxes) == 0, 255, 0).astype(np.uint8)


def missed(truth, mask):
    return StandingObstacles(truth).missed(mask).tolist()


def test_obstacle_is_missed_where_more_than_half_of_it_is_called_free():
    truth = truth_with((10, 20, 10, 20), (30, 40, 10, 20), (30, 40, 50, 60))
    mask = free((10, 15, 10, 20), (30, 35, 10, 20), (35, 36, 10, 11), (0, 9, 0, 80))
    assert missed(truth, mask) == [False, True, False]


@pytest.mark.parametrize(
    ("box", "n"),
    [
        ((10, 12, 10, 12), 1),
        ((10, 11, 10, 13), 0),  # 3 pixels of 4000
        ((0, 12, 10, 20), 0),
        ((1, 12, 10, 20), 1),
        ((40, 50, 70, 80), 1),
    ],
)
def test_obstacle_is_large_enough_and_does_not_reach_the_top_row(box, n):
    assert StandingObstacles(truth_with(box)).n == n


def test_obstacles_are_connected_over_corners_and_parted_by_what_is_unknown():
    truth = truth_with((10, 14, 10, 14), (14, 18, 14, 18))
    assert StandingObstacles(truth).n == 1
    truth[14, 14] = 128
    assert StandingObstacles(truth).n == 2


def test_frame_without_obstacles_has_none_missed():
    for truth in (truth_with(), np.zeros(SHAPE, np.uint8), np.full(SHAPE, 128, np.uint8)):
        obstacles = StandingObstacles(truth, distance_m=np.full(SHAPE, 3.0), height_m=np.zeros(SHAPE, np.float32))
        scores = obstacles.scores([free((0, 50, 0, 80))])
        assert scores == ObstacleScores(ObstacleCounts(0, 0.0), (ObstacleCounts(),) * 5, (ObstacleCounts(),) * 4)
        assert obstacles.outlines() == []


def test_obstacles_are_counted_by_the_distance_of_their_feet():
    distance_m = np.full(SHAPE, np.inf)
    distance_m[20:] = (200 / np.arange(1, 31))[:, None]  # row 19 + n is 200 / n metres ahead
    boxes = (15, 24, 2, 8), (22, 30, 10, 20), (35, 45, 30, 40), (35, 45, 50, 60), (5, 12, 60, 70)
    obstacles = StandingObstacles(truth_with(*boxes), distance_m=distance_m)
    scores = obstacles.scores([free((35, 45, 30, 40), (15, 24, 2, 8), (5, 12, 60, 70))])
    none = ObstacleCounts()
    assert scores.total == ObstacleCounts(5, 3)
    assert scores.by_distance == (none, ObstacleCounts(2, 1), none, ObstacleCounts(1, 0), ObstacleCounts(1, 1))
    assert scores.by_height == ()


def test_obstacles_are_counted_by_their_height_whatever_a_few_pixels_say():
    boxes = ((10, 20, 10, 20), (10, 20, 30, 40), (10, 20, 50, 60), (30, 40, 10, 20))
    height_m = np.zeros(SHAPE, np.float32)
    for (top, bottom, left, right), height in zip(boxes, (0.15, 0.2, 2.5, 0.7), strict=True):
        height_m[top:bottom, left:right] = np.linspace(height, 0, bottom - top)[:, None]
    height_m[10, 10:13] = 9.0
    obstacles = StandingObstacles(truth_with(*boxes), height_m=height_m)
    scores = obstacles.scores([free(boxes[0], boxes[2])])
    assert scores.by_height == (ObstacleCounts(1, 1), ObstacleCounts(1, 0), ObstacleCounts(1, 0), ObstacleCounts(1, 1))
    assert scores.by_distance == ()


def test_seeds_count_as_their_mean():
    box = (10, 20, 10, 20)
    obstacles = StandingObstacles(truth_with(box, (30, 40, 10, 20)), distance_m=np.full(SHAPE, 7.0))
    scores = obstacles.scores([free(box), free(), free(), free(box)])
    assert scores.total == scores.by_distance[1] == ObstacleCounts(2, 0.5)


def test_sums_leave_out_bands_that_are_not_known():
    bands = (ObstacleCounts(2, 1.0), ObstacleCounts(1, 0.0))
    known, unknown = ObstacleScores(ObstacleCounts(3, 1.0), bands, bands), ObstacleScores(ObstacleCounts(4, 2.0))
    assert known + unknown == unknown + known == ObstacleScores(ObstacleCounts(7, 3.0), bands, bands)
    assert (known + known).by_height == (ObstacleCounts(4, 2.0), ObstacleCounts(2, 0.0))


def test_mask_of_another_size_is_refused():
    with pytest.raises(ValueError, match=r"mask is \(80, 50\), ground truth \(50, 80\)"):
        StandingObstacles(truth_with()).missed(free().T)


def test_outlines_enclose_each_obstacle():
    first, second = StandingObstacles(truth_with((10, 20, 10, 25), (30, 40, 50, 52))).outlines()
    assert cv2.boundingRect(first) == (10, 10, 15, 10)
    assert cv2.boundingRect(second) == (50, 30, 2, 10)
