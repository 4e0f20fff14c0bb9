"""Tests of the memory of evidence, with features that tell which superpixel they are of."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lrtrav_ros.config import MemoryConfig
from lrtrav_ros.method import memory as module
from lrtrav_ros.method.features import Features
from lrtrav_ros.method.memory import Memory
from lrtrav_ros.method.propagation import Belief, Evidence

SECOND_NS = 1_000_000_000
N = 90  # superpixels of a frame


def features(first: int = 0, n: int = N) -> Features:
    """Return features of n superpixels with the numbers first, first + 1, ... in all of their values."""
    numbers = np.arange(first, first + n)[:, None]
    return Features(
        numbers.repeat(4, axis=1).astype(np.float32),
        numbers.repeat(3, axis=1).astype(np.float32),
        numbers.repeat(2, axis=1).astype(np.float64),
    )


def evidence(share: NDArray[np.float64] | float = 1.0, n: int = N) -> Evidence:
    return Evidence(np.full(n, share), np.arange(n) / n)


def belief(sure: float = 0.5, n: int = N) -> Belief:
    return Belief(np.zeros((n, 2)), np.zeros((n, 2)), np.full(n, sure))


def remembered(memory: Memory) -> list[int]:
    """Return the numbers of the superpixels that are remembered, the oldest first."""
    recalled = memory.recall()
    if recalled is None:
        assert len(memory) == 0
        return []
    known = recalled.features
    assert len(known) == len(recalled.evidence) == len(memory)
    for values in (known.colour, known.texture, known.chromaticity):
        np.testing.assert_array_equal(values, np.broadcast_to(known.chromaticity[:, :1], values.shape))
    return [int(number) for number in known.chromaticity[:, 0]]


def recalled_evidence(memory: Memory) -> Evidence:
    recalled = memory.recall()
    assert recalled is not None
    return recalled.evidence


def filled(memory: Memory, *stamps_ns: int | None) -> Memory:
    """Return the memory after a frame with a superpixel at each of these times."""
    for i, stamp_ns in enumerate(stamps_ns):
        memory.at(stamp_ns)
        memory.remember(features(first=100 * i, n=1), evidence(n=1), belief(i / 10, n=1))
    return memory


@pytest.mark.parametrize("frames", [1, 3, 7, 100])
def test_it_is_bounded_whatever_the_number_of_frames_and_superpixels(frames: int) -> None:
    memory = Memory(MemoryConfig(frames=frames))
    sizes = []
    for i in range(frames + 5):
        memory.at(i * SECOND_NS)
        memory.remember(features(n=500), evidence(n=500), belief(n=500))
        sizes.append(len(remembered(memory)))
    each = module._MAX_REMEMBERED // frames
    assert max(sizes) <= 120
    assert sizes == [each * min(i + 1, frames) for i in range(frames + 5)]


def test_the_oldest_frame_is_forgotten_first() -> None:
    memory = Memory(MemoryConfig(frames=2))
    stamps = [i * SECOND_NS for i in range(4)]
    assert remembered(filled(memory, *stamps[:1])) == [0]
    assert remembered(filled(Memory(MemoryConfig(frames=2)), *stamps)) == [200, 300]


def test_superpixels_with_evidence_are_kept_with_it() -> None:
    memory = Memory(MemoryConfig(frames=1))
    share = np.where(np.arange(N) % 3 == 1, 1.0, 0.0)
    memory.remember(features(), evidence(share), belief())
    assert remembered(memory) == list(range(1, N, 3))
    known = recalled_evidence(memory)
    np.testing.assert_array_equal(known.share, 0.25)  # a quarter of what the frame's own weigh
    np.testing.assert_array_equal(known.ground, np.arange(1, N, 3) / N)


def test_those_kept_are_evenly_spread() -> None:
    memory = Memory(MemoryConfig(frames=5))
    memory.remember(features(n=500), evidence(n=500), belief(n=500))
    kept = remembered(memory)
    assert (kept[0], kept[-1]) == (0, 499)
    assert len(kept) >= 10
    assert np.ptp(np.diff(kept)) <= 1


def test_frames_without_evidence_are_remembered_as_nothing() -> None:
    memory = Memory(MemoryConfig(frames=2))
    memory.remember(features(n=9), evidence(n=9), belief(n=9))
    memory.remember(features(n=9), evidence(0.0, n=9), belief(n=9))
    assert remembered(memory) == list(range(9))
    memory.remember(features(n=9), evidence(0.0, n=9), belief(n=9))
    assert remembered(memory) == []


def test_no_frames_are_no_memory() -> None:
    memory = filled(Memory(MemoryConfig(frames=0)), 0, SECOND_NS)
    assert len(memory) == 0
    assert memory.recall() is None
    assert memory.belief is None


@pytest.mark.parametrize(
    ("second_ns", "expected"),
    [
        pytest.param(SECOND_NS, [0, 100], id="the next frame"),
        pytest.param(0, [0, 100], id="the same stamp"),
        pytest.param(3 * SECOND_NS, [0, 100], id="the longest gap"),
        pytest.param(3 * SECOND_NS + 1, [100], id="a longer gap"),
        pytest.param(-1, [100], id="back in time"),
        pytest.param(None, [0, 100], id="without a stamp"),
    ],
)
def test_a_jump_in_time_forgets(second_ns: int | None, expected: list[int]) -> None:
    start_ns = 1_700_000_000 * SECOND_NS
    memory = Memory(MemoryConfig(frames=5, max_gap_s=3.0))
    filled(memory, start_ns, None if second_ns is None else start_ns + second_ns)
    assert remembered(memory) == expected
    memory.at(second_ns if second_ns is None else start_ns + second_ns)  # as the next frame does, at the same time
    assert memory.belief is not None
    assert memory.belief.traversable.tolist() == [0.1]  # of the last frame


def test_belief_lasts_while_things_are_at_the_same_place() -> None:
    memory = filled(Memory(MemoryConfig(frames=5, max_gap_s=3.0)), 0)
    memory.at(SECOND_NS // 5)
    assert memory.belief is not None
    memory.at(SECOND_NS // 5 + SECOND_NS // 2)
    assert memory.belief is None
    assert len(memory) > 0  # what things look like lasts longer


def test_after_a_jump_it_goes_on_from_there() -> None:
    memory = Memory(MemoryConfig(frames=5, max_gap_s=3.0))
    assert remembered(filled(memory, 50 * SECOND_NS, 0, SECOND_NS)) == [100, 200]


def test_clear_forgets_all_and_the_time_too() -> None:
    memory = filled(Memory(MemoryConfig(frames=5)), 50 * SECOND_NS)
    memory.clear()
    assert len(memory) == 0
    assert memory.belief is None
    assert remembered(filled(memory, 0, SECOND_NS)) == [0, 100]


def test_it_is_deterministic_and_keeps_its_own_copy() -> None:
    first, second = Memory(MemoryConfig(frames=3)), Memory(MemoryConfig(frames=3))
    frame, known = features(), evidence()
    first.remember(frame, known, belief())
    second.remember(features(), evidence(), belief())
    for values in (frame.colour, frame.texture, frame.chromaticity, known.share, known.ground):
        values[:] = 0
    assert remembered(first) == remembered(second)
    np.testing.assert_array_equal(recalled_evidence(first).ground, recalled_evidence(second).ground)


def test_times_of_numpy_are_as_good_as_those_of_python() -> None:
    memory = Memory(MemoryConfig(frames=3, max_gap_s=1.0))
    for stamp_ns in (np.int8(1), np.uint64(10), 2**40):
        memory.at(stamp_ns)
        memory.remember(features(), evidence(), belief())
    memory.at(np.uint64(5))  # back in time
    assert len(memory) == 0
    memory.at(2**62)


def test_a_time_that_is_none_leaves_the_memory_as_it_was() -> None:
    memory = Memory(MemoryConfig(frames=3))
    memory.at(1)
    memory.remember(features(), evidence(), belief())
    with pytest.raises(TypeError, match=r"^stamp_ns is 1\.5; give a whole number$"):
        memory.at(1.5)  # type: ignore[arg-type]
    memory.at(2)
    assert len(memory) > 0
