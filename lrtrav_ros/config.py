"""Every setting of the package: one frozen dataclass per stage of the method, and the presets.

A setting stands here and nowhere else: its default, range, unit and description. ROS parameters, ``--help``, the
YAML files in ``config/`` and the README's table are made from this module or checked against it by a test.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import yaml

Value = bool | int | float | str

PRESETS = ("robust", "paper")


def setting(
    default: Value,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] = (),
    unit: str = "",
    name: str = "",
    read_only: bool = False,
) -> Any:
    """Return a dataclass field that carries all that a user needs to know of a setting.

    `name` is the parameter's full name where it is not ``STAGE.FIELD``; a `read_only` one needs a restart of a node.
    """
    metadata = {
        "description": description,
        "minimum": minimum,
        "maximum": maximum,
        "choices": choices,
        "unit": unit,
        "name": name,
        "read_only": read_only,
    }
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A setting as the outside sees it: its full name, such as ``stereo.matcher``, and what it may be."""

    name: str
    default: Value
    description: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    unit: str
    read_only: bool

    @property
    def type(self) -> type[Value]:
        """The type of its values: bool, int, float or str."""
        return type(self.default)

    def check(self, value: object) -> Value:
        """Return `value` as this parameter's type.

        Raises
        ------
        ValueError
            If the value has another type or is out of range; the message names parameter, value and remedy.
        """
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not self.type:
            raise ValueError(f"{self.name} is {value!r}; give {self.type.__name__}: {self.range_text}")
        if self.choices and value not in self.choices:
            raise ValueError(f"{self.name} is {value!r}; give {self.range_text}")
        if isinstance(value, (int, float)) and not self._in_range(value):
            raise ValueError(f"{self.name} is {value!r}; give {self.range_text}")
        return value

    def parse(self, text: str) -> Value:
        """Return the value that `text` (from a command line) spells; raises ValueError as `check` does."""
        if self.type is str:
            return self.check(text)
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            value = text
        return self.check(value)

    def _in_range(self, value: float) -> bool:
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        return math.isfinite(value) and low <= value <= high

    @property
    def range_text(self) -> str:
        """What it may be, in words: its choices, or its bounds with the unit."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        if self.type is bool:
            return "true or false"
        unit = f" {self.unit}" if self.unit else ""
        if self.minimum is not None and self.maximum is not None:
            return f"{self.minimum:g} to {self.maximum:g}{unit}"
        return f"at least {self.minimum:g}{unit}" if self.minimum is not None else "any finite number"


def _parameters_of(stage: type | object, prefix: str) -> Iterator[tuple[str, Parameter]]:
    """Yield field name and parameter for each setting of a stage's dataclass."""
    for item in dataclasses.fields(stage):  # type: ignore[arg-type]
        if item.metadata:
            meta = item.metadata
            yield (
                item.name,
                Parameter(
                    name=meta["name"] or f"{prefix}{item.name}",
                    default=cast(Value, item.default),
                    description=meta["description"],
                    minimum=meta["minimum"],
                    maximum=meta["maximum"],
                    choices=meta["choices"],
                    unit=meta["unit"],
                    read_only=meta["read_only"],
                ),
            )


