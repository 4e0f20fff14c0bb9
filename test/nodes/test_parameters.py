"""Parameters of a node: declared from the configuration, changed as a whole, refused with a reason."""

import itertools

import pytest

pytest.importorskip("rclpy")

from rclpy.node import Node
from rclpy.parameter import Parameter

from lrtrav_ros.config import Config, parameters
from lrtrav_ros.nodes.parameters import Settings

STAGES = ("threads", "source", "stereo", "superpixels", "clustering", "extension")
NAMES = itertools.count()


@pytest.fixture
def make(ros):
    nodes = []

    def make(**overrides):
        given = [Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()]
        nodes.append(Node(f"settings_{next(NAMES)}", parameter_overrides=given, enable_rosout=False))
        return nodes[-1], Settings(nodes[-1], STAGES)

    yield make
    for node in nodes:
        node.destroy_node()


def set_all(node, **values):
    return node.set_parameters_atomically(
        [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
    )


def test_all_parameters_of_the_stages_are_declared_with_default_and_description(make):
    node, settings = make()
    expected = {known.name: known for known in parameters() if known.name.partition(".")[0] in STAGES}
    assert settings.config == Config()
    assert not node.has_parameter("elas.beta")
    for name, known in expected.items():
        descriptor = node.describe_parameter(name)
        assert node.get_parameter(name).value == known.default
        assert known.description in descriptor.description
        assert descriptor.read_only == known.read_only
    integer = node.describe_parameter("stereo.n_disparities").integer_range[0]
    assert (integer.from_value, integer.to_value) == (1, 512)
    floating = node.describe_parameter("superpixels.compactness").floating_point_range[0]
    assert (floating.from_value, floating.to_value) == (0.1, 1000.0)
    assert "sgbm" in node.describe_parameter("stereo.matcher").additional_constraints


def test_values_given_at_the_start_count(make):
    _, settings = make(stereo__matcher="bm", superpixels__compactness=15)
    assert settings.config == Config().updated({"stereo.matcher": "bm", "superpixels.compactness": 15.0})


def test_a_preset_gives_the_defaults_and_single_values_win(make):
    node, settings = make(preset="paper", extension__rule="evidence")
    paper = Config.preset("paper")
    assert settings.config.clustering == paper.clustering
    assert settings.config.extension.rule == "evidence"
    assert node.get_parameter("clustering.k").value == paper.clustering.k
    assert not set_all(node, preset="robust").successful


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        ({"stereo__matcher": "magic"}, "stereo.matcher is 'magic'"),
        ({"stereo__n_disparities": 0}, "stereo.n_disparities out of range"),
        ({"stereo__n_disparities": "many"}, "stereo.n_disparities"),
        ({"superpixels__compactness": "much"}, "superpixels.compactness is 'much'"),
        ({"preset": "best"}, "no preset 'best'"),
    ],
)
def test_a_bad_value_at_the_start_is_named(make, overrides, reason):
    with pytest.raises(ValueError, match=reason):
        make(**overrides)


def test_a_misspelt_name_at_the_start_is_warned_of(make, capfd):
    make(stereo__matchr="bm")
    assert "no parameter 'stereo.matchr'; did you mean stereo.matcher" in capfd.readouterr().err


def test_a_change_takes_effect_and_makes_a_new_configuration(make):
    node, settings = make()
    before = settings.config
    assert set_all(node, stereo__n_disparities=64, superpixels__compactness=15).successful
    assert settings.config == Config().updated({"stereo.n_disparities": 64, "superpixels.compactness": 15.0})
    assert before == Config()


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"stereo__n_disparities": 64, "stereo__matcher": "magic"}, "stereo.matcher is 'magic'"),
        ({"stereo__n_disparities": 64, "superpixels__compactness": float("nan")}, "superpixels.compactness"),
        ({"stereo__n_disparities": 64, "extension__min_share": 1.5}, "extension.min_share out of range"),
        ({"stereo__n_disparities": 64, "source": "depth"}, "read-only"),
    ],
)
def test_a_batch_with_a_bad_value_changes_nothing(make, values, reason):
    node, settings = make()
    before = settings.config
    result = set_all(node, **values)
    assert not result.successful
    assert reason in result.reason
    assert settings.config is before
    assert node.get_parameter("stereo.n_disparities").value == Config().stereo.n_disparities


def test_tolerance_in_nanoseconds(make):
    _, settings = make(source__max_stamp_difference_s=0.0125)
    assert settings.stamp_tolerance_ns == 12_500_000
