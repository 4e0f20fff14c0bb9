#!/usr/bin/env python3
"""What each part of the method does to its scores: one part off at a time, all other settings at their defaults.

    python benchmarks/ablation.py DATASET... [--max-depth 10]

Each folder is a set; the last table holds the means over the frames of all. Disparity is matched once a frame.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

import numpy as np
from tqdm import tqdm

from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.evaluation.scoring.obstacles import StandingObstacles
from lrtrav_ros.evaluation.scoring.scores import count
from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame
from lrtrav_ros.evaluation.truth.opening import ReaderOptions, open_sets
from lrtrav_ros.frame import Frame
from lrtrav_ros.method import propagation


@dataclass(frozen=True)
class Variant:
    """Settings, and constants of `propagation`, that turn a part off."""

    name: str
    settings: dict[str, object] = field(default_factory=dict)
    constants: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def in_force(self) -> Iterator[None]:
        """Change the constants for a while."""
        with ExitStack() as patches:
            for name, value in self.constants.items():
                patches.enter_context(patch.object(propagation, name, value))
            yield


VARIANTS = (
    Variant("all parts"),
    Variant("no contact", {"ground.contact_margin": 1.0}),
    Variant("no drops", {"ground.min_drop_m": 0.0}),
    Variant("max_step_m = 0.13", {"ground.max_step_m": 0.13}),
    Variant("rule evidence", {"extension.rule": "evidence"}),
    Variant("200 superpixels", {"superpixels.n_superpixels": 200}),
    Variant("no ties of looks", constants={"_TIE_WEIGHT": 0.0}),
    Variant("no chromaticity", constants={"_VOTE_CHROMATICITY": 1e9, "_TIE_CHROMATICITY": 1e9}),
    Variant("no vote", constants={"_VOTE_WEIGHT": 1e-6, "_UNANIMITY_WEIGHT": 0.0}),
    Variant("no overruling", constants={"_OVERRULED_GROUND": -1.0}),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("datasets", nargs="+", type=Path, metavar="DATASET")
    parser.add_argument("--max-depth", type=float, default=0.0, help="how far disparity is trusted, m (0: no limit)")
    args = parser.parse_args()
    rows: dict[str, list[tuple[float, ...]]] = {variant.name: [] for variant in VARIANTS}
    for named in open_sets(args.datasets, ReaderOptions()):
        for item in tqdm(list(named.frames.items(named.frames.names)), desc=named.name, unit="frame", disable=None):
            for variant, row in zip(VARIANTS, score_all(item.read(), args.max_depth), strict=True):
                rows[variant.name].append(row)
    print("| | precision | recall | RMSE | false positives | obstacles missed |\n|---|---|---|---|---|---|")
    for name, scores in rows.items():
        precision, recall, rmse, false_positives, missed, n = np.array(scores).T
        shares = " | ".join(f"{values.mean():.3f}" for values in (precision, recall, rmse))
        print(f"| {name} | {shares} | {100 * false_positives.mean():.2f} % | {missed.sum():.0f} of {n.sum():.0f} |")


def score_all(labelled: LabelledFrame, max_depth_m: float) -> Iterator[tuple[float, ...]]:
    """Yield the scores of each variant on a frame."""
    frame = matched(labelled.frame)
    obstacles = StandingObstacles(labelled.truth)
    for variant in VARIANTS:
        config = Config().updated({"source.max_depth_m": max_depth_m, **variant.settings})
        with variant.in_force():
            mask = Detector(config).detect_frame(frame).long_range.mask
        scores = count(mask, labelled.truth).scores
        n_missed = int(obstacles.missed(mask).sum())
        yield scores.precision, scores.recall, scores.rmse, scores.false_positive_rate, n_missed, obstacles.n


def matched(frame: Frame) -> Frame:
    """Return a frame with its disparity in place of the right image."""
    if frame.source != "stereo":
        return frame
    disparity = Detector(Config()).short_range.detect(frame).disparity
    return Frame(camera=frame.camera, left=frame.left, disparity=disparity, name=frame.name)


if __name__ == "__main__":
    main()
