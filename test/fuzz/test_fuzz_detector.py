"""The whole detector on frames of every source, under all settings; and that it is deterministic."""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from strategies import SMALL_SHAPES, cameras, configs, disparities, images

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detection, Detector
from lrtrav_ros.frame import SOURCES, Frame
from lrtrav_ros.method.ground import GROUND, OBSTACLE, UNKNOWN

STAGES = ("source", "stereo", "elas", "ground", "superpixels", "features", "clustering", "extension", "memory")
STAMPS = st.none() | st.integers(0, 10**10) | st.integers(-(2**62), 2**62)


@st.composite
def frames(draw: st.DrawFn, shape: tuple[int, int], **fields: Any) -> Frame:
    """Return a frame of any source."""
    fields = {**fields, "left": draw(images(shape, dtypes=(np.uint8, np.uint16))), "stamp_ns": draw(STAMPS)}
    source = draw(st.sampled_from(SOURCES))
    if source == "stereo":
        fields["right"] = np.roll(fields["left"], -draw(st.integers(0, 9)), axis=1)
    else:
        fields["disparity" if source == "disparity" else "depth_m"] = draw(disparities(shape))
    if draw(st.booleans()):
        fields["unseen"] = np.random.default_rng(draw(st.integers(0, 99))).random(shape) < draw(st.floats(0, 1))
    return Frame(**fields)


def sequences(shapes: st.SearchStrategy[tuple[int, int]] = SMALL_SHAPES) -> st.SearchStrategy[list[Frame]]:
    """Return a few frames of one camera."""
    cameras_of = shapes.flatmap(lambda shape: st.tuples(st.just(shape), cameras(shape)))
    return cameras_of.flatmap(lambda made: st.lists(frames(made[0], camera=made[1]), min_size=1, max_size=3))


def settings(n_superpixels: st.SearchStrategy[int]) -> st.SearchStrategy[Config]:
    """Return any settings of all stages, with one thread."""
    return configs(*STAGES, **{"threads": st.just(1), "superpixels.n_superpixels": n_superpixels})


FEW = st.integers(1, 200)
ANY = settings(FEW | st.integers(1, 20_000))
WIDE_SHAPES = SMALL_SHAPES | st.just((50, 170))  # of which threads get their bands


def assert_valid(found: Detection, frame: Frame) -> None:
    """Assert that a detection is one that a frame may have."""
    images = [found.short_range.occupancy, found.long_range.occupancy]
    for occupancy in images:
        assert (occupancy.dtype, occupancy.shape) == (np.uint8, frame.shape)
        assert set(np.unique(occupancy)) <= {GROUND, OBSTACLE, UNKNOWN}
        assert frame.unseen is None or (occupancy[frame.unseen] == UNKNOWN).all()
    assert np.isfinite(found.disparity).all()
    assert found.disparity.min() >= 0
    labels, clusters = found.superpixels, found.long_range.superpixel_clusters
    assert (labels.dtype, labels.shape) == (np.int32, frame.shape)
    np.testing.assert_array_equal(np.unique(labels), np.arange(len(clusters)))
    assert clusters.dtype == np.int32
    assert (clusters >= 0).all()
    assert (clusters < len(clusters)).all()
    confidence = found.long_range.confidence
    assert confidence is None or confidence.shape == frame.shape
    np.testing.assert_array_equal(found.long_range.mask == 255, found.long_range.occupancy == GROUND)


def as_bytes(found: Detection) -> list[bytes]:
    """Return all that was found but times, as bytes."""
    near, far = found.short_range, found.long_range
    arrays: list[NDArray[Any] | None] = [
        *(near.disparity, near.occupancy, near.u_disparity, near.obstacle_cells, near.v_disparity),
        *(far.occupancy, far.superpixels, far.superpixel_clusters, far.confidence),
    ]
    return [
        repr((near.line, near.is_line_remembered)).encode(),
        *(repr(array).encode() if array is None else array.tobytes() for array in arrays),
    ]


@given(cameras=st.lists(sequences(), min_size=1, max_size=3), config=ANY)
def test_detector(cameras: list[list[Frame]], config: Config) -> None:
    detector = Detector(config)
    for frame in itertools.chain.from_iterable(cameras):  # the size may change, which memories outlive
        assert_valid(detector.detect_frame(frame), frame)


@given(sequence=sequences(WIDE_SHAPES), config=settings(FEW))
def test_detector_is_deterministic(sequence: list[Frame], config: Config) -> None:
    one, same, two = Detector(config), Detector(config), Detector(config.updated({"threads": 2}))
    for frame in sequence:
        expected = as_bytes(one.detect_frame(frame))
        assert as_bytes(same.detect_frame(frame)) == expected
        assert as_bytes(two.detect_frame(frame)) == expected


@given(sequence=sequences(), config=ANY)
def test_detector_without_memory_has_no_memory(sequence: list[Frame], config: Config) -> None:
    config = config.updated({"memory.frames": 0, "ground.memory_s": 0.0})
    used = Detector(config)
    for frame in [*sequence, sequence[0]]:
        found = used.detect_frame(frame)
    assert as_bytes(found) == as_bytes(Detector(config).detect_frame(sequence[0]))


@given(sequence=sequences(), config=ANY)
def test_an_empty_short_range_gives_an_empty_result(sequence: list[Frame], config: Config) -> None:
    detector = Detector(config)
    nothing = np.full(sequence[0].shape, UNKNOWN, np.uint8)
    for frame in sequence:
        detector.detect_frame(frame)  # which a memory remembers
        found = detector.long_range.detect(frame.image, nothing, stamp_ns=frame.stamp_ns)
        assert not found.mask.any()
        if config.extension.rule != "area":  # which calls all obstacle that is not ground
            assert (found.occupancy == UNKNOWN).all()


@given(sequence=sequences())
def test_frames_are_not_written_to(sequence: list[Frame]) -> None:
    frame = sequence[0]
    arrays = {name: value for name, value in dataclasses.asdict(frame).items() if isinstance(value, np.ndarray)}
    Detector(Config(threads=1)).detect_frame(frame)
    for name, before in arrays.items():
        np.testing.assert_array_equal(getattr(frame, name), before)
