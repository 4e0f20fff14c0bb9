"""Dataset folders: frames of a rectified stereo or depth camera, with calibration and ground truth.

A folder holds ``left/NAME.{png,jpg,jpeg}`` and one or more of ``right/NAME.*``, ``disparity/NAME.png`` (16 bit,
disparity x 256, 0 for none) and ``depth/NAME.png`` (16 bit: metres x ``depth_scale`` where the calibration has one,
else millimetres; 0 for none); ``calib.json`` or ``calib/NAME.json`` with fx, fy, cx, cy, baseline_m, width, height; and
optionally ``gt/NAME.png`` (255 traversable, 0 not traversable, 128 ignored).
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.io.encodings import (
    DISPARITY_SCALE,
    Image,
    as_8bit,
    read_disparity,
    read_image,
    write_bytes,
    write_disparity,
    write_image,
)

SOURCES = ("stereo", "disparity", "depth")
"""What disparity is made from, in the order of preference."""

_SUFFIXES = (".png", ".jpg", ".jpeg")
_FOLDERS = {"stereo": "right", "disparity": "disparity", "depth": "depth"}
_MILLIMETRES = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """What a camera saw at one time: the left image and one of right image, disparity or depth.

    Parameters
    ----------
    name
        The file's name without suffix, or the left image's header stamp in nanoseconds.
    left : (H, W) or (H, W, 3) ndarray of uint8
        Left image, grey or BGR; those of 16 bits come as `images.as_8bit` makes them, right like left.
    camera
        Calibration.
    right : (H, W) or (H, W, 3) ndarray of uint8, optional
        Right image, rectified like the left one.
    disparity : (H, W) ndarray of float32, optional
        Disparity in pixels, 0 for none.
    depth_m : (H, W) ndarray of float32, optional
        Depth in metres, 0 for none.
    stamp_ns
        Time of the left image in nanoseconds, where it is known.
    """

    name: str
    left: NDArray[np.uint8]
    camera: StereoCamera
    right: NDArray[np.uint8] | None = None
    disparity: NDArray[np.float32] | None = None
    depth_m: NDArray[np.float32] | None = None
    stamp_ns: int | None = None


class FolderDataset:
    """A dataset folder that is open for reading; files are read when a frame is asked for.

    Parameters
    ----------
    path
        The folder.
    source
        Which input frames carry where the folder holds several: ``stereo``, ``disparity`` or ``depth``. Where the
        folder does not hold it, the first of these that it does.

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

    def __init__(self, path: str | os.PathLike[str], *, source: str = "stereo") -> None:
        self.path = Path(path)
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
        """Read one frame; what is wrong with it says nothing of the others.

        Raises
        ------
        FileNotFoundError
            If a file of it is missing.
        ValueError
            If a file of it cannot be used; the message names file and remedy.
        """
        left = read_image(_file(self._left, name, self.path / "left"))
        calibration = _read_calibration(self._calibration_path(name), left.shape)
        path = _file(self._input, name, self.path / _FOLDERS[self.source])
        right = disparity = depth_m = None
        if self.source == "stereo":
            right = as_8bit(_of_size(read_image(path), left, path), like=left)
        elif self.source == "disparity":
            disparity = _of_size(read_disparity(path), left, path)
        else:
            depth_m = _of_size(read_disparity(path, scale=calibration.depth_scale), left, path)
        return Frame(
            name=name, left=as_8bit(left), camera=calibration.camera, right=right, disparity=disparity, depth_m=depth_m
        )

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

    def truth(self, name: str) -> NDArray[np.uint8] | None:
        """Read a frame's ground truth: (H, W), 255 traversable, 0 not, 128 ignored; None where there is none.

        Raises
        ------
        ValueError
            If the file is no grey image of 8 bits or has other values.
        """
        path = self.path / "gt" / f"{name}.png"
        if not path.exists():
            return None
        image = read_image(path)
        if image.dtype != np.uint8 or image.ndim != 2:
            raise ValueError(f"{path}: has shape {image.shape} and type {image.dtype}; give a grey PNG of 8 bits")
        other = set(np.unique(image).tolist()) - {0, 128, 255}
        if other:
            raise ValueError(f"{path}: has the value {min(other)}; give 255 traversable, 0 not, 128 ignored")
        return image

    def _calibration_path(self, name: str) -> Path:
        own = self.path / "calib" / f"{name}.json"
        return own if own.exists() or not (self.path / "calib.json").exists() else self.path / "calib.json"


