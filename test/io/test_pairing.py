"""Pairing by stamp: exact numbers, bounded queues, messages that are late, time that jumps back."""

import pytest

from lrtrav_ros.io.pairing import CAPACITY, StampPairing, TopicQueue

MS = 1_000_000


def pairing(capacity=3):
    return StampPairing(TopicQueue("/left", capacity), TopicQueue("/right", capacity))


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


def test_the_nearest_stamp_wins_and_the_others_wait_on():
    pairs = pairing()
    for stamp in (0, 10, 20):
        pairs.add_first(stamp, f"l{stamp}", tolerance_ns=10)
    assert pairs.add_second(11, "r11", tolerance_ns=10) == ("l10", "r11")
    assert pairs.add_second(2, "r2", tolerance_ns=10) == ("l0", "r2")
    assert list(pairs.first.waiting.values()) == ["l20"]
    assert (pairs.first.unpaired, pairs.n_pairs) == (0, 2)


def test_where_both_topics_are_ordered_no_late_pair_follows_a_newer_one():
    pairs = StampPairing(TopicQueue("/left", is_ordered=True), TopicQueue("/right", is_ordered=True))
    pairs.add_first(1, "l1", tolerance_ns=0)
    pairs.add_second(2, "r2", tolerance_ns=0)
    assert pairs.add_first(2, "l2", tolerance_ns=0) == ("l2", "r2")
    assert pairs.first.unpaired == 1  # at once
    assert pairs.add_second(1, "r1", tolerance_ns=0) is None
    for stamp in (0, 1):  # a looped bag: time jumps back, and r1 of the first round finds a partner
        pairs.add_second(stamp, f"R{stamp}", tolerance_ns=0)
        assert pairs.add_first(stamp, f"L{stamp}", tolerance_ns=0) == (f"L{stamp}", f"R{stamp}")


@pytest.mark.parametrize("is_ordered", [False, True])
def test_unpaired_messages_only_grow_in_number_and_all_are_accounted_for(is_ordered):
    pairs = StampPairing(TopicQueue("/left", 3, is_ordered=is_ordered), TopicQueue("/right", 3, is_ordered=is_ordered))
    counts = []
    for stamp in (10, 20, 30, 0, 5, 1, 40, 2, 3, 50):  # jumps back and on
        pairs.add_first(stamp, f"l{stamp}", tolerance_ns=0)
        if stamp % 20 == 0:
            pairs.add_second(stamp, f"r{stamp}", tolerance_ns=0)
        counts.append(pairs.first.unpaired)
        assert pairs.first.received == pairs.n_pairs + pairs.first.unpaired + len(pairs.first.waiting)
    assert counts == sorted(counts)
    assert counts[-1] > 0


def test_damaged_messages_are_received_and_told_of():
    pairs = pairing()
    pairs.first.count_damaged()
    pairs.add_first(1_000_000_000, "l", tolerance_ns=0)
    assert (pairs.first.received, pairs.first.damaged, pairs.first.unpaired) == (2, 1, 0)
    assert str(pairs.first) == "/left: 2 received, 1 of them damaged, last stamp 1.000000"


def test_a_message_without_a_partner_goes_when_many_have_come_after_it():
    pairs = pairing(capacity=3)
    pairs.add_first(0, "l0", tolerance_ns=0)
    for stamp in range(1, 5):
        pairs.add_first(stamp, f"l{stamp}", tolerance_ns=0)
        assert pairs.add_second(stamp, f"r{stamp}", tolerance_ns=0) == (f"l{stamp}", f"r{stamp}")
    assert (pairs.first.waiting, pairs.first.unpaired) == ({}, 1)
    assert pairs.add_second(0, "late", tolerance_ns=0) is None


def test_a_pair_pushes_out_no_message_that_waits():
    pairs = pairing(capacity=3)
    for stamp in (0, 1, 2):
        pairs.add_first(stamp, f"l{stamp}", tolerance_ns=0)
    pairs.add_second(3, "r3", tolerance_ns=0)
    assert pairs.add_first(3, "l3", tolerance_ns=0) == ("l3", "r3")
    assert pairs.add_second(0, "r0", tolerance_ns=0) == ("l0", "r0")


