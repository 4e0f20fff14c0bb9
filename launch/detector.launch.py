"""Both nodes in one process.

ros2 launch lrtrav_ros detector.launch.py namespace:=front_camera params_file:=params.yaml
ros2 launch lrtrav_ros detector.launch.py left:=/zed/left right:=/zed/right preset:=paper
"""

from __future__ import annotations

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "namespace": ("", "namespace of the nodes and of their topics"),
    "params_file": ("", "YAML file of parameters; if empty, none is read"),
    "preset": (
        "",
        "robust or paper, for what params_file does not set; a section for one node may name its own preset",
    ),
    "left": ("left", "namespace of the left camera's image_rect and camera_info"),
    "right": ("right", "namespace of the right camera's image_rect and camera_info"),
    "disparity": ("disparity", "topic of the disparity image"),
    "depth": ("depth/image_rect", "topic of the depth image, where the parameter source is depth"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the detector with its arguments."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=detector_process)])


def detector_process(context: LaunchContext) -> list[Node]:
    """Return the process that runs both nodes."""
    node = Node(
        package="lrtrav_ros",
        executable="detector",
        namespace=LaunchConfiguration("namespace"),
        # Not as `parameters`: launch_ros only warns of a file that does not exist, and the nodes would run without it.
        ros_arguments=parameter_arguments(
            params_file=LaunchConfiguration("params_file").perform(context),
            preset=LaunchConfiguration("preset").perform(context),
        ),
        remappings=[
            *(
                (f"{side}/{topic}", [LaunchConfiguration(side), f"/{topic}"])
                for side in ("left", "right")
                for topic in ("image_rect", "camera_info")
            ),
            ("disparity", LaunchConfiguration("disparity")),
            ("depth/image_rect", LaunchConfiguration("depth")),
        ],
        output="screen",
        emulate_tty=True,
    )
    return [node]


def parameter_arguments(*, params_file: str, preset: str) -> list[str]:
    """Return the ROS arguments for what is given; the preset prevails over one in the file's section for all nodes."""
    file_arguments = ["--params-file", params_file] if params_file else []
    preset_arguments = ["-p", f"preset:={preset}"] if preset else []
    return [*file_arguments, *preset_arguments]
