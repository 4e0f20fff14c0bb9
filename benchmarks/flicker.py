#!/usr/bin/env python3
"""How much masks change from a frame to the next: of a camera that stands, and of one that drives over flat ground.

    python benchmarks/flicker.py
    python benchmarks/flicker.py --set memory.frames=0 --style forest --frames 20

Standing, all pixels count. Driving, a mask is compared with the one before at the same points of the ground, where both
frames show ground. Numbers are shares of the pixels that change, means over neighbouring frames, in percent.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from lrtrav_ros.commands.options import add_detection_options, config_from
from lrtrav_ros.config import Config
from lrtrav_ros.detector import Detector
from lrtrav_ros.evaluation.scoring.flicker import mean_flicker
from lrtrav_ros.synthetic.landscape import make_scene
from lrtrav_ros.synthetic.rendering import camera_view, render_sequence
from lrtrav_ros.synthetic.scene_config import STYLES, SceneConfig

Mask = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Masks:
    """What is found in a frame, and what is true."""

    short_range: Mask
    long_range: Mask
    truth: Mask


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_detection_options(parser)
    parser.add_argument("--style", nargs="+", choices=STYLES, default=STYLES, help="landscapes (all)")
    parser.add_argument("--frames", type=int, default=12, help="frames of each sequence, at least 2 (12)")
    parser.add_argument("--seed", type=int, default=7, help="seed of the scenes (7)")
    parser.add_argument("--speed", type=float, default=2.5, help="of the drive, m/s at 10 frames per second (2.5)")
    args = parser.parse_args()
    if args.frames < 2:
        parser.error(f"--frames is {args.frames}; give at least 2")
    config = config_from(args)
    print(f"{'changes, %':12} {'standing':>21} {'driving':>21}")
    print(f"{'':12} " + " ".join(f"{name:>10}" for name in ("short", "long") * 2))
    for style in args.style:
        still = SceneConfig(
            style=style, seed=args.seed, n_frames=args.frames, speed_m_s=0.0, sway_deg=0.0, undulation_m=0.0
        )
        drive = replace(still, speed_m_s=args.speed)
        standing, driving = detect(config, still), detect(config, drive)
        shares = (
            mean_flicker(item.short_range for item in standing),
            mean_flicker(item.long_range for item in standing),
            *ground_flicker(driving, drive),
        )
        print(f"{style:12} " + " ".join(f"{100 * share:10.2f}" for share in shares))


def detect(config: Config, scene: SceneConfig) -> list[Masks]:
    """Return the masks of a sequence, found by one detector in the order of the frames."""
    detector, found = Detector(config), []
    for item in render_sequence(scene):
        detection = detector.detect_frame(item.frame)
        found.append(Masks(detection.short_range.mask, detection.long_range.mask, item.truth))
    return found


def ground_flicker(found: list[Masks], scene: SceneConfig) -> tuple[float, float]:
    """Return the mean share of the ground whose label changes, at short and at long range."""
    views = ground_to_image(scene)
    shares = []
    for (before, now), (view_before, view_now) in zip(pairwise(found), pairwise(views), strict=True):
        motion = view_now @ np.linalg.inv(view_before)
        is_ground = (moved(before.truth, motion) == 255) & (now.truth == 255)
        shares.append(
            [
                np.mean(moved(mask_before, motion)[is_ground] != mask_now[is_ground])
                for mask_before, mask_now in (
                    (before.short_range, now.short_range),
                    (before.long_range, now.long_range),
                )
            ]
        )
    short_range, long_range = np.mean(shares, axis=0)
    return float(short_range), float(long_range)


def ground_to_image(scene: SceneConfig) -> list[NDArray[np.float64]]:
    """Return, for each frame, the homography from points of the flat ground (x, y, 1) [m] to pixels (u, v, 1)."""
    world, camera = make_scene(scene), scene.camera
    calibration = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    homographies = []
    for index in range(scene.n_frames):
        view = camera_view(scene, world, index)
        axes = view.rotation.T
        homographies.append(calibration @ np.column_stack((axes[:, 0], axes[:, 1], -axes @ view.origin)))
    return homographies


def moved(mask: Mask, motion: NDArray[np.float64]) -> Mask:
    """Return a mask as it looks after the motion; 128 where it was not in sight."""
    height, width = mask.shape
    return cv2.warpPerspective(mask, motion, (width, height), flags=cv2.INTER_NEAREST, borderValue=128)


if __name__ == "__main__":
    main()
