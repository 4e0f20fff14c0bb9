"""The worker: the newest frame wins, every failure is counted, and none ends it."""

import threading
import time
from concurrent.futures import CancelledError

import pytest

from lrtrav_ros.io.message_frames import PartError
from lrtrav_ros.nodes.worker import Worker, WorkerCounts

DEADLINE_S = 60


class Job:
    """Processes frames when it is let through; frames that are exceptions are raised."""

    def __init__(self):
        self.done = []
        self.reported = []
        self.entered = threading.Semaphore(0)
        self.gate = threading.Semaphore(0)
        self.finished = threading.Semaphore(0)
        self.worker = Worker(self.process, failed=self.report)
        self.worker.start()

    def process(self, frame):
        self.entered.release()
        assert self.gate.acquire(timeout=DEADLINE_S)
        if isinstance(frame, Exception):
            raise frame
        self.done.append(frame)
        self.finished.release()

    def report(self, err):
        self.reported.append(err)
        self.finished.release()


@pytest.fixture
def job():
    job = Job()
    yield job
    for _ in range(10):
        job.gate.release()
    job.worker.close()


def test_newest_wins_and_drops_are_counted(job):
    job.worker.put(0)
    assert job.entered.acquire(timeout=DEADLINE_S)
    for frame in (1, 2, 3):
        job.worker.put(frame)
    job.gate.release()
    job.gate.release()
    assert job.finished.acquire(timeout=DEADLINE_S)
    assert job.finished.acquire(timeout=DEADLINE_S)
    job.worker.close()
    assert job.done == [0, 3]
    assert job.worker.counts() == WorkerCounts(put=4, processed=2, dropped=2)
    assert job.worker.rate_hz > 0
    assert job.worker.last_ms > 0
    assert job.worker.median_ms > 0


@pytest.mark.parametrize(
    ("error", "text", "part"),
    [
        (ValueError("too small"), "too small", ""),
        (KeyError(), "KeyError", ""),
        (PartError("left", "cut off"), "cut off", "left"),
    ],
)
def test_a_failed_frame_is_reported_and_the_next_one_processed(job, error, text, part):
    job.gate.release()
    job.worker.put(error)
    assert job.finished.acquire(timeout=DEADLINE_S)
    assert job.reported == [error]
    failures = job.worker.counts().failed_by(part)
    assert (failures.n, failures.last.reason) == (1, text)
    job.gate.release()
    job.worker.put(1)
    assert job.finished.acquire(timeout=DEADLINE_S)
    job.worker.close()
    assert job.done == [1]
    assert job.worker.counts() == WorkerCounts(put=2, processed=1, failed=1, failures={part: failures})


def test_a_frame_that_is_given_up_is_dropped_without_a_report(job):
    job.gate.release()
    job.gate.release()
    job.worker.put(CancelledError())
    assert job.entered.acquire(timeout=DEADLINE_S)
    job.worker.put(1)
    assert job.finished.acquire(timeout=DEADLINE_S)
    job.worker.close()
    assert job.done == [1]
    assert job.reported == []
    assert job.worker.counts() == WorkerCounts(put=2, processed=1, dropped=1)


def test_counts_add_up_at_every_moment(job):
    job.worker.put(0)
    assert job.entered.acquire(timeout=DEADLINE_S)
    job.worker.put(1)
    job.worker.put(2)
    assert job.worker.counts() == WorkerCounts(put=3, dropped=1, waiting=2)


@pytest.mark.parametrize("frame", [0, ValueError("too small"), CancelledError()])
def test_a_frame_at_hand_is_not_counted_after_all_was_forgotten(job, frame):
    job.worker.put(frame)
    assert job.entered.acquire(timeout=DEADLINE_S)
    job.worker.put(1)
    job.worker.forget()
    assert job.worker.counts() == WorkerCounts()
    job.worker.put(2)
    job.gate.release()
    assert job.entered.acquire(timeout=DEADLINE_S)
    assert job.worker.counts() == WorkerCounts(put=1, waiting=1)
    job.gate.release()
    job.worker.close()
    assert job.worker.counts() == WorkerCounts(put=1, processed=1)


def test_close_ends_the_thread_with_frames_waiting_and_twice(job):
    job.worker.put(0)
    assert job.entered.acquire(timeout=DEADLINE_S)
    job.worker.put(1)
    closing = threading.Thread(target=job.worker.close)
    closing.start()
    end_s = time.monotonic() + DEADLINE_S
    while not job.worker._closed and time.monotonic() < end_s:
        time.sleep(0.001)
    job.gate.release()
    closing.join(DEADLINE_S)
    assert not closing.is_alive()
    job.worker.close()
    assert job.done == [0]


def test_figures_before_the_first_frame(job):
    assert (job.worker.rate_hz, job.worker.last_ms, job.worker.median_ms) == (0.0, 0.0, 0.0)