def test_partners_that_come_in_order_make_earlier_messages_useless():
    pairs = StampPairing(TopicQueue("/occupancy"), TopicQueue("/left", is_ordered=True))
    for stamp in (5, 1, 2, 3, 4):
        pairs.add_second(stamp, f"l{stamp}", tolerance_ns=0)
    assert pairs.add_first(3, "o3", tolerance_ns=0) == ("o3", "l3")
    assert list(pairs.second.waiting) == [5, 4]
    assert pairs.second.unpaired == 2
    pairs.add_first(7, "o7", tolerance_ns=0)
    assert pairs.add_second(7, "l7", tolerance_ns=0) == ("o7", "l7")  # whichever of the two comes last
    assert list(pairs.second.waiting) == []


@pytest.mark.parametrize("late", [1, -(10**18)])
def test_one_late_message_leaves_the_queue_as_it_is(late):
    pairs = pairing()
    pairs.add_first(100, "l100", tolerance_ns=0)
    pairs.add_first(101, "l101", tolerance_ns=0)
    pairs.add_first(late, "late", tolerance_ns=0)
    assert pairs.add_second(100, "r100", tolerance_ns=0) == ("l100", "r100")
    assert pairs.add_second(101, "r101", tolerance_ns=0) == ("l101", "r101")
    assert pairs.add_second(late, "its partner", tolerance_ns=0) == ("late", "its partner")


def test_a_message_replaces_an_earlier_one_of_its_stamp():
    pairs = pairing()
    pairs.add_first(1, "first", tolerance_ns=0)
    pairs.add_first(1, "again", tolerance_ns=0)
    assert pairs.add_second(1, "r", tolerance_ns=0) == ("again", "r")
    assert (pairs.first.received, pairs.first.unpaired, pairs.first.waiting) == (2, 1, {})


def test_topics_that_never_share_a_stamp_cost_bounded_memory_and_say_so():
    pairs = StampPairing(TopicQueue("/left"), TopicQueue("/right"))
    for i in range(10_000):
        assert pairs.add_first(2 * i * MS, i, tolerance_ns=0) is None
        assert pairs.add_second((2 * i + 1) * MS, i, tolerance_ns=0) is None
    assert (len(pairs.first.waiting), len(pairs.second.waiting)) == (CAPACITY, CAPACITY)
    assert pairs.first.unpaired == 10_000 - CAPACITY
    assert "stamps differ by at least 0.001 s, allowed are 0 s" in pairs.silence(tolerance_ns=0)
    assert pairs.losses(tolerance_ns=0).startswith("/left: 10000 of 10000 without partner, last stamp 19998000000 ns; ")


def test_queues_are_bounded_and_drop_the_oldest():
    pairs = pairing(capacity=2)
    for stamp in (1, 2, 3):
        pairs.add_first(stamp, f"l{stamp}", tolerance_ns=0)
    assert (pairs.first.received, pairs.first.unpaired) == (3, 1)
    assert pairs.add_second(1, "r1", tolerance_ns=0) is None
    assert pairs.add_second(3, "r3", tolerance_ns=0) == ("l3", "r3")


def test_time_that_jumps_back_pairs_as_before():
    pairs = pairing()
    pairs.add_first(100, "old", tolerance_ns=0)
    pairs.add_second(90, "old", tolerance_ns=0)
    for stamp in range(5):
        assert pairs.add_first(stamp, f"l{stamp}", tolerance_ns=0) is None
        assert pairs.add_second(stamp, f"r{stamp}", tolerance_ns=0) == (f"l{stamp}", f"r{stamp}")
    assert (pairs.first.waiting, pairs.second.waiting) == ({}, {})  # and what is from before the jump is gone


def test_silence_names_topics_counts_stamps_and_difference():
    pairs = pairing()
    assert (
        pairs.silence(tolerance_ns=0)
        == "no messages for 0 s; /left: 0 received, none yet; /right: 0 received, none yet"
    )
    pairs.add_first(1_000_000_000, "l", tolerance_ns=5 * MS)
    pairs.add_second(1_040_000_000, "r", tolerance_ns=5 * MS)
    pairs.add_second(1_060_000_000, "r", tolerance_ns=5 * MS)
    assert pairs.silence(tolerance_ns=5 * MS) == (
        "no pairs for 0 s; /left: 1 received, last stamp 1.000000; /right: 2 received, last stamp 1.060000; "
        "stamps differ by at least 0.04 s, allowed are 0.005 s"
    )
