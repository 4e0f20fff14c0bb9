"""ROS 2 parameter files, read offline as nodes would read them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from damaged_files import refusal, variants

from lrtrav_ros.config import PRESETS, Config
from lrtrav_ros.io.parameter_file import ParameterFile, dump_parameters, read_parameter_file

ROOT = Path(__file__).parents[2]

Read = Callable[[str], ParameterFile]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Return a function that reads a parameter file of this text."""

    def read(text: str) -> ParameterFile:
        path = tmp_path / "params.yaml"
        path.write_text(text, encoding="utf-8")
        return read_parameter_file(path)

    return read


def section(name: str, **values: object) -> str:
    """Return a section; two underscores in a parameter's name stand for a dot."""
    assignments = ", ".join(f"{key.replace('__', '.')}: {value}" for key, value in values.items())
    return f'"{name}": {{ros__parameters: {{{assignments}}}}}\n'


@pytest.mark.parametrize("preset", PRESETS)
def test_files_in_config_are_the_presets(preset: str) -> None:
    assert read_parameter_file(ROOT / "config" / f"{preset}.yaml").config() == Config.preset(preset)


def test_what_is_written_is_read(read: Read) -> None:
    config = Config().updated({"elas.beta": 1e-3, "features.cues": "colour", "ground.max_step_m": 0.3, "threads": 3})
    file = read(dump_parameters(config))
    assert file.values == config.values()
    assert file.config() == config


def test_each_node_has_its_section_and_those_of_others_are_passed_over(read: Read) -> None:
    file = read("""
/short_range:
  ros__parameters:
    use_sim_time: true
    source.max_depth_m: 8
    stereo: {matcher: bm, n_disparities: 64}
    qos_overrides: {/left/image_rect: {subscription: {reliability: reliable}}}
long_range:
  ros__parameters:
    start_type_description_service: false
    superpixels.n_superpixels: 300
    source.max_depth_m: 5.0
    stereo.matcher: sgbm
/camera_driver:
  ros__parameters: {stereo.mathcer: 5, fps: [1, 2], nested: {width: null}}
""")
    assert file.values == {
        "source.max_depth_m": 8,
        "stereo.matcher": "bm",
        "stereo.n_disparities": 64,
        "superpixels.n_superpixels": 300,
    }
    assert file.foreign == ()
    assert file.config() == Config().updated(file.values)


@pytest.mark.parametrize(
    "name",
    [
        "/**",
        "/short_range",
        "short_range",
        "/front/short_range",
        "/robot/front/short_range",
        "/**/short_range",
        "/*/short_range",
        "/front/*",
        "/front/**",
        "/*",
        "/*/front/**",
        "/*/**",
        "/front/**/*",
        "**/short_range",
    ],
)
def test_sections_that_match_the_node_in_some_namespace(read: Read, name: str) -> None:
    assert read(section(name, stereo__matcher="bm")).values == {"stereo.matcher": "bm"}


@pytest.mark.parametrize("name", ["/short", "/short_range_2", "/short_range/camera", "/front/*/camera", "/long_range"])
def test_sections_that_do_not(read: Read, name: str) -> None:
    assert read(section(name, stereo__matcher="bm")).values == {}


def test_namespaces_as_nested_maps(read: Read) -> None:
    file = read("""
/robot:
  front:
    short_range: {ros__parameters: {stereo.matcher: bm}}
    long_range: {ros__parameters: {clustering: {k: 7}}}
  "**": {ros__parameters: {ground.max_step_m: .2}}
  ros__parameters: {name: of a node called robot}
""")
    assert file.values == {"stereo.matcher": "bm", "ground.max_step_m": 0.2, "clustering.k": 7}


def test_a_section_overrides_those_before_it_and_may_come_twice(read: Read) -> None:
    first, second = section("/**", threads=1, stereo__matcher="bm"), section("/front/short_range", threads=2)
    assert read(first + second).values == {"threads": 2, "stereo.matcher": "bm"}
    assert read(second + first).values == {"threads": 1, "stereo.matcher": "bm"}
    again = section("/front/short_range", ground__shape="line", threads=3)
    assert read(second + first + again).values == {"threads": 1, "stereo.matcher": "bm", "ground.shape": "line"}


def test_numbers_are_spelt_as_ros_takes_them(read: Read) -> None:
    file = read(section("/**", elas__beta="2e-3", ground__noise_px=1, ground__max_step_m=".5", elas__gamma="1.E1"))
    assert file.values == {"elas.beta": 0.002, "ground.noise_px": 1, "ground.max_step_m": 0.5, "elas.gamma": 10.0}


@pytest.mark.parametrize(
    "text",
    [
        section("/front/short_range", threads=1) + section("/rear/short_range", threads=2),
        section("/*/short_range", threads=1) + section("/rear/short_range", threads=2) + section("/front/*"),
        section("/front/**", threads=1) + section("/rear/short_range", threads=2),
    ],
)
def test_namespaces_that_disagree_are_refused_with_both_names(read: Read, text: str) -> None:
    with pytest.raises(ValueError, match=r"params\.yaml: threads is \d for .*; keep the sections of one") as refused:
        read(text)
    assert all(f"/{namespace}/short_range" in str(refused.value) for namespace in ("front", "rear"))


def test_a_parameter_that_only_one_namespace_has_is_a_disagreement(read: Read) -> None:
    text = section("/short_range", threads=1) + section("/front/short_range", threads=1, ground__shape="line")
    with pytest.raises(
        ValueError, match=r"ground\.shape is not set for /short_range and 'line' for /front/short_range"
    ):
        read(text)


