"""Transforms that never change, as ``/tf_static`` holds them, and the pose of one frame in another."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.io.bag_files import reason
from lrtrav_ros.io.bag_reader import BagReader
from lrtrav_ros.pose import Pose

TRANSFORMS_TYPE = "tf2_msgs/msg/TFMessage"

_ROS2 = get_typestore(Stores.ROS2_JAZZY)


class StaticTransforms:
    """Frames, each with its pose in its parent."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Pose]] = {}

    @classmethod
    def recorded(cls, reader: BagReader) -> StaticTransforms:
        """Return the transforms of a bag's ``tf_static``; messages that are damaged are reported to the reader."""
        transforms = cls()
        topics = [topic for topic in reader.topics if topic.rpartition("/")[2] == "tf_static"]
        for message in reader.messages(topics):
            try:
                transforms.add(_ROS2.deserialize_cdr(message.data, TRANSFORMS_TYPE))
            except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged messages
                reader.report_unreadable(message, f"cannot be read: {reason(err)}")
        return transforms

    def add(self, message: Any) -> None:
        """Take the transforms of a ``tf2_msgs/TFMessage``, of rclpy or of rosbags; those that are none are left out."""
        for item in message.transforms:
            translation, rotation = item.transform.translation, item.transform.rotation
            with suppress(ValueError):
                pose = Pose.of_quaternion(
                    (translation.x, translation.y, translation.z), (rotation.x, rotation.y, rotation.z, rotation.w)
                )
                self._parents[_name(item.child_frame_id)] = (_name(item.header.frame_id), pose)

    def pose(self, target: str, source: str) -> Pose | None:
        """Return the pose of the frame `source` in the frame `target`; None where the two are not connected."""
        in_ancestors = self._ancestors(_name(target))
        for ancestor, pose in self._ancestors(_name(source)).items():
            if ancestor in in_ancestors:
                return in_ancestors[ancestor].inverse() @ pose
        return None

    def _ancestors(self, frame: str) -> dict[str, Pose]:
        """Return the pose of a frame in itself, in its parent, and so on."""
        pose = Pose.parsed("0 0 0 0 0 0 1")
        found = {frame: pose}
        while frame in self._parents:
            frame, in_parent = self._parents[frame]
            if frame in found:  # a circle
                break
            pose = in_parent @ pose
            found[frame] = pose
        return found


def _name(frame_id: str) -> str:
    """Return a frame's name as ROS 2 has it; ROS 1 had a slash before it."""
    return frame_id.lstrip("/")
