"""Maps, registered depth and rectified images, of whatever they may be given."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from strategies import SHAPES, cameras, configs, disparities, ground_lines, has_frame, images, occupancies, of_shapes

from lrtrav_ros.camera import StereoCamera
from lrtrav_ros.config import Config
from lrtrav_ros.mapping import grid, ground_disparity, points, segmentation, slopes
from lrtrav_ros.mapping.ground_frame import GroundFrame
from lrtrav_ros.mapping.pose_smoothing import PoseSmoother
from lrtrav_ros.method.ground import GROUND, GroundLine
from lrtrav_ros.pose import Pose
from lrtrav_ros.rectification import Lens, Rectification, raw_pair
from lrtrav_ros.registration import DepthRegistration

Array = NDArray[Any]
SCENES = of_shapes(
    occupancies, occupancies, disparities, cameras, lambda shape: ground_lines(shape), lambda shape: st.booleans()
)


class Near(NamedTuple):
    """What the grid takes of the short range."""

    occupancy: Array
    disparity: Array
    line: GroundLine | None


@given(scene=SCENES, config=configs("maps"), moved=st.tuples(*3 * (st.floats(-1e4, 1e4),)))
def test_grid(scene: tuple[Any, ...], config: Config, moved: tuple[float, float, float]) -> None:
    occupancy, near, disparity, camera, line, has_line = scene
    assume(has_frame(line, camera))
    found = grid.ground_grid(occupancy, Near(near, disparity, line if has_line else None), camera, config.maps)
    assert found.cells.dtype == np.int8
    assert set(np.unique(found.cells)) <= {grid.FREE, grid.OCCUPIED, grid.UNKNOWN}
    assert has_line or (found.cells == grid.UNKNOWN).all()
    assert (occupancy == GROUND).any() or not (found.cells == grid.FREE).any()
    turned = found.in_frame(*moved)
    assert set(np.unique(turned.cells)) <= set(np.unique(found.cells)) | {grid.UNKNOWN}
    assert (turned.cells == grid.OCCUPIED).sum() >= (found.cells == grid.OCCUPIED).any()
    assert found.image.shape == found.cells.shape[::-1]


@given(scene=SCENES, config=configs("maps"))
def test_points(scene: tuple[Any, ...], config: Config) -> None:
    _, occupancy, disparity, camera, line, has_line = scene
    assume(has_frame(line, camera))
    line = line if has_line else None
    obstacles = points.obstacle_points(disparity, occupancy, line, camera, config.maps)
    free = points.free_points(occupancy, line, camera, config.maps)
    for cloud in (obstacles, free):
        assert cloud.dtype == np.float32
        assert cloud.shape == (len(cloud), 3)
        assert np.isfinite(cloud).all()
        assert len(cloud) <= occupancy.size
        assert has_line or not len(cloud)
    assert (free[:, 2] > 0).all()


@given(scene=SCENES, config=configs("maps"))
def test_slopes(scene: tuple[Any, ...], config: Config) -> None:
    _, occupancy, disparity, camera, line, has_line = scene
    assume(has_frame(line, camera))
    rising = slopes.with_slopes(occupancy, disparity, line if has_line else None, camera, config.maps)
    assert (rising.dtype, rising.shape) == (np.uint8, occupancy.shape)
    assert ((rising == occupancy) | (rising == GROUND)).all()
    assert has_line or (rising == occupancy).all()


@given(scene=SCENES, config=configs("maps"))
def test_segmentation(scene: tuple[Any, ...], config: Config) -> None:
    occupancy, _, disparity, camera, line, has_line = scene
    found = segmentation.segmentation_points(occupancy, disparity, line if has_line else None, camera, config.maps)
    assert (found.dtype, found.shape) == (np.float32, (*occupancy.shape, 3))
    assert (np.isnan(found).all(axis=2) | np.isfinite(found).all(axis=2)).all()
    mask, confidence = segmentation.segmentation_mask(occupancy), segmentation.segmentation_confidence(occupancy)
    np.testing.assert_array_equal(mask == segmentation.CLASSES["free"], occupancy == GROUND)
    np.testing.assert_array_equal(mask > 0, confidence == 255)


@given(scene=SHAPES.flatmap(lambda shape: st.tuples(st.just(shape), ground_lines(shape))))
def test_ground_disparity(scene: tuple[tuple[int, int], GroundLine]) -> None:
    shape, line = scene
    image = line.disparity(*shape)
    assert (image.dtype, image.shape) == (np.float32, shape)
    assert np.isfinite(image).all()
    assert (image >= 0).all()
    found = ground_disparity.ground_line_of(image)
    assert found is None or found.slope > 0


@given(disparity=SHAPES.flatmap(lambda shape: disparities(shape, wild=False)))
def test_ground_line_of_any_disparity(disparity: Array) -> None:
    found = ground_disparity.ground_line_of(disparity)
    assert found is None or found.slope > 0


@given(
    frames=st.lists(
        st.tuples(
            st.tuples(st.floats(-1, 1), st.floats(-1, -0.01), st.floats(-2, 2)),
            st.floats(1e-3, 1e3),
            st.none() | st.integers(-(2**62), 2**62) | st.integers(0, 10**10),
        ),
        min_size=1,
        max_size=5,
    )
)
def test_pose_smoothing(frames: list[tuple[tuple[float, ...], float, int | None]]) -> None:
    smoother, heights = PoseSmoother(), []
    for up, height_m, stamp_ns in frames:
        heights.append(height_m)
        found = smoother.add(GroundFrame.from_up(np.array(up), height_m), stamp_ns)
        assert min(heights) * (1 - 1e-9) <= found.height_m <= max(heights) * (1 + 1e-9)
        np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-9)


@given(scene=of_shapes(cameras, ground_lines))
def test_ground_frame(scene: tuple[StereoCamera, GroundLine]) -> None:
    camera, line = scene
    try:
        frame = GroundFrame.of(line, camera)
    except ValueError:
        return
    assert math.isclose(frame.height_m, line.camera_height_m(camera))
    assert math.isclose(math.hypot(*frame.quaternion), 1)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    """Return a pose, of another camera in most cases."""
    angles = draw(st.tuples(*3 * (st.floats(-0.2, 0.2) | st.floats(-math.pi, math.pi),)))
    shift = draw(st.tuples(*3 * (st.floats(-0.5, 0.5) | st.floats(-1e6, 1e6),)))
    return Pose.parsed(" ".join(map(repr, (*shift, *angles))))


@given(
    scene=of_shapes(disparities, cameras),
    left=SHAPES.flatmap(lambda shape: cameras(shape, has_size=True)),
    pose=poses(),
)
def test_registration(scene: tuple[Array, StereoCamera], left: StereoCamera, pose: Pose) -> None:
    depth_m, camera = scene
    try:
        registration = DepthRegistration(camera, left, pose)
    except ValueError:
        return
    found = registration.registered(depth_m)
    assert (found.dtype, found.shape) == (np.float32, (left.height, left.width))
    assert np.isfinite(found).all()
    assert (found >= 0).all()


@st.composite
def lenses(draw: st.DrawFn, shape: tuple[int, int]) -> Lens:
    """Return a lens for raw images of a shape."""
    camera = draw(cameras(shape, has_size=True))
    model = draw(st.sampled_from(("plumb_bob", "rational_polynomial", "equidistant", "fisheye")))
    n = {"plumb_bob": 5, "rational_polynomial": 8}.get(model, 4)
    scale = draw(st.sampled_from([0.0, 1e-2, 1.0, 1e6]))
    distortion = tuple(scale * draw(st.floats(-1, 1)) for _ in range(n))
    return Lens(
        **{name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")},
        distortion_model=model,
        distortion=distortion,
    )


@given(
    scene=SHAPES.flatmap(lambda shape: st.tuples(lenses(shape), lenses(shape), images(shape))),
    pose=poses(),
    shift_m=st.none() | st.floats(1e-3, 1e3) | st.floats(0, 1e300),
)
def test_rectification(scene: tuple[Lens, Lens, Array], pose: Pose, shift_m: float | None) -> None:
    left, right, image = scene
    shift = pose.translation_m if shift_m is None else (-shift_m, 0.0, 0.0)
    try:
        pair = raw_pair(left, right, rotation=pose.rotation.ravel().tolist(), translation_m=shift)
        rectification = Rectification(pair)
    except ValueError:
        return
    for rectified in rectification.rectify(image, image):
        assert (rectified.dtype, rectified.shape) == (image.dtype, image.shape)
    unseen = rectification.unseen
    assert unseen is None or (unseen.any() and not unseen.all())
