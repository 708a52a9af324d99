"""Rendered corners lie where a float64 projection puts them, to a few thousandths of a pixel; Mitsuba's own do not.

The corner localiser knows nothing of the truth but where to start: it fits two curved edges, blurred, to the picture.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import erf

from optics.layout import Layout
from optics.targets import Checkerboard
from optics.values import FloatArray
from render_scenes.integrator import integrator
from render_scenes.scene import BoardScene
from render_scenes.sensor import sensor
from render_scenes.settings import RenderSettings
from render_scenes.truth import Oracle

LIMIT_PX = 0.005
BLUR_PX = 0.8
HALF_PX = 7  # of the localiser's window
CUT = 4  # squares along the side of a pixel: fine enough that the picture hides no detail from the blur
TARGET = Checkerboard(cols=20, rows=14, square_mm=12.0)
CROP = (180, 130)

Crop = tuple[int, int, int, int]


@pytest.fixture(scope="module")
def rig_from_board(distorted_layout: Layout) -> FloatArray:
    """A tilted and turned board whose squares span about 35 px."""
    pose = np.eye(4)
    pose[:3, :3] = distorted_layout.view_from_rig.T @ Rotation.from_euler("xyz", [12, -9, 7], degrees=True).as_matrix()
    middle = distorted_layout.view_from_rig.T @ np.array([3.0, -60.0, 400.0])
    pose[:3, 3] = middle - pose[:3, :3] @ np.array([*TARGET.size_mm, 0.0]) / 2.0
    return pose


@pytest.fixture(scope="module")
def crops(distorted_layout: Layout) -> list[Crop]:
    """A window in the middle of each sub-image."""
    middles = [distorted_layout.outline_px(index).mean(axis=0).astype(int) for index in range(9)]
    return [(int(x) - CROP[0] // 2, int(y) - CROP[1] // 2, *CROP) for x, y in middles]


@pytest.fixture(scope="module")
def scene(distorted_layout: Layout, rig_from_board: FloatArray) -> BoardScene:
    scene = BoardScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, RenderSettings())
    scene.place_board(rig_from_board)
    return scene


def photograph(radiance: NDArray[np.float32]) -> FloatArray:
    """The picture of a crop: blurred while still cut fine, then gathered into pixels."""
    blurred = cv2.GaussianBlur(radiance.astype(np.float64), (0, 0), BLUR_PX * CUT)
    return blurred.reshape(CROP[1], CUT, CROP[0], CUT).mean(axis=(1, 3))


def locate(picture: FloatArray, start: FloatArray, tangents: FloatArray, dark_first: bool) -> FloatArray:
    """Where two blurred edges cross, to a few ten-thousandths of a pixel.

    Fits point (2), directions (2), curvatures (2), mean, contrast and blur, from the directions of `tangents` (2, 2).
    """
    x0, y0 = np.round(start).astype(int)
    window = picture[y0 - HALF_PX : y0 + HALF_PX + 1, x0 - HALF_PX : x0 + HALF_PX + 1].ravel()
    y, x = np.mgrid[-HALF_PX : HALF_PX + 1, -HALF_PX : HALF_PX + 1].reshape(2, -1)

    def misfit(p: FloatArray) -> FloatArray:
        product = np.ones(len(window))
        for angle, curvature in ((p[2], p[4]), (p[3], p[5])):
            dx, dy = x - p[0], y - p[1]
            along, across = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
            product *= erf((across + curvature * along**2) / (np.sqrt(2.0) * p[8]))
        return p[6] + p[7] * product - window

    angles = np.arctan2(tangents[:, 1], tangents[:, 0])
    turn = np.sign(np.sin(angles[1] - angles[0]))  # the product is positive between the two directions, or beside
    contrast = np.ptp(window) / 2.0 * (turn if dark_first else -turn)
    guess = [*(start - [x0, y0]), *angles, 0.0, 0.0, window.min() + np.ptp(window) / 2.0, contrast, BLUR_PX]
    found = least_squares(misfit, guess, method="lm")
    assert np.sqrt(np.mean(found.fun**2)) < 0.02 * np.ptp(window)
    return np.array([found.x[0] + x0, found.x[1] + y0])


def errors_by_mirror(
    pictures: dict[int, FloatArray], crops: list[Crop], layout: Layout, rig_from_board: FloatArray
) -> dict[int, FloatArray]:
    """Located minus projected corners (n, 2) in each mirror's window, px."""
    oracle = Oracle(layout, TARGET)
    px, visible = oracle.by_mirrors(rig_from_board)
    steps = []
    for axis in (0, 1):
        moved = np.eye(4)
        moved[axis, 3] = 0.1
        steps.append(oracle.by_mirrors(rig_from_board @ moved)[0] - px)
    random = np.random.default_rng(0)
    errors = {}
    for index, picture in pictures.items():
        crop, found = crops[index], []
        for corner in np.flatnonzero(visible[index]):
            expected = px[index, corner] - crop[:2]
            if (expected < HALF_PX + 4).any() or (expected > np.array(CROP) - HALF_PX - 5).any():
                continue
            row, col = divmod(int(corner), TARGET.cols - 1)
            tangents = np.stack([step[index, corner] for step in steps])
            start = expected + random.normal(0.0, 0.2, 2)
            found.append(locate(picture, start, tangents, (row + col) % 2 == 0) - expected)
        errors[index] = np.array(found)
    return errors


