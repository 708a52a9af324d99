"""Corners that the reference renders lie where a float64 projection puts them; Mitsuba's own do not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.reference.camera_sensor import sensor
from mirrorcam.render_scenes.reference.integrator import PathOptions, integrator
from mirrorcam.render_scenes.settings import RenderSettings
from tests.render_scenes.corners import TARGET, Crop, errors_by_mirror, photographed, tilted_board, windows

BIAS_PX = 0.002  # of the mean of all corners
LIMIT_PX = 0.005  # of the mean in a window, whose ten corners have noise of their own
CUT = 4  # squares along the side of a pixel: fine enough that the picture hides no detail from the blur


@pytest.fixture(scope="module")
def rig_from_board(distorted_layout: Layout) -> FloatArray:
    return tilted_board(distorted_layout)


@pytest.fixture(scope="module")
def crops(distorted_layout: Layout) -> list[Crop]:
    return windows(distorted_layout)


@pytest.fixture(scope="module")
def scene(distorted_layout: Layout, rig_from_board: FloatArray) -> BoardScene:
    scene = BoardScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, RenderSettings())
    scene.place_board(rig_from_board)
    return scene


def test_rendered_corners_agree_with_the_projection(
    scene: BoardScene, crops: list[Crop], distorted_layout: Layout, rig_from_board: FloatArray
) -> None:
    pictures = {
        i: photographed(scene.render(spp=24, seed=1, subpixels=CUT, crop=crop), CUT) for i, crop in enumerate(crops)
    }
    errors = errors_by_mirror(pictures, crops, distorted_layout, rig_from_board)
    for index, error in errors.items():
        assert len(error) >= 6, index
        assert np.linalg.norm(error.mean(axis=0)) <= LIMIT_PX, (index, error.mean(axis=0))
    together = np.concatenate(list(errors.values()))
    assert np.linalg.norm(together.mean(axis=0)) <= BIAS_PX
    assert np.sqrt(np.mean(together**2)) < LIMIT_PX


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
        pictures[index] = photographed(np.array(radiance)[..., 0], CUT)
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
    pictures = stock_pictures(scene, two, distorted_layout, integrator(PathOptions(mirrors_only=True)), 16)
    for index, error in errors_by_mirror(pictures, crops, distorted_layout, rig_from_board).items():
        assert np.linalg.norm(error.mean(axis=0)) <= LIMIT_PX, (index, error.mean(axis=0))
