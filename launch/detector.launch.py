"""Both nodes in one process.

ros2 launch lrtrav_ros detector.launch.py namespace:=front_camera params_file:=params.yaml
ros2 launch lrtrav_ros detector.launch.py left:=/zed/left right:=/zed/right
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "namespace": ("", "namespace of the nodes and of their topics"),
    "left": ("left", "namespace of the left camera's image_rect and camera_info"),
    "right": ("right", "namespace of the right camera's image_rect and camera_info"),
    "disparity": ("disparity", "topic of the disparity image"),
    "depth": ("depth/image_rect", "topic of the depth image, where the parameter source is depth"),
}


def generate_launch_description():
    """Return the detector with its arguments."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    params_file = DeclareLaunchArgument(
        "params_file",
        default_value=PathJoinSubstitution([FindPackageShare("lrtrav_ros"), "config", "robust.yaml"]),
        description="YAML file of parameters",
    )
    detector = Node(
        package="lrtrav_ros",
        executable="detector",
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("params_file")],
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
    return LaunchDescription([*declared, params_file, detector])