def write_frame(folder: str | os.PathLike[str], frame: Frame, truth: NDArray[np.uint8] | None = None) -> None:
    """Write the images of a frame into a dataset folder, as PNG.

    Disparity and depth are rounded to 1/256 pixel and metre; `write_calibration` says so to readers.
    """
    folder, file = Path(folder), f"{frame.name}.png"
    write_image(folder / "left" / file, frame.left)
    if frame.right is not None:
        write_image(folder / "right" / file, frame.right)
    if frame.disparity is not None:
        write_disparity(folder / "disparity" / file, frame.disparity)
    if frame.depth_m is not None:
        write_disparity(folder / "depth" / file, frame.depth_m)
    if truth is not None:
        write_image(folder / "gt" / file, truth)


def write_calibration(folder: str | os.PathLike[str], camera: StereoCamera, width: int, height: int) -> None:
    """Write ``calib.json`` of a dataset folder whose images have `width` x `height` pixels."""
    values = {
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "baseline_m": camera.baseline_m,
        "width": width,
        "height": height,
        "depth_scale": DISPARITY_SCALE,
    }
    write_bytes(Path(folder) / "calib.json", (json.dumps(values, indent=1) + "\n").encode())


def read_camera(path: Path, shape: tuple[int, ...]) -> StereoCamera:
    """Read a calibration for images of `shape`, as `FolderDataset` does.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or does not fit; the message names the file.
    """
    return _read_calibration(path, shape).camera


@dataclass(frozen=True, slots=True)
class _Calibration:
    """A calibration file: the camera, and what depth in metres was multiplied by."""

    camera: StereoCamera
    depth_scale: float


def _read_calibration(path: Path, shape: tuple[int, ...]) -> _Calibration:
    """Return the checked calibration for images of `shape`."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: there is no such calibration") from None
    except (ValueError, RecursionError) as err:
        raise ValueError(f"{path}: cannot be read as JSON ({err})") from err
    if not isinstance(values, Mapping):
        raise ValueError(f"{path}: is no JSON object; give fx, fy, cx, cy, baseline_m, width, height")
    try:
        return _calibration(values, shape)
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


def _calibration(values: Mapping[str, Any], shape: tuple[int, ...]) -> _Calibration:
    """Return the calibration; raises ValueError that names the field."""
    for key in ("fx", "fy", "cx", "cy", "baseline_m", "width", "height"):
        if key not in values:
            raise ValueError(f"{key} is missing")
    for key, pixels in (("width", shape[1]), ("height", shape[0])):
        if values[key] != pixels:
            raise ValueError(f"{key} is {values[key]!r}, but the left image's is {pixels}; calibrate for this size")
    camera = StereoCamera(**{key: values[key] for key in ("fx", "fy", "cx", "cy", "baseline_m")})
    scale = values.get("depth_scale", _MILLIMETRES)
    if isinstance(scale, bool) or not isinstance(scale, (int, float)) or not 0 < scale < math.inf:
        raise ValueError(f"depth_scale is {scale!r}; give a positive number")
    return _Calibration(camera, scale)


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


def _of_size(image: Image, left: Image, path: Path) -> Image:
    """Return `image`, which must have the size of the left one."""
    if image.shape[:2] != left.shape[:2]:
        size, wanted = (f"{shape[1]} x {shape[0]}" for shape in (image.shape, left.shape))
        raise ValueError(f"{path}: is {size} pixels, but the left image is {wanted}; give images of one size")
    return image
