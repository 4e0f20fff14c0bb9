"""Frames in MATLAB files, such as the hand-labelled LAGR sets: a folder with ``NAME.mat``, one file a frame.

A file holds arrays for the left image, the truth, and at least one of right image, disparity and depth. What they are
called there is a setting, see `MatFields`; `describe` lists what a file holds. ``calib.json`` beside the files gives
the camera, as in dataset folders.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.evaluation.truth.labelled_sets import LabelledFrame, LabelledItem
from lrtrav_ros.evaluation.truth.labels import Labels, decode_truth
from lrtrav_ros.evaluation.truth.mat_arrays import read_arrays
from lrtrav_ros.frame import SOURCES, Frame
from lrtrav_ros.io.dataset_folder import read_camera

LAGR_LABELS = Labels(traversable=0, not_traversable=1, unknown=2)
"""Values of the truth in the LAGR files."""


@dataclass(frozen=True, slots=True)
class MatFields:
    """Names of a frame's arrays in a file (``STRUCT.FIELD`` for those in a struct), and how to read them.

    The defaults of `image`, `truth` and `layout` are those of the LAGR files; those of `right`, `disparity` and `depth`
    are placeholders. `describe` lists what a file holds.

    Parameters
    ----------
    image, right : str
        Left and right image: grey or RGB; of uint8, uint16, or floating point from 0 to 1.
    disparity : str
        Disparity in pixels x `disparity_scale`; none where it is not positive or not finite.
    depth : str
        Depth in metres; none where it is not positive or not finite.
    truth : str
        Label of each pixel.
    layout : str
        ``columns``: arrays are (width, height[, 3]); ``rows``: (height, width[, 3]), as MATLAB shows them.
    disparity_scale : float
        Set it to 256, for example, where disparities are stored as whole numbers of 1/256 pixel.

    Raises
    ------
    ValueError
        If `layout` is another one, or `disparity_scale` is not positive.
    """

    image: str = "im_rgb"
    right: str = "im_rgb_right"
    disparity: str = "im_disparity"
    depth: str = "im_depth"
    truth: str = "manual_human_labeling_mask"
    layout: str = "columns"
    disparity_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.layout not in ("columns", "rows"):
            raise ValueError(f"layout is {self.layout!r}; give columns or rows")
        if not self.disparity_scale > 0:
            raise ValueError(f"disparity_scale is {self.disparity_scale!r}; give a positive number")

    @classmethod
    def parsed(cls, settings: Sequence[tuple[str, str]]) -> MatFields:
        """Return the defaults with some fields replaced.

        Parameters
        ----------
        settings : sequence of (str, str)
            Name of a field, and its value as text.

        Raises
        ------
        ValueError
            If a field is unknown or a value does not fit.
        """
        known = [item.name for item in dataclasses.fields(cls)]
        values: dict[str, Any] = {}
        for name, text in settings:
            if name not in known:
                raise ValueError(f"no field {name!r}; choose one of {', '.join(known)}")
            try:
                values[name] = float(text) if name == "disparity_scale" else text
            except ValueError as err:
                raise ValueError(f"{name} is {text!r}; give a number") from err
        return cls(**values)


class MatFolder:
    """A folder of ``.mat`` files; a `LabelledSet`.

    Parameters
    ----------
    path : Path
        The folder, with ``calib.json`` beside the files.
    fields : MatFields
        Where things are in a file.
    labels : Labels
        Values of the truth.
    source : str
        What disparity is made from where files hold several: ``stereo``, ``disparity`` or ``depth``.

    Raises
    ------
    FileNotFoundError
        If there is no calibration.
    """

    unknown_rule = "not-traversable"

    def __init__(self, path: Path, *, fields: MatFields, labels: Labels, source: str) -> None:
        self.path = path
        self.n_without_truth = 0
        if not (path / "calib.json").exists():
            raise FileNotFoundError(
                f"{path / 'calib.json'}: there is no such calibration; "
                "write one with fx, fy, cx, cy, baseline_m, width, height"
            )
        self.names = sorted(file.stem for file in path.glob("*.mat"))
        self._reader = _FrameReader(path.absolute(), fields, labels, source)

    def files(self, name: str) -> list[Path]:
        """Return the files of a frame."""
        return [self.path / f"{name}.mat", self.path / "calib.json"]

    def items(self, names: Collection[str]) -> Iterator[LabelledItem]:
        """Yield the frames of these names."""
        for name in sorted(names):
            yield _MatFrame(self._reader, name)


@dataclass(frozen=True, slots=True)
class _FrameReader:
    folder: Path
    fields: MatFields
    labels: Labels
    source: str

    def read(self, name: str) -> LabelledFrame:
        """Read a frame; raises OSError or ValueError that names the file."""
        path = self.folder / f"{name}.mat"
        arrays = read_arrays(path)
        try:
            return self._frame(name, arrays)
        except ValueError as err:
            raise ValueError(f"{path}: {err}") from err

    def _frame(self, name: str, arrays: dict[str, NDArray[Any]]) -> LabelledFrame:
        fields, source = self.fields, self._source_in(arrays)
        right = disparity = depth_m = None
        if source == "stereo":
            right = self._image(arrays, fields.right)
        elif source == "disparity":
            disparity = self._array(arrays, fields.disparity).astype(np.float32) / np.float32(fields.disparity_scale)
        else:
            depth_m = self._array(arrays, fields.depth).astype(np.float32)
        frame = Frame(
            name=name,
            camera=read_camera(self.folder / "calib.json"),
            left=self._image(arrays, fields.image),
            right=right,
            disparity=disparity,
            depth_m=depth_m,
        )
        return LabelledFrame(frame, decode_truth(self._array(arrays, fields.truth), self.labels))

    def _source_in(self, arrays: dict[str, NDArray[Any]]) -> str:
        """Return what disparity is made from: the preferred source, or else the first that the file holds."""
        fields = dict(zip(SOURCES, (self.fields.right, self.fields.disparity, self.fields.depth), strict=True))
        for source in (self.source, *SOURCES):
            if fields[source] in arrays:
                return source
        raise ValueError(
            f"has none of right ({self.fields.right}), disparity ({self.fields.disparity}) and depth "
            f"({self.fields.depth}), but {', '.join(arrays)}; say with --field what they are called"
        )

    def _array(self, arrays: dict[str, NDArray[Any]], field: str) -> NDArray[Any]:
        if field not in arrays:
            raise ValueError(f"has no array {field!r}, but {', '.join(arrays)}; say with --field what it is called")
        array = arrays[field]
        if array.ndim not in (2, 3) or array.dtype.kind not in "buif":
            raise ValueError(f"{field} has shape {array.shape} and type {array.dtype}; give an image of numbers")
        return np.ascontiguousarray(np.swapaxes(array, 0, 1) if self.fields.layout == "columns" else array)

    def _image(self, arrays: dict[str, NDArray[Any]], field: str) -> NDArray[Any]:
        """Return an image as grey or BGR; one of floating point has values from 0 to 1 as in MATLAB."""
        image = self._array(arrays, field)
        if image.dtype.kind == "f":
            image = np.rint(np.clip(np.nan_to_num(image), 0, 1) * 255).astype(np.uint8)
        return image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])


@dataclass(frozen=True, slots=True)
class _MatFrame:
    reader: _FrameReader
    name: str

    def read(self) -> LabelledFrame:
        return self.reader.read(self.name)


def describe(path: Path) -> list[str]:
    """Return a line for each array of a file: name, shape, type, and its range or, where they are few, its values.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    OSError, ValueError
        If it cannot be read.
    """
    arrays = read_arrays(path)
    width = max(map(len, arrays), default=0)
    return [
        f"{name:{width}}  {' x '.join(map(str, array.shape)):16} {array.dtype!s:8} {_range(array)}".rstrip()
        for name, array in arrays.items()
    ]


def _range(array: NDArray[Any]) -> str:
    """Return the values of an array in a few words."""
    if array.dtype.kind not in "buif" or not array.size:
        return ""
    finite = array[np.isfinite(array)]
    gaps = "" if finite.size == array.size else f", {array.size - finite.size} not finite"
    values = np.unique(finite)
    if values.size <= 8:
        return f"values {', '.join(f'{value:g}' for value in values)}{gaps}"
    return f"{values[0]:g} .. {values[-1]:g}{gaps}"