def test_rendered_corners_agree_with_the_projection(
    scene: BoardScene, crops: list[Crop], distorted_layout: Layout, rig_from_board: FloatArray
) -> None:
    pictures = {i: photograph(scene.render(spp=16, seed=1, subpixels=CUT, crop=crop)) for i, crop in enumerate(crops)}
    errors = errors_by_mirror(pictures, crops, distorted_layout, rig_from_board)
    for index, error in errors.items():
        assert len(error) >= 6, index
        assert np.linalg.norm(error.mean(axis=0)) <= LIMIT_PX, (index, error.mean(axis=0))
    assert np.sqrt(np.mean(np.concatenate(list(errors.values())) ** 2)) < LIMIT_PX


def stock_pictures(
    scene: BoardScene, crops: dict[int, Crop], layout: Layout, chosen: Any, spp: int
) -> dict[int, FloatArray]:
    """Windows by Mitsuba's own loop, film and sampler, with any integrator, on a sensor cut as finely."""
    import mitsuba as mi

    camera = layout.camera
    focal, centre, lens = camera.intrinsics[:2] * CUT, (camera.intrinsics[2:4] + 0.5) * CUT - 0.5, camera.distortion
    fine = camera.replaced(width_px=camera.width_px * CUT, height_px=camera.height_px * CUT)
    fine = fine.with_intrinsics(np.concatenate([focal, centre, lens]))
    pictures = {}
    for index, crop in crops.items():
        x, y, width, height = (number * CUT for number in crop)
        eye = sensor(fine, crop=(x, y, width, height))
        radiance = mi.render(scene.scene, sensor=eye, integrator=chosen, spp=spp, seed=mi.UInt32(1))
        pictures[index] = photograph(np.array(radiance)[..., 0])
    return pictures


def test_the_stock_integrator_fails_this_test(
    scene: BoardScene, crops: list[Crop], distorted_layout: Layout, rig_from_board: FloatArray
) -> None:
    import mitsuba as mi

    pictures = stock_pictures(scene, dict(enumerate(crops)), distorted_layout, mi.load_dict({"type": "path"}), 4)
    errors = errors_by_mirror(pictures, crops, distorted_layout, rig_from_board)
    bias = np.array([np.linalg.norm(error.mean(axis=0)) for error in errors.values()])
    assert (bias > LIMIT_PX).all(), bias
    assert bias.max() > 3 * LIMIT_PX, bias


def test_the_stock_loop_is_innocent(
    scene: BoardScene, crops: list[Crop], distorted_layout: Layout, rig_from_board: FloatArray
) -> None:
    two = {index: crops[index] for index in (1, 3)}
    pictures = stock_pictures(scene, two, distorted_layout, integrator(mirrors_only=True), 16)
    for index, error in errors_by_mirror(pictures, crops, distorted_layout, rig_from_board).items():
        assert np.linalg.norm(error.mean(axis=0)) <= LIMIT_PX, (index, error.mean(axis=0))
