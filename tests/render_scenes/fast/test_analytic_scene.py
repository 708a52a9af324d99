"""The renderer by formula: against a float64 projection, against the reference, against rays through every pixel."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.targets import Charuco, Checkerboard
from mirrorcam.render_scenes.boards.printed_board import board_from_texels
from mirrorcam.render_scenes.fast.analytic_scene import FastScene, build_mipmap, map_to_print
from mirrorcam.render_scenes.fast.pixel_footprints import pixel_footprints, virtual_views
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.sets.poses import plan_frames
from mirrorcam.render_scenes.settings import RenderSettings
from mirrorcam.render_scenes.truth.pixel_maps import board_maps, pixel_rays
from mirrorcam.render_scenes.variant import SCALAR
from tests.render_scenes.corners import MARGIN_PX, TARGET, errors_by_mirror, photographed, tilted_board, windows

SETTINGS = RenderSettings(renderer="fast")
CUT = SETTINGS.subpixels


def seen(scene: FastScene, layout: Layout) -> dict[int, FloatArray]:
    """The window of each mirror."""
    radiance, pictures = scene.render(), {}
    for index, (x, y, width, height) in enumerate(windows(layout)):
        rows, columns = (
            slice(CUT * (at - MARGIN_PX), CUT * (at + length + MARGIN_PX)) for at, length in ((y, height), (x, width))
        )
        inner = slice(MARGIN_PX, -MARGIN_PX)
        pictures[index] = photographed(radiance[rows, columns], CUT)[inner, inner]
    return pictures


def test_corners_agree_with_the_projection(distorted_layout: Layout) -> None:
    pose = tilted_board(distorted_layout)
    scene = FastScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, SETTINGS)
    scene.place_board(pose)
    errors = errors_by_mirror(seen(scene, distorted_layout), windows(distorted_layout), distorted_layout, pose)
    for index, error in errors.items():
        assert len(error) >= 6, index
        assert np.linalg.norm(error.mean(axis=0)) <= 0.002, (index, error.mean(axis=0))
    assert np.sqrt(np.mean(np.concatenate(list(errors.values())) ** 2)) < 0.005


def test_it_agrees_with_the_reference(distorted_layout: Layout) -> None:
    """The same window of the same board by both: corners, and flat areas."""
    pose = tilted_board(distorted_layout)
    crops = {index: windows(distorted_layout)[index] for index in (0, 4, 7)}
    fast = FastScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, SETTINGS)
    fast.place_board(pose)
    reference = BoardScene(distorted_layout.camera, distorted_layout.mirrors, TARGET, SETTINGS)
    reference.place_board(pose)
    radiance = fast.render()
    pictures: dict[str, dict[int, FloatArray]] = {"fast": {}, "reference": {}}
    for index, (x, y, width, height) in crops.items():
        window = radiance[CUT * y : CUT * (y + height), CUT * x : CUT * (x + width)]
        traced = reference.render(spp=64, seed=1, subpixels=CUT, crop=(x, y, width, height))
        flat = (window == cv2.dilate(window, np.ones((3, 3)))) & (window == cv2.erode(window, np.ones((3, 3))))
        assert flat.mean() > 0.5
        np.testing.assert_allclose(traced[flat], window[flat], rtol=0.005)
        pictures["fast"][index], pictures["reference"][index] = photographed(window, CUT), photographed(traced, CUT)
    errors = [errors_by_mirror(found, windows(distorted_layout), distorted_layout, pose) for found in pictures.values()]
    for index in crops:
        assert np.abs(errors[0][index] - errors[1][index]).max() <= 0.02


def test_sheets_are_followed_like_rays_surface_by_surface(sheets: Layout, small_board: Charuco) -> None:
    """Where every pixel's light left the board, by formula and by `render_scenes.truth.maps`."""
    camera = sheets.camera.replaced(width_px=480, height_px=270).with_intrinsics(
        sheets.camera.intrinsics * [0.25, 0.25, 0.25, 0.25, 1, 1, 1, 1, 1]
    )
    small = sheets.replaced(camera=camera)
    pose = plan_frames(small, small_board, 1, np.random.default_rng(1)).poses[0]
    truth = board_maps(pixel_rays(small, mirrors=True), small_board, pose)
    views, board = virtual_views(small.mirrors), board_from_texels(small_board)
    ghost, picture, twice, thrice = pixel_footprints(camera, small.mirrors, 1, np.full(9, 0.92))
    for footprints in picture:
        to_print = map_to_print(views[footprints.view], pose, np.asarray(np.linalg.inv(board)))
        rays = np.column_stack([footprints.x, footprints.y, np.ones(len(footprints.x))]).astype(np.float64).T
        texels = (to_print.print @ rays - footprints.slide_mm * (to_print.slide @ rays)) / (to_print.depth @ rays)
        at = board[:2] @ np.vstack([texels, np.ones(texels.shape[1])])
        same = truth["mirror"].ravel()[footprints.square] == footprints.view
        same &= np.isfinite(truth["board.x"].ravel()[footprints.square])
        assert same.sum() > 0.5 * len(footprints.square)
        for name, found in zip(("board.x", "board.y"), at, strict=True):
            np.testing.assert_allclose(found[same], truth[name].ravel()[footprints.square][same], atol=2e-4)
    # About 5 % at the front; what is left of it goes on; as much of that again at the front from within.
    for layer, low, high in ((ghost, 0.03, 0.08), (picture, 0.75, 0.9), (twice, 0.02, 0.07), (thrice, 0.001, 0.005)):
        weights = np.concatenate([footprints.weight for footprints in layer])
        assert low < np.median(weights) < high


