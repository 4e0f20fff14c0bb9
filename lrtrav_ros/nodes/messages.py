"""Arrays as messages of rclpy."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import MapMetaData, OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2, PointField, RegionOfInterest
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.encodings import encode_image
from lrtrav_ros.io.point_clouds import FIELDS, FLOAT32, encode_points
from lrtrav_ros.mapping.grid import Grid
from lrtrav_ros.mapping.ground_frame import GroundFrame, ground_frame_id

_NO_DISPARITY = -1.0
_DELTA_DISPARITY = 1 / 16  # what OpenCV's matchers resolve


def header_of(message: Any) -> Header:
    """Return the header of a message that rosbags or rclpy decoded."""
    header = message.header
    return Header(
        stamp=Time(sec=int(header.stamp.sec), nanosec=int(header.stamp.nanosec)), frame_id=str(header.frame_id)
    )


def array_to_image(pixels: NDArray[Any], header: Header) -> Image:
    """Return `pixels`, (H, W) or (H, W, 3), as a message; see `encode_image` for encodings and errors."""
    encoded = encode_image(pixels)
    return Image(
        header=header,
        height=encoded.height,
        width=encoded.width,
        encoding=encoded.encoding,
        is_bigendian=0,
        step=encoded.step,
        data=_taken_over(encoded.data, "B"),
    )


def _taken_over(data: NDArray[Any], code: str) -> array.array[int]:
    """Return what rclpy takes over at once, of the type `code`; a NumPy array costs it 50 ms."""
    taken = array.array(code)
    taken.frombytes(data.data)
    return taken


def as_uint16(values: NDArray[np.int32]) -> NDArray[np.uint16]:
    """Return labels or counts as ``mono16`` holds them; what exceeds it is 65535."""
    return np.clip(values, 0, 65535).astype(np.uint16)


def disparity_to_message(
    disparity: NDArray[np.float32], header: Header, camera: StereoCamera, *, n_disparities: int
) -> DisparityImage:
    """Return a disparity (H, W) in pixels, 0 where there is none, as a message; invalid pixels are -1."""
    height, width = disparity.shape
    return DisparityImage(
        header=header,
        image=array_to_image(np.where(disparity > 0, disparity, np.float32(_NO_DISPARITY)), header),
        f=float(camera.fx),
        t=float(camera.baseline_m),
        valid_window=RegionOfInterest(x_offset=0, y_offset=0, height=height, width=width),
        min_disparity=0.0,
        max_disparity=max(float(n_disparities - 1), float(disparity.max())),
        delta_d=_DELTA_DISPARITY,
    )


def points_to_message(points: NDArray[np.float32], header: Header) -> PointCloud2:
    """Return points, (N, 3) or (H, W, 3), in metres and in the frame of the header; see `encode_points` for errors."""
    encoded = encode_points(points)
    return PointCloud2(
        header=header,
        height=encoded.height,
        width=encoded.width,
        fields=[PointField(name=name, offset=offset, datatype=FLOAT32, count=1) for name, offset in FIELDS.items()],
        is_bigendian=False,
        point_step=encoded.point_step,
        row_step=encoded.row_step,
        data=_taken_over(encoded.data, "B"),
        is_dense=encoded.is_dense,
    )


def grid_to_message(grid: Grid, header: Header, frame_id: str) -> OccupancyGrid:
    """Return a grid that is drawn in `frame_id`, at the time of the header."""
    height, width = grid.cells.shape
    x, y = grid.origin_m
    return OccupancyGrid(
        header=Header(stamp=header.stamp, frame_id=frame_id),
        info=MapMetaData(
            map_load_time=header.stamp,
            resolution=float(grid.resolution_m),
            width=width,
            height=height,
            origin=Pose(position=Point(x=float(x), y=float(y)), orientation=Quaternion(w=1.0)),
        ),
        data=_taken_over(np.ascontiguousarray(grid.cells).reshape(-1), "b"),
    )


def message_to_grid(message: OccupancyGrid) -> Grid:
    """Return the grid that a message holds, in the message's frame."""
    info = message.info
    cells = np.array(message.data, np.int8).reshape(info.height, info.width)
    return Grid(cells, info.resolution, (info.origin.position.x, info.origin.position.y))


def pose_to_message(ground: GroundFrame, header: Header) -> PoseStamped:
    """Return the pose of the camera that the header names in the frame on the ground below it."""
    x, y, z, w = ground.quaternion
    return PoseStamped(
        header=Header(stamp=header.stamp, frame_id=ground_frame_id(header.frame_id)),
        pose=Pose(position=Point(z=float(ground.height_m)), orientation=Quaternion(x=x, y=y, z=z, w=w)),
    )
