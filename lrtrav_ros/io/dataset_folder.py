"""Dataset folders: frames of a stereo or depth camera, with calibration and ground truth.

A folder holds ``left/NAME.{png,jpg,jpeg}`` and one or more of ``right/NAME.*``, ``disparity/NAME.png`` (16 bit,
disparity x 256, 0 for none) and ``depth/NAME.png`` (16 bit: metres x ``depth_scale`` where the calibration has one,
else millimetres; 0 for none); ``calib.json`` or ``calib/NAME.json`` with fx, fy, cx, cy, baseline_m, width, height; and
optionally ``gt/NAME.png`` (255 traversable, 0 not traversable, 128 ignored) and ``height/NAME.png`` (16 bit,
millimetres above the ground of what a pixel shows; 0 for ground and sky).

Images of a stereo camera may be raw. The calibration then has width, height, ``left`` and ``right``, each with fx, fy,
cx, cy, distortion_model and distortion (see `rectification.Lens`), and the pose as stereo calibration gives it:
right = ``rotation`` @ left + ``translation_m``, with rotation as three rows. The images are rectified as they are read;
ground truth and heights are those of the rectified left one.
"""

from __future__ import annotations

import dataclasses
import json
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import MAX_PIXELS
from lrtrav_ros.frame import SOURCES, Frame
from lrtrav_ros.io.atomic_files import write_bytes
from lrtrav_ros.io.image_files import DISPARITY_SCALE, encode_file, read_disparity, read_image, scaled_disparity
from lrtrav_ros.io.input_files import read_text
from lrtrav_ros.numerics.checks import check_array, check_type
from lrtrav_ros.rectification import Lens, RawPair, raw_pair, rectification

_CALIBRATION = ("fx", "fy", "cx", "cy", "baseline_m", "width", "height")
_LENS = ("fx", "fy", "cx", "cy", "distortion_model", "distortion")
_RAW_CALIBRATION = ("width", "height", "left", "right", "rotation", "translation_m")
_SUFFIXES = (".png", ".jpg", ".jpeg")
_FOLDERS = {"stereo": "right", "disparity": "disparity", "depth": "depth"}
_DEPTH_SCALES = (1.0, 1e6)  # steps of a metre to a micrometre

OWN_FOLDERS = ("left", *_FOLDERS.values(), "calib", "gt", "height")
"""The folders of a dataset folder."""

MILLIMETRES = 1000.0
"""Scale of files in millimetres: depth, where `calib.json` names no other, and height."""


@dataclass(frozen=True, slots=True)
class FrameFile:
    """A frame of a dataset folder that is not read yet: a few bytes that any process can read it by.

    Attributes
    ----------
    folder : Path
        The dataset folder; absolute.
    source, name : str
        As `DatasetFolder` takes them.
    opened_ns : int
        When the folder was opened. It is listed once for all the frames of one opening.
    max_pixels : int
        Most pixels that an image of it may have.
    """

    folder: Path
    source: str
    name: str
    opened_ns: int
    max_pixels: int

    def read(self) -> Frame:
        """Read the frame; raises what `DatasetFolder.frame` does."""
        return _opened_folder(self.folder, self.source, self.opened_ns, self.max_pixels).frame(self.name)


