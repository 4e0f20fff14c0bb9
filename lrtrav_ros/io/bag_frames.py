"""Rosbags as frames: reading stereo, disparity and depth recordings of ROS 1 and ROS 2, and writing such bags."""

from __future__ import annotations

import os
import shutil
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io import encodings as images
from lrtrav_ros.io.bag_reader import BagMessage, Recording
from lrtrav_ros.io.camera_info import depth_camera, disparity_camera, stereo_camera
from lrtrav_ros.io.dataset_folder import SOURCES, Frame
from lrtrav_ros.io.topics import (
    DEPTH_IMAGE,
    DISPARITY,
    DISPARITY_TYPE,
    IMAGE_TYPE,
    INFO_TYPE,
    LEFT_IMAGE,
    LEFT_INFO,
    PARTNER,
    RIGHT_IMAGE,
    RIGHT_INFO,
    find_inputs,
    required_inputs,
)

FORMATS = ("mcap", "sqlite3", "rosbag1")

_QUEUE_SIZE = 16
_ROS1 = get_typestore(Stores.ROS1_NOETIC)
_ROS2 = get_typestore(Stores.ROS2_JAZZY)


@dataclass(frozen=True, slots=True)
class UnusableFrame:
    """A frame that is recorded but cannot be used, and why."""

    name: str
    problem: str


