"""Exact disparity of small scenes: ground, flat or with a slope ahead, boxes on it, and a ditch in it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.method.ground import GROUND, OBSTACLE, GroundLine

CAMERA = StereoCamera(fx=260.0, fy=250.0, cx=155.0, cy=90.0, baseline_m=0.25)
HEIGHT, WIDTH = 240, 320


def line_of(*, height_m: float, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> GroundLine:
    """Return the ground line of a camera at a height, pitched down and rolled to the right."""
    pitch, roll = math.radians(pitch_deg), math.radians(roll_deg)
    down = np.array([math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch), math.sin(pitch)])
    per_metre = CAMERA.fx * CAMERA.baseline_m / height_m
    tilt, slope = per_metre * down[0] / CAMERA.fx, per_metre * down[1] / CAMERA.fy
    return GroundLine(slope, per_metre * down[2] - slope * CAMERA.cy - tilt * CAMERA.cx, tilt)


@dataclass(frozen=True)
class Box:
    """A box on the ground: where it begins and ends ahead, to the left and up, in metres; below 0 it is a ditch."""

    ahead: tuple[float, float]
    left: tuple[float, float]
    up: tuple[float, float]

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far points are from the box; 0 on and in it."""
        low, high = np.array([self.ahead, self.left, self.up]).T
        return np.linalg.norm(np.maximum(np.maximum(low - points, points - high), 0), axis=-1)


@dataclass(frozen=True)
class Scene:
    """What a camera over the ground sees.

    From `slope_from` on, the ground rises by `slope`.
    """

    line: GroundLine
    boxes: tuple[Box, ...] = ()
    slope: float = 0.0
    slope_from: float = 5.0
    ditch: tuple[float, float, float] | None = None  # begin and end ahead, and depth
    frame: GroundFrame = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame", GroundFrame.of(self.line, CAMERA))

    def ground_height(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how high points of the ground's frame are above the ground."""
        return points[..., 2] - self.slope * np.maximum(points[..., 0] - self.slope_from, 0)

    def rays(self) -> NDArray[np.float64]:
        """Return the directions of the pixels in the ground's frame, of depth 1, (H, W, 3)."""
        v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
        rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
        return rays @ self.frame.rotation.T

    def depths(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """Return the depth of each pixel, infinite for the sky, and which box it is of; -1 for the ground."""
        rays, height = self.rays(), self.frame.height_m
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = np.where(rays[..., 2] < 0, -height / rays[..., 2], np.inf)
            if self.ditch is not None:
                flat = self._into_ditch(flat, rays)
            rising = (height + self.slope * self.slope_from) / (self.slope * rays[..., 0] - rays[..., 2])
            depth = np.minimum(flat, np.where(rising > 0, rising, np.inf)) if self.slope else flat
            which = np.full(depth.shape, -1, np.int32)
            for number, box in enumerate(self.boxes):
                near = self._hit(box, rays)
                which = np.where(near < depth, np.int32(number), which)
                depth = np.minimum(depth, near)
        return depth, which

    def disparity(self) -> NDArray[np.float32]:
        """Return the disparity, (H, W)."""
        return (CAMERA.fx * CAMERA.baseline_m / self.depths()[0]).astype(np.float32)

    def occupancy(self) -> NDArray[np.uint8]:
        """Return what is ground and what is not, without fault."""
        depth, which = self.depths()
        return np.where((which < 0) & np.isfinite(depth), np.uint8(GROUND), np.uint8(OBSTACLE))

    def points(self) -> NDArray[np.float64]:
        """Return what each pixel sees in the ground's frame, (H, W, 3); NaN for the sky."""
        depth = np.where(np.isfinite(self.depths()[0]), self.depths()[0], np.nan)
        return self.rays() * depth[..., None] + np.array([0, 0, self.frame.height_m])

    def _hit(self, box: Box, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the depth at which rays enter a box; infinite where they miss it."""
        low, high = np.array([box.ahead, box.left, box.up]).T - np.array([0, 0, self.frame.height_m])[:, None].T
        enter, leave = np.sort(np.stack([low / rays, high / rays]), axis=0)
        first, last = enter.max(axis=-1), leave.min(axis=-1)
        return np.where((first < last) & (first > 0), first, np.inf)

    def _into_ditch(self, flat: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the depths of flat ground, but those within the ditch of its floor or its far wall."""
        assert self.ditch is not None
        begin, end, deep = self.ditch
        ahead = flat * rays[..., 0]
        inside = (ahead > begin) & (ahead < end)
        floor, wall = -(self.frame.height_m + deep) / rays[..., 2], end / rays[..., 0]
        return np.where(inside, np.minimum(floor, wall), flat)
