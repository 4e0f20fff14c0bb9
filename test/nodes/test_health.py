"""Levels and texts by the rules of the page on troubleshooting, on a clock of the test's."""

import time

import pytest

from lrtrav_ros.nodes.counts import Counts, Received
from lrtrav_ros.nodes.health import Health, Level, Window, frames_health, silent_health, topic_health
from lrtrav_ros.nodes.input_topic import Failure, Failures, InputTopic
from lrtrav_ros.nodes.worker import WorkerCounts

OK = Health(Level.OK, ())


class Watch:
    """A window of 10 s over the counts of one name, at the time that the test sets."""

    def __init__(self):
        self.now_s = 0.0
        self.window = Window(10.0, lambda: self.now_s)

    def add(self, at_s, **counts):
        self.now_s = at_s
        self.window.add({"x": Counts(**counts)})

    def topic(self, *, needs_partner=True, publishers="", last=None):
        recent = self.window.recent("x")
        return topic_health(
            "/x", recent, self.window, last_refusal=last, needs_partner=needs_partner, publishers=publishers
        )

    def frames(self, *, problem="", topics=(), last=None):
        return frames_health(
            self.window.recent("x"), self.window, last_failure=last, problem=problem, topics=list(topics)
        )


@pytest.fixture
def watch():
    return Watch()


def test_a_refusal_is_told_of_for_ten_seconds_whatever_good_comes_after_it(watch):
    watch.add(100.0, received=30, processed=30)
    watch.now_s = 101.5
    refusal = Failure(101.5, "cut off")
    for second in range(102, 112):
        watch.add(second, received=30 * (second - 100), processed=30 * (second - 100) - 1, refused=1)
        health = watch.topic(last=refusal)
        n = 30 * (second - 100 if second < 110 else second - 101)  # since the beginning, then since second 100
        text = f"1 of {n} messages on /x refused in the last 10 s; last, {second - 101.5:.0f} s ago: cut off"
        assert health == Health(Level.WARN, (text,))
    watch.add(112, received=360, processed=359, refused=1)
    assert watch.topic(last=refusal) == OK


@pytest.mark.parametrize(
    ("counts", "level"),
    [
        ({"received": 4, "refused": 4}, Level.ERROR),
        ({"received": 4, "refused": 3, "processed": 1}, Level.WARN),
        ({}, Level.OK),
        ({"received": 100, "unpaired": 10}, Level.OK),
        ({"received": 100, "unpaired": 11}, Level.WARN),
        ({"received": 9, "unpaired": 9}, Level.OK),
        ({"received": 100, "dropped": 100}, Level.OK),
    ],
)
def test_levels_of_a_topic(watch, counts, level):
    watch.add(1.0, **counts)
    assert watch.topic().level == level


def test_a_topic_without_need_of_partners_and_one_of_two_publishers(watch):
    watch.add(1.0, received=100, unpaired=100)
    assert watch.topic(needs_partner=False) == OK
    assert watch.topic().lines == ("100 of 100 messages on /x without partner in the last 10 s",)
    assert watch.topic(needs_partner=False, publishers="2 publishers") == Health(Level.WARN, ("2 publishers",))


@pytest.mark.parametrize(
    ("counts", "level"),
    [
        ({"received": 100, "processed": 100}, Level.OK),
        ({"received": 100, "processed": 50, "dropped": 50}, Level.OK),
        ({"received": 100, "processed": 49, "dropped": 51}, Level.WARN),
        ({"received": 100, "processed": 99, "failed": 1}, Level.WARN),
        ({"received": 100, "failed": 100}, Level.ERROR),
        ({"received": 100, "dropped": 100}, Level.ERROR),
        ({"received": 1, "unpaired": 1}, Level.ERROR),
        ({"received": 1, "waiting": 1}, Level.OK),
        ({}, Level.OK),  # why nothing comes is told as a problem
    ],
)
def test_levels_of_frames(watch, counts, level):
    watch.add(0.0)
    watch.add(10.0, **counts)
    assert watch.frames().level == level


