"""Every setting of the package: one frozen dataclass per stage of the method, and the presets.

Each setting is defined here and nowhere else: default, range, unit and description. ROS parameters, ``--help``, the
YAML files in ``config/`` and the README's table are made from this module or checked against it by a test.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, cast

import yaml

Value = bool | int | float | str

PRESETS = ("robust", "paper")

SHORT_RANGE_STAGES = ("threads", "source", "stereo", "elas", "ground", "maps")
"""The stages whose parameters the node ``short_range`` has."""

LONG_RANGE_STAGES = ("source", "superpixels", "features", "clustering", "extension", "memory", "maps")
"""The stages whose parameters the node ``long_range`` has."""

NODE_DEFAULTS: Mapping[str, Value] = {"memory.frames": 5, "ground.memory_s": 0.5}
"""Defaults of the nodes where they are others: nodes see one frame after the other."""

# Every node of this package has these besides its stages.
_GENERAL = ("preset", "autostart", "use_sim_time", "start_type_description_service")
_GENERAL_PREFIX = "qos_overrides."
_DISTINCTIVE = 7  # letters: shorter names without a stage, such as seed, may well belong to another package

MAX_PIXELS = 2**26
"""No camera has so many: what is made for each pixel stays within the memory."""

# Settings are refused that take more for a frame of 640 x 480 pixels: benchmarks/extreme_settings.py measures it.
_TOO_SLOW = "could take more than 5 s of CPU time a frame"
_MAX_CELLS = 10_000_000  # of a grid: 2 s
_MAX_COMPARED = 500  # superpixels, pair by pair, by another distance than correlation: 4 s

_SURELY_MISSPELT = 0.8  # similarity from which on a name can be meant for nobody else


@dataclass(frozen=True, slots=True)
class Parameter:
    """A setting as users see it: its full name, such as ``stereo.matcher``, and the values it takes.

    Parameters
    ----------
    name : str
        The stage and the field, joined by a dot, unless `setting` was given another name.
    default : bool, int, float or str
        Its value in the preset ``robust``.
    description : str
        What it sets, and when to change it.
    minimum, maximum : float, optional
        Bounds of a number, in `unit`; None for none.
    choices : tuple of str
        All values of a text that is not free.
    unit : str
        Unit of a number, such as ``m``.
    read_only : bool
        A node reads it when it starts; it takes a restart to change it.
    option : str
        The option that sets it where a command has one, such as ``--seed``.
    """

    name: str
    default: Value
    description: str
    minimum: float | None
    maximum: float | None
    choices: tuple[str, ...]
    unit: str
    read_only: bool
    option: str

    @property
    def type(self) -> type[Value]:
        """The type of its values: bool, int, float or str."""
        return type(self.default)

    @property
    def stage(self) -> str:
        """The stage it belongs to: the first part of its name."""
        return self.name.partition(".")[0]

    def check(self, value: object) -> Value:
        """Return `value` as this parameter's type.

        Raises
        ------
        ValueError
            If the value has another type or is out of range; the message names parameter, value and remedy.
        """
        if isinstance(value, int) and value.bit_length() >= 64:
            raise ValueError(f"{self.name} is a number of more than 64 bits; give {self.range_text}")
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
        value: object = text
        try:
            if self.type in (int, float):
                value = self.type(text)
            elif self.type is bool:
                value = yaml.safe_load(text)
        except (ValueError, yaml.YAMLError):
            pass  # `check` refuses the text itself
        return self.check(value)

    def _in_range(self, value: float) -> bool:
        low = -math.inf if self.minimum is None else self.minimum
        high = math.inf if self.maximum is None else self.maximum
        return math.isfinite(value) and low <= value <= high

    @property
    def range_text(self) -> str:
        """The values it takes, in words: its choices, or its bounds with the unit."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        if self.type is bool:
            return "true or false"
        if self.type is str:
            return "any text"
        unit = f" {self.unit}" if self.unit else ""
        if self.minimum is not None and self.maximum is not None:
            return f"{self._spelt(self.minimum)} to {self._spelt(self.maximum)}{unit}"
        return f"at least {self._spelt(self.minimum)}{unit}" if self.minimum is not None else "any finite number"

    def _spelt(self, bound: float) -> str:
        """Return a bound as text."""
        return str(int(bound)) if self.type is int else f"{bound:g}"


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
    option: str = "",
) -> Any:
    """Return a dataclass field of a `CheckedConfig` that carries all that a user needs to know of a setting.

    The arguments are those of `Parameter`; `name` is only given where it is not the stage's and the field's.
    """
    parameter = Parameter(name, default, description, minimum, maximum, choices, unit, read_only, option)
    return field(default=default, metadata={"parameter": parameter})


