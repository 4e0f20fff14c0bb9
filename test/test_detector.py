"""Tests of the detector as a whole: its inputs, its parts, and images with little or nothing in them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import recorded
from recorded import CAMERA, HEIGHT, WIDTH

from lrtrav_ros import Config, Detector
from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.detector import LongRangeDetector, ShortRangeDetector, Stage, StageRunner
from lrtrav_ros.evaluation.scoring.scores import score
from lrtrav_ros.frame import Frame
from lrtrav_ros.method.ground import detect_ground

SETTINGS = {"stereo.n_disparities": 64, "superpixels.n_superpixels": 60}


@pytest.fixture(scope="module")
def detector():
    return Detector(Config().updated(SETTINGS), CAMERA)


@pytest.fixture(scope="module")
def item():
    return recorded.rendered()[0]


def same(first, second):
    """Whether two detections are equal, bit for bit."""
    return (
        np.array_equal(first.disparity, second.disparity)
        and np.array_equal(first.short_range.occupancy, second.short_range.occupancy)
        and first.short_range.line == second.short_range.line
        and np.array_equal(first.long_range.occupancy, second.long_range.occupancy)
        and np.array_equal(first.long_range.superpixels, second.long_range.superpixels)
        and np.array_equal(first.long_range.clusters, second.long_range.clusters)
    )


def test_finds_the_traversable_region(detector, item):
    result = detector.detect(item.frame.left, item.frame.right)
    short, long = score(result.short_range.mask, item.truth), score(result.long_range.mask, item.truth)
    assert long.precision > 0.9
    assert long.recall > 0.9
    assert long.rmse < short.rmse
    assert result.short_range.line.camera_height_m(CAMERA) == pytest.approx(1.0, abs=0.15)


def test_shapes_types_and_values(detector, item):
    result = detector.detect(item.frame.left, item.frame.right)
    assert (result.disparity.shape, result.disparity.dtype) == ((HEIGHT, WIDTH), np.float32)
    for occupancy in (result.short_range.occupancy, result.long_range.occupancy):
        assert (occupancy.shape, occupancy.dtype) == ((HEIGHT, WIDTH), np.uint8)
        assert set(np.unique(occupancy)) <= {0, 100, 255}
    for mask in (result.short_range.mask, result.long_range.mask):
        assert (mask.shape, mask.dtype) == ((HEIGHT, WIDTH), np.uint8)
        assert set(np.unique(mask)) == {0, 255}
    long = result.long_range
    assert set(np.unique(long.superpixels)) == set(range(len(long.superpixel_clusters)))
    assert set(np.unique(long.clusters)) == set(range(int(long.superpixel_clusters.max()) + 1))
    assert all(value > 0 for value in dataclasses.asdict(result.times).values())


def test_parts_give_what_the_whole_gives(detector, item):
    whole = detector.detect_frame(item.frame)
    short_range = ShortRangeDetector(detector.config).detect(item.frame)
    long_range = LongRangeDetector(detector.config).detect(item.frame.left, short_range.occupancy)
    assert same(whole, dataclasses.replace(whole, short_range=short_range, long_range=long_range))
    assert whole.superpixels is whole.long_range.superpixels
    assert np.array_equal(whole.clusters, long_range.clusters)


def test_stages_run_in_the_order_of_the_paper(detector, item):
    class Recording(StageRunner):
        def __call__(self, stage, function, *args, **kwargs):
            stages.append(stage)
            return super().__call__(stage, function, *args, **kwargs)

    stages = []
    run = Recording()
    result = detector.detect_frame(item.frame, run)
    assert list(dict.fromkeys(stages)) == list(Stage)
    assert result.times == run.times


def test_a_frame_without_image_has_short_range_alone(detector, item):
    frame = Frame(camera=CAMERA, disparity=item.disparity)
    alone = ShortRangeDetector(detector.config).detect(frame)
    both = detector.detect(item.frame.left, disparity=item.disparity)
    assert np.array_equal(alone.occupancy, both.short_range.occupancy)
    with pytest.raises(ValueError, match="no left image"):
        detector.detect_frame(frame)


def test_detector_keeps_no_state(detector, item):
    first = detector.detect(item.frame.left, item.frame.right)
    other = recorded.rendered()[2].frame
    detector.detect(other.left, other.right)
    assert same(first, detector.detect(item.frame.left, item.frame.right))
    assert same(first, Detector(detector.config, CAMERA).detect(item.frame.left, item.frame.right))


def test_disparity_of_the_pair_gives_the_same_as_the_pair(detector, item):
    pair = detector.detect(item.frame.left, item.frame.right)
    given = detector.detect(item.frame.left, disparity=pair.disparity)
    assert same(pair, given)
    assert given.times.matching_ms < 1


def test_depth_is_detected_in_as_disparity_of_its_precision(detector, item):
    depth_m = CAMERA.depth_m(item.disparity)
    result = detector.detect(item.frame.left, depth_m=depth_m)
    np.testing.assert_allclose(result.disparity, item.disparity, rtol=1e-6)
    assert score(result.long_range.mask, item.truth).precision > 0.9
    ground = detector.config.ground
    as_precise = dataclasses.replace(ground, noise_px=ground.depth_noise_px)
    assert np.array_equal(
        result.short_range.occupancy, detect_ground(result.disparity, CAMERA, config=as_precise).occupancy
    )


@pytest.mark.parametrize("source", ["stereo", "disparity", "depth"])
def test_disparity_of_every_source_is_cut_at_the_limit(source):
    (frame,) = recorded.frames(source, n=1)
    whole = Detector(Config().updated(SETTINGS), CAMERA).detect_frame(frame).disparity
    limited = Detector(Config().updated({**SETTINGS, "source.max_depth_m": 6.0}), CAMERA).detect_frame(frame)
    near = whole >= CAMERA.fx * CAMERA.baseline_m / 6.0
    assert 0.1 < near.mean() < 0.9
    assert np.array_equal(limited.disparity, np.where(near, whole, 0))
    assert limited.disparity is limited.short_range.disparity


@pytest.mark.parametrize("given", [[], ["right", "disparity"], ["disparity", "depth_m"], ["right", "depth_m"]])
def test_exactly_one_input_is_needed(detector, item, given):
    inputs = {"right": item.frame.right, "disparity": item.disparity, "depth_m": item.disparity}
    with pytest.raises(ValueError, match="give exactly one of right image, disparity and depth"):
        detector.detect(item.frame.left, **{name: inputs[name] for name in given})


@pytest.mark.parametrize("rule", ["area", "evidence"])
def test_grey_images_are_detected_in(item, rule):
    detector = Detector(Config().updated({**SETTINGS, "extension.rule": rule}), CAMERA)
    left, right = item.frame.left[..., 1], item.frame.right[..., 1]
    result = detector.detect(left, right)
    assert result.image.ndim == 2
    assert score(result.long_range.mask, item.truth).recall > 0.8


@pytest.mark.parametrize("shift", [2, 8])
def test_images_of_16_bits_give_what_those_of_8_bits_do(detector, item, shift):
    left, right = item.frame.left[..., 1].copy(), item.frame.right[..., 1].copy()
    left[0, 0] = right[0, 0] = 255  # the brightest pixel says how many bits are used
    wide = detector.detect(left.astype(np.uint16) << shift, right.astype(np.uint16) << shift)
    narrow = detector.detect(left, right)
    assert wide.image.dtype == np.uint8
    assert same(wide, narrow)


def test_a_right_image_that_is_brighter_is_not_clipped(detector, item):
    left, right = (image[..., 1].astype(np.uint16) for image in (item.frame.left, item.frame.right))
    brighter = detector.detect(left * 8, right * 16)
    assert score(brighter.short_range.mask, item.truth).recall > 0.5
    scaled = detector.detect((left // 2).astype(np.uint8), right.astype(np.uint8))
    assert np.array_equal(brighter.disparity, scaled.disparity)


def test_colour_images_of_16_bits_are_detected_in(detector, item):
    result = detector.detect(item.frame.left.astype(np.uint16) << 4, item.frame.right.astype(np.uint16) << 4)
    assert score(result.long_range.mask, item.truth).recall > 0.9


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (np.zeros((20, 30, 3), np.uint8), np.zeros((20, 31, 3), np.uint8)),
        (np.zeros((20, 30, 3), np.uint8), np.zeros((30, 20, 3), np.uint8)),
        (np.zeros((20, 30, 4), np.uint8), np.zeros((20, 30, 4), np.uint8)),
        (np.zeros((20, 30, 2), np.uint8), np.zeros((20, 30, 2), np.uint8)),
        (np.zeros((20, 30, 3), np.float32), np.zeros((20, 30, 3), np.float32)),
        (np.zeros((20, 30, 3), np.int32), np.zeros((20, 30, 3), np.int32)),
        (np.zeros((0, 30), np.uint8), np.zeros((0, 30), np.uint8)),
        (np.zeros(30, np.uint8), np.zeros(30, np.uint8)),
    ],
)
def test_images_that_do_not_fit_are_refused(detector, left, right):
    with pytest.raises(ValueError, match=r"give|convert"):
        detector.detect(left, right)


@pytest.mark.parametrize(
    "disparity", [np.zeros((20, 31), np.float32), np.zeros((20, 30), np.float64), np.zeros((20, 30, 1), np.float32)]
)
def test_disparity_that_does_not_fit_is_refused(detector, disparity):
    with pytest.raises(ValueError, match="give"):
        detector.detect(np.zeros((20, 30, 3), np.uint8), disparity=disparity)


def test_disparity_with_nan_and_infinity_counts_as_none_there(detector, item):
    disparity = item.disparity.copy()
    disparity[:, 20:40] = 0
    clean = detector.detect(item.frame.left, disparity=disparity)
    disparity[:, 20:30] = np.nan
    disparity[:, 30:35] = np.inf
    disparity[:, 35:38] = -1
    disparity[:, 38:40] = 1e30
    dirty = detector.detect(item.frame.left, disparity=disparity)
    assert np.array_equal(clean.short_range.occupancy, dirty.short_range.occupancy)
    assert np.array_equal(clean.long_range.occupancy, dirty.long_range.occupancy)


@pytest.mark.parametrize("preset", ["robust", "paper"])
@pytest.mark.parametrize("matcher", ["sgbm", "bm", "elas"])
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 3), (16, 16), (48, 90)])
@pytest.mark.parametrize("value", [0, 127, 255])
def test_images_with_nothing_in_them_have_no_traversable_region(preset, matcher, size, value):
    config = Config.preset(preset).updated({"stereo.matcher": matcher, "stereo.n_disparities": 16})
    detector = Detector(config, StereoCamera(fx=50.0, cx=size[1] / 2, cy=size[0] / 2, baseline_m=0.2))
    image = np.full((*size, 3), value, np.uint8)
    for left, right in ((image, image), (image[..., 0], image[..., 0])):
        result = detector.detect(left, right)
        assert result.short_range.line is None
        assert not result.short_range.mask.any()
        assert not result.long_range.mask.any()
        assert result.long_range.superpixels.shape == size


@pytest.mark.parametrize("preset", ["robust", "paper"])
@pytest.mark.parametrize("size", [(1, 1), (3, 2), (16, 16), (17, 90)])
def test_images_of_noise_are_worked_on_whatever_their_size(preset, size):
    config = Config.preset(preset).updated({"stereo.n_disparities": 16})
    detector = Detector(config, StereoCamera(fx=50.0, cx=size[1] / 2, cy=size[0] / 2, baseline_m=0.2))
    rng = np.random.default_rng(1)
    for _ in range(5):
        left, right = rng.integers(0, 256, (2, *size, 3), np.uint8)
        disparity = rng.uniform(-2, 16, size).astype(np.float32)
        for result in (detector.detect(left, right), detector.detect(left, disparity=disparity)):
            assert set(np.unique(result.long_range.mask)) <= {0, 255}
            assert len(result.long_range.superpixel_clusters) == result.long_range.superpixels.max() + 1


def test_wall_in_front_of_the_camera_is_no_ground(detector):
    disparity = np.full((HEIGHT, WIDTH), 30.0, np.float32)
    left = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    result = detector.detect(left, disparity=disparity)
    assert not result.short_range.mask.any()
    assert not result.long_range.mask.any()
