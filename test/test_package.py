"""Tests of the package as a whole: what is installed, what it needs, and what stays apart."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml
from catkin_pkg.package import parse_package

from lrtrav_ros.commands import COMMANDS

ROOT = Path(__file__).parents[1]
EXECUTABLES = {"lrtrav", *COMMANDS}
ROS_MODULES = (
    "rclpy",
    "sensor_msgs",
    "stereo_msgs",
    "std_msgs",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "nav_msgs",
    "rosgraph_msgs",
    "tf2_msgs",
    "tf2_ros",
    "vision_msgs",
    "builtin_interfaces",
)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the source tree, so that nothing built before gets into what is built here."""
    ignored = shutil.ignore_patterns(".*", "build", "install", "log", "demo", "*.egg-info", "__pycache__")
    return Path(shutil.copytree(ROOT, tmp_path_factory.mktemp("package") / "source", ignore=ignored))


def run(*command: str | Path, cwd: Path = ROOT, **environment: str) -> str:
    """Run a command and return what it prints; fail with that if it fails."""
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def build_wheel(source: Path, folder: Path, kind: str) -> Path:
    """Build what pip installs, as pip does it: a ``wheel``, or an ``editable`` one that refers to `source`."""
    code = f"from setuptools import build_meta; build_meta.build_{kind}({str(folder)!r})"
    run(sys.executable, "-c", code, cwd=source)
    return next(folder.glob("*.whl"))


def test_wheel_holds_all_of_the_package_and_what_ros_looks_for(source: Path, tmp_path: Path) -> None:
    files = set(zipfile.ZipFile(build_wheel(source, tmp_path, "wheel")).namelist())
    package = {
        path.relative_to(source).as_posix()
        for path in (source / "lrtrav_ros").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert {"lrtrav_ros/py.typed", "lrtrav_ros/evaluation/report/report.css"} <= package
    assert {name for name in files if name.startswith("lrtrav_ros/")} == package
    assert {
        "ament_index/resource_index/packages/lrtrav_ros",
        "lrtrav_ros/package.xml",
        "lrtrav_ros/config/robust.yaml",
        "lrtrav_ros/config/cameras/realsense_stereo.yaml",
        "lrtrav_ros/launch/detector.launch.py",
    } <= {name.split("/data/share/")[1] for name in files if "/data/share/" in name}


@pytest.mark.parametrize("kind", ["wheel", "editable"])
def test_pip_puts_lrtrav_on_the_path_and_all_executables_where_ros2_run_looks(
    source: Path, tmp_path: Path, kind: str
) -> None:
    prefix = tmp_path / "prefix"
    wheel = build_wheel(source, tmp_path, kind)
    # `--ignore-installed`, or else pip would uninstall the package from the environment that runs the tests.
    options = ("--no-deps", "--no-index", "--ignore-installed", "--no-warn-script-location")
    run(sys.executable, "-m", "pip", "install", *options, "--prefix", prefix, wheel)
    assert {path.name for path in (prefix / "bin").iterdir()} == {"lrtrav"}
    assert {path.name for path in (prefix / "lib" / "lrtrav_ros").iterdir()} == EXECUTABLES
    (tmp_path / "link").symlink_to(prefix / "lib" / "lrtrav_ros" / "detector")
    for executable, usage in (
        (prefix / "bin" / "lrtrav", "usage: lrtrav [-h]"),
        (prefix / "lib" / "lrtrav_ros" / "lrtrav", "usage: lrtrav [-h]"),
        (prefix / "lib" / "lrtrav_ros" / "short_range_node", "usage: lrtrav short_range_node [-h]"),
        (tmp_path / "link", "usage: lrtrav detector [-h]"),
    ):
        assert run(executable, "--help", cwd=tmp_path).startswith(usage)


@pytest.mark.parametrize("options", [[], ["--symlink-install"]])
def test_colcon_puts_all_executables_where_ros2_run_looks(source: Path, tmp_path: Path, options: list[str]) -> None:
    pytest.importorskip("colcon_core")
    run(
        Path(sys.executable).with_name("colcon"),
        *("--log-base", tmp_path / "log", "build", "--base-paths", source),
        *("--build-base", tmp_path / "build", "--install-base", tmp_path / "install", *options),
    )
    folder = tmp_path / "install" / "lrtrav_ros" / "lib" / "lrtrav_ros"
    assert {path.name for path in folder.iterdir()} == EXECUTABLES
    in_workspace = f'. "{tmp_path}/install/setup.bash" && exec "$0" --help'
    for name in ("detector", "lrtrav"):
        interpreter = (folder / name).read_text(encoding="utf-8").splitlines()[0].removeprefix("#!")
        assert Path(interpreter).parent == Path(sys.executable).parent
        assert run("bash", "-c", in_workspace, folder / name, cwd=tmp_path).startswith(f"usage: {name} [-h]")


def test_version_stands_in_package_xml_alone(source: Path, tmp_path: Path) -> None:
    renumbered = tmp_path / "source"
    shutil.copytree(source, renumbered)
    manifest = renumbered / "package.xml"
    text = manifest.read_text(encoding="utf-8")
    manifest.write_text(re.sub("<version>.*</version>", "<version>3.14.15</version>", text), encoding="utf-8")
    wheel = build_wheel(renumbered, tmp_path, "wheel")
    code = "import lrtrav_ros; print(lrtrav_ros.__version__)"
    assert run(sys.executable, "-c", code, cwd=tmp_path, PYTHONPATH=str(wheel)).strip() == "3.14.15"


def test_package_xml_is_valid_and_agrees_with_setup_py() -> None:
    package = parse_package(str(ROOT / "package.xml"))
    assert package.get_build_type() == "ament_python"
    name, version, licence = run(sys.executable, "setup.py", "--name", "--version", "--license").splitlines()[-3:]
    assert (package.name, package.version, package.licenses[0]) == (name, version, licence)


def test_oldest_dependencies_are_those_of_setup_py() -> None:
    bounds = re.findall(r'"([a-z-]+)>=([0-9.]+)"', (ROOT / "setup.py").read_text(encoding="utf-8"))
    oldest = dict(sorted(bounds, key=lambda item: version(item[1])))  # the extras included
    constraints = (ROOT / "test" / "oldest-dependencies.txt").read_text(encoding="utf-8")
    tested = dict(re.findall(r"^([a-z-]+)==([0-9.]+?)(?:\.\*)?$", constraints, re.MULTILINE))
    assert {name: version(text) for name, text in tested.items()} == {
        name: version(oldest[name]) for name in oldest if name != "setuptools"
    }


def version(text: str) -> tuple[int, ...]:
    """Return the numbers of a version, without zeros at the end."""
    return tuple(map(int, re.sub(r"(\.0)+$", "", text).split(".")))


def test_citation_has_no_version_of_its_own() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["cff-version"], citation["license"]) == ("1.2.0", "Apache-2.0")
    assert "version" not in citation
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == ["Lu", "Jiang", "Zell"]
    assert paper["title"].startswith("Long Range Traversable Region Detection")


