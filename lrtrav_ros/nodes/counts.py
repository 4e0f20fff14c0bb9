"""What came of the messages and frames of a node: counts that add up at any moment."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from lrtrav_ros.nodes.input_topic import Failure, InputTopic
from lrtrav_ros.nodes.worker import WorkerCounts


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """What came of messages or frames up to a moment; those received are the sum of all others.

    Attributes
    ----------
    received : int
        All that came.
    processed, dropped : int
        Of frames that were processed, and that a newer one replaced or that were given up.
    refused : int
        Of which no frame can be made.
    failed : int
        Of frames that failed for another reason.
    unpaired : int
        Given up without a partner.
    waiting : int
        Those that wait for a partner, for calibration or for their turn, and that of the frame at hand.
    """

    received: int = 0
    processed: int = 0
    dropped: int = 0
    refused: int = 0
    failed: int = 0
    unpaired: int = 0
    waiting: int = 0

    @property
    def lost(self) -> int:
        """All that came to nothing."""
        return self.dropped + self.refused + self.failed + self.unpaired

    def __add__(self, other: Counts) -> Counts:
        return Counts(**{field.name: getattr(self, field.name) + getattr(other, field.name) for field in fields(self)})

    def since(self, before: Counts) -> Counts:
        """Return what they grew by; all of them where one is smaller than before, for then they began anew."""
        grown = {field.name: getattr(self, field.name) - getattr(before, field.name) for field in fields(self)}
        began_anew = any(n < 0 for name, n in grown.items() if name != "waiting")
        return self if began_anew else Counts(**grown)


@dataclass(frozen=True, slots=True)
class Received:
    """What came before the worker.

    Attributes
    ----------
    topics : tuple of InputTopic
        All that the node subscribes to.
    frame_topic : InputTopic or None
        The one of them whose messages count as frames; None where frames come without a topic.
    n_replaced, n_waiting : int
        Frames that newer ones replaced while they waited for their calibration, and those that wait.
    """

    topics: tuple[InputTopic, ...]
    frame_topic: InputTopic | None
    n_replaced: int = 0
    n_waiting: int = 0

    def frames(self, worker: WorkerCounts) -> Counts:
        """Return what came of frames; one is refused where one of its messages is."""
        if self.frame_topic is None:
            counts = Counts(
                received=worker.put,
                processed=worker.processed,
                dropped=worker.dropped,
                failed=worker.failed,
                waiting=worker.waiting,
            )
        else:
            counts = self.messages(self.frame_topic, worker)
        n_failed = worker.failed_by("").n
        return replace(counts, refused=counts.refused + counts.failed - n_failed, failed=n_failed)

    def messages(self, topic: InputTopic, worker: WorkerCounts) -> Counts:
        """Return what came of the messages of a topic."""
        queue = topic.queue
        if not topic.part:
            n_refused = topic.refusals.n
            return Counts(received=queue.received, processed=queue.received - n_refused, refused=n_refused)
        n_refused = worker.failed_by(topic.part).n
        return Counts(
            received=queue.received,
            processed=worker.processed,
            dropped=worker.dropped + self.n_replaced,
            refused=topic.refusals.n + n_refused,
            failed=worker.failed - n_refused,
            unpaired=queue.unpaired,
            waiting=len(queue.waiting) + self.n_waiting + worker.waiting,
        )

    def last_refusal(self, topic: InputTopic, worker: WorkerCounts) -> Failure | None:
        """Return the last refusal of a topic's messages; None where there is none."""
        refusals = (topic.refusals.last, worker.failed_by(topic.part).last if topic.part else None)
        return max((refusal for refusal in refusals if refusal is not None), default=None)