def test_no_square_of_a_layer_is_shown_twice(distorted_layout: Layout) -> None:
    """Also where one mirror hides a part of another: of a square, both together show no more than the whole."""
    first, *others = distorted_layout.mirrors
    nearer = first.moved(np.eye(3), 0.35 * first.virtual_centre_in_rig_mm * [-0.05, 0.0, 0.0])
    built = distorted_layout.replaced(mirrors=(nearer, *others), kind="as-built")
    layers = pixel_footprints(built.camera, built.mirrors, 1, np.ones(9))
    assert len(layers) > 1
    filled = np.zeros(built.camera.width_px * built.camera.height_px)
    for layer in layers:
        squares = np.concatenate([footprints.square for footprints in layer])
        assert len(np.unique(squares)) == len(squares)
        np.add.at(filled, squares, np.concatenate([footprints.weight for footprints in layer]))
    assert filled.max() <= 1.0 + 1e-6


def test_numpy_renders_the_same(small_layout: Layout, small_board: Charuco) -> None:
    pose = plan_frames(small_layout, small_board, 1, np.random.default_rng(1)).poses[0]
    pictures = []
    for variant in (None, SCALAR):
        scene = FastScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS, variant=variant)
        scene.place_board(pose)
        pictures.append(scene.render())
    np.testing.assert_allclose(pictures[0], pictures[1], atol=1e-4)
    assert np.ptp(pictures[0]) > 0.5


def test_a_moving_board_is_sheared_by_a_rolling_shutter(small_layout: Layout, small_board: Charuco) -> None:
    """Every row shows the board where it is when the row is read."""
    start = plan_frames(small_layout, small_board, 1, np.random.default_rng(1)).poses[0]
    poses = [start.copy() for _ in range(3)]
    for part, pose in enumerate(poses):
        pose[:3, 3] += 10.0 * part * small_layout.view_from_rig[0]
    scene = FastScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS)
    scene.place_board(*poses)
    rolling = scene.render()
    rows = len(rolling)
    for row in (0, rows // 3, rows - 1):
        now = start.copy()
        now[:3, 3] += 20.0 * row / (rows - 1) * small_layout.view_from_rig[0]
        scene.place_board(now)
        np.testing.assert_allclose(rolling[row], scene.render()[row], atol=2e-3)


def test_no_frame_compiles_anything_but_the_first(small_layout: Layout, small_board: Charuco) -> None:
    import drjit as dr

    scene = FastScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS)
    poses = plan_frames(small_layout, small_board, 3, np.random.default_rng(1)).poses
    scene.place_board(poses[0])
    scene.render()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for pose in poses[1:]:
            scene.place_board(pose)
            scene.render()
        kernels = [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]
    assert kernels
    assert all(entry["cache_hit"] for entry in kernels)


def test_every_scale_of_a_print_is_as_bright_as_the_print() -> None:
    radiance = np.random.default_rng(0).random((37, 50))
    pyramid = build_mipmap(radiance)
    assert len(pyramid.levels) > 3
    for index, level in enumerate(pyramid.levels):
        texels = pyramid.texels[level.begin : level.begin + level.columns * level.rows].reshape(level.rows, -1)
        assert texels.sum() * 4.0**index == pytest.approx(radiance.sum(), rel=1e-5)
        assert not texels[[0, -1]].any()
        assert not texels[:, [0, -1]].any()


def test_a_board_that_shows_its_back_is_black(small_layout: Layout) -> None:
    board = Checkerboard(cols=10, rows=7, square_mm=24.0)
    pose = plan_frames(small_layout, board, 1, np.random.default_rng(1)).poses[0]
    scene = FastScene(small_layout.camera, small_layout.mirrors, board, SETTINGS)
    scene.place_board(pose)
    assert scene.render().max() > 0.5
    scene.place_board(pose @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    assert not scene.render().any()
