"""Tests of the package as a whole: what is installed, what it needs, and what stays apart."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
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
    "rosgraph_msgs",
    "builtin_interfaces",
)


def run(*command: str | Path, cwd: Path = ROOT, **environment: str) -> str:
    """Run a command and return what it prints; fail with that if it fails."""
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_pip_builds_a_wheel_with_all_commands_and_files(tmp_path: Path) -> None:
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", tmp_path, ".")
    wheel = zipfile.ZipFile(next(tmp_path.glob("lrtrav_ros-*.whl")))
    entry_points = wheel.read(next(name for name in wheel.namelist() if name.endswith("entry_points.txt"))).decode()
    found = {line.split(" = ")[0] for line in entry_points.splitlines() if " = " in line}
    assert found == EXECUTABLES
    shared = {name.split("/data/share/")[1] for name in wheel.namelist() if "/data/share/" in name}
    assert {
        "ament_index/resource_index/packages/lrtrav_ros",
        "lrtrav_ros/package.xml",
        "lrtrav_ros/config/robust.yaml",
        "lrtrav_ros/launch/detector.launch.py",
    } <= shared


def test_colcon_installs_executables_that_run(tmp_path: Path) -> None:
    pytest.importorskip("colcon_core")
    run(
        Path(sys.executable).with_name("colcon"),
        *("--log-base", tmp_path / "log", "build", "--base-paths", ROOT),
        *("--build-base", tmp_path / "build", "--install-base", tmp_path / "install"),
    )
    prefix = tmp_path / "install" / "lrtrav_ros"
    folder = prefix / "lib" / "lrtrav_ros"
    assert {path.name for path in folder.iterdir()} == EXECUTABLES
    library = next(prefix.glob("lib/python*/site-packages"))
    path = os.pathsep.join([str(library), os.environ.get("PYTHONPATH", "")])
    assert "usage: detector" in run(folder / "detector", "--help", cwd=tmp_path, PYTHONPATH=path)
    assert "usage: lrtrav" in run(folder / "lrtrav", "--help", cwd=tmp_path, PYTHONPATH=path)


def test_package_xml_is_valid_and_agrees_with_setup_py() -> None:
    package = parse_package(str(ROOT / "package.xml"))
    assert package.get_build_type() == "ament_python"
    name, version, licence = run(sys.executable, "setup.py", "--name", "--version", "--license").splitlines()[-3:]
    assert (package.name, package.version, package.licenses[0]) == (name, version, licence)


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
