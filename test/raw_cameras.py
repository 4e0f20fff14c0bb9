"""Raw cameras for tests: lenses of every model, and images of spots that are projected through them by OpenCV."""

import cv2
import numpy as np

from lrtrav_ros.rectification import Lens, raw_pair

WIDTH, HEIGHT = 320, 200
DISTORTIONS = {
    "none": ("", ()),
    "plumb_bob of 4": ("plumb_bob", (-0.28, 0.07, 0.002, -0.001)),
    "plumb_bob of 5": ("radial-tangential", (-0.3, 0.1, -0.001, 0.002, -0.015)),
    "rational_polynomial of 8": ("rational_polynomial", (0.4, -0.1, 0.001, -0.0005, 0.01, 0.75, 0.02, 0.01)),
    "rational_polynomial of 12": ("rational_polynomial", (-0.2, 0.05, 0, 0, 0, 0.02, 0, 0, 2e-3, 1e-3, -1e-3, 1e-3)),
    "rational_polynomial of 14": ("rational_polynomial", (-0.2, 0.05, 0, 0, 0, 0.02, 0, 0, 0, 0, 0, 0, 0.01, -0.02)),
    "equidistant": ("fisheye", (-0.02, -0.007, 0.002, -0.001)),
}
ROTATION = cv2.Rodrigues(np.array([0.02, -0.03, 0.04]))[0]
TRANSLATION_M = np.array([-0.25, 0.01, -0.005])


def lens(model="plumb_bob of 5", **fields):
    name, distortion = DISTORTIONS[model]
    values = {"fx": 190.0, "fy": 188.0, "cx": 163.0, "cy": 96.0, "distortion_model": name, "distortion": distortion}
    return Lens(**{"width": WIDTH, "height": HEIGHT, **values, **fields})


def pair(model="plumb_bob of 5"):
    """Return a pair whose right camera has other intrinsics, and is turned and shifted against the left one."""
    right = lens(model, fx=192.0, fy=191.0, cx=157.0, cy=101.0)
    return raw_pair(lens(model), right, rotation=ROTATION.reshape(-1).tolist(), translation_m=TRANSLATION_M.tolist())


def calibrations(raw):
    """Return the fields of the left and the right CameraInfo that calibrate a pair."""
    camera, size = raw.camera, {"width": raw.left.width, "height": raw.left.height}
    sides = ((raw.left, raw.left_rotation, 0.0), (raw.right, raw.right_rotation, -camera.fx * camera.baseline_m))
    return [
        {
            **size,
            "distortion_model": lens.distortion_model,
            "d": np.array(lens.distortion),
            "k": lens.matrix.reshape(-1),
            "r": np.array(turn),
            "p": np.array([camera.fx, 0, camera.cx, shift, 0, camera.fy, camera.cy, 0, 0, 0, 1, 0]),
        }
        for lens, turn, shift in sides
    ]


def project(lens, points):
    """Return where a lens shows points (N, 3) of its own optical frame, (N, 2) pixels."""
    points, zero = np.asarray(points, float).reshape(-1, 1, 3), np.zeros(3)
    compute = cv2.fisheye.projectPoints if lens.is_equidistant else cv2.projectPoints
    arguments = (lens.matrix, lens.coefficients)
    return compute(points, zero, zero, *arguments)[0].reshape(-1, 2)


def spots(pixels, shape=(HEIGHT, WIDTH)):
    """Return a grey image of bright spots."""
    v, u = np.mgrid[: shape[0], : shape[1]]
    image = np.zeros(shape)
    for x, y in pixels:
        image += 200 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / 8)
    return np.rint(image.clip(0, 255)).astype(np.uint8)


def texture(seed=0, channels=3):
    """Return a smooth random raw image without black."""
    noise = np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, channels), np.uint8)
    image = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 40, 255, cv2.NORM_MINMAX)
    return image.reshape(HEIGHT, WIDTH, channels) if channels > 1 else image.reshape(HEIGHT, WIDTH)