class StereoBag:
    """A rosbag that is open for reading as frames.

    Topics are found under any namespace by the ends of their names: ``left/image_rect``, ``right/image_rect``,
    ``left/camera_info``, ``right/camera_info``, ``disparity``, ``depth/image_rect``; or else ``image_rect_color`` and
    ``image_raw``, which are taken for rectified; each plain or ``…/compressed``.

    Parameters
    ----------
    path
        A ``.bag``, ``.mcap`` or ``.db3`` file, or the folder of a ROS 2 bag.
    source
        Which input frames carry where the bag holds several: ``stereo``, ``disparity`` or ``depth``. Where the bag
        does not hold it, the first of these that it does.
    topics
        The bag's topic for each of the six names above that is not to be searched for.
    max_stamp_difference_s
        A left image and its partner whose header stamps differ by more, in seconds, are no pair.

    Attributes
    ----------
    source : str
        What the frames carry.
    inputs : dict of str to str
        Topic in the bag of each of the names above that is used.
    n_skipped : int
        Frames and messages that could not be used, up to now.
    unusable : list of UnusableFrame
        The frames among them.

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
        max_stamp_difference_s: float = 0.005,
    ) -> None:
        if source not in SOURCES:
            raise ValueError(f"source is {source!r}; choose one of {', '.join(SOURCES)}")
        self.recording = Recording(path)
        self.n_skipped = 0
        self.unusable: list[UnusableFrame] = []
        self._problems: list[str] = []
        self._tolerance_ns = round(max_stamp_difference_s * 1e9)
        try:
            self.source, self.inputs = find_inputs(self.recording.topics, source, topics or {})
        except ValueError as err:
            self.close()
            raise ValueError("; ".join([f"{self.recording.path}: {err}", *self.recording.problems])) from err

    def __enter__(self) -> StereoBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the bag."""
        self.recording.close()

    def __len__(self) -> int:
        """Number of left images, which is the largest possible number of frames."""
        return self.recording.counts[self.inputs[LEFT_IMAGE]]

    @property
    def problems(self) -> list[str]:
        """What could not be read or used, up to now: damage, frames skipped, images without a partner."""
        return [*self.recording.problems, *self._problems]

    def frames(self) -> Iterator[Frame]:
        """Yield the frames, named by the left image's header stamp in nanoseconds; see `problems` afterwards.

        Raises
        ------
        ValueError
            If there is no CameraInfo, or no left image has a partner.
        """
        self._problems, self.n_skipped, self.unusable = self._notes(), 0, []
        infos = self._first_infos()
        pairs = _Pairs(self.inputs[LEFT_IMAGE], self.inputs[PARTNER[self.source]], self._tolerance_ns)
        roles = {topic: role for role, topic in self.inputs.items()}
        names: set[str] = set()
        for message in self.recording.messages(roles):
            try:
                frame = self._taken(message, roles[message.topic], pairs, infos)
                if frame is not None and frame.name in names:
                    raise _FrameError(frame.name, "another frame has this header stamp")
            except ValueError as err:
                self.n_skipped += 1
                if isinstance(err, _FrameError):
                    self.unusable.append(UnusableFrame(err.name, err.problem))
                self._problems.append(f"{self.recording.path}: skipped {err}")
                continue
            if frame is not None:
                names.add(frame.name)
                yield frame
        self._finish(pairs)

    def _taken(self, message: BagMessage, role: str, pairs: _Pairs, infos: dict[str, Any]) -> Frame | None:
        """Take a message; return the frame that it completes, if any."""
        decoded = _deserialized(message)
        if role in (LEFT_INFO, RIGHT_INFO):
            infos[role] = decoded
            return None
        pair = pairs.add(message.topic, decoded)
        return None if pair is None else self._frame(*pair, infos)

    def _finish(self, pairs: _Pairs) -> None:
        """Report the images that found no partner."""
        report = pairs.report()
        if pairs.n_pairs == 0:
            raise ValueError(f"{self.recording.path}: no images pair; {report}")
        if report:
            self._problems.append(f"{self.recording.path}: {report}")

    def _notes(self) -> list[str]:
        """Return what is worth to know of the topics that are used."""
        raw = [topic for topic in self.inputs.values() if "image_raw" in topic.rsplit("/", 2)[-2:]]
        return [f"{self.recording.path}: {topic} is taken for rectified" for topic in raw]

    def _first_infos(self) -> dict[str, Any]:
        """Return the first CameraInfo of each side; the images before it have none else."""
        infos: dict[str, Any] = {}
        for role in (LEFT_INFO, RIGHT_INFO):
            topic = self.inputs.get(role)
            if topic is None:
                continue
            with closing(self.recording.messages([topic])) as messages:
                for message in messages:
                    with suppress(ValueError):
                        infos[role] = _deserialized(message)
                        break
            if role not in infos and role in required_inputs(self.source):
                raise ValueError(
                    f"{self.recording.path}: {topic} has no message that can be read; record the camera's calibration"
                )
        return infos

    def _frame(self, left_message: Any, second: Any, infos: Mapping[str, Any]) -> Frame:
        """Return the frame of a pair of messages; raises ValueError where they cannot be used."""
        stamp_ns = _stamp_ns(left_message)
        try:
            raw = images.decode_message(left_message)
            left = images.as_8bit(raw)
            right = disparity = depth_m = None
            if self.source == "stereo":
                right = _of_size(images.as_8bit(images.decode_message(second), like=raw), left)
                camera = stereo_camera(infos[LEFT_INFO], infos[RIGHT_INFO])
            elif self.source == "disparity":
                found = images.valid_disparity(images.decode_message(second.image), second.min_disparity)
                disparity = _of_size(found, left)
                camera = disparity_camera(second, infos[LEFT_INFO])
            else:
                depth_m = _of_size(images.depth_in_metres(images.decode_message(second)), left)
                camera = depth_camera(infos[LEFT_INFO], infos.get(RIGHT_INFO))
            _check_size(infos[LEFT_INFO], left)
        except ValueError as err:
            raise _FrameError(str(stamp_ns), str(err)) from err
        return Frame(
            name=str(stamp_ns),
            left=left,
            camera=camera,
            right=right,
            disparity=disparity,
            depth_m=depth_m,
            stamp_ns=stamp_ns,
        )


