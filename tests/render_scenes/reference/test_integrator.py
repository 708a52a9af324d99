"""Steps of additive recurrences: the known constants, and points that are spread evenly.

Weights of sampling strategies, and masks of scalar variants.

Corners that the reference renders lie where a float64 projection puts them; Mitsuba's own do not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.reference.camera_sensor import sensor
from mirrorcam.render_scenes.reference.integrator import (
    PathOptions,
    additive_steps,
    has_flag,
    integrator,
    logical_not,
    power_heuristic,
)
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.variant import SCALAR, use_variant
from tests.render_scenes.corners import TARGET, Crop, errors_by_mirror, photographed, tilted_board, windows


def test_the_golden_ratio_and_the_plastic_number_are_known() -> None:
    assert additive_steps(1)[0] == pytest.approx(2.0 / (1.0 + 5.0**0.5), rel=1e-11)
    assert additive_steps(2) == pytest.approx((0.7548776662466927, 0.5698402909959032), rel=1e-11)


@pytest.mark.parametrize("dimensions", [4, 9])
def test_means_are_closer_than_those_of_random_points(dimensions: int) -> None:
    count = 4096
    points = np.arange(count)[:, None] * np.array(additive_steps(dimensions)) % 1.0
    error = np.abs(np.cos(2.0 * np.pi * points).mean(axis=0))
    assert error.max() < 0.1 / count**0.5


@pytest.mark.parametrize("variant", [None, SCALAR])
def test_the_weights_of_two_strategies_add_up_to_one(variant: str | None) -> None:
    use_variant(variant)
    import mitsuba as mi

    for own, other in ((1.0, 3.0), (0.2, 0.0), (5.0, 5.0)):
        weights = [power_heuristic(mi.Float(a), mi.Float(b)) for a, b in ((own, other), (other, own))]
        assert float(np.sum([np.array(weight) for weight in weights])) == pytest.approx(1.0)
    assert float(np.sum(np.array(power_heuristic(mi.Float(1.0), mi.Float(3.0))))) == pytest.approx(0.1)
    assert float(np.sum(np.array(power_heuristic(mi.Float(0.0), mi.Float(0.0))))) == 0.0


@pytest.mark.parametrize("variant", [None, SCALAR])
def test_masks_are_inverted_as_masks(variant: str | None) -> None:
    use_variant(variant)
    import mitsuba as mi

    assert not np.array(logical_not(mi.Bool(True))).any()
    assert np.array(logical_not(mi.Bool(False))).all()


def test_a_ray_that_meets_nothing_has_no_flag() -> None:
    use_variant(SCALAR)
    import mitsuba as mi

    assert not has_flag(None, mi.BSDFFlags.Smooth, mi.Bool(True))


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


@pytest.mark.slow
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
