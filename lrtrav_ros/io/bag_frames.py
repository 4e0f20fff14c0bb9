"""Rosbags as frames: stereo, disparity and depth recordings of ROS 1 and ROS 2."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import cv2
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.frame import SOURCES, Frame
from lrtrav_ros.io.bag_files import reason
from lrtrav_ros.io.bag_reader import BagMessage, BagReader
from lrtrav_ros.io.camera_info import is_distorted
from lrtrav_ros.io.message_frames import FrameMessages, frame_of, header_stamp_ns
from lrtrav_ros.io.pairing import StampPairing, TopicQueue
from lrtrav_ros.io.problems import Problems
from lrtrav_ros.io.static_transforms import StaticTransforms
from lrtrav_ros.io.topics import DEPTH_INFO, LEFT_INFO, RIGHT_INFO, RIGHT_RAW, find_inputs, image_inputs
from lrtrav_ros.pose import Pose

_ROS2 = get_typestore(Stores.ROS2_JAZZY)
_Pairing = StampPairing[Any, Any]


@dataclass(frozen=True, slots=True)
class UnusableFrame:
    """A frame that is recorded but cannot be used, and why."""

    name: str
    problem: str


class StereoBag:
    """A rosbag that is open for reading as frames.

    Topics are found under any namespace by the ends of their names: ``left/image_rect``, ``right/image_rect``,
    ``left/camera_info``, ``right/camera_info``, ``disparity``, ``depth/image_rect``; or else ``image_rect_color`` and
    ``image_raw``, which are taken for rectified; with `rectify`, by ``left/image_raw`` and ``right/image_raw``, or else
    ``image_color`` and ``image_mono``; each plain or ``…/compressed``.

    Parameters
    ----------
    path : path
        A ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a ROS 2 bag.
    source : str
        Preferred input of the frames: ``stereo``, ``disparity`` or ``depth``. Where the bag does not hold it, the first
        of these that it does.
    topics : mapping of str to str, optional
        The bag's topic for each of the canonical names above that is not to be searched for.
    rectify : bool
        Rectify the images of stereo pairs, which are raw, by the distortion in their CameraInfo.
    depth_registered : bool
        False where depth images have a camera of their own (``depth/camera_info``) and are to be registered.
    depth_pose : str
        Pose of that camera in the left one, as `Pose.parsed` takes it; empty to take it from ``/tf_static``.
    max_stamp_difference_s : float
        A left image and its partner whose header stamps differ by more, in seconds, are no pair.
    max_pixels : int
        Frames whose images have more pixels cannot be used.

    Attributes
    ----------
    source : str
        The input that the frames carry.
    inputs : dict of str to str
        Topic in the bag of each of the names above that is used.
    n_skipped : int
        Frames and messages that could not be used, up to now.

    Raises
    ------
    FileNotFoundError
        If there is no such bag.
    ValueError
        If it is no bag, or the topics for no source are in it; the message says which there are.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        source: str = "stereo",
        topics: Mapping[str, str] | None = None,
        rectify: bool = False,
        depth_registered: bool = True,
        depth_pose: str = "",
        max_stamp_difference_s: float = 0.005,
        max_pixels: int = MAX_PIXELS,
    ) -> None:
        if source not in SOURCES:
            raise ValueError(f"source is {source!r}; choose one of {', '.join(SOURCES)}")
        self._depth_pose = Pose.parsed(depth_pose) if depth_pose else None
        self.reader = BagReader(path)
        self.n_skipped = 0
        self._problems = Problems()
        self._tolerance_ns = round(max_stamp_difference_s * 1e9)
        self._max_pixels = max_pixels
        try:
            self.source, self.inputs = find_inputs(
                self.reader.topics, source, topics or {}, rectify=rectify, register=not depth_registered
            )
        except ValueError as err:
            self.close()
            raise ValueError("; ".join([f"{self.reader.path}: {err}", *self.reader.problems])) from err
        self._is_raw = RIGHT_RAW in self.inputs
        self._left, self._partner = image_inputs(self.source, rectify=self._is_raw)

    def __enter__(self) -> StereoBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the bag."""
        self.reader.close()

    def __len__(self) -> int:
        """Number of left images, which is the largest possible number of frames."""
        return self.reader.counts[self.left_topic]

    @property
    def left_topic(self) -> str:
        """The topic of the left images."""
        return self.inputs[self._left]

    @property
    def problems(self) -> list[str]:
        """Everything that could not be read or used so far: damage, skipped frames, unpaired images.

        One line each, but for those that are alike, which are told once, with their number.
        """
        return [*self.reader.problems, *self._problems.lines()]

    @property
    def is_damaged(self) -> bool:
        """Whether something of the bag is damaged or lost, as far as it has been read."""
        return bool(self.reader.problems)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames that can be used; see `items`."""
        return (item for item in self.items() if isinstance(item, Frame))

    def items(self) -> Iterator[Frame | UnusableFrame]:
        """Yield the frames, named by the left image's header stamp in nanoseconds; see `problems` afterwards.

        Raises
        ------
        ValueError
            If there is no CameraInfo, no left image has a partner, or it is not known where the depth camera is.
        """
        self._problems, self.n_skipped = Problems(), 0
        infos = self._first_infos()
        if DEPTH_INFO in infos and self._depth_pose is None:
            self._depth_pose = self._recorded_pose(infos)
        for note in self._notes(infos):
            self._problems.add(note)
        pairing = _Pairing(TopicQueue(self.left_topic), TopicQueue(self.inputs[self._partner]))
        roles = {topic: role for role, topic in self.inputs.items()}
        names: set[str] = set()
        for message in self.reader.messages(roles):
            try:
                frame = self._frame_after(message, roles[message.topic], pairing, infos)
                if frame is not None and frame.name in names:
                    raise _FrameError(frame.name, "another frame has this header stamp")
            except _FrameError as err:
                self.n_skipped += 1
                self._problems.add(f"{self.reader.path}: skipped {err}", kind=err.problem, case=self.n_skipped)
                yield UnusableFrame(err.name, err.problem)
                continue
            except ValueError as err:
                self.n_skipped += 1
                self.reader.report_unreadable(message, str(err))
                continue
            if frame is not None:
                names.add(frame.name)
                yield frame
        self._report_losses(pairing)

    def _frame_after(self, message: BagMessage, role: str, pairing: _Pairing, infos: dict[str, Any]) -> Frame | None:
        """Take a message; return the frame that it completes, if any."""
        decoded = _deserialized(message)
        if role in (LEFT_INFO, RIGHT_INFO, DEPTH_INFO):
            infos[role] = decoded
            return None
        add = pairing.add_first if role == self._left else pairing.add_second
        pair = add(header_stamp_ns(decoded), decoded, tolerance_ns=self._tolerance_ns)
        return None if pair is None else self._frame(*pair, infos)

    def _report_losses(self, pairing: _Pairing) -> None:
        """Report the images that found no partner."""
        losses = pairing.losses(tolerance_ns=self._tolerance_ns)
        if pairing.n_pairs == 0:
            reasons = filter(None, [losses, *self.problems])
            raise ValueError("; ".join([f"{self.reader.path}: no images pair", *reasons]))
        if losses:
            self._problems.add(f"{self.reader.path}: {losses}")

    def _notes(self, infos: Mapping[str, Any]) -> list[str]:
        """Return a remark for each topic whose use is a guess."""
        if self._is_raw:
            return []
        raw = [topic for topic in self.inputs.values() if "image_raw" in topic.rsplit("/", 2)[-2:]]
        can_rectify = self.source == "stereo" and any(map(is_distorted, infos.values()))
        remedy = ", though its CameraInfo has distortion; source.rectify=true rectifies it" if can_rectify else ""
        return [f"{self.reader.path}: {topic} is taken for rectified{remedy}" for topic in raw]

    def _first_infos(self) -> dict[str, Any]:
        """Return the first CameraInfo of each camera, which also serves the images recorded before it."""
        infos: dict[str, Any] = {}
        for role in (LEFT_INFO, RIGHT_INFO, DEPTH_INFO):
            topic = self.inputs.get(role)
            if topic is None:
                continue
            with closing(self.reader.messages([topic])) as messages:
                for message in messages:
                    with suppress(ValueError):
                        infos[role] = _deserialized(message)
                        break
            if role not in infos and (role != RIGHT_INFO or self.source == "stereo"):
                raise ValueError(
                    f"{self.reader.path}: {topic} has no message that can be read; record the camera's calibration"
                )
        return infos

    def _recorded_pose(self, infos: Mapping[str, Any]) -> Pose:
        """Return the pose of the depth camera in the left one; raises ValueError where the bag does not tell."""
        left, depth = (str(infos[role].header.frame_id) for role in (LEFT_INFO, DEPTH_INFO))
        pose = StaticTransforms.recorded(self.reader).pose(left, depth)
        if pose is None:
            raise ValueError(
                f"{self.reader.path}: /tf_static has no transform from {depth!r} to {left!r}, the cameras of depth and "
                "left image; record it, or set source.depth_pose"
            )
        return pose

    def _frame(self, left: Any, partner: Any, infos: Mapping[str, Any]) -> Frame:
        """Return the frame of a pair of messages; raises _FrameError where they cannot be used."""
        messages = FrameMessages(
            source=self.source,
            left=left,
            partner=partner,
            left_info=infos[LEFT_INFO],
            right_info=infos.get(RIGHT_INFO),
            is_raw=self._is_raw,
            depth_info=infos.get(DEPTH_INFO),
            depth_pose=self._depth_pose,
        )
        try:
            return frame_of(messages, max_pixels=self._max_pixels)
        except (ValueError, cv2.error) as err:
            raise _FrameError(str(messages.stamp_ns), " ".join(str(err).split())) from err


class _FrameError(ValueError):
    """A frame cannot be used."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"frame {name}: {problem}")
        self.name = name
        self.problem = problem


def _deserialized(message: BagMessage) -> Any:
    """Return a message's fields; raises ValueError where it is not whole."""
    try:
        return _ROS2.deserialize_cdr(message.data, message.type)
    except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged messages
        raise ValueError(f"cannot be read: {reason(err)}") from err
