"""The whole method, stage after stage: frame -> disparity -> short range -> superpixels -> long range."""

from __future__ import annotations

import dataclasses
import enum
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ParamSpec, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config, GroundConfig
from lrtrav_ros.frame import Frame, Image, as_8bit
from lrtrav_ros.method.clustering import spectral_clusters, spread_clusters
from lrtrav_ros.method.comparison import feature_distances, landmarks
from lrtrav_ros.method.extension import extend
from lrtrav_ros.method.features import Features, pixel_bins, superpixel_features
from lrtrav_ros.method.ground import UNKNOWN, ShortRange, detect_ground, traversable_mask
from lrtrav_ros.method.ground_memory import GroundMemory
from lrtrav_ros.method.matching import Matcher, create_matcher
from lrtrav_ros.method.memory import Memory
from lrtrav_ros.method.propagation import SuperpixelGraph, propagate, superpixel_graph
from lrtrav_ros.method.superpixels import preemptive_slic
from lrtrav_ros.numerics.checks import check_array, check_number, check_type
from lrtrav_ros.numerics.thread_team import ALONE, ThreadTeam

_P = ParamSpec("_P")
_R = TypeVar("_R")


class Stage(enum.Enum):
    """A stage of the method."""

    MATCHING = "matching"
    GROUND = "ground"
    SUPERPIXELS = "superpixels"
    FEATURES = "features"
    CLUSTERING = "clustering"
    EXTENSION = "extension"


@dataclass(frozen=True, slots=True)
class StageTimes:
    """Time that each stage took, in milliseconds; 0 for one that did not run."""

    matching_ms: float = 0.0
    ground_ms: float = 0.0
    superpixels_ms: float = 0.0
    features_ms: float = 0.0
    clustering_ms: float = 0.0
    extension_ms: float = 0.0