def test_namespaces_that_agree_are_read(read: Read) -> None:
    text = (
        section("/front/short_range", threads=1, use_sim_time=True, ground__noise_px=1)
        + section("/rear/short_range", threads=1, ground__noise_px="1.0")
        + section("/**/short_range", stereo__matcher="bm")
        + section("/rear/*", clustering__k=5)
    )
    assert read(text).values == {"threads": 1, "ground.noise_px": 1, "stereo.matcher": "bm", "clustering.k": 5}


def test_a_preset_is_what_the_file_starts_from(read: Read) -> None:
    file = read(section("/**", preset="paper", extension__rule="evidence"))
    assert file.values == {"extension.rule": "evidence"}
    assert file.config() == Config.preset("paper").updated(file.values)
    assert file.config("robust") == Config().updated(file.values)


def test_a_preset_of_one_node_is_for_its_stages(read: Read) -> None:
    config = read(section("/long_range", preset="paper")).config()
    assert (config.clustering.k, config.extension.rule) == (0, "area")
    assert (config.ground, config.source) == (Config().ground, Config().source)


def test_names_for_nodes_of_others_are_reported_once(read: Read) -> None:
    file = read(section("/**", robot_radius=0.3, threads=1) + section("/*/**", robot_radius=0.3, map="m"))
    assert file.values == {"threads": 1}
    assert file.foreign == ("robot_radius", "map")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"has no parameters; write them under '/\*\*:'"),
        ("# nothing", "has no parameters"),
        ("- 1", "has no parameters"),
        ("/**: {}", "has no parameters"),
        ("stereo: {matcher: bm}", "has no 'ros__parameters:' under 'stereo'"),
        ("threads: 1", "has no 'ros__parameters:' under 'threads'"),
        ("/**: {ros__parameters: }", r"has no 'ros__parameters:' under '/\*\*'"),
        ("ros__parameters: {threads: 1}", "'' is no name of a node"),
        ("/front*/short_range: {ros__parameters: {threads: 1}}", r"'/front\*/short_range' is no name of a node"),
        ("/front: {/short_range: {ros__parameters: {}}}", "'/front//short_range' is no name of a node"),
        ("a: [", "is not YAML"),
        (section("/**", stereo__mathcer="bm"), "no parameter 'stereo.mathcer'; did you mean stereo.matcher"),
        (section("/**", max_depth_m=10), "no parameter 'max_depth_m'; did you mean source.max_depth_m"),
        (section("/**", matcher="bm"), "no parameter 'matcher'; did you mean stereo.matcher"),
        (section("/short_range", robot_radius=1), "no parameter 'robot_radius'"),
        (section("/**/long_range", robot_radius=1), "no parameter 'robot_radius'"),
        (section("/**", stereo__matcher="best"), "stereo.matcher is 'best'; give one of elas, sgbm, bm"),
        (section("/**", threads="[1, 2]"), r"threads is \[1, 2\]; give int"),
        (section("/**", threads="null"), "threads is None; give int"),
        (section("/**", preset="best"), "no preset 'best'; choose one of robust, paper"),
    ],
)
def test_bad_files_are_refused_by_name(read: Read, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=f"params.yaml.*{message}"):
        read(text)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_bytes(b"/**: \xff")
    with pytest.raises(ValueError, match=r"params\.yaml: is no text in UTF-8 \(invalid start byte at byte 5\)"):
        read_parameter_file(path)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("[*a, *a]", r"has an alias, such as \*a"),
        ("{b: *a, c: *a}", r"has an alias, such as \*a"),
        ("9" * 400, "has a number of 400 digits"),
        ("9" * 60, "source.max_depth_m is a number of more than 64 bits; give 0 to 1000 m"),
        ("1e400", "source.max_depth_m is inf; give 0 to 1000 m"),
        ("1" + ":59" * 40000, "has a number of 120001 digits"),
        ("[" * 10000, "is nested too deeply"),
        ("{a: " * 10000, "is nested too deeply"),
        ("- " * 20000, "is nested too deeply|is not YAML"),
        ("!!int ''", "has a tag that does not fit its value"),
        ("!!bool maybe", "has a tag that does not fit its value"),
        ("!!timestamp now", "has a tag that does not fit its value"),
        ("!!python/object/apply:os.getpid []", "is not YAML: could not determine a constructor"),
        ("2001-99-99", "month must be in 1..12"),
        ("\0", "is not YAML: unacceptable character"),
        ("1 #" + "x" * (1 << 17), "has 131124 bytes; give a file of at most 131072"),
    ],
    ids=lambda value: value[:12],
)
def test_values_that_take_yaml_long_or_break_it_are_refused(read: Read, value: str, message: str) -> None:
    with pytest.raises(ValueError, match=f"params.yaml.*({message})"):
        read(f"/**:\n  ros__parameters:\n    source.max_depth_m: {value}\n")


def test_a_byte_order_mark_is_passed_over(read: Read) -> None:
    assert read("\ufeff/**: {ros__parameters: {threads: 3}}").values == {"threads": 3}


@pytest.mark.parametrize("damaged", [*variants(dump_parameters(Config()).encode(), n_flips=10, step=512)])
def test_damaged_files_are_refused_by_name_or_read_as_what_they_say(tmp_path: Path, damaged: bytes) -> None:
    path = tmp_path / "params.yaml"
    path.write_bytes(damaged)
    assert re.match(f"{path}: |{path} is not YAML: |$", refusal(read_parameter_file, path))


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.yaml"):
        read_parameter_file(tmp_path / "none.yaml")
