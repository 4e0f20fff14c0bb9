"""Records as JSON."""

import pytest

from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.scoring.obstacles import ObstacleCounts, ObstacleScores
from lrtrav_ros.evaluation.scoring.reliability import ConfidenceBin
from lrtrav_ros.evaluation.scoring.score_records import (
    FrameRecord,
    FrameTimes,
    MethodRecord,
    MethodTimes,
    Summary,
    from_json,
    to_json,
)
from lrtrav_ros.evaluation.scoring.scores import (
    Counts,
    Scores,
)


def test_records_are_the_same_after_json():
    scored = MethodRecord(
        "proposed",
        Scores(0.1, 0.2, 0.3, 0.4),
        Counts(10, 5, 4, 3),
        ObstacleScores(ObstacleCounts(3, 1.5), (ObstacleCounts(3, 1.5),)),
        spread=Scores(0.0, 0.0, 0.01, 0.0),
        bands=(Counts(1, 2, 3, 4), Counts(0, 0, 0, 0)),
        reach_m=12.5,
        problem="no ground line found",
        reliability=(ConfidenceBin(3, 2, 700),),
        seeds=(Scores(0.1, 0.2, 0.3, 0.4),),
    )
    other = MethodRecord("robust", Scores(1.0, 1.0, 0.0, 0.0), Counts(10, 5, 5, 5), ObstacleScores())
    record = FrameRecord("DS1A", "frame ü", (scored, other), files_digest="12ab")
    times = FrameTimes("DS1A", "frame ü", (MethodTimes("proposed", StageTimes(matching_ms=1.25)),))
    assert from_json(FrameRecord, to_json(record)) == record
    assert from_json(FrameTimes, to_json(times)) == times


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"set": "a", "frame": "b", "methods": 3}', "null"])
def test_text_that_is_no_record_is_refused(text):
    for kind in (FrameRecord, Summary):
        with pytest.raises(ValueError, match=r"is no|Expecting value"):
            from_json(kind, text)