class StageRunner:
    """Runs the stages of one frame, and takes their times."""

    def __init__(self) -> None:
        self._times_ms = dict.fromkeys(Stage, 0.0)

    def __call__(self, stage: Stage, function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Return what `function` returns; the time that it takes counts for `stage`."""
        start = time.perf_counter()
        result = function(*args, **kwargs)
        self._times_ms[stage] += (time.perf_counter() - start) * 1e3
        return result

    @property
    def times(self) -> StageTimes:
        """Time of each stage up to now."""
        return StageTimes(**{f"{stage.value}_ms": time_ms for stage, time_ms in self._times_ms.items()})


@dataclass(frozen=True, eq=False)
class LongRange:
    """The traversable region to the horizon, in an image of (H, W) pixels.

    The clusters are found when they are first asked for, where the region was found without them.

    Attributes
    ----------
    occupancy : (H, W) ndarray of uint8
        0 free, 100 occupied, 255 unknown.
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    find_clusters : callable
        Returns the cluster of each superpixel, (n,) ndarray of int32.
    confidence : (H, W) ndarray of uint8 or None
        Probability that the mask's label of each pixel is right, times 255; 0 where nothing tells. None where the
        method does not say.
    """

    occupancy: NDArray[np.uint8]
    superpixels: NDArray[np.int32]
    find_clusters: Callable[[], NDArray[np.int32]]
    confidence: NDArray[np.uint8] | None = None

    @property
    def superpixel_clusters(self) -> NDArray[np.int32]:
        """The cluster of each superpixel, int32 (n,)."""
        # Before Python 3.12, functools.cached_property has a lock, which is never free in a child forked meanwhile.
        if "_clusters" not in self.__dict__:
            self.__dict__["_clusters"] = self.find_clusters()
        clusters: NDArray[np.int32] = self.__dict__["_clusters"]
        return clusters

    @property
    def mask(self) -> NDArray[np.uint8]:
        """Traversable pixels, uint8 (H, W): 255 traversable, 0 not."""
        return traversable_mask(self.occupancy)

    @property
    def clusters(self) -> NDArray[np.int32]:
        """The cluster of each pixel, int32 (H, W)."""
        return self.superpixel_clusters[self.superpixels]

    def without(self, unseen: NDArray[np.bool_] | None) -> LongRange:
        """Return the same, with pixels that the camera does not show as unknown; see `Frame`.

        Parameters
        ----------
        unseen : (H, W) ndarray of bool or None
            None where it shows all.

        Raises
        ------
        TypeError, ValueError
            If it is no such array of the image's size.
        """
        if unseen is None:
            return self
        check_array("occupancy", self.occupancy, np.uint8, ("H", "W"))
        check_array("unseen", unseen, np.bool_, self.occupancy.shape)
        nothing = np.uint8(0)
        confidence = None if self.confidence is None else np.where(unseen, nothing, self.confidence)
        occupancy = np.where(unseen, np.uint8(UNKNOWN), self.occupancy)
        return dataclasses.replace(self, occupancy=occupancy, confidence=confidence)


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """All that the method finds in one frame.

    Attributes
    ----------
    image : (H, W) or (H, W, 3) ndarray of uint8
        The left image that it was found in, grey or BGR.
    short_range : ShortRange
        Disparity, ground and obstacles.
    long_range : LongRange
        The traversable region to the horizon, superpixels and clusters.
    times : StageTimes
        Time of each stage.
    """

    image: NDArray[np.uint8]
    short_range: ShortRange
    long_range: LongRange
    times: StageTimes

    @property
    def disparity(self) -> NDArray[np.float32]:
        """Disparity as far as it is trusted (``source.max_depth_m``), float32 (H, W) in pixels, 0 for none."""
        return self.short_range.disparity

    @property
    def superpixels(self) -> NDArray[np.int32]:
        """The superpixel of each pixel, int32 (H, W)."""
        return self.long_range.superpixels

    @property
    def clusters(self) -> NDArray[np.int32]:
        """The cluster of each pixel, int32 (H, W)."""
        return self.long_range.clusters


class ShortRangeDetector:
    """Finds ground and obstacles as far as disparity is trusted: stereo matching and u-v-disparity.

    With ``ground.memory_s`` it remembers the ground of the last frame: give it those of one camera, in their order.

    Parameters
    ----------
    config : Config
        Only `source`, `stereo`, `elas`, `ground` and `threads` are used.
    matcher : Matcher, optional
        Used in place of the one that `config` names, to share one among detectors.
    team : ThreadTeam, optional
        Threads to share the work; one of its own, as large as `config` says, where none is given.

    Raises
    ------
    TypeError
        If an argument is something else.
    """

    def __init__(self, config: Config, *, matcher: Matcher | None = None, team: ThreadTeam | None = None) -> None:
        check_type("config", config, Config)
        check_type("matcher", matcher, Matcher, may_be_none=True)
        check_type("team", team, ThreadTeam, may_be_none=True)
        self.config = config
        self._team = team or _new_team(config)
        self._matcher = matcher or create_matcher(config.stereo, config.elas, team=self._team)
        self._memory = GroundMemory(config.ground)

    def detect(self, frame: Frame, run: StageRunner | None = None) -> ShortRange:
        """Detect ground and obstacles in a frame.

        Parameters
        ----------
        frame : Frame
            From any source; the left image may be missing if the frame has disparity or depth.
        run : StageRunner, optional
            Times the stages.

        Returns
        -------
        ShortRange
            Disparity as far as it is trusted, ground and obstacles; all is unknown where no ground line is found.
        """
        check_type("frame", frame, Frame)
        run, camera = run or StageRunner(), frame.camera
        disparity = self._disparity(frame, run)
        disparity = run(Stage.GROUND, within_reach, disparity, camera, self.config.source.max_depth_m)
        before = self._memory.recall(camera, frame.stamp_ns)
        found = run(
            Stage.GROUND, detect_ground, disparity, camera, self._ground_config(frame), before=before, team=self._team
        )
        if found.line is not None and not found.is_line_remembered:
            self._memory.remember(found.line, camera, frame.stamp_ns)
        if frame.unseen is None:
            return found
        return dataclasses.replace(found, occupancy=np.where(frame.unseen, np.uint8(UNKNOWN), found.occupancy))

    def _disparity(self, frame: Frame, run: StageRunner) -> NDArray[np.float32]:
        """Return the disparity of a frame, from whatever source, however far it goes."""
        if frame.left is not None and frame.right is not None:
            disparity = run(Stage.MATCHING, self._matcher.compute, frame.left, frame.right)
            return disparity if frame.unseen is None else np.where(frame.unseen, np.float32(0), disparity)
        if frame.depth_m is not None:
            return run(Stage.MATCHING, frame.camera.disparity, frame.depth_m)
        assert frame.disparity is not None  # a frame is valid by construction
        return frame.disparity

    def _ground_config(self, frame: Frame) -> GroundConfig:
        """Return the settings of the ground for the precision of the frame's source."""
        config = self.config.ground
        return dataclasses.replace(config, noise_px=config.depth_noise_px) if frame.source == "depth" else config


def _new_team(config: Config) -> ThreadTeam:
    """Return a team of as many threads as a configuration says, and hold OpenCV, in the whole process, to as many."""
    cv2.setNumThreads(config.n_threads)
    return ThreadTeam(config.n_threads) if config.n_threads > 1 else ALONE


def within_reach(disparity: NDArray[np.float32], camera: StereoCamera, limit_m: float) -> NDArray[np.float32]:
    """Return disparity, 0 where it is farther away than a limit.

    Parameters
    ----------
    disparity : (H, W) ndarray of float32
        In pixels, 0 for none.
    camera : StereoCamera
        Its calibration.
    limit_m : float
        Greatest depth in metres that is kept; 0 for no limit, and then `disparity` itself is returned.

    Returns
    -------
    (H, W) ndarray of float32

    Raises
    ------
    TypeError, ValueError
        If an argument is not as above.
    """
    check_array("disparity", disparity, np.float32, ("H", "W"))
    check_type("camera", camera, StereoCamera)
    limit_m = check_number("limit_m", limit_m)
    if limit_m < 0:
        raise ValueError(f"limit_m is {limit_m}; give 0 or more")
    if not limit_m:
        return disparity
    least = min(camera.fx * camera.baseline_m / limit_m, float(np.finfo(np.float32).max))
    return np.where(disparity >= least, disparity, np.float32(0))


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """What the left image of a frame looks like: all of the long range that needs no disparity.

    Parameters
    ----------
    superpixels : (H, W) ndarray of int32
        Labels 0 .. n - 1.
    features : Features
        Of the n superpixels.
    graph : SuperpixelGraph or None
        How they are alike, for the rule ``propagation``.
    """

    superpixels: NDArray[np.int32]
    features: Features
    graph: SuperpixelGraph | None


class LongRangeDetector:
    """Extends short-range ground to the horizon, over superpixels of the left image.

    With ``memory.frames`` it remembers the frames before: give it those of one camera, in their order.

    Parameters
    ----------
    config : Config
        Only `superpixels`, `features`, `clustering`, `extension`, `memory` and `threads` are used.
    memory : Memory, optional
        What is remembered, to go on with where settings other than those of `features` change; empty where none is
        given.
    team : ThreadTeam, optional
        Threads to share the work; one of its own, as large as `config` says, where none is given.

    Raises
    ------
    TypeError
        If an argument is something else.
    """

    def __init__(self, config: Config, *, memory: Memory | None = None, team: ThreadTeam | None = None) -> None:
        check_type("config", config, Config)
        check_type("memory", memory, Memory, may_be_none=True)
        check_type("team", team, ThreadTeam, may_be_none=True)
        self.config = config
        self.memory = Memory(config.memory) if memory is None else memory  # an empty one has length 0
        self._team = team or _new_team(config)

    def detect(
        self,
        image: Image,
        occupancy: NDArray[np.uint8],
        run: StageRunner | None = None,
        *,
        stamp_ns: int | None = None,
    ) -> LongRange:
        """Detect the traversable region to the horizon: `look`, then `extend`.

        Parameters
        ----------
        image : (H, W) or (H, W, 3) ndarray of uint8 or uint16
            The left image, grey or BGR.
        occupancy : (H, W) ndarray of uint8
            Short range: 0 ground, 100 obstacle, 255 unknown.
        run : StageRunner, optional
            Times the stages.
        stamp_ns : int, optional
            The image's time in nanoseconds: a jump in it makes the memory forget.

        Returns
        -------
        LongRange
            The region, the superpixels and their clusters.

        Raises
        ------
        TypeError, ValueError
            If the two differ in size, or one has another type.
        """
        check_array("occupancy", occupancy, np.uint8, as_8bit(image).shape[:2])
        return self.extend(self.look(image, run), occupancy, run, stamp_ns=stamp_ns)

    def look(self, image: Image, run: StageRunner | None = None) -> Appearance:
        """Find all that needs no disparity; it may run beside the stereo matching.

        Parameters
        ----------
        image : (H, W) or (H, W, 3) ndarray of uint8 or uint16
            The left image, grey or BGR.
        run : StageRunner, optional
            Times the stages.

        Returns
        -------
        Appearance
            For `extend`.

        Raises
        ------
        TypeError, ValueError
            If the image is not such an array.
        """
        run, config, image = run or StageRunner(), self.config, as_8bit(image)
        team, graph = self._team, None
        with team.start(run, Stage.FEATURES, pixel_bins, image, config.features, team=team) as bins:
            superpixels = run(Stage.SUPERPIXELS, preemptive_slic, image, config.superpixels, team=team)
            features = run(
                Stage.FEATURES, superpixel_features, image, superpixels, config.features, bins=bins.result(), team=team
            )
        if config.extension.rule == "propagation":
            graph = run(Stage.FEATURES, superpixel_graph, superpixels, features, config.features, team=team)
        return Appearance(superpixels, features, graph)

    def extend(
        self,
        appearance: Appearance,
        occupancy: NDArray[np.uint8],
        run: StageRunner | None = None,
        *,
        stamp_ns: int | None = None,
    ) -> LongRange:
        """Extend short-range ground over an image, and remember what was found.

        Parameters
        ----------
        appearance : Appearance
            What `look` found in the image.
        occupancy, run, stamp_ns
            As in `detect`.

        Returns
        -------
        LongRange
            As from `detect`.

        Raises
        ------
        TypeError, ValueError
            If the occupancy is not such an array, or not of the image's size.
        """
        check_type("appearance", appearance, Appearance)
        check_type("appearance.features", appearance.features, Features)
        run, config, superpixels = run or StageRunner(), self.config, appearance.superpixels
        check_array("superpixels", superpixels, np.int32, ("H", "W"))
        check_array("occupancy", occupancy, np.uint8, superpixels.shape)
        if appearance.graph is not None:
            return self._propagate(occupancy, appearance.graph, stamp_ns, run)
        clusters = _find_clusters(appearance.features, config, run)
        extended = run(Stage.EXTENSION, extend, occupancy, superpixels, clusters, config.extension)
        return LongRange(extended, superpixels, partial(np.asarray, clusters))

    def _propagate(
        self, occupancy: NDArray[np.uint8], graph: SuperpixelGraph, stamp_ns: int | None, run: StageRunner
    ) -> LongRange:
        """Extend short-range ground by propagation, with what the memory holds."""
        self.memory.at(stamp_ns)
        found = run(
            Stage.EXTENSION,
            propagate,
            occupancy,
            graph,
            remembered=self.memory.recall(),
            before=self.memory.belief,
            min_share=self.config.extension.min_share,
            team=self._team,
        )
        self.memory.remember(graph.features, found.evidence, found.belief)
        find_clusters = partial(_find_clusters, graph.features, self.config, StageRunner())
        return LongRange(found.occupancy, graph.superpixels, find_clusters, found.confidence)


def _find_clusters(features: Features, config: Config, run: StageRunner) -> NDArray[np.int32]:
    """Return the cluster of each superpixel."""
    chosen = landmarks(features, config.features)
    some = features if len(chosen) == len(features) else features.chosen(chosen)
    distances = run(Stage.FEATURES, feature_distances, some, config.features)
    clusters = run(Stage.CLUSTERING, spectral_clusters, distances, config.clustering)
    return run(Stage.CLUSTERING, spread_clusters, clusters, features, config.features)


class Detector:
    """Detects the traversable region, frame by frame; between frames it keeps only its two memories.

    It uses as many threads as `config` says, and holds OpenCV, in the whole process, to as many. What needs no
    disparity is done beside the stereo matching. Results do not depend on the number of threads.

    Parameters
    ----------
    config : Config
        Settings of all stages.
    camera : StereoCamera, optional
        Calibration of the images that `detect` is given; `detect_frame` does without, for a frame brings its own.
    matcher : Matcher, optional
        Used in place of the one that `config` names, to share one among detectors.

    Raises
    ------
    TypeError
        If an argument is something else.

    Examples
    --------
    >>> detector = Detector(Config.preset("robust"), StereoCamera(fx=721.5, cx=609.6, cy=172.9, baseline_m=0.53))
    >>> result = detector.detect(left_bgr, right_bgr)  # doctest: +SKIP
    >>> result.long_range.mask.dtype  # doctest: +SKIP
    dtype('uint8')
    """

    def __init__(self, config: Config, camera: StereoCamera | None = None, *, matcher: Matcher | None = None) -> None:
        check_type("config", config, Config)
        check_type("camera", camera, StereoCamera, may_be_none=True)
        check_type("matcher", matcher, Matcher, may_be_none=True)
        self.config = config
        self.camera = camera
        self._team = _new_team(config)
        self.short_range = ShortRangeDetector(config, matcher=matcher, team=self._team)
        self.long_range = LongRangeDetector(config, team=self._team)

    def detect(
        self,
        left: Image,
        right: Image | None = None,
        *,
        disparity: NDArray[np.float32] | None = None,
        depth_m: NDArray[np.float32] | None = None,
    ) -> Detection:
        """Detect short and long range in one frame.

        Parameters
        ----------
        left : (H, W) or (H, W, 3) ndarray of uint8 or uint16
            Left image, grey or BGR.
        right : ndarray, optional
            Right image, of the same shape and type.
        disparity, depth_m : (H, W) ndarray of float32, optional
            In place of `right`: disparity in pixels, or depth in metres, with 0 for none. What is negative or not
            finite counts as none.

        Returns
        -------
        Detection
            All that was found.

        Raises
        ------
        ValueError
            If not exactly one of the three is given, an image does not fit, or the detector has no camera.
        """
        if self.camera is None:
            raise ValueError("the detector has no camera; make it with one, or give a frame to detect_frame")
        return self.detect_frame(
            Frame(camera=self.camera, left=left, right=right, disparity=disparity, depth_m=depth_m)
        )

    def detect_frame(self, frame: Frame, run: StageRunner | None = None) -> Detection:
        """Detect short and long range in a frame, with the frame's own camera.

        Parameters
        ----------
        frame : Frame
            From any source, with a left image.
        run : StageRunner, optional
            Times the stages.

        Returns
        -------
        Detection
            All that was found.

        Raises
        ------
        ValueError
            If the frame has no left image.
        """
        check_type("frame", frame, Frame)
        run, image = run or StageRunner(), frame.image
        with self._team.start(self.long_range.look, image, run) as appearance:
            short_range = self.short_range.detect(frame, run)
            long_range = self.long_range.extend(
                appearance.result(), short_range.occupancy, run, stamp_ns=frame.stamp_ns
            )
        return Detection(image, short_range, long_range.without(frame.unseen), run.times)
