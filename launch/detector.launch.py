"""The detector; beside it, where asked for, a bag in place of the camera, and RViz.

ros2 launch lrtrav_ros detector.launch.py camera:=realsense_stereo
ros2 launch lrtrav_ros detector.launch.py namespace:=front left:=/front/left right:=/front/right
ros2 launch lrtrav_ros detector.launch.py bag:=recording.mcap rviz:=true
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(__file__).parents[1] / "config"
REMAP = re.compile(r"^# remap: (\S+):=(\S+)$", re.MULTILINE)

ARGUMENTS = {
    "namespace": ("", "namespace of the nodes and of their topics"),
    "camera": ("", "camera family, a file of config/cameras such as realsense_stereo, or a file of your own like them"),
    "params_file": ("", "YAML file of parameters, which prevails over the camera family's; if empty, none is read"),
    "preset": (
        "",
        "robust or paper, for what params_file does not set; a section for one node may name its own preset",
    ),
    "source": ("", "stereo, disparity or depth; if empty, as in the files"),
    "rectify": ("", "true for raw images, left/image_raw and right/image_raw; if empty, as in the files"),
    "left": ("left", "namespace of the left camera's image and camera_info"),
    "right": ("right", "namespace of the right camera's image and camera_info"),
    "disparity": ("disparity", "topic of the disparity image, where the source is disparity"),
    "depth": ("depth/image_rect", "topic of the depth image, where the source is depth; camera_info stands beside it"),
    "bag": ("", "rosbag to replay, in its own time, in place of a camera"),
    "rviz": ("false", "true for RViz with config/detector.rviz"),
    "fixed_frame": ("base_link", "RViz's fixed frame"),
    "two_processes": ("false", "true for a process of its own for each node"),
    "autostart": ("", "false for nodes that wait for a lifecycle manager"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the detector with its arguments."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=processes)])


def processes(context: LaunchContext) -> list[Node]:
    """Return the processes that the arguments ask for."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    family = family_file(given["camera"])
    text = family.read_text(encoding="utf-8") if family else ""
    remappings = [*named_topics(given), *family_topics(text)]
    executables = ["short_range_node", "long_range_node"] if is_true(given, "two_processes") else ["detector"]
    clock = ["-p", "use_sim_time:=true"] if given["bag"] else []
    nodes = [
        # Not as `parameters`: launch_ros only warns of a file that does not exist, and the nodes would run without it.
        process(given, "lrtrav_ros", executable, [*parameter_arguments(given, family), *clock], remappings=remappings)
        for executable in executables
    ]
    if given["bag"]:
        arguments = replay_arguments(given, text)
        nodes.append(process(given, "lrtrav_ros", "replay", [], arguments=arguments, remappings=remappings))
    if is_true(given, "rviz"):
        arguments = ["-d", str(CONFIG / "detector.rviz"), "-f", given["fixed_frame"]]
        nodes.append(process(given, "rviz2", "rviz2", clock, arguments=arguments))
    return nodes


def process(
    given: Mapping[str, str],
    package: str,
    executable: str,
    ros_arguments: Sequence[str],
    *,
    arguments: Sequence[str] = (),
    remappings: Sequence[tuple[str, str]] = (),
) -> Node:
    """Return one process in the namespace of them all."""
    return Node(
        package=package,
        executable=executable,
        namespace=given["namespace"],
        arguments=list(arguments),
        ros_arguments=list(ros_arguments),
        remappings=list(remappings),
        output="screen",
        emulate_tty=True,
    )


def is_true(given: Mapping[str, str], name: str) -> bool:
    """Return whether an argument is true; raises ValueError where it is neither true nor false."""
    if given[name].lower() not in ("true", "false"):
        raise ValueError(f"{name} is {given[name]!r}; give true or false")
    return given[name].lower() == "true"


def family_file(camera: str) -> Path | None:
    """Return the file of a camera family, None for no family; raises ValueError where there is no such file."""
    if not camera:
        return None
    path = Path(camera) if camera.endswith(".yaml") else CONFIG / "cameras" / f"{camera}.yaml"
    if not path.is_file():
        families = ", ".join(sorted(file.stem for file in (CONFIG / "cameras").glob("*.yaml")))
        raise ValueError(f"camera is {camera!r}; give one of {families}, or a YAML file that exists")
    return path


def family_topics(text: str) -> list[tuple[str, str]]:
    """Return what the file of a camera family remaps, as names of this package and topics of the driver."""
    return REMAP.findall(text)


def named_topics(given: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return what arguments remap; they go before those of the camera family, as ROS takes the first that fits."""
    pairs = [
        (f"{side}/{topic}", f"{given[side]}/{topic}")
        for side in ("left", "right")
        for topic in ("image_rect", "image_raw", "camera_info")
    ]
    pairs += [
        ("disparity", given["disparity"]),
        ("depth/image_rect", given["depth"]),
        ("depth/camera_info", str(PurePosixPath(given["depth"]).with_name("camera_info"))),
    ]
    return [(name, topic) for name, topic in pairs if name != topic]


def parameter_arguments(given: Mapping[str, str], family: Path | None) -> list[str]:
    """Return the ROS arguments for what is given, the later ones prevailing over sections for all nodes before them."""
    files = [str(family) if family else "", given["params_file"]]
    values = {
        "preset": given["preset"],
        "source": given["source"],
        "source.rectify": given["rectify"],
        "autostart": given["autostart"],
    }
    return [
        *(word for file in files if file for word in ("--params-file", file)),
        *(word for name, value in values.items() if value for word in ("-p", f"{name}:={value}")),
    ]


def replay_arguments(given: Mapping[str, str], text: str) -> list[str]:
    """Return the arguments of `replay`, for a bag of the driver's topics where a camera family is given."""
    family = (yaml.safe_load(text) or {}).get("/**", {}).get("ros__parameters", {})
    source = given["source"] or family.get("source", "")
    is_raw = given["rectify"].lower() or str(family.get("source.rectify", False)).lower()
    return [
        given["bag"],
        "--clock",
        *(["--source", source] if source else []),
        *(["--raw"] if is_raw == "true" else []),
        *(word for name, topic in family_topics(text) for word in ("--remap", f"{topic}:={name}")),
    ]
