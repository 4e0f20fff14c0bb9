"""Parameters of a node: declared from the configuration, changed as a whole, refused with a reason."""

import itertools
import sys

import pytest

pytest.importorskip("rclpy")

from rclpy.node import Node
from rclpy.parameter import Parameter
from ros_graph import process_starter

from lrtrav_ros.config import LONG_RANGE_STAGES, NODE_DEFAULTS, SHORT_RANGE_STAGES, Config, parameters
from lrtrav_ros.io.parameter_file import read_parameter_file
from lrtrav_ros.nodes.parameters import Settings

STAGES = ("threads", "source", "stereo", "superpixels", "features", "clustering", "extension", "memory", "maps")
DEFAULTS = Config().updated(NODE_DEFAULTS)
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
    expected = {known.name: known for known in parameters() if known.stage in STAGES}
    assert settings.config == DEFAULTS
    assert not node.has_parameter("elas.beta")
    for name, known in expected.items():
        descriptor = node.describe_parameter(name)
        assert node.get_parameter(name).value == DEFAULTS.values()[name]
        assert known.description in descriptor.description
        assert descriptor.read_only == known.read_only
    integer = node.describe_parameter("stereo.n_disparities").integer_range[0]
    assert (integer.from_value, integer.to_value) == (1, 512)
    floating = node.describe_parameter("superpixels.compactness").floating_point_range[0]
    assert (floating.from_value, floating.to_value) == (0.1, 1000.0)
    assert "sgbm" in node.describe_parameter("stereo.matcher").additional_constraints


def test_values_given_at_the_start_count(make):
    _, settings = make(stereo__matcher="bm", superpixels__compactness=15)
    assert settings.config == DEFAULTS.updated({"stereo.matcher": "bm", "superpixels.compactness": 15.0})


@pytest.mark.parametrize(("overrides", "n_frames"), [({}, 5), ({"preset": "paper"}, 5), ({"memory__frames": 2}, 2)])
def test_nodes_remember_five_frames_unless_told_otherwise(make, overrides, n_frames):
    node, settings = make(**overrides)
    assert settings.config.memory.frames == node.get_parameter("memory.frames").value == n_frames


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


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("stereo.matchr", "no parameter 'stereo.matchr'; did you mean stereo.matcher?"),
        ("stereo.frame_id", "no parameter 'stereo.frame_id'"),
        ("thread", "no parameter 'thread'; did you mean threads?"),
    ],
)
def test_a_misspelt_name_at_the_start_is_refused(make, name, reason):
    with pytest.raises(ValueError, match="no parameter") as refused:
        make(**{name: "bm"})
    assert str(refused.value).startswith(reason)


def test_names_for_nodes_of_others_are_warned_of_once_and_the_node_runs(make, capfd):
    _, settings = make(robot_radius=0.3, threads=3, use_sim_time=False, map="m")
    assert settings.config.threads == 3
    warnings = [line for line in capfd.readouterr().err.splitlines() if "[WARN]" in line]
    assert len(warnings) == 1
    assert warnings[0].endswith("ignored, this package has no such parameters: robot_radius, map")


SECTIONS = """
/**:
  ros__parameters:
    use_sim_time: false
    start_type_description_service: true
    robot_radius: 0.3
    ground.max_step_m: 0.2
    clustering.k: 4
/**/short_range:
  ros__parameters: {stereo: {matcher: bm, n_disparities: 32}, elas.beta: 2e-3}
/*/long_range:
  ros__parameters: {clustering.k: 5, superpixels.compactness: 15, preset: paper, qos_overrides: {/tf: {depth: 1}}}
camera_driver:
  ros__parameters: {fps: 30}
front:
  short_range:
    ros__parameters: {stereo.n_disparities: 64, ground: {shape: line}, source: depth}
"""
OVERRULED = """
front/short_range:
  ros__parameters: {threads: 2, stereo.matcher: bm}
/front/**:
  ros__parameters: {threads: 3, preset: paper}
/front/long_range:
  ros__parameters: {features.cues: colour, memory.frames: 3}
"""