class CheckedConfig:
    """Base of the configurations, which are frozen dataclasses with a `setting` for each field.

    Making one raises ValueError where a value does not fit. `prefix` begins the full names of its parameters.
    """

    __slots__ = ()
    prefix = ""

    def __post_init__(self) -> None:
        for name, parameter in settings_of(type(self)).items():
            object.__setattr__(self, name, parameter.check(getattr(self, name)))


def settings_of(config: type[CheckedConfig]) -> Mapping[str, Parameter]:
    """Return the parameter of each field that `setting` declares, by the field's name and in their order."""
    settings = {}
    for item in dataclasses.fields(config):  # type: ignore[arg-type]  # every subclass is a dataclass
        if "parameter" in item.metadata:
            parameter: Parameter = item.metadata["parameter"]
            settings[item.name] = dataclasses.replace(parameter, name=parameter.name or config.prefix + item.name)
    return settings


@dataclass(frozen=True, slots=True)
class SourceConfig(CheckedConfig):
    """The source of disparity."""

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
        "how far disparity and depth are trusted: what is farther is left to the long range; 0 for no limit; "
        "set it to where the camera's depth becomes ragged, often about 10 m",
        minimum=0.0,
        maximum=1000.0,
        unit="m",
    )
    rectify: bool = setting(
        False,
        "rectify the stereo pair here, by the distortion in its CameraInfo: image_raw in place of image_rect; for "
        "drivers that publish nothing rectified",
        read_only=True,
    )
    depth_registered: bool = setting(
        True,
        "whether the depth image shows what the left image shows, pixel by pixel; false where it has a camera of its "
        "own (depth/camera_info) and is to be registered to the left image here",
        read_only=True,
    )
    depth_pose: str = setting(
        "",
        "pose of the depth camera's optical frame in the left camera's one, where depth is registered here: "
        "x y z qx qy qz qw or x y z roll pitch yaw, in metres and radians; empty to take it from tf, for which tf2_ros "
        "is needed, or a bag's /tf_static",
        read_only=True,
    )
    compressed: bool = setting(
        False,
        "subscribe to …/compressed (sensor_msgs/CompressedImage) in place of raw images; "
        "for cameras on another computer",
        read_only=True,
    )
    max_stamp_difference_s: float = setting(
        0.005,
        "two images whose stamps differ by more are not of one frame; raise it for cameras that are not triggered "
        "together, to less than half the time between two frames",
        minimum=0.0,
        maximum=1.0,
        unit="s",
    )
    max_pixels: int = setting(
        2**24,
        "images of more pixels are refused, compressed ones and files by their header, before memory is made for them; "
        "raise it for larger cameras, lower it to what yours have where others may send images; a frame takes some 40 "
        "bytes a pixel",
        minimum=1,
        maximum=MAX_PIXELS,
        unit="px",
    )

    def __post_init__(self) -> None:
        CheckedConfig.__post_init__(self)
        if self.depth_pose:
            _check_pose(self.depth_pose)


def _check_pose(text: str) -> None:
    """Raise ValueError where ``source.depth_pose`` is no pose."""
    from lrtrav_ros.pose import Pose

    try:
        Pose.parsed(text)
    except ValueError as err:
        raise ValueError(f"source.depth_pose: {err}") from err


