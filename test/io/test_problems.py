"""Problems that are told once for each kind."""

from lrtrav_ros.io.problems import Problems


def test_problems_that_are_alike_are_told_once_with_their_number():
    problems = Problems()
    assert not problems
    for frame in (3, 4, 5, 4):
        problems.add(f"frame {frame}: too small", kind="too small", case=frame)
    problems.add("cut off")
    problems.add("cut off")
    assert problems
    assert problems.lines() == ["frame 3: too small (and 2 more like it)", "cut off"]