@pytest.mark.parametrize("text", [SECTIONS, OVERRULED])
@pytest.mark.parametrize(("name", "stages"), [("short_range", SHORT_RANGE_STAGES), ("long_range", LONG_RANGE_STAGES)])
def test_a_file_gives_a_node_what_it_gives_offline(ros, tmp_path, text, name, stages):
    path = tmp_path / "params.yaml"
    path.write_text(text, encoding="utf-8")
    arguments = ["--ros-args", "--params-file", str(path)]
    node = Node(name, namespace="front", cli_args=arguments, use_global_arguments=False, enable_rosout=False)
    file = read_parameter_file(path)
    online = Settings(node, stages).config.values()
    offline = {
        **file.config().values(),
        **{name: NODE_DEFAULTS[name] for name in NODE_DEFAULTS if name not in file.values},
    }
    node.destroy_node()
    own = [known.name for known in parameters() if known.stage in stages]
    if name == "long_range":  # offline, the short-range node's source counts
        own = [known for known in own if known.partition(".")[0] != "source"]
    assert {known: online[known] for known in own} == {known: offline[known] for known in own}
    assert file.config() != Config()


def test_a_file_with_a_misspelt_name_ends_the_executable_with_status_2(tmp_path):
    path = tmp_path / "params.yaml"
    path.write_text("/**/short_range: {ros__parameters: {stereo.mathcer: bm}}", encoding="utf-8")
    with process_starter() as start:
        process = start(
            *(sys.executable, "-m", "lrtrav_ros", "detector", "--ros-args", "--params-file", str(path)),
            *("-r", "__ns:=/parameters"),
        )
        _, errors = process.communicate(timeout=300)
    assert process.returncode == 2
    assert errors.splitlines()[-1].endswith("no parameter 'stereo.mathcer'; did you mean stereo.matcher?")
    assert "Traceback" not in errors


def test_a_change_takes_effect_and_makes_a_new_configuration(make):
    node, settings = make()
    before = settings.config
    assert set_all(node, stereo__n_disparities=64, superpixels__compactness=15).successful
    assert settings.config == DEFAULTS.updated({"stereo.n_disparities": 64, "superpixels.compactness": 15.0})
    assert before == DEFAULTS


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


TOO_WIDE = {"maps__cell_m": 0.01, "maps__length_m": 90.0, "maps__width_m": 12.0}
FINE_AND_NARROW = {"maps__cell_m": 0.01, "maps__length_m": 90.0, "maps__width_m": 10.0}  # cells: 9 million
COSTLY = {"superpixels__n_superpixels": 501, "features__distance": "euclidean"}


def test_values_that_only_fit_together_may_be_given_at_the_start(make):
    _, settings = make(**FINE_AND_NARROW)
    maps = settings.config.maps
    assert (maps.cell_m, maps.length_m, maps.width_m) == (0.01, 90.0, 10.0)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (COSTLY, "501 with features.distance 'euclidean'"),
        (TOO_WIDE, "10800000 cells"),
    ],
)
def test_values_that_together_take_too_long_are_refused(make, values, reason):
    with pytest.raises(ValueError, match=reason):
        make(**values)
    node, settings = make()
    refused = set_all(node, **values)
    assert not refused.successful
    assert reason in refused.reason
    assert settings.config == DEFAULTS


@pytest.mark.parametrize("names", [list(COSTLY), list(reversed(COSTLY))])
def test_of_values_that_do_not_fit_together_the_last_one_is_refused(make, names):
    node, settings = make()
    first, last = (set_all(node, **{name: COSTLY[name]}) for name in names)
    assert (first.successful, last.successful) == (True, False)
    assert "superpixels.n_superpixels 501 with features.distance 'euclidean'" in last.reason
    assert set_all(node, superpixels__n_superpixels=500, features__distance="euclidean").successful
    assert settings.config.superpixels.n_superpixels == 500


def test_what_one_by_one_does_not_fit_may_be_set_together(make):
    node, settings = make(maps__length_m=500.0, maps__width_m=200.0)
    refused, *_ = node.set_parameters([Parameter("maps.cell_m", value=0.01)])
    assert "give numbers that make 10000000 at most" in refused.reason
    assert set_all(node, **FINE_AND_NARROW).successful
    assert settings.config.maps.cell_m == 0.01


def test_tolerance_in_nanoseconds(make):
    _, settings = make(source__max_stamp_difference_s=0.0125)
    assert settings.stamp_tolerance_ns == 12_500_000
