"""The settings of a scene: checked, described, and the camera that follows from them."""

import pytest

from lrtrav_ros.config import settings_of
from lrtrav_ros.synthetic.scene_config import SceneConfig


def test_field_of_view_gives_the_focal_length():
    camera = SceneConfig(width=200, height=90, hfov_deg=90).camera
    assert (camera.fx, camera.cx, camera.cy) == pytest.approx((100, 99.5, 44.5))


@pytest.mark.parametrize(
    ("field", "value", "remedy"),
    [
        ("style", "desert", "one of any, forest, field, park, road"),
        ("n_frames", 0, "1 to 100000"),
        ("width", 3, "32 to 8192 px"),
        ("height", 480.0, "int: 32 to 8192 px"),
        ("hfov_deg", 180.0, "10 to 140 deg"),
        ("baseline_m", 0.0, "0.001 to 10 m"),
        ("camera_height_m", -1.0, "0.1 to 20 m"),
        ("noise", float("nan"), "0 to 50 grey levels"),
        ("undulation_m", True, "float: 0 to 2 m"),
        ("seed", -1, "0 to 9223372036854775807"),
        ("drops", "hole", "one of none, ditch, step, platform"),
        ("n_small_things", -1, "0 to 1000"),
        ("sun_elevation_deg", 91.0, "0 to 90 deg"),
        ("sun_hardness", 1.1, "0 to 1"),
        ("dapple", -0.1, "0 to 1"),
        ("exposure", 5.0, "-4 to 4 stops"),
    ],
)
def test_bad_settings_are_refused_by_name_and_value(field, value, remedy):
    with pytest.raises(ValueError, match=f"{field} is .*; give .*{remedy}"):
        SceneConfig(**{field: value})


def test_every_setting_is_described_and_has_its_default_in_range():
    settings = settings_of(SceneConfig)
    assert list(settings) == list(SceneConfig.__dataclass_fields__)
    for name, parameter in settings.items():
        assert parameter.name == name
        assert len(parameter.description) > 10, name
        assert parameter.check(parameter.default) == parameter.default
