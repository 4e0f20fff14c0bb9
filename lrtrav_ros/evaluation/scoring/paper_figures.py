"""Figures that the paper reports; Lu et al., IROS 2015, section V. Unknown pixels count as not traversable there."""

from __future__ import annotations

import re
from collections.abc import Collection

from lrtrav_ros.evaluation.scoring.score_records import PaperScores

_MEANS = {
    "uv_disparity": PaperScores(precision=0.9749, recall=0.7634, rmse=0.3510),
    "proposed": PaperScores(precision=0.9452, recall=0.9011, rmse=0.2692),
    "colour_only": PaperScores(precision=0.9441, recall=0.8922, rmse=0.2770),
    "texture_only": PaperScores(precision=0.9146, recall=0.8775, rmse=0.3155),
    "random_centres": PaperScores(precision=0.9459, recall=0.8981, rmse=0.2715),
    "near_to_far": PaperScores(rmse=0.273),
}
_PROPOSED_RMSE = {"DS1A": 0.2521, "DS1B": 0.2347, "DS2A": 0.2662, "DS2B": 0.2856, "DS3A": 0.2545, "DS3B": 0.3224}


def lagr_set(name: str) -> str:
    """Return which of the LAGR sets a name holds, such as DS1A; an empty text for none."""
    found = re.search("(?<![A-Z0-9])DS[123][AB](?![A-Z0-9])", name.upper())
    return found.group() if found else ""


def paper_scores(set_name: str, method: str) -> PaperScores | None:
    """Return what the paper reports for a method on a set; None where it does not."""
    rmse = _PROPOSED_RMSE.get(lagr_set(set_name)) if method == "proposed" else None
    return None if rmse is None else PaperScores(rmse)


def paper_mean(set_names: Collection[str], method: str) -> PaperScores | None:
    """Return the means that the paper reports for a method; None unless these are the paper's six sets."""
    return _MEANS.get(method) if {lagr_set(name) for name in set_names} == set(_PROPOSED_RMSE) else None
