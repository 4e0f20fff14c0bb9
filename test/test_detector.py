"""Tests of the detector as a whole: its inputs, its parts, and images with little or nothing in them."""

from __future__ import annotations

import dataclasses
import pickle
import threading

import numpy as np
import pytest
import recorded
from recorded import CAMERA, HEIGHT, WIDTH

from lrtrav_ros import Config, Detector
from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.detector import LongRangeDetector, ShortRangeDetector, Stage, StageRunner, within_reach
from lrtrav_ros.evaluation.scoring.scores import score
from lrtrav_ros.frame import Frame
from lrtrav_ros.method.ground import detect_ground
from lrtrav_ros.method.memory import Memory

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
    assert (long.confidence.shape, long.confidence.dtype) == ((HEIGHT, WIDTH), np.uint8)
    times_ms = dataclasses.asdict(result.times)
    assert times_ms.pop("clustering_ms") == 0  # `propagation`, the default rule, does without clusters
    assert all(value > 0 for value in times_ms.values())


def test_what_the_camera_does_not_show_is_unknown(detector, item):
    unseen = np.zeros((HEIGHT, WIDTH), np.bool_)
    unseen[-12:], unseen[:, :9] = True, True
    left, right = (np.where(unseen[..., None], np.uint8(0), image) for image in (item.frame.left, item.frame.right))
    frame = dataclasses.replace(item.frame, left=left, right=right, unseen=unseen)
    result = detector.detect_frame(frame)
    assert not result.disparity[unseen].any()
    assert np.all(result.short_range.occupancy[unseen] == 255)
    assert np.all(result.long_range.occupancy[unseen] == 255)
    assert not result.long_range.confidence[unseen].any()
    assert score(result.long_range.mask[~unseen][None], item.truth[~unseen][None]).recall > 0.9


def test_parts_give_what_the_whole_gives(detector, item):
    whole = detector.detect_frame(item.frame)
    short_range = ShortRangeDetector(detector.config).detect(item.frame)
    long_range = LongRangeDetector(detector.config).detect(item.frame.left, short_range.occupancy)
    assert same(whole, dataclasses.replace(whole, short_range=short_range, long_range=long_range))
    assert whole.superpixels is whole.long_range.superpixels
    assert np.array_equal(whole.clusters, long_range.clusters)


@pytest.mark.parametrize(
    ("rule", "left_out"), [("area", set()), ("evidence", set()), ("propagation", {Stage.CLUSTERING})]
)
def test_stages_run_in_the_order_of_the_paper(item, rule, left_out):
    class Recording(StageRunner):
        def __call__(self, stage, function, *args, **kwargs):
            stages.append(stage)
            return super().__call__(stage, function, *args, **kwargs)

    stages = []
    run = Recording()
    detector = Detector(Config().updated({**SETTINGS, "extension.rule": rule, "threads": 1}), CAMERA)
    result = detector.detect_frame(item.frame, run)
    assert list(dict.fromkeys(stages)) == [stage for stage in Stage if stage not in left_out]
    assert result.times == run.times


def test_what_needs_no_disparity_is_done_beside_the_matching(item):
    class Waiting:
        def compute(self, left, right):
            assert looked.wait(timeout=60)
            return item.disparity

    class Announcing(StageRunner):
        def __call__(self, stage, function, *args, **kwargs):
            result = super().__call__(stage, function, *args, **kwargs)
            if stage is Stage.FEATURES:
                looked.set()
            return result

    looked = threading.Event()
    config = Config().updated({**SETTINGS, "threads": 2})
    result = Detector(config, CAMERA, matcher=Waiting()).detect_frame(item.frame, Announcing())
    assert same(result, Detector(config, CAMERA).detect(item.frame.left, disparity=item.disparity))


@pytest.mark.parametrize("threads", [1, 2])
def test_failed_matching_leaves_nothing_undone_behind(item, threads):
    class Failing:
        def compute(self, left, right):
            raise RuntimeError("no matching today")

    config = Config().updated({**SETTINGS, "threads": threads})
    detector = Detector(config, CAMERA, matcher=Failing())
    with pytest.raises(RuntimeError, match="no matching today"):
        detector.detect_frame(item.frame)
    result = detector.detect(item.frame.left, disparity=item.disparity)
    assert same(result, Detector(config, CAMERA).detect(item.frame.left, disparity=item.disparity))