@dataclass(frozen=True, slots=True)
class StereoConfig(CheckedConfig):
    """Stereo matching, for every matcher."""

    prefix = "stereo."

    matcher: str = setting(
        "elas",
        "elas: the paper's matcher; sgbm, bm: OpenCV's semi-global and block matcher; bm where a frame takes too long",
        choices=("elas", "sgbm", "bm"),
    )
    n_disparities: int = setting(
        128,
        "disparities 0 .. n - 1 are searched; sgbm and bm round up to a multiple of 16; raise it to match what is "
        "nearer than focal length x baseline / n, lower it to save time",
        minimum=1,
        maximum=512,
        unit="px",
    )
    half_resolution: bool = setting(
        False,
        "match every second row and column: faster and coarser; the result has full size; "
        "for large images and slow computers",
    )
    block_size: int = setting(
        0,
        "matching window of sgbm and bm, rounded up to an odd number, for bm at least 5; 0 for 5 (sgbm) and 15 (bm); "
        "raise it for noisy images, lower it for thin obstacles",
        minimum=0,
        maximum=31,
        unit="px",
    )


@dataclass(frozen=True, slots=True)
class ElasConfig(CheckedConfig):
    """ELAS; Geiger, Roser and Urtasun, ACCV 2010, with the settings for robotics."""

    prefix = "elas."

    grid_step_px: int = setting(
        5,
        "distance of the candidates for support points; lower it for thin obstacles, raise it to save time",
        minimum=1,
        maximum=50,
        unit="px",
    )
    support_texture: int = setting(
        10,
        "least sum of |descriptor - 128| of a support point; raise it where noise passes for texture, "
        "lower it for dark or hazy images",
        minimum=0,
        maximum=2048,
    )
    support_uniqueness: float = setting(
        0.85,
        "largest ratio of the best to the second-best cost of a support point; "
        "lower it where fences and other repeated texture match wrongly",
        minimum=0.0,
        maximum=1.0,
    )
    consistency_px: int = setting(
        2,
        "largest difference of left and right disparity, for support points and pixels; "
        "lower it for fewer wrong pixels, raise it for fewer holes",
        minimum=0,
        maximum=20,
        unit="px",
    )
    support_window: int = setting(
        5,
        "half size of the neighbourhood that must agree with a support point; raise it with a smaller grid_step_px",
        minimum=1,
        maximum=50,
        unit="grid cells",
    )
    support_similarity_px: int = setting(
        5,
        "support points of a neighbourhood agree within this difference; raise it for steep surfaces near the camera",
        minimum=0,
        maximum=50,
        unit="px",
    )
    min_support: int = setting(
        5,
        "a support point that fewer of its neighbourhood, itself included, agree with is dropped; "
        "raise it where single wrong points remain, lower it for thin obstacles",
        minimum=0,
        maximum=1000,
    )
    redundancy_window: int = setting(
        5,
        "a support point between two alike, this close along the row or column, is dropped; 0 keeps all; "
        "raise it for fewer triangles",
        minimum=0,
        maximum=50,
        unit="grid cells",
    )
    match_texture: int = setting(
        1,
        "least sum of |descriptor - 128| of a pixel that is matched; raise it to leave uniform regions unmatched",
        minimum=0,
        maximum=2048,
    )
    beta: float = setting(
        0.02,
        "weight of the descriptors' difference; raise it to trust the images more and the planes less",
        minimum=0.001,
        maximum=10.0,
    )
    gamma: float = setting(
        3.0,
        "constant part of the prior on disparity; raise it where pixels may leave their plane more freely",
        minimum=0.01,
        maximum=100.0,
    )
    sigma_px: float = setting(
        1.0,
        "width of the prior around the plane; raise it for rough terrain",
        minimum=0.1,
        maximum=20.0,
        unit="px",
    )
    plane_radius_px: int = setting(
        2,
        "disparities this close to the plane are searched; raise it for rough terrain, at the price of time",
        minimum=0,
        maximum=20,
        unit="px",
    )
    cell_size_px: int = setting(
        20,
        "support points of a pixel's cell and its neighbours add their disparities; lower it to save time",
        minimum=4,
        maximum=200,
        unit="px",
    )
    speckle_size_px: int = setting(
        200,
        "smaller segments are removed; lower it for small images and thin obstacles, raise it where false patches stay",
        minimum=0,
        maximum=100000,
        unit="px",
    )
    speckle_similarity_px: float = setting(
        1.0,
        "neighbours within this difference belong to one segment; lower it to cut false patches off more readily",
        minimum=0.0,
        maximum=20.0,
        unit="px",
    )
    gap_width_px: int = setting(
        3,
        "longest gap along a row or column that is filled; raise it for disparity without holes, some of it guessed",
        minimum=0,
        maximum=5000,
        unit="px",
    )
    adaptive_mean: bool = setting(True, "smooth with the adaptive-mean filter; turn it off to save time")


