"""Package of lrtrav_ros, for pip and for colcon (ament_python)."""

from pathlib import Path

from setuptools import find_packages, setup

# What `ros2 run lrtrav_ros` and the shell can start; each is a subcommand of `lrtrav` as well.
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
# Wheels of ROS 2 exist for x86-64 Linux only; elsewhere, and under colcon, the ROS installation is used.
ROS = "platform_system == 'Linux' and platform_machine == 'x86_64'"

setup(
    name="lrtrav_ros",
    version="0.1.0",
    description="Finds where a mobile robot can drive, far beyond the range of its stereo camera, without any learning",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=["lrtrav_ros", "lrtrav_ros.*"]),
    package_data={"lrtrav_ros.evaluation.report": ["report.css", "report.js"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/lrtrav_ros"]),
        ("share/lrtrav_ros", ["package.xml"]),
        ("share/lrtrav_ros/config", sorted(map(str, Path("config").iterdir()))),
        ("share/lrtrav_ros/launch", ["launch/detector.launch.py"]),
    ],
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
            "distributed",
            "mypy",
            "pytest",
            "ruff",
            "scikit-learn>=1.3",
            "setuptools>=70.1,<80",
            "types-PyYAML",
            "types-tqdm",
        ],
    },
    zip_safe=True,
    entry_points={"console_scripts": [f"{name} = lrtrav_ros.commands:main" for name in EXECUTABLES]},
)