class _FrameError(ValueError):
    """A frame cannot be used."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"frame {name}: {problem}")
        self.name = name
        self.problem = problem


def write_stereo_bag(
    path: str | os.PathLike[str],
    frames: Iterable[Frame],
    *,
    format: str = "mcap",  # noqa: A002 - the word for it
    frame_id: str = "left_camera",
) -> None:
    """Write frames as a rosbag, under a temporary name until it is finished.

    Topics are ``/left/image_rect``, ``/left/camera_info``, ``/right/camera_info`` and one or more of
    ``/right/image_rect``, ``/disparity`` and ``/depth/image_rect`` (float32, metres). Messages carry, and were received
    at, the frame's stamp.

    Parameters
    ----------
    path
        A folder to make, or a file where `format` is ``rosbag1``.
    frames
        Frames with `stamp_ns`, in order of time.
    format
        ``mcap`` or ``sqlite3`` for ROS 2, ``rosbag1`` for ROS 1.
    frame_id
        Coordinate frame of all messages.

    Raises
    ------
    FileExistsError
        If the path exists.
    ValueError
        If the format is unknown or a frame has no stamp.
    """
    path = Path(path)
    if format not in FORMATS:
        raise ValueError(f"bag format is {format!r}; choose one of {', '.join(FORMATS)}")
    if path.exists():
        raise FileExistsError(f"{path}: exists; remove it or choose another name")
    # The files of a ROS 2 bag carry the folder's name, therefore it is the folder around it that is temporary.
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    temporary.mkdir(parents=True)
    try:
        with _Writer(temporary / path.name, format) as writer:
            for frame in frames:
                for topic, message in _messages_of(frame, frame_id):
                    writer.write(topic, message, _checked_stamp_ns(frame))
        (temporary / path.name).replace(path)
    finally:
        shutil.rmtree(temporary)


class _Writer:
    """Writes messages of ROS 2 into a bag of any format."""

    def __init__(self, path: Path, format: str) -> None:  # noqa: A002
        self._is_ros1 = format == "rosbag1"
        self._bag: Any
        if self._is_ros1:
            self._bag = rosbag1.Writer(path)
        else:
            self._bag = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[format.upper()])
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> _Writer:
        self._bag.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bag.__exit__(kind, err, trace)

    def write(self, topic: str, message: Any, time_ns: int) -> None:
        """Write a message to a topic, which is made with its first one."""
        kind = message.__msgtype__
        if topic not in self._connections:
            typestore = _ROS1 if self._is_ros1 else _ROS2
            self._connections[topic] = self._bag.add_connection(topic, kind, typestore=typestore)
        data = _ROS2.serialize_cdr(message, kind)
        self._bag.write(self._connections[topic], time_ns, _ROS2.cdr_to_ros1(data, kind) if self._is_ros1 else data)


def _checked_stamp_ns(frame: Frame) -> int:
    if frame.stamp_ns is None:
        raise ValueError(f"frame {frame.name} has no stamp; give stamp_ns")
    return frame.stamp_ns


def _messages_of(frame: Frame, frame_id: str) -> Iterator[tuple[str, Any]]:
    """Yield topic and message of all that a frame holds; calibration first."""
    header = _header(_checked_stamp_ns(frame), frame_id)
    camera, size = frame.camera, frame.left.shape[:2]
    yield f"/{LEFT_INFO}", _camera_info(header, camera, size, baseline_m=0.0)
    yield f"/{RIGHT_INFO}", _camera_info(header, camera, size, baseline_m=camera.baseline_m)
    yield f"/{LEFT_IMAGE}", _image_message(header, frame.left)
    if frame.right is not None:
        yield f"/{RIGHT_IMAGE}", _image_message(header, frame.right)
    if frame.disparity is not None:
        yield f"/{DISPARITY}", _disparity_message(header, frame.disparity, camera)
    if frame.depth_m is not None:
        yield f"/{DEPTH_IMAGE}", _image_message(header, frame.depth_m)


def _header(stamp_ns: int, frame_id: str) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    stamp = _ROS2.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return _ROS2.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def _image_message(header: Any, image: NDArray[Any]) -> Any:
    encoded = images.encode_image(image)
    return _ROS2.types[IMAGE_TYPE](
        header=header,
        height=encoded.height,
        width=encoded.width,
        encoding=encoded.encoding,
        is_bigendian=0,
        step=encoded.step,
        data=encoded.data,
    )


def _region(height: int, width: int) -> Any:
    return _ROS2.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=height, width=width, do_rectify=False
    )


def _camera_info(header: Any, camera: StereoCamera, size: tuple[int, ...], *, baseline_m: float) -> Any:
    """Return the calibration of the camera that stands `baseline_m` to the right of the left one."""
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    return _ROS2.types[INFO_TYPE](
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


def _disparity_message(header: Any, disparity: NDArray[np.float32], camera: StereoCamera) -> Any:
    """Return a DisparityImage, of which the invalid pixels (0) are below the least valid disparity."""
    valid = disparity[disparity > 0]
    return _ROS2.types[DISPARITY_TYPE](
        header=header,
        image=_image_message(header, disparity),
        f=camera.fx,
        t=camera.baseline_m,
        valid_window=_region(*disparity.shape),
        min_disparity=float(valid.min(initial=np.inf)) if valid.size else 1.0,
        max_disparity=float(valid.max(initial=1.0)),
        delta_d=1 / images.DISPARITY_SCALE,
    )


@dataclass(slots=True)
class _Side:
    """One of two topics: its messages that wait for a partner, by stamp, and what came so far."""

    topic: str
    waiting: deque[tuple[int, Any]] = field(default_factory=lambda: deque(maxlen=_QUEUE_SIZE))
    n_received: int = 0
    last_stamp_ns: int = 0

    def take(self, stamp_ns: int, tolerance_ns: int) -> Any | None:
        """Remove and return the message whose stamp is nearest to `stamp_ns`, if it is near enough."""
        differences = [abs(waiting_ns - stamp_ns) for waiting_ns, _ in self.waiting]
        if not differences or min(differences) > tolerance_ns:
            return None
        index = differences.index(min(differences))
        message = self.waiting[index][1]
        del self.waiting[index]
        return message


class _Pairs:
    """Pairs the messages of two topics by header stamp; at most `_QUEUE_SIZE` of each wait."""

    def __init__(self, left: str, second: str, tolerance_ns: int) -> None:
        self._sides = (_Side(left), _Side(second))
        self._tolerance_ns = tolerance_ns
        self.n_pairs = 0

    def add(self, topic: str, message: Any) -> tuple[Any, Any] | None:
        """Take a message; return the pair (left first) that it completes, if any."""
        left, second = self._sides
        own, other = (left, second) if topic == left.topic else (second, left)
        stamp_ns = own.last_stamp_ns = _stamp_ns(message)
        own.n_received += 1
        partner = other.take(stamp_ns, self._tolerance_ns)
        if partner is None:
            own.waiting.append((stamp_ns, message))
            return None
        self.n_pairs += 1
        return (message, partner) if own is left else (partner, message)

    def report(self) -> str:
        """Return which messages found no partner; empty where all did."""
        if all(side.n_received == self.n_pairs for side in self._sides):
            return ""
        texts = [
            f"{side.topic}: {side.n_received - self.n_pairs} of {side.n_received} without partner"
            + (f", last stamp {side.last_stamp_ns} ns" if side.n_received else "")
            for side in self._sides
        ]
        return f"{'; '.join(texts)} (stamps may differ by {self._tolerance_ns / 1e9:g} s)"


def _deserialized(message: BagMessage) -> Any:
    """Return a message's fields; raises ValueError where it is not whole."""
    try:
        return _ROS2.deserialize_cdr(message.data, message.type)
    except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged messages
        text = str(err) or type(err).__name__
        raise ValueError(f"message on {message.topic} at {message.time_ns} ns: cannot be read ({text})") from err


def _stamp_ns(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _of_size(image: NDArray[Any], left: NDArray[Any]) -> NDArray[Any]:
    """Return `image`, which must have the size of the left one."""
    if image.shape[:2] != left.shape[:2]:
        size, wanted = (f"{shape[1]} x {shape[0]}" for shape in (image.shape, left.shape))
        raise ValueError(f"the partner is {size} pixels, but the left image is {wanted}; record images of one size")
    return image


def _check_size(info: Any, left: NDArray[Any]) -> None:
    """Raise ValueError where the left image is not of the size that was calibrated; 0 says nothing."""
    if (info.height, info.width) not in ((0, 0), left.shape[:2]):
        size = f"{left.shape[1]} x {left.shape[0]}"
        raise ValueError(f"CameraInfo is for {info.width} x {info.height} pixels, but the left image is {size}")