@dataclass(frozen=True, slots=True)
class GroundConfig(CheckedConfig):
    """Short range: u-v-disparity and the ground line."""

    prefix = "ground."

    obstacle_height_m: float = setting(
        0.5,
        "an upright thing of this height fills a cell of the u-disparity; "
        "lower it where low obstacles are missed, raise it where rough ground counts as one",
        minimum=0.05,
        maximum=10.0,
        unit="m",
    )
    min_obstacle_share: float = setting(
        0.05,
        "least share of the image's rows that such a cell covers; raise it where distant ground counts as an obstacle",
        minimum=0.0,
        maximum=1.0,
    )
    min_camera_height_m: float = setting(
        0.2,
        "ground lines of a lower camera are refused; set it somewhat below the camera's height where that is known",
        minimum=0.01,
        maximum=100.0,
        unit="m",
    )
    max_camera_height_m: float = setting(
        5.0,
        "ground lines of a higher camera are refused; set it somewhat above the camera's height where that is known",
        minimum=0.01,
        maximum=100.0,
        unit="m",
    )
    max_pitch_deg: float = setting(
        45.0,
        "ground lines of a camera pitched farther up or down are refused; lower it where the camera stays level",
        minimum=1.0,
        maximum=60.0,
        unit="deg",
    )
    min_support: float = setting(
        0.1,
        "least share of the disparities below the horizon that lie on a ground line; "
        "lower it where obstacles hide most of the ground, raise it where walls are taken for ground",
        minimum=0.0,
        maximum=1.0,
    )
    shape: str = setting(
        "curved",
        "what is fitted to the ground: a line in the v-disparity; a plane, for a camera that rolls; "
        "a plane that bends along the way, for crests and slopes",
        choices=("line", "plane", "curved"),
    )
    noise_px: float = setting(
        0.4,
        "precision of disparities; raise it for a coarse matcher or an imprecise rectification",
        minimum=0.01,
        maximum=20.0,
        unit="px",
    )
    depth_noise_px: float = setting(
        0.2,
        "precision of disparities that come from a depth image; raise it for a noisy depth camera",
        minimum=0.01,
        maximum=20.0,
        unit="px",
    )
    max_step_m: float = setting(
        0.08,
        "largest step up or down that still counts as ground; set it to what the robot can climb",
        minimum=0.0,
        maximum=2.0,
        unit="m",
    )
    min_obstacle_m: float = setting(
        0.35,
        "anything at least this high above the ground is an obstacle, and lower things where they stand upright; "
        "0: only the u-disparity's obstacles; lower it for robots that must avoid low things",
        minimum=0.0,
        maximum=5.0,
        unit="m",
    )
    contact_margin: float = setting(
        0.03,
        "what stands upright is an obstacle down to where the ground is nearer by less than this share; raise it where "
        "obstacles swallow the ground before them, lower it where feet are called ground; 1 marks neither feet nor low "
        "things, nor does min_obstacle_m = 0",
        minimum=0.0,
        maximum=1.0,
    )
    min_drop_m: float = setting(
        0.2,
        "what lies this far below the ground, behind a rim of ground and 0.2 m wide at least, is an obstacle: ditches, "
        "steps down, edges; "
        "0 for none, as with min_obstacle_m = 0; raise it on rough slopes",
        minimum=0.0,
        maximum=5.0,
        unit="m",
    )
    max_hole_px: int = setting(
        15,
        "holes in the ground without disparity are filled up to this size; 0 for none; raise it for sparse disparity",
        minimum=0,
        maximum=501,
        unit="px",
    )
    memory_s: float = setting(
        0.0,
        "for how long the ground of the last frame that shows it serves frames that show too little of it, as before a "
        "wall; 0 for none; it needs frames with a time; lower it for cameras that pitch and bounce",
        minimum=0.0,
        maximum=60.0,
        unit="s",
    )


