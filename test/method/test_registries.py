"""The choices of settings, which config.py lists, are those that the method has."""

from __future__ import annotations

from collections.abc import Collection

import pytest

from lrtrav_ros.config import find_parameter
from lrtrav_ros.method import clustering, comparison, extension, ground, matching, textures


@pytest.mark.parametrize(
    ("setting", "registry"),
    [
        ("stereo.matcher", matching.MATCHERS),
        ("ground.shape", ground.SHAPES),
        ("features.cues", comparison.CUES),
        ("features.texture", textures.TEXTURES),
        ("features.distance", comparison.DISTANCES),
        ("clustering.centres", clustering.CENTRES),
        ("extension.rule", (*extension.RULES, "propagation")),  # the last takes no clusters: `propagation`
    ],
)
def test_choices_are_what_there_is(setting: str, registry: Collection[str]) -> None:
    assert find_parameter(setting).choices == tuple(registry)
