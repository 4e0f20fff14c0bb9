"""Pairing by stamp: exact numbers, bounded queues, time that jumps back."""

import pytest

from lrtrav_ros.io.pairing import Pairing

MS = 1_000_000


def pairing(capacity=3):
    return Pairing(("/left", capacity), ("/right", capacity))


@pytest.mark.parametrize("left_first", [True, False])
def test_equal_stamps_pair_in_either_order(left_first):
    pairs = pairing()
    if left_first:
        assert pairs.add_first(5, "l5", tolerance_ns=0) is None
        assert pairs.add_second(5, "r5", tolerance_ns=0) == ("l5", "r5")
    else:
        assert pairs.add_second(5, "r5", tolerance_ns=0) is None
        assert pairs.add_first(5, "l5", tolerance_ns=0) == ("l5", "r5")


@pytest.mark.parametrize(("difference", "pairs_up"), [(5 * MS, True), (5 * MS + 1, False)])
def test_tolerance_is_inclusive(difference, pairs_up):
    pairs = pairing()
    pairs.add_first(100 * MS, "l", tolerance_ns=5 * MS)
    assert (pairs.add_second(100 * MS + difference, "r", tolerance_ns=5 * MS) is not None) == pairs_up


def test_the_nearest_stamp_wins_and_older_messages_go():
    pairs = pairing()
    for stamp in (0, 10, 20):
        pairs.add_first(stamp, f"l{stamp}", tolerance_ns=10)
    assert pairs.add_second(11, "r11", tolerance_ns=10) == ("l10", "r11")
    assert [item for _, item in pairs.first.waiting] == ["l20"]
    assert pairs.first.unpaired == 1


def test_queues_are_bounded_and_drop_the_oldest():
    pairs = pairing(capacity=2)
    for stamp in (1, 2, 3):
        pairs.add_first(stamp, f"l{stamp}", tolerance_ns=0)
    assert (pairs.first.received, pairs.first.unpaired) == (3, 1)
    assert pairs.add_second(1, "r1", tolerance_ns=0) is None
    assert pairs.add_second(3, "r3", tolerance_ns=0) == ("l3", "r3")


def test_time_that_jumps_back_clears_only_what_is_from_before():
    pairs = pairing()
    pairs.add_first(100, "old", tolerance_ns=0)
    pairs.add_second(90, "old", tolerance_ns=0)
    assert pairs.add_first(0, "l0", tolerance_ns=0) is None
    assert pairs.add_first(1, "l1", tolerance_ns=0) is None
    assert pairs.add_second(0, "r0", tolerance_ns=0) == ("l0", "r0")
    assert pairs.add_second(1, "r1", tolerance_ns=0) == ("l1", "r1")
    assert (pairs.first.unpaired, pairs.second.unpaired) == (1, 1)


def test_reason_names_topics_counts_stamps_and_difference():
    pairs = pairing()
    assert (
        pairs.reason(tolerance_ns=0) == "no messages for 0 s; /left: 0 received, none yet; /right: 0 received, none yet"
    )
    pairs.add_first(1_000_000_000, "l", tolerance_ns=5 * MS)
    pairs.add_second(1_040_000_000, "r", tolerance_ns=5 * MS)
    pairs.add_second(1_060_000_000, "r", tolerance_ns=5 * MS)
    assert pairs.reason(tolerance_ns=5 * MS) == (
        "no pairs for 0 s; /left: 1 received, last stamp 1.000000; /right: 2 received, last stamp 1.060000; "
        "stamps differ by at least 0.04 s, allowed are 0.005 s"
    )