@dataclass(frozen=True, slots=True)
class SuperpixelsConfig(CheckedConfig):
    """Preemptive SLIC; Neubert and Protzel, ICPR 2014."""

    prefix = "superpixels."

    n_superpixels: int = setting(
        500,
        "superpixels that are asked for; raise it for narrow paths and thin obstacles; from 1000 on it takes time",
        minimum=1,
        maximum=20000,
    )
    compactness: float = setting(
        20.0,
        "weight of distance in the image against distance in Lab colour; raise it for squarer superpixels, "
        "lower it for ones that follow faint edges",
        minimum=0.1,
        maximum=1000.0,
    )
    max_iterations: int = setting(
        5,
        "iterations at most; lower it to save time, raise it for borders that follow edges a little closer",
        minimum=1,
        maximum=100,
    )
    preemption_threshold: float = setting(
        0.01,
        "share of pixels that must have changed label for a cluster to be visited again; "
        "raise it to save time, 0 for plain SLIC",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True, slots=True)
class FeaturesConfig(CheckedConfig):
    """Colour and texture of superpixels, and the distance between two of them."""

    prefix = "features."

    cues: str = setting(
        "both",
        "what superpixels are compared by; colour or texture alone where the other misleads",
        choices=("both", "colour", "texture"),
    )
    texture: str = setting(
        "wld",
        "texture descriptor: Weber's law, the paper's choice; binary patterns: local, centre-symmetric, ternary; "
        "homogeneity",
        choices=("wld", "lbp", "cs_lbp", "ltp", "homogeneity"),
    )
    distance: str = setting(
        "correlation",
        "distance between histograms; correlation is the paper's choice; the others take seconds a frame, and "
        f"{_MAX_COMPARED} superpixels at most",
        choices=("correlation", "chi_square", "intersection", "bhattacharyya", "euclidean", "earth_mover"),
    )


@dataclass(frozen=True, slots=True)
class ClusteringConfig(CheckedConfig):
    """Improved spectral clustering of the superpixels."""

    prefix = "clustering."

    k: int = setting(
        10,
        "number of clusters; 0 takes it from the largest gap between eigenvalues; raise it where ground and obstacles "
        "share a cluster, lower it where the long range ends too soon",
        minimum=0,
        maximum=1000,
    )
    centres: str = setting(
        "farthest",
        "initial centres of k-means: each the farthest from those before, or at random, as the paper's comparison",
        choices=("farthest", "random"),
    )
    seed: int = setting(
        0,
        "seed of the random first centre; change it to see how much depends on chance",
        minimum=0,
        maximum=2**31 - 1,
    )


@dataclass(frozen=True, slots=True)
class ExtensionConfig(CheckedConfig):
    """Extension of the short-range ground over the clusters."""

    prefix = "extension."

    rule: str = setting(
        "propagation",
        "area: the paper's, by a cluster's share of short-range ground; "
        "evidence: by connected regions, with obstacles as evidence against; a region without any is as its cluster; "
        "propagation: superpixels vote by how alike they look, and votes settle over their neighbourhood",
        choices=("area", "evidence", "propagation"),
    )
    min_share: float = setting(
        0.5,
        "a cluster, region or superpixel with more than this share of ground is traversable; "
        "raise it to claim less ground, lower it to see farther",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True, slots=True)
class MemoryConfig(CheckedConfig):
    """Evidence of the frames before, for the rule ``propagation``."""

    prefix = "memory."

    frames: int = setting(
        0,
        "how many frames before lend their evidence, by appearance; 0 for none; raise it where the mask flickers, "
        "lower it where light changes fast",
        minimum=0,
        maximum=100,
    )
    max_gap_s: float = setting(
        2.0,
        "a longer gap between two frames, and any jump back in time, forgets what is remembered; what was found at the "
        "same place is only used for 0.25 s; raise it for cameras with few frames a second",
        minimum=0.0,
        maximum=3600.0,
        unit="s",
    )


