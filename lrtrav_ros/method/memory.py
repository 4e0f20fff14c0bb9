"""Evidence of the last frames, by appearance: what is near and known now was far and unknown a moment ago."""

from __future__ import annotations

from collections import deque

import numpy as np

from lrtrav_ros.config import MemoryConfig
from lrtrav_ros.method.features import Features, joined
from lrtrav_ros.method.propagation import Belief, Evidence, Remembered
from lrtrav_ros.numerics.checks import check_stamp, check_type

_MAX_REMEMBERED = 120  # superpixels, whatever the number of frames: what they cost is bounded
_SAME_PLACE_S = 0.25  # later, things are elsewhere in the image
_RECALLED = 0.25  # of the weight that a superpixel of the frame itself has
_LEAST_SHARE = 0.5  # of a superpixel that is judged, to be remembered


class Memory:
    """Remembers some superpixels with evidence of each of the last frames.

    It is bounded: all frames together leave at most 120 superpixels, evenly spread over those with evidence.

    Parameters
    ----------
    config : MemoryConfig
        For how many frames it remembers, and which gap in time makes it forget.

    Raises
    ------
    TypeError
        If `config` is something else.

    Attributes
    ----------
    belief : Belief or None
        What was found in the last frame.
    """

    def __init__(self, config: MemoryConfig) -> None:
        check_type("config", config, MemoryConfig)
        self.config = config
        self.belief: Belief | None = None
        self._frames: deque[tuple[Features, Evidence]] = deque(maxlen=config.frames)
        self._stamp_ns: int | None = None

    def __len__(self) -> int:
        """Number of superpixels that are remembered."""
        return sum(len(evidence) for _, evidence in self._frames)

    def clear(self) -> None:
        """Forget everything."""
        self.belief = None
        self._frames.clear()
        self._stamp_ns = None

    def at(self, stamp_ns: int | None) -> None:
        """Go on to the time of a frame [ns], None where it is not known; a jump in time forgets everything."""
        if stamp_ns is None:
            return
        stamp_ns = check_stamp(stamp_ns)
        if self._stamp_ns is not None:
            passed_s = (stamp_ns - self._stamp_ns) / 1e9
            if not 0 <= passed_s <= self.config.max_gap_s:
                self.clear()
            if passed_s > _SAME_PLACE_S:
                self.belief = None
        self._stamp_ns = stamp_ns

    def recall(self) -> Remembered | None:
        """Return what is remembered, None where that is nothing."""
        if not len(self):
            return None
        return Remembered(
            joined([features for features, _ in self._frames]),
            Evidence(
                np.concatenate([evidence.share for _, evidence in self._frames]),
                np.concatenate([evidence.ground for _, evidence in self._frames]),
            ),
        )

    def remember(self, features: Features, evidence: Evidence, belief: Belief) -> None:
        """Remember some of a frame's superpixels, evenly spread over those with evidence, and what was found of all."""
        if not self.config.frames:
            return
        self.belief = belief
        known = np.flatnonzero(evidence.share >= _LEAST_SHARE)
        n_kept = min(len(known), _MAX_REMEMBERED // self.config.frames)
        kept = known[np.linspace(0, len(known) - 1, n_kept).astype(np.intp)]
        self._frames.append((features.chosen(kept), Evidence(_RECALLED * evidence.share[kept], evidence.ground[kept])))