class _Stage:
    """Base of the configurations: checks every setting when one is made."""

    __slots__ = ()
    prefix = ""

    def __post_init__(self) -> None:
        for name, parameter in _parameters_of(self, self.prefix):
            object.__setattr__(self, name, parameter.check(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class SourceConfig(_Stage):
    """Where disparity comes from."""

    prefix = "source."

    source: str = setting(
        "stereo",
        "input of the short-range node: a rectified stereo pair, a disparity image or a depth image; "
        "offline, the input that is preferred where a recording holds several",
        choices=("stereo", "disparity", "depth"),
        name="source",
        read_only=True,
    )
    max_depth_m: float = setting(
        0.0,
        "how far depth or disparity is trusted: what is farther is left to the long range; 0 for no limit",
        minimum=0.0,
        maximum=1000.0,
        unit="m",
    )
    compressed: bool = setting(
        False, "subscribe to …/compressed (sensor_msgs/CompressedImage) in place of raw images", read_only=True
    )
    max_stamp_difference_s: float = setting(
        0.005,
        "left and right images whose stamps differ by more are not a pair",
        minimum=0.0,
        maximum=1.0,
        unit="s",
    )


@dataclass(frozen=True, slots=True)
class StereoConfig(_Stage):
    """Stereo matching, for every matcher."""

    prefix = "stereo."

    matcher: str = setting(
        "elas",
        "elas: the paper's matcher; sgbm, bm: OpenCV's semi-global and block matcher",
        choices=("elas", "sgbm", "bm"),
    )
    n_disparities: int = setting(
        128,
        "disparities 0 .. n - 1 are searched; sgbm and bm round up to a multiple of 16",
        minimum=1,
        maximum=512,
        unit="px",
    )
    half_resolution: bool = setting(
        False, "match every second row and column: faster and coarser; the result has full size"
    )
    block_size: int = setting(
        0,
        "matching window of sgbm and bm, rounded up to an odd number, for bm at least 5; 0 for 5 (sgbm) and 15 (bm)",
        minimum=0,
        maximum=31,
        unit="px",
    )


@dataclass(frozen=True, slots=True)
class ElasConfig(_Stage):
    """ELAS; Geiger, Roser and Urtasun, ACCV 2010, with the settings for robotics."""

    prefix = "elas."

    grid_step_px: int = setting(5, "distance of the candidates for support points", minimum=1, maximum=50, unit="px")
    support_texture: int = setting(10, "least sum of |descriptor - 128| of a support point", minimum=0, maximum=2048)
    support_uniqueness: float = setting(
        0.85, "largest ratio of the best to the second-best cost of a support point", minimum=0.0, maximum=1.0
    )
    consistency_px: int = setting(
        2,
        "largest difference of left and right disparity, for support points and pixels",
        minimum=0,
        maximum=20,
        unit="px",
    )
    support_window: int = setting(
        5,
        "half size of the neighbourhood that must agree with a support point",
        minimum=1,
        maximum=50,
        unit="grid cells",
    )
    support_similarity_px: int = setting(
        5, "support points of a neighbourhood agree within this difference", minimum=0, maximum=50, unit="px"
    )
    min_support: int = setting(
        5, "a support point that fewer of its neighbourhood, itself included, agree with is dropped",
        minimum=0, maximum=1000,
    )  # fmt: skip
    redundancy_window: int = setting(
        5,
        "a support point between two alike, this close along the row or column, is dropped; 0 keeps all",
        minimum=0,
        maximum=50,
        unit="grid cells",
    )
    match_texture: int = setting(
        1, "least sum of |descriptor - 128| of a pixel that is matched", minimum=0, maximum=2048
    )
    beta: float = setting(0.02, "weight of the descriptors' difference", minimum=0.001, maximum=10.0)
    gamma: float = setting(3.0, "constant part of the prior on disparity", minimum=0.01, maximum=100.0)
    sigma_px: float = setting(1.0, "width of the prior around the plane", minimum=0.1, maximum=20.0, unit="px")
    plane_radius_px: int = setting(
        2, "disparities this close to the plane are searched", minimum=0, maximum=20, unit="px"
    )
    cell_size_px: int = setting(
        20,
        "support points of a pixel's cell and its neighbours add their disparities",
        minimum=4,
        maximum=200,
        unit="px",
    )
    speckle_size_px: int = setting(200, "smaller segments are removed", minimum=0, maximum=100000, unit="px")
    speckle_similarity_px: float = setting(
        1.0, "neighbours within this difference belong to one segment", minimum=0.0, maximum=20.0, unit="px"
    )
    gap_width_px: int = setting(
        3, "longest gap along a row or column that is filled", minimum=0, maximum=5000, unit="px"
    )
    adaptive_mean: bool = setting(True, "smooth with the adaptive-mean filter")


@dataclass(frozen=True, slots=True)
class GroundConfig(_Stage):
    """Short range: u-v-disparity and the ground line."""

    prefix = "ground."

    obstacle_height_m: float = setting(
        0.5, "an upright thing of this height fills a cell of the u-disparity", minimum=0.05, maximum=10.0, unit="m"
    )
    min_obstacle_share: float = setting(
        0.05, "least share of the image's rows that such a cell covers", minimum=0.0, maximum=1.0
    )
    min_camera_height_m: float = setting(
        0.2, "ground lines of a lower camera are refused", minimum=0.01, maximum=100.0, unit="m"
    )
    max_camera_height_m: float = setting(
        5.0, "ground lines of a higher camera are refused", minimum=0.01, maximum=100.0, unit="m"
    )
    max_pitch_deg: float = setting(
        45.0, "ground lines of a camera pitched farther up or down are refused", minimum=1.0, maximum=60.0, unit="deg"
    )
    min_support: float = setting(
        0.1, "least share of the disparities below the horizon that lie on a ground line", minimum=0.0, maximum=1.0
    )
    shape: str = setting(
        "curved",
        "what is fitted to the ground: a line in the v-disparity; a plane, for a camera that rolls; "
        "a plane that bends along the way, for crests and slopes",
        choices=("line", "plane", "curved"),
    )
    noise_px: float = setting(0.4, "precision of disparities", minimum=0.01, maximum=20.0, unit="px")
    depth_noise_px: float = setting(
        0.2, "precision of disparities that come from a depth image", minimum=0.01, maximum=20.0, unit="px"
    )
    max_step_m: float = setting(
        0.13, "what is higher or lower than this is not ground", minimum=0.0, maximum=2.0, unit="m"
    )
    min_obstacle_m: float = setting(
        0.3,
        "what stands this high above the plane is an obstacle; 0 takes the u-disparity's obstacles alone",
        minimum=0.0,
        maximum=5.0,
        unit="m",
    )
    max_hole_px: int = setting(
        31,
        "holes in the ground without disparity are filled up to this size; 0 for none",
        minimum=0,
        maximum=501,
        unit="px",
    )


@dataclass(frozen=True, slots=True)
class SuperpixelsConfig(_Stage):
    """Preemptive SLIC; Neubert and Protzel, ICPR 2014."""

    prefix = "superpixels."

    n_superpixels: int = setting(200, "superpixels that are asked for", minimum=1, maximum=20000)
    compactness: float = setting(
        20.0, "weight of distance in the image against distance in Lab colour; higher gives squarer superpixels",
        minimum=0.1, maximum=1000.0,
    )  # fmt: skip
    max_iterations: int = setting(10, "iterations at most", minimum=1, maximum=100)
    preemption_threshold: float = setting(
        0.01, "share of pixels that must have changed label for a cluster to be visited again", minimum=0.0, maximum=1.0
    )


@dataclass(frozen=True, slots=True)
class FeaturesConfig(_Stage):
    """Colour and texture of superpixels, and the distance between two of them."""

    prefix = "features."

    cues: str = setting("both", "what superpixels are compared by", choices=("both", "colour", "texture"))
    texture: str = setting(
        "wld",
        "texture descriptor: Weber's law; binary patterns: local, centre-symmetric, ternary; homogeneity",
        choices=("wld", "lbp", "cs_lbp", "ltp", "homogeneity"),
    )
    distance: str = setting(
        "correlation",
        "distance between histograms",
        choices=("correlation", "chi_square", "intersection", "bhattacharyya", "euclidean", "earth_mover"),
    )


@dataclass(frozen=True, slots=True)
class ClusteringConfig(_Stage):
    """Improved spectral clustering of the superpixels."""

    prefix = "clustering."

    k: int = setting(
        10, "number of clusters; 0 takes it from the largest gap between eigenvalues", minimum=0, maximum=1000
    )
    centres: str = setting(
        "farthest",
        "initial centres of k-means: each the farthest from those before, or at random",
        choices=("farthest", "random"),
    )
    seed: int = setting(0, "seed of the random first centre", minimum=0, maximum=2**31 - 1)


@dataclass(frozen=True, slots=True)
class ExtensionConfig(_Stage):
    """Extension of the short-range ground over the clusters."""

    prefix = "extension."

    rule: str = setting(
        "evidence",
        "area: the paper's, by a cluster's share of short-range ground; "
        "evidence: by connected regions, with obstacles as evidence against; a region without any is as its cluster",
        choices=("area", "evidence"),
    )
    min_share: float = setting(
        0.5, "a cluster or region with more than this share of ground is traversable", minimum=0.0, maximum=1.0
    )


@dataclass(frozen=True, slots=True)
class Config(_Stage):
    """The whole configuration: one part per stage, and what concerns them all.

    Examples
    --------
    >>> Config.preset("paper").extension.rule
    'area'
    >>> Config().updated({"stereo.n_disparities": 64}).stereo.n_disparities
    64
    """

    threads: int = setting(
        0,
        "threads that matching may use; 0 for all processors; the result does not depend on it",
        minimum=0,
        maximum=256,
    )
    source: SourceConfig = field(default_factory=SourceConfig)
    stereo: StereoConfig = field(default_factory=StereoConfig)
    elas: ElasConfig = field(default_factory=ElasConfig)
    ground: GroundConfig = field(default_factory=GroundConfig)
    superpixels: SuperpixelsConfig = field(default_factory=SuperpixelsConfig)
    features: FeaturesConfig = field(default_factory=FeaturesConfig)
    clustering: ClusteringConfig = field(default_factory=ClusteringConfig)
    extension: ExtensionConfig = field(default_factory=ExtensionConfig)

    @classmethod
    def preset(cls, name: str) -> Config:
        """Return the configuration called `name`: ``robust`` (the default) or ``paper`` (the paper's letter).

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        if name == "robust":
            return cls()
        if name == "paper":
            return cls().updated(_PAPER)
        raise ValueError(f"no preset {name!r}; choose one of {', '.join(PRESETS)}")

    def updated(self, values: Mapping[str, object]) -> Config:
        """Return a copy with the parameters of `values`, such as ``{"stereo.matcher": "bm"}``, replaced.

        Raises
        ------
        ValueError
            If a name is unknown or a value does not fit; nothing is changed then.
        """
        places = _places()
        changes: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            stage, attribute = places[find_parameter(name).name]
            changes.setdefault(stage, {})[attribute] = find_parameter(name).check(value)
        own = changes.pop("", {})
        stages: dict[str, Any] = {
            stage: dataclasses.replace(getattr(self, stage), **new) for stage, new in changes.items()
        }
        return dataclasses.replace(self, **own, **stages)

    def values(self) -> dict[str, Value]:
        """Return all parameters by full name, in the order of this module."""
        return {
            name: getattr(getattr(self, stage) if stage else self, attribute)
            for name, (stage, attribute) in _places().items()
        }

    @property
    def n_threads(self) -> int:
        """The number of threads to use, at least 1."""
        return self.threads or os.cpu_count() or 1


# The letter of the paper, where it differs from the defaults above.
_PAPER: dict[str, Value] = {
    "ground.shape": "line",
    "ground.noise_px": 1.0,
    "ground.min_obstacle_m": 0.0,
    "ground.max_hole_px": 0,
    "clustering.k": 0,
    "extension.rule": "area",
}


def _stages() -> Iterator[tuple[str, object]]:
    yield "", Config()
    for item in dataclasses.fields(Config):
        if not item.metadata:
            yield item.name, getattr(Config(), item.name)


@lru_cache(maxsize=1)
def _places() -> dict[str, tuple[str, str]]:
    """Return stage and attribute of each parameter; the stage is empty for those of `Config` itself."""
    return {
        parameter.name: (stage, attribute)
        for stage, part in _stages()
        for attribute, parameter in _parameters_of(part, f"{stage}." if stage else "")
    }


@lru_cache(maxsize=1)
def parameters() -> tuple[Parameter, ...]:
    """Return every parameter, with the defaults of the preset ``robust``."""
    return tuple(
        parameter for stage, part in _stages() for _, parameter in _parameters_of(part, f"{stage}." if stage else "")
    )


def find_parameter(name: str) -> Parameter:
    """Return the parameter called `name`; raises ValueError, with the closest names, if there is none."""
    import difflib

    known = {parameter.name: parameter for parameter in parameters()}
    if name not in known:
        close = difflib.get_close_matches(name, known, n=3) or list(known)
        raise ValueError(f"no parameter {name!r}; did you mean {' or '.join(close)}?")
    return known[name]


def load_parameters(path: Path) -> dict[str, object]:
    """Return the parameters of a ROS parameter file, by full name.

    They stand under ``NODE: ros__parameters:`` for any node, nested or with dots.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If it is not a ROS parameter file.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as err:
        raise ValueError(f"{path} is not YAML: {' '.join(str(err).split())}") from err
    if not isinstance(document, dict) or not document:
        raise ValueError(f"{path} has no parameters; write them under '/**:' and 'ros__parameters:'")
    values: dict[str, object] = {}
    for node, content in document.items():
        if not isinstance(content, dict) or not isinstance(content.get("ros__parameters"), dict):
            raise ValueError(f"{path} has no 'ros__parameters:' under {str(node)!r}; write the parameters there")
        values.update(_flattened(content["ros__parameters"], ""))
    return values


def _flattened(tree: Mapping[object, object], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _flattened(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def dump_parameters(config: Config) -> str:
    """Return `config` as the text of a ROS parameter file, which `load_parameters` and the nodes read."""
    return yaml.safe_dump({"/**": {"ros__parameters": config.values()}}, sort_keys=False)