@dataclass(frozen=True, slots=True)
class MapsConfig(CheckedConfig):
    """Maps in metres: the grid and the point clouds."""

    prefix = "maps."

    cell_m: float = setting(
        0.1,
        "size of the grid's cells, and distance between points of obstacles and free; set it to the resolution of the "
        "costmap",
        minimum=0.01,
        maximum=5.0,
        unit="m",
    )
    length_m: float = setting(
        30.0,
        "how far ahead the grid and the point clouds reach; raise it for fast robots and high cameras",
        minimum=1.0,
        maximum=500.0,
        unit="m",
    )
    width_m: float = setting(
        20.0,
        "how wide the grid is, half of it to either side; raise it for wide lenses",
        minimum=1.0,
        maximum=500.0,
        unit="m",
    )
    max_row_m: float = setting(
        0.5,
        "a row of the image that covers more of the way ahead than this is left unknown in the grid; raise it to see "
        "farther and more coarsely",
        minimum=0.01,
        maximum=100.0,
        unit="m",
    )
    clearance_m: float = setting(
        2.0,
        "what hangs higher than this above the ground is no obstacle in the maps; set it a little above the height of "
        "the robot",
        minimum=0.1,
        maximum=100.0,
        unit="m",
    )
    frame: str = setting(
        "",
        "frame that the grid is drawn in, that of the costmap that it is for, such as odom; it takes tf2_ros; "
        "empty for the frame on the ground below the camera",
        read_only=True,
    )

    def __post_init__(self) -> None:
        CheckedConfig.__post_init__(self)
        # A frame of others is turned: its grid is the box around the one of the camera.
        area_m2 = (self.length_m + self.width_m) ** 2 / 2 if self.frame else self.length_m * self.width_m
        n_cells = area_m2 / self.cell_m**2
        where = " in another frame" if self.frame else ""
        if n_cells > _MAX_CELLS:
            raise ValueError(
                f"maps.length_m {self.length_m:g} and maps.width_m {self.width_m:g} are {n_cells:.0f} cells of "
                f"maps.cell_m {self.cell_m:g}{where}, which {_TOO_SLOW}; give numbers that make {_MAX_CELLS} at most"
            )


