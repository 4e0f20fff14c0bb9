"""Arrays as messages of rosbags, to be written to bags."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.encodings import encode_image
from lrtrav_ros.io.image_files import DISPARITY_SCALE
from lrtrav_ros.io.point_clouds import FIELDS, FLOAT32, encode_points
from lrtrav_ros.io.topics import DISPARITY_TYPE, IMAGE_TYPE, INFO_TYPE
from lrtrav_ros.mapping.grid import Grid
from lrtrav_ros.mapping.ground_frame import GroundFrame, ground_frame_id
from lrtrav_ros.numerics.checks import check_array, check_type

ROS2 = get_typestore(Stores.ROS2_JAZZY)


def header_message(stamp_ns: int, frame_id: str) -> Any:
    """Return a ``std_msgs/Header``."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    stamp = ROS2.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return ROS2.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def image_message(header: Any, image: NDArray[Any]) -> Any:
    """Return a ``sensor_msgs/Image``; see `encode_image` for encodings and errors."""
    encoded = encode_image(image)
    return ROS2.types[IMAGE_TYPE](
        header=header,
        height=encoded.height,
        width=encoded.width,
        encoding=encoded.encoding,
        is_bigendian=0,
        step=encoded.step,
        data=encoded.data,
    )


def _region(height: int, width: int) -> Any:
    return ROS2.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=height, width=width, do_rectify=False
    )


def camera_info_message(header: Any, camera: StereoCamera, size: tuple[int, ...], *, baseline_m: float) -> Any:
    """Return the calibration of the camera that stands `baseline_m` to the right of the left one."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    return ROS2.types[INFO_TYPE](
        header=header,
        height=size[0],
        width=size[1],
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1], np.float64),
        r=np.eye(3).reshape(-1),
        p=np.array([fx, 0, cx, -fx * baseline_m, 0, fy, cy, 0, 0, 0, 1, 0], np.float64),
        binning_x=0,
        binning_y=0,
        roi=_region(0, 0),
    )


def disparity_message(header: Any, disparity: NDArray[np.float32], camera: StereoCamera) -> Any:
    """Return a DisparityImage, of which the invalid pixels (0) are below the least valid disparity."""
    check_array("disparity", disparity, np.float32, ("H", "W"))
    check_type("camera", camera, StereoCamera)
    valid = disparity[disparity > 0]
    return ROS2.types[DISPARITY_TYPE](
        header=header,
        image=image_message(header, disparity),
        f=camera.fx,
        t=camera.baseline_m,
        valid_window=_region(*disparity.shape),
        min_disparity=float(valid.min(initial=np.inf)) if valid.size else 1.0,
        max_disparity=float(valid.max(initial=1.0)),
        delta_d=1 / DISPARITY_SCALE,
    )


def points_message(header: Any, points: NDArray[np.float32]) -> Any:
    """Return points (N, 3), x, y and z in metres, as a ``sensor_msgs/PointCloud2``."""
    encoded = encode_points(points)
    field = ROS2.types["sensor_msgs/msg/PointField"]
    return ROS2.types["sensor_msgs/msg/PointCloud2"](
        header=header,
        height=encoded.height,
        width=encoded.width,
        fields=[field(name=name, offset=offset, datatype=FLOAT32, count=1) for name, offset in FIELDS.items()],
        is_bigendian=False,
        point_step=encoded.point_step,
        row_step=encoded.row_step,
        data=encoded.data,
        is_dense=encoded.is_dense,
    )


def grid_message(header: Any, grid: Grid) -> Any:
    """Return a grid as a ``nav_msgs/OccupancyGrid`` in the ground frame below the camera that a header names."""
    n_y, n_x = grid.cells.shape
    info = ROS2.types["nav_msgs/msg/MapMetaData"](
        map_load_time=header.stamp,
        resolution=grid.resolution_m,
        width=n_x,
        height=n_y,
        origin=_pose((*grid.origin_m, 0.0), (0.0, 0.0, 0.0, 1.0)),
    )
    return ROS2.types["nav_msgs/msg/OccupancyGrid"](
        header=_below(header), info=info, data=np.ascontiguousarray(grid.cells).reshape(-1)
    )


def ground_pose_message(header: Any, ground: GroundFrame) -> Any:
    """Return the pose of the camera that a header names over the ground, a ``geometry_msgs/PoseStamped``."""
    pose = _pose((0.0, 0.0, ground.height_m), ground.quaternion)
    return ROS2.types["geometry_msgs/msg/PoseStamped"](header=_below(header), pose=pose)


def ground_transform_message(header: Any, ground: GroundFrame) -> Any:
    """Return the ground frame as a child of the frame of the camera that a header names, a ``tf2_msgs/TFMessage``."""
    x, y, z = ground.pose_in_camera.translation_m.tolist()
    qx, qy, qz, qw = ground.quaternion
    transform = ROS2.types["geometry_msgs/msg/Transform"](
        translation=ROS2.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z), rotation=_quaternion(-qx, -qy, -qz, qw)
    )
    stamped = ROS2.types["geometry_msgs/msg/TransformStamped"](
        header=header, child_frame_id=ground_frame_id(header.frame_id), transform=transform
    )
    return ROS2.types["tf2_msgs/msg/TFMessage"](transforms=[stamped])


def _below(header: Any) -> Any:
    """Return a camera's header, but in the ground frame below it."""
    return ROS2.types["std_msgs/msg/Header"](stamp=header.stamp, frame_id=ground_frame_id(header.frame_id))


def _pose(position: tuple[float, float, float], orientation: tuple[float, float, float, float]) -> Any:
    x, y, z = position
    point = ROS2.types["geometry_msgs/msg/Point"](x=x, y=y, z=z)
    return ROS2.types["geometry_msgs/msg/Pose"](position=point, orientation=_quaternion(*orientation))


def _quaternion(x: float, y: float, z: float, w: float) -> Any:
    return ROS2.types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)