class DatasetFolder:
    """A dataset folder that is open for reading; files are read when a frame is asked for.

    Parameters
    ----------
    path : path
        The folder.
    source : str
        Preferred input of the frames: ``stereo``, ``disparity`` or ``depth``. Where the folder does not hold it, the
        first of these that it does.
    max_pixels : int
        Frames whose images have more pixels cannot be used.

    Attributes
    ----------
    problems : list of str
        Why frames were skipped by `frames`, one entry each.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    ValueError
        If it is no folder, has no left images, no input or no calibration, or two left images of one name.
    """

    def __init__(self, path: str | os.PathLike[str], *, source: str = "stereo", max_pixels: int = MAX_PIXELS) -> None:
        self.path = Path(path)
        self._max_pixels = max_pixels
        self._opened_ns = time.time_ns()
        self.problems: list[str] = []
        if source not in SOURCES:
            raise ValueError(f"source is {source!r}; choose one of {', '.join(SOURCES)}")
        if not self.path.exists():
            raise FileNotFoundError(f"{self.path}: there is no such folder")
        if not self.path.is_dir():
            raise ValueError(f"{self.path}: is not a folder; give a dataset folder with left/")
        self._left = _images_in(self.path / "left")
        if not self._left:
            raise ValueError(f"{self.path / 'left'}: holds no images; put the left images there as PNG or JPEG")
        self.source = self._available(source)
        self._input = _images_in(self.path / _FOLDERS[self.source])
        if not (self.path / "calib.json").exists() and not (self.path / "calib").is_dir():
            raise ValueError(f"{self.path}: has no calibration; add calib.json or calib/NAME.json")

    def _available(self, preferred: str) -> str:
        """Return the preferred source where the folder holds it, else the first that it does."""
        for source in (preferred, *SOURCES):
            if _images_in(self.path / _FOLDERS[source]):
                return source
        raise ValueError(f"{self.path}: has only left images; add right/, disparity/ or depth/")

    @property
    def names(self) -> list[str]:
        """Names of the frames, sorted."""
        return sorted(self._left)

    def __len__(self) -> int:
        return len(self._left)

    def frame(self, name: str) -> Frame:
        """Read one frame.

        Raises
        ------
        FileNotFoundError
            If a file of it is missing.
        ValueError
            If a file of it cannot be used; the message names file and remedy.
        """
        left = read_image(_file(self._left, name, self.path / "left"), max_pixels=self._max_pixels)
        calibration = _read_calibration(self._calibration_path(name))
        if calibration.raw is not None and self.source != "stereo":
            raise ValueError(f"{self._calibration_path(name)}: is for raw pairs, not for {self.source}; add right/")
        path = _file(self._input, name, self.path / _FOLDERS[self.source])
        right = disparity = depth_m = unseen = None
        if self.source == "stereo":
            right = read_image(path, max_pixels=self._max_pixels)
        elif self.source == "disparity":
            disparity = read_disparity(path, max_pixels=self._max_pixels)
        else:
            depth_m = read_disparity(path, scale=calibration.depth_scale, max_pixels=self._max_pixels)
        try:
            if calibration.raw is not None and right is not None:
                pair = rectification(calibration.raw)
                left, right = pair.rectify(left, right)
                unseen = pair.unseen
            return Frame(
                name=name,
                left=left,
                camera=calibration.camera,
                right=right,
                disparity=disparity,
                depth_m=depth_m,
                unseen=unseen,
            )
        except ValueError as err:
            raise ValueError(f"{self.path}, frame {name}: {err}") from err

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in the order of their names; those that cannot be used are skipped, see `problems`."""
        self.problems = []
        for name in self.names:
            try:
                frame = self.frame(name)
            except (OSError, ValueError) as err:
                self.problems.append(f"skipped {err}")
            else:
                yield frame

    def items(self) -> Iterator[FrameFile]:
        """Yield all frames in the order of their names, without reading them."""
        return map(self.frame_file, self.names)

    def frame_file(self, name: str) -> FrameFile:
        """Return one frame without reading it."""
        return FrameFile(self.path.absolute(), self.source, name, self._opened_ns, self._max_pixels)

    def _calibration_path(self, name: str) -> Path:
        own = self.path / "calib" / f"{name}.json"
        return own if own.exists() or not (self.path / "calib.json").exists() else self.path / "calib.json"


@lru_cache(maxsize=4)
def _opened_folder(folder: Path, source: str, opened_ns: int, max_pixels: int) -> DatasetFolder:
    return DatasetFolder(folder, source=source, max_pixels=max_pixels)


def write_frame(
    folder: str | os.PathLike[str],
    frame: Frame,
    *,
    truth: NDArray[np.uint8] | None = None,
    disparity: NDArray[np.float32] | None = None,
    height_m: NDArray[np.float32] | None = None,
) -> None:
    """Write the images of a frame into a dataset folder, which is made where it is missing; see `frame_files`."""
    for path, data in frame_files(frame, truth=truth, disparity=disparity, height_m=height_m).items():
        write_bytes(Path(folder) / path, data)


def frame_files(
    frame: Frame,
    *,
    truth: NDArray[np.uint8] | None = None,
    disparity: NDArray[np.float32] | None = None,
    height_m: NDArray[np.float32] | None = None,
) -> dict[str, bytes]:
    """Return the images of a frame as PNG, by their paths in a dataset folder.

    Disparity and depth are rounded to 1/256 pixel and metre; `write_calibration` says so to readers. Heights are
    rounded to millimetres.

    Parameters
    ----------
    frame : Frame
        All that it holds is written.
    truth : (H, W) ndarray of uint8, optional
        Ground truth: 255 traversable, 0 not, 128 ignored.
    disparity : (H, W) ndarray of float32, optional
        Known disparity in pixels, beside what the frame holds.
    height_m : (H, W) ndarray of float32, optional
        Known height over the ground in metres, at least 0; what exceeds 65.535 m is written as that.
    """
    check_type("frame", frame, Frame)
    if truth is not None:
        check_array("truth", truth, np.uint8, ("H", "W"))
    if height_m is not None:
        check_array("height_m", height_m, (np.float32, np.float64), ("H", "W"))
        height_m = np.nan_to_num(height_m)
    disparity = frame.disparity if disparity is None else disparity
    images = {
        "left": frame.left,
        "right": frame.right,
        "gt": truth,
        "disparity": None if disparity is None else scaled_disparity(disparity),
        "depth": None if frame.depth_m is None else scaled_disparity(frame.depth_m),
        "height": None if height_m is None else np.rint(np.clip(height_m, 0, 65.535) * MILLIMETRES).astype(np.uint16),
    }
    paths = {f"{name}/{frame.name}.png": image for name, image in images.items() if image is not None}
    return {path: encode_file(path, image) for path, image in paths.items()}


def write_calibration(folder: str | os.PathLike[str], camera: StereoCamera, width: int, height: int) -> None:
    """Write ``calib.json`` of a dataset folder whose images have `width` x `height` pixels."""
    camera = dataclasses.replace(camera, width=width, height=height)
    values = {**{key: getattr(camera, key) for key in _CALIBRATION}, "depth_scale": DISPARITY_SCALE}
    write_bytes(Path(folder) / "calib.json", (json.dumps(values, indent=1) + "\n").encode())


def read_camera(path: Path) -> StereoCamera:
    """Read a calibration, as `DatasetFolder` does.

    Raises
    ------
    OSError, ValueError
        If it cannot be read; the message names the file.
    """
    return _read_calibration(path).camera


@dataclass(frozen=True, slots=True)
class _Calibration:
    """A calibration file: the camera, what depth in metres was multiplied by, and what rectifies raw images."""

    camera: StereoCamera
    depth_scale: float
    raw: RawPair | None = None


def _read_calibration(path: Path) -> _Calibration:
    """Return the checked calibration."""
    try:
        text = read_text(path)
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: there is no such calibration") from None
    try:
        values = json.loads(text, parse_int=_number)
    except (ValueError, RecursionError) as err:
        raise ValueError(f"{path}: cannot be read as JSON ({err})") from err
    if not isinstance(values, Mapping):
        raise ValueError(f"{path}: is no JSON object; give fx, fy, cx, cy, baseline_m, width, height")
    try:
        return _calibration(values)
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


def _number(text: str) -> float:
    """Return a whole number; one that no float holds exactly as a float, which may be infinite."""
    return int(text) if len(text) < 16 else float(text)


def _calibration(values: Mapping[str, Any]) -> _Calibration:
    """Return the calibration; raises ValueError that names the field."""
    if "left" in values or "right" in values:
        raw = _raw_pair(values)
        return _Calibration(raw.camera, MILLIMETRES, raw)  # depth is none of a raw pair's
    camera = StereoCamera(**_fields(values, _CALIBRATION))
    scale = values.get("depth_scale", MILLIMETRES)
    low, high = _DEPTH_SCALES
    if isinstance(scale, bool) or not isinstance(scale, (int, float)) or not low <= scale <= high:
        raise ValueError(f"depth_scale is {scale!r}; give {low:.0f} to {high:.0f}, such as 1000 for millimetres")
    return _Calibration(camera, scale)


def _raw_pair(values: Mapping[str, Any]) -> RawPair:
    """Return the calibration of raw images; raises ValueError that names the field."""
    fields = _fields(values, _RAW_CALIBRATION)
    lenses = {side: _lens(fields, side) for side in ("left", "right")}
    try:
        rotation = [number for row in fields["rotation"] for number in row]
        return raw_pair(**lenses, rotation=rotation, translation_m=fields["translation_m"])
    except TypeError as err:
        raise ValueError(
            f"rotation is {fields['rotation']!r}, translation_m {fields['translation_m']!r}; give 3 rows of 3 numbers, "
            "and 3 numbers"
        ) from err


def _lens(values: Mapping[str, Any], side: str) -> Lens:
    """Return one side's lens."""
    if not isinstance(values[side], Mapping):
        raise ValueError(f"{side} is {values[side]!r}; give an object with {', '.join(_LENS)}")
    try:
        fields = _fields(values[side], _LENS)
        if not isinstance(fields["distortion_model"], str) or not isinstance(fields["distortion"], list):
            raise ValueError("distortion_model is no text, or distortion no list; give a model's name and its numbers")
        lens = {**fields, "distortion": tuple(fields["distortion"])}
        return Lens(width=values["width"], height=values["height"], **lens)
    except ValueError as err:
        raise ValueError(f"{side}: {err}") from err


def _fields(values: Mapping[str, Any], keys: tuple[str, ...]) -> dict[str, Any]:
    """Return the values of keys; raises ValueError that names the one that is missing."""
    for key in keys:
        if key not in values:
            raise ValueError(f"{key} is missing")
    return {key: values[key] for key in keys}


def _images_in(folder: Path) -> dict[str, Path]:
    """Return the images of a folder by name; none where there is no such folder."""
    images: dict[str, Path] = {}
    for path in sorted(folder.glob("*")):
        if path.suffix.lower() in _SUFFIXES and not path.name.startswith("."):
            if path.stem in images:
                raise ValueError(f"{path}: the folder has {images[path.stem].name} too; keep one of them")
            images[path.stem] = path
    return images


def _file(images: Mapping[str, Path], name: str, folder: Path) -> Path:
    """Return the file of a frame."""
    if name not in images:
        raise FileNotFoundError(f"{folder / name}: there is no such image (.png, .jpg, .jpeg)")
    return images[name]