@dataclass(frozen=True, slots=True)
class Config(CheckedConfig):
    """The whole configuration: one part per stage, and what concerns them all.

    Raises
    ------
    TypeError, ValueError
        If a part is not that of its stage, or a value does not fit.

    Examples
    --------
    >>> Config.preset("paper").extension.rule
    'area'
    >>> Config().updated({"stereo.n_disparities": 64}).stereo.n_disparities
    64
    """

    threads: int = setting(
        0,
        "threads that a detector may use, those of OpenCV included (sgbm and the node long_range have one each); 0 for "
        "all processors, and never more than there are; lower it to leave processors to others: the result does not "
        "depend on it",
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
    memory: MemoryConfig = field(default_factory=MemoryConfig)
    maps: MapsConfig = field(default_factory=MapsConfig)

    def __post_init__(self) -> None:
        CheckedConfig.__post_init__(self)
        for name, kind in _parts().items():
            part = getattr(self, name)
            if not isinstance(part, kind):
                raise TypeError(f"{name} is of type {type(part).__name__}; give {kind.__name__}")
        n, distance = self.superpixels.n_superpixels, self.features.distance
        if distance != "correlation" and n > _MAX_COMPARED:
            raise ValueError(
                f"superpixels.n_superpixels {n} with features.distance {distance!r} {_TOO_SLOW}; give {_MAX_COMPARED} "
                "at most, or the distance 'correlation'"
            )

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
        changes: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            parameter = find_parameter(name)
            stage, attribute = _places()[name]
            changes.setdefault(stage, {})[attribute] = parameter.check(value)
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
    def memories(self) -> dict[str, Value]:
        """The settings by which frames depend on those before them, by full name; none where each stands alone."""
        settings: dict[str, Value] = {
            "ground.memory_s": self.ground.memory_s,
            "memory.frames": self.memory.frames,
        }
        return {name: value for name, value in settings.items() if value}

    @property
    def n_threads(self) -> int:
        """The number of threads to use, at least 1 and at most one for each processor: more get in each other's way.

        Processors are those that this process may use, of which a container may leave it a few.
        """
        from joblib import cpu_count

        n_processors = int(cpu_count())
        return min(self.threads or n_processors, n_processors)


# The letter of the paper, where it differs from the defaults above.
_PAPER: dict[str, Value] = {
    "ground.shape": "line",
    "ground.noise_px": 1.0,
    "ground.max_step_m": 0.13,
    "ground.min_obstacle_m": 0.0,
    "ground.contact_margin": 1.0,
    "ground.min_drop_m": 0.0,
    "ground.max_hole_px": 0,
    "superpixels.n_superpixels": 200,
    "superpixels.max_iterations": 10,
    "clustering.k": 0,
    "extension.rule": "area",
}


@cache
def _parts() -> dict[str, type[CheckedConfig]]:
    """Return the configuration of each stage."""
    parts = {item.name: item.default_factory for item in dataclasses.fields(Config) if not item.metadata}
    return cast("dict[str, type[CheckedConfig]]", parts)


def _stages() -> dict[str, type[CheckedConfig]]:
    """Return the configuration of each stage; that of `Config` itself under an empty name."""
    return {"": Config, **_parts()}


@cache
def _places() -> dict[str, tuple[str, str]]:
    """Return stage and field of each parameter; the stage is empty for those of `Config` itself."""
    return {
        parameter.name: (stage, attribute)
        for stage, part in _stages().items()
        for attribute, parameter in settings_of(part).items()
    }


@cache
def parameters() -> tuple[Parameter, ...]:
    """Return every parameter, with the defaults of the preset ``robust``."""
    return tuple(parameter for part in _stages().values() for parameter in settings_of(part).values())


def find_parameter(name: str) -> Parameter:
    """Return the parameter called `name`; raises ValueError, with the names that are near, if there is none."""
    for parameter in parameters():
        if parameter.name == name:
            return parameter
    nearest = _nearest(name)
    remedy = f"did you mean {' or '.join(nearest)}?" if nearest else "`lrtrav detect --help` lists all"
    raise ValueError(f"no parameter {name!r}; {remedy}")


def foreign_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names that belong to other packages' nodes: no parameter here has that name or a similar one.

    A section for all nodes of a robot, ``/**``, has such names. ``preset``, ``use_sim_time``, ``qos_overrides`` and
    what else every node has are not among them.

    Raises
    ------
    ValueError
        If a name is most likely a misspelt one of ours: it is near one, or begins with the name of a stage.
    """
    known = {parameter.name for parameter in parameters()}
    foreign = [name for name in names if name not in known and not is_general(name)]
    for name in foreign:
        if _is_misspelt(name):
            find_parameter(name)  # says which are near
    return tuple(foreign)


def is_general(name: str) -> bool:
    """Return whether `name` is a parameter that every node has, such as ``use_sim_time``, and that is no setting."""
    return name in _GENERAL or name.startswith(_GENERAL_PREFIX)


def _is_misspelt(name: str) -> bool:
    """Return whether an unknown name can only be meant for a parameter of ours."""
    import difflib

    stage, dot, _ = name.partition(".")
    if dot and any(stage == parameter.stage for parameter in parameters()):
        return True
    if len(name) >= _DISTINCTIVE and any(known.endswith(f".{name}") for known in _all_names()):
        return True
    return bool(difflib.get_close_matches(name, _all_names(), n=1, cutoff=_SURELY_MISSPELT))


def _nearest(name: str) -> list[str]:
    """Return up to three names that resemble `name`, the nearest first; one that only lacks its stage before all."""
    import difflib

    others = [known for known in _all_names() if known != name]
    return [known for known in others if known.endswith(f".{name}")] or difflib.get_close_matches(name, others, n=3)


def _all_names() -> list[str]:
    """Return the names of all parameters and of what every node has."""
    return [*(parameter.name for parameter in parameters()), *_GENERAL]