def test_clusters_that_are_found_when_asked_for_are_those_of_the_other_rules(detector, item):
    short_range = detector.short_range.detect(item.frame)
    lazy, eager = (
        LongRangeDetector(detector.config.updated({"extension.rule": rule})).detect(
            item.frame.left, short_range.occupancy
        )
        for rule in ("propagation", "evidence")
    )
    assert np.array_equal(lazy.superpixels, eager.superpixels)
    assert np.array_equal(lazy.superpixel_clusters, eager.superpixel_clusters)
    assert lazy.superpixel_clusters.max() > 3
    assert lazy.superpixel_clusters is lazy.superpixel_clusters  # found once
    assert eager.confidence is None


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


SECOND_NS = 1_000_000_000
THIRD = 40  # columns of each look in the images below


def striped(*colours):
    """Return an image of three stripes of noise around a colour, and which pixels are of each stripe."""
    noise = np.random.default_rng(0).integers(-9, 10, (60, 3 * THIRD, 3))
    image = np.array(colours).repeat(THIRD, axis=0)[None] + noise
    stripes = np.arange(3 * THIRD)[None].repeat(60, axis=0) // THIRD
    return image.astype(np.uint8), [stripes == i for i in range(3)]


WAY, GRASS, DARK = (120, 120, 130), (60, 140, 90), (40, 50, 90)


def seen_before(detector, dark):
    """Show a frame in which short range says of the dark stripe what is given, and of the others what they are."""
    image, (there, way, grass) = striped(DARK, WAY, GRASS)
    occupancy = np.select([there, way, grass], [dark, 0, 100]).astype(np.uint8)
    detector.detect(image, occupancy, stamp_ns=7 * SECOND_NS)


def dark_between(detector, stamp_ns):
    """Show a frame in which nothing is known of a dark stripe between way and grass; return the share that is free."""
    image, (way, dark, grass) = striped(WAY, DARK, GRASS)
    occupancy = np.select([way, grass, dark], [0, 100, 255]).astype(np.uint8)
    return (detector.detect(image, occupancy, stamp_ns=stamp_ns).occupancy[dark] == 0).mean()


@pytest.fixture
def remembering():
    settings = {"superpixels.n_superpixels": 50, "memory.frames": 1, "memory.max_gap_s": 2.0}
    return LongRangeDetector(Config().updated(settings))


@pytest.mark.parametrize(("dark", "free"), [(0, 1.0), (100, 0.0)])
def test_what_was_near_and_known_tells_of_what_is_far_and_dark(remembering, dark, free):
    seen_before(remembering, dark)
    assert dark_between(remembering, 8 * SECOND_NS) == pytest.approx(free, abs=0.05)


@pytest.mark.parametrize("forgets", ["a gap", "a jump back", "on demand", "no frames"])
def test_without_memory_all_pasts_are_the_same(remembering, forgets):
    if forgets == "no frames":
        remembering = LongRangeDetector(remembering.config.updated({"memory.frames": 0}))
    shares = []
    for dark in (0, 100):
        seen_before(remembering, dark)
        if forgets == "on demand":
            remembering.memory.clear()
        shares.append(dark_between(remembering, {"a gap": 10, "a jump back": 6}.get(forgets, 8) * SECOND_NS))
    assert shares[0] == shares[1]


@pytest.mark.parametrize(("min_share", "free"), [(0.0, 1.0), (1.0, 0.0)])
def test_share_that_is_asked_for_decides_what_is_unknown(min_share, free):
    detector = LongRangeDetector(Config().updated({**SETTINGS, "extension.min_share": min_share}))
    assert dark_between(detector, None) == pytest.approx(free, abs=0.05)


def test_a_memory_is_shared_from_its_first_frame(remembering):
    memory = Memory(remembering.config.memory)
    first, second = (LongRangeDetector(remembering.config, memory=memory) for _ in range(2))
    seen_before(first, 0)
    assert len(memory) > 0
    assert dark_between(second, 8 * SECOND_NS) == pytest.approx(1.0, abs=0.05)


def test_the_first_frame_is_the_same_with_memory_and_without(detector, item):
    remembering = Detector(detector.config.updated({"memory.frames": 3}), CAMERA)
    assert same(remembering.detect_frame(item.frame), detector.detect_frame(item.frame))