def test_every_ros_package_that_is_imported_is_declared() -> None:
    declared = {dependency.name for dependency in parse_package(str(ROOT / "package.xml")).exec_depends}
    imported = {
        name
        for path in (ROOT / "lrtrav_ros").rglob("*.py")
        for name in imported_modules(path)
        if name == "rclpy" or name.endswith("_msgs")
    }
    assert imported <= declared


def imported_modules(path: Path) -> set[str]:
    """Return the top-level names of what a source file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize(
    ("room", "allowed"),
    [
        ("config.py", {"pose"}),
        ("camera.py", {"config", "numerics"}),
        ("frame.py", {"camera", "numerics"}),
        ("pose.py", {"numerics"}),
        ("registration.py", {"camera", "numerics", "pose", "_registration_kernels"}),
        ("rectification.py", {"camera", "frame", "numerics"}),
        ("detector.py", {"camera", "config", "frame", "method", "numerics"}),
        ("numerics", {"numerics"}),
        ("method", {"camera", "config", "frame", "method", "numerics"}),
        ("mapping", {"camera", "config", "frame", "mapping", "method", "numerics", "pose"}),
        ("synthetic", {"camera", "config", "frame", "numerics", "synthetic"}),
        (
            "io",
            {
                "camera",
                "config",
                "detector",
                "frame",
                "io",
                "mapping",
                "method",
                "numerics",
                "pose",
                "rectification",
                "registration",
            },
        ),
        ("offline", {"camera", "config", "detector", "io", "offline"}),
        ("benchmark", {"benchmark", "config", "detector", "frame", "method", "nodes", "synthetic"}),
        (
            "nodes",
            {
                *("camera", "config", "detector", "frame", "io", "mapping"),
                *("method", "nodes", "numerics", "pose", "registration"),
            },
        ),
    ],
)
def test_a_room_imports_only_what_lies_further_in(room: str, allowed: set[str]) -> None:
    place = ROOT / "lrtrav_ros" / room
    imported = {
        node.module.split(".")[1]
        for path in (place.rglob("*.py") if place.is_dir() else [place])
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("lrtrav_ros.")
    }
    assert imported <= allowed


def test_only_the_nodes_import_ros() -> None:
    outside = [path for path in (ROOT / "lrtrav_ros").rglob("*.py") if path.parent.name != "nodes"]
    assert len(outside) > 15
    assert {path.name: imported_modules(path) & set(ROS_MODULES) for path in outside} == {
        path.name: set() for path in outside
    }


def test_core_works_where_ros_is_not_installed() -> None:
    code = f"""
import sys
for name in {ROS_MODULES}:
    sys.modules[name] = None
import numpy as np
from lrtrav_ros import Config, Detector, StereoCamera
detector = Detector(Config.preset("robust"), StereoCamera(fx=50.0, cx=20.0, cy=15.0, baseline_m=0.1))
print(detector.detect(np.zeros((30, 40, 3), np.uint8), np.zeros((30, 40, 3), np.uint8)).long_range.mask.shape)
"""
    assert run(sys.executable, "-c", code).strip() == "(30, 40)"


def test_package_names_what_it_exports() -> None:
    import lrtrav_ros

    assert all(hasattr(lrtrav_ros, name) for name in lrtrav_ros.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Detektor'"):
        _ = lrtrav_ros.Detektor