def test_texts_of_frames(watch):
    watch.add(0.0)
    watch.add(10.0, received=40, processed=10, dropped=28, failed=2)
    health = watch.frames(problem="rows are off", topics=[Health(Level.WARN, ("refused",))], last=Failure(7.0, "why"))
    assert health.lines == (
        "rows are off",
        "refused",
        "2 of 40 frames failed in the last 10 s; last, 3 s ago: why",
        "28 of 40 frames dropped in the last 10 s: they come faster than they are processed",
    )
    watch.add(20.0, received=70, processed=10, dropped=58, failed=2)
    assert watch.frames() == Health(Level.ERROR, ("none of 30 frames processed in the last 10 s",))


def test_a_problem_is_an_error_once_nothing_was_processed_for_ten_seconds(watch):
    watch.add(9.9)
    assert watch.frames(problem="no messages") == Health(Level.WARN, ("no messages",))
    watch.add(10.0)
    assert watch.frames(problem="no messages") == Health(Level.ERROR, ("no messages",))
    watch.add(11.0, received=1, processed=1)
    assert watch.frames(problem="no messages").level == Level.WARN


def test_a_topic_is_silent_once_nothing_came_for_ten_seconds(watch):
    watch.add(9.0, received=1, processed=1)
    watch.add(18.9, received=1, processed=1)
    assert silent_health(watch.window.recent("x"), watch.window) is None
    watch.add(19.0, received=1, processed=1)
    assert silent_health(watch.window.recent("x"), watch.window) == Health(
        Level.ERROR, ("no message in the last 10 s",)
    )


def test_counts_that_begin_anew(watch):
    watch.add(1.0, received=5, processed=2, refused=3)
    watch.add(2.0, received=8, processed=8)  # of a topic that was subscribed to again
    assert watch.window.recent("x") == Counts(received=13, processed=10, refused=3)
    watch.window.add({})  # nothing is subscribed to
    watch.add(3.0, received=9, processed=7, refused=1, waiting=1)
    watch.add(4.0, received=9, processed=8, refused=1)
    assert watch.window.recent("x") == Counts(received=22, processed=18, refused=4)
    watch.add(12.0, received=9, processed=8, refused=1)
    assert watch.window.recent("x") == Counts(received=9, processed=8, refused=1)
    watch.window.forget()
    watch.add(3.0, received=60, processed=60)
    assert watch.window.recent("x") == Counts(received=60, processed=60)
    assert not watch.window.is_full


def test_rate(watch):
    watch.add(0.0)
    for second in range(1, 31):
        watch.add(second, received=20 * second)
    assert watch.window.rate_hz("x") == pytest.approx(20)


def total(counts):
    return counts.processed + counts.dropped + counts.refused + counts.failed + counts.unpaired + counts.waiting


def test_counts_of_frames_and_of_each_topic_add_up():
    left, right = (InputTopic(name, lambda text: None, part=part) for name, part in (("l", "left"), ("r", "partner")))
    info = InputTopic("info", lambda text: None)
    for stamp in range(20):
        left.queue.count(stamp)
        right.queue.count(stamp)
    left.queue.add(20, None)
    left.queue.count(20)
    left.refuse_damaged(ValueError("4 bytes"))
    info.queue.count(0)
    info.refuse(ValueError("not calibrated"))
    failures = {"": Failures(1), "left": Failures(2, Failure(1.0, "l")), "partner": Failures(3, Failure(2.0, "r"))}
    worker = WorkerCounts(put=16, processed=5, dropped=4, failed=6, waiting=1, failures=failures)
    received = Received((left, right, info), left, n_replaced=3, n_waiting=1)
    assert received.messages(left, worker) == Counts(
        received=22, processed=5, dropped=7, refused=3, failed=4, unpaired=0, waiting=3
    )
    assert received.messages(right, worker) == Counts(
        received=20, processed=5, dropped=7, refused=3, failed=3, unpaired=0, waiting=2
    )
    assert received.messages(info, worker) == Counts(received=1, refused=1)
    assert received.frames(worker) == Counts(received=22, processed=5, dropped=7, refused=6, failed=1, waiting=3)
    for counts in (received.frames(worker), *(received.messages(topic, worker) for topic in received.topics)):
        assert total(counts) == counts.received
    assert received.last_refusal(left, worker).reason == "4 bytes"  # just now; the others long ago
    assert received.last_refusal(right, worker).reason == "r"
    assert received.last_refusal(info, worker).at_s == pytest.approx(time.monotonic(), abs=5)
    without_topic = Received((), None).frames(worker)
    assert (without_topic.received, without_topic.failed, without_topic.refused) == (16, 1, 5)