def test_memory_of_a_sequence_is_deterministic_and_follows_the_stamps_of_the_frames(detector):
    config = detector.config.updated({"memory.frames": 3, "source.max_depth_m": 8.0})
    first, second, jumping = (Detector(config, CAMERA) for _ in range(3))
    *past, last = (item.frame for item in recorded.rendered())
    for frame in past:
        assert same(first.detect_frame(frame), second.detect_frame(frame))
        jumping.detect_frame(frame)
    alone, remembered = Detector(config, CAMERA).detect_frame(last), first.detect_frame(last)
    assert same(remembered, second.detect_frame(last))
    assert len(remembered.long_range.superpixel_clusters) == remembered.superpixels.max() + 1  # none of the past
    assert not np.array_equal(remembered.long_range.confidence, alone.long_range.confidence)
    later = dataclasses.replace(last, stamp_ns=last.stamp_ns + 100 * SECOND_NS)
    assert same(jumping.detect_frame(later), alone)


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


@pytest.mark.parametrize("rule", ["area", "evidence", "propagation"])
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


def test_preset_paper_finds_what_it_always_found():
    rng = np.random.default_rng(4)
    v, u = np.mgrid[:120, :200]
    way = (v > 40) & (abs(u - 100) < (v - 40) * 0.9)
    image = np.where(way[..., None], (110, 112, 118), np.where(v < 40, 190, 70)[..., None] * np.array([1.2, 1.1, 0.8]))
    image = np.clip(image + rng.normal(0, 8, image.shape), 0, 255).astype(np.uint8)
    disparity = np.where((v > 25) & (v < 80) & (u < 30), 12.0, np.maximum((v - 40) * 0.3, 0))
    near = (disparity > 4) & (way | (u < 30))  # the grass has no disparity
    disparity = np.where(near, disparity + rng.normal(0, 0.2, disparity.shape), 0).astype(np.float32)
    camera = StereoCamera(fx=150.0, cx=100.0, cy=40.0, baseline_m=0.3)
    result = Detector(Config.preset("paper"), camera).detect(image, disparity=disparity)
    counts = [
        [int((occupancy == value).sum()) for value in (0, 100, 255)]
        for occupancy in (result.short_range.occupancy, result.long_range.occupancy)
    ]
    # As found before feet, drops, holes and propagation; another BLAS may move a few pixels.
    assert counts[0] == pytest.approx([6661, 9415, 7924], abs=5)
    assert counts[1] == pytest.approx([6822, 17178, 0], abs=150)
    assert (result.superpixels.max(), result.clusters.max()) == (191, 3)


def test_wall_in_front_of_the_camera_is_no_ground(detector):
    disparity = np.full((HEIGHT, WIDTH), 30.0, np.float32)
    left = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    result = detector.detect(left, disparity=disparity)
    assert not result.short_range.mask.any()
    assert not result.long_range.mask.any()


@pytest.mark.parametrize("rule", ["propagation", "area", "evidence"])
def test_a_detection_can_be_pickled(detector, item, rule):
    found = Detector(detector.config.updated({"extension.rule": rule}), CAMERA).detect_frame(item.frame)
    assert same(pickle.loads(pickle.dumps(found)), found)
    found.clusters  # noqa: B018 - found once, and then kept
    assert same(pickle.loads(pickle.dumps(found)), found)


@pytest.mark.parametrize("rule", ["propagation", "evidence"])
def test_times_of_numpy_are_as_good_as_those_of_python(item, rule):
    detector = LongRangeDetector(Config().updated({**SETTINGS, "memory.frames": 2, "extension.rule": rule}))
    occupancy = np.zeros(item.frame.shape, np.uint8)
    for stamp_ns in (np.int8(1), 2**62, np.int8(-1)):
        detector.detect(item.frame.image, occupancy, stamp_ns=stamp_ns)


def test_a_limit_of_numpy_is_as_good_as_one_of_python():
    disparity = np.full((3, 4), 2.0, np.float32)
    camera = StereoCamera(fx=20000.0, cx=2.0, cy=1.0, baseline_m=10.0)  # the product is no float16
    for limit_m in (np.float16(1e5 / 2**16), np.int8(100), np.longdouble(100)):
        np.testing.assert_array_equal(
            within_reach(disparity, camera, limit_m), within_reach(disparity, camera, float(limit_m))
        )
