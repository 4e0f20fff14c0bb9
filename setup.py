"""Package of lrtrav_ros, for pip and for colcon (ament_python)."""

import sys
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Distribution, find_packages, setup

# isort: split
from distutils.command.install_data import install_data  # setuptools brings it where Python no longer does

PACKAGE = ElementTree.parse("package.xml")
# All but `lrtrav` are its subcommands, and executables for `ros2 run`, too.
EXECUTABLES = [
    "lrtrav",
    "benchmark",
    "demo",
    "detect",
    "detector",
    "evaluate",
    "generate",
    "long_range_node",
    "replay",
    "short_range_node",
]
# `ros2 run` looks in lib/lrtrav_ros. colcon puts console scripts there (setup.cfg); pip puts them on the path, where
# names such as `demo` do not belong: under pip, `lrtrav` is the only one, and lib/lrtrav_ros has launchers of it.
UNDER_COLCON = not {"install", "develop"}.isdisjoint(sys.argv)
LAUNCHER = """#!/bin/sh
exec "$(dirname "$(readlink -f "$0")")/../../bin/lrtrav"{subcommand} "$@"
"""
# Wheels of ROS 2 exist for x86-64 Linux only; elsewhere, and under colcon, the ROS installation is used.
ROS = "platform_system == 'Linux' and platform_machine == 'x86_64'"


class DistributionWithData(Distribution):
    """A distribution whose editable installs have data files: there, setuptools asks for `has_data`, which it lacks."""

    has_data = Distribution.has_data_files


class InstallDataAndLaunchers(install_data):
    """Installs the data files, and a launcher for each executable."""

    def run(self) -> None:
        """Write them into the wheel."""
        super().run()
        folder = Path(self.install_dir, "lib", "lrtrav_ros")
        folder.mkdir(parents=True, exist_ok=True)
        for name in EXECUTABLES:
            launcher = folder / name
            launcher.write_text(LAUNCHER.format(subcommand="" if name == "lrtrav" else f" {name}"), encoding="utf-8")
            launcher.chmod(0o755)
            self.outfiles.append(str(launcher))


setup(
    name="lrtrav_ros",
    version=PACKAGE.findtext("version"),
    description=PACKAGE.findtext("description"),
    license=PACKAGE.findtext("license"),
    python_requires=">=3.10",
    packages=find_packages(include=["lrtrav_ros", "lrtrav_ros.*"]),
    package_data={"lrtrav_ros": ["py.typed"], "lrtrav_ros.evaluation.report": ["report.css", "report.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/lrtrav_ros"]),
        ("share/lrtrav_ros", ["package.xml"]),
        ("share/lrtrav_ros/config", sorted(map(str, Path("config").glob("*.*")))),
        ("share/lrtrav_ros/config/cameras", sorted(map(str, Path("config", "cameras").iterdir()))),
        ("share/lrtrav_ros/launch", ["launch/detector.launch.py"]),
    ],
    distclass=DistributionWithData,
    cmdclass={} if UNDER_COLCON else {"install_data": InstallDataAndLaunchers},
    install_requires=[
        "numpy>=1.26",
        "scipy>=1.11",
        "opencv-python-headless>=4.6",
        "numba>=0.59",
        "rosbags>=0.11.9",
        "joblib>=1.3",
        "threadpoolctl",
        "tqdm",
        "PyYAML",
        f"ros-jazzy-rclpy[fastrtps]; {ROS}",
        f"ros-jazzy-common-interfaces; {ROS}",
    ],
    extras_require={
        "cluster": ["distributed", "joblib>=1.4"],
        "evaluation": ["scikit-learn>=1.3"],
        "test": [
            "catkin_pkg",
            "colcon-common-extensions",
            "coverage",
            "distributed",
            "hypothesis",
            "mypy",
            "pytest",
            "pytest-xdist",
            "ruff",
            "scikit-learn>=1.3",
            "setuptools>=70.1,<80",
            "types-PyYAML",
            "types-tqdm",
        ],
    },
    zip_safe=True,
    entry_points={
        "console_scripts": [
            f"{name} = lrtrav_ros.commands:main" for name in (EXECUTABLES if UNDER_COLCON else ["lrtrav"])
        ]
    },
)
