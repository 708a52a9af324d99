"""Rendered boards, mirrors and the black between them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.boards import CalibrationBoard, Charuco, Checkerboard
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings

SETTINGS = RenderSettings(sensor=SENSORS["ideal"])


def facing(layout: Layout, board: CalibrationBoard, depth_mm: float = 350.0) -> FloatArray:
    """rig_from_board of a board square to the view axis, its middle in front of the central mirror."""
    turn = layout.view_from_rig.T
    middle = turn @ np.array([0.0, -70.0, depth_mm])
    return rigid(turn, middle - turn @ np.array([*board.size_mm, 0.0]) / 2.0)


def before_camera(board: CalibrationBoard, distance_mm: float = 400.0) -> FloatArray:
    return rigid(np.eye(3), [-board.size_mm[0] / 2, -board.size_mm[1] / 2, distance_mm])


def grey(radiance: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.clip(radiance * 255.0, 0, 255).astype(np.uint8)


def ids_of(picture: NDArray[np.uint8], board: Charuco) -> set[int]:
    detector = cv2.aruco.CharucoDetector(board.opencv_board)
    _, ids, _, _ = detector.detectBoard(picture)
    return set() if ids is None else {int(number) for number in ids.ravel()}


@pytest.fixture(scope="module")
def via_mirrors(default_layout: Layout) -> NDArray[np.float32]:
    """A board of 24 mm squares via the nine mirrors, radiance (1080, 1920)."""
    board = Charuco(cols=10, rows=7, square_mm=24.0, marker_mm=18.0)
    scene = BoardScene(default_layout.camera, default_layout.mirrors, board, SETTINGS)
    scene.place_board(facing(default_layout, board))
    return scene.render(spp=4, seed=0)


def test_markers_decode_by_way_of_a_mirror_only_when_flipped(
    default_layout: Layout, via_mirrors: NDArray[np.float32], small_board: Charuco
) -> None:
    for index in range(9):
        only = np.zeros(via_mirrors.shape, dtype=np.uint8)
        cv2.fillPoly(only, [default_layout.outline_px(index).round().astype(np.int32)], 1)
        sub_image = grey(via_mirrors) * only
        assert len(ids_of(sub_image, small_board)) == 0, index
        assert len(ids_of(np.ascontiguousarray(sub_image[:, ::-1]), small_board)) >= 4, index


def test_markers_decode_as_they_are_before_the_bare_camera(default_layout: Layout, small_board: Charuco) -> None:
    scene = BoardScene(default_layout.camera, (), small_board, SETTINGS)
    scene.place_board(before_camera(small_board))
    picture = grey(scene.render(spp=4, seed=0))
    assert ids_of(picture, small_board) == set(range(9 * 6))
    assert ids_of(np.ascontiguousarray(picture[:, ::-1]), small_board) == set()


def test_all_between_the_mirrors_is_black_and_nothing_is_clipped(
    default_layout: Layout, via_mirrors: NDArray[np.float32]
) -> None:
    y, x = np.mgrid[:1080, :1920]
    near = np.zeros(via_mirrors.shape, dtype=np.bool_)
    for index in range(9):
        outline = shapely.Polygon(default_layout.outline_px(index))
        near |= shapely.contains_xy(outline.buffer(1.5), x, y)
        middle = via_mirrors[shapely.contains_xy(outline.buffer(-3.0), x, y)]
        assert middle.min() >= SETTINGS.ink * SETTINGS.mirror_reflectance - 1e-6, index
    assert via_mirrors[~near].size > 70_000
    assert via_mirrors[~near].max() == 0.0
    assert via_mirrors.max() == pytest.approx(SETTINGS.paper * SETTINGS.mirror_reflectance, abs=1e-5)
    assert via_mirrors.max() < 1.0


def test_the_camera_sees_no_board_past_the_mirrors(default_layout: Layout, small_board: Charuco) -> None:
    scene = BoardScene(default_layout.camera, default_layout.mirrors, small_board, SETTINGS)
    scene.place_board(before_camera(small_board, 1000.0))
    assert scene.render(spp=1, seed=0).max() == 0.0


def test_the_back_of_a_board_is_dark(default_layout: Layout, small_board: Charuco) -> None:
    turned = before_camera(small_board) @ np.diag([-1.0, 1.0, -1.0, 1.0])
    turned[:3, 3] += [small_board.size_mm[0], 0.0, 0.0]
    scene = BoardScene(default_layout.camera, (), small_board, SETTINGS)
    scene.place_board(turned)
    assert scene.render(spp=1, seed=0).max() == 0.0


def test_the_sheet_has_one_square_of_paper_around_the_print(default_layout: Layout) -> None:
    board = Checkerboard(cols=6, rows=5, square_mm=24.0)
    scene = BoardScene(default_layout.camera, (), board, SETTINGS)
    scene.place_board(before_camera(board))
    radiance = scene.render(spp=1, seed=0)
    left, top = default_layout.camera.project(np.array([[-72.0 - 12.0, -60.0 - 12.0, 400.0]]))[0].round().astype(int)
    assert radiance[top, left] == pytest.approx(SETTINGS.paper)  # half a square outside the print
    left, top = default_layout.camera.project(np.array([[-72.0 + 12.0, -60.0 + 12.0, 400.0]]))[0].round().astype(int)
    assert radiance[top, left] == pytest.approx(SETTINGS.ink)  # the top left square is black
    left, top = default_layout.camera.project(np.array([[-72.0 - 26.0, -60.0 - 26.0, 400.0]]))[0].round().astype(int)
    assert radiance[top, left] == 0.0


def test_a_moved_board_compiles_nothing(small_layout: Layout, small_board: Charuco) -> None:
    import drjit as dr

    scene = BoardScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS)
    scene.place_board(facing(small_layout, small_board))
    first = scene.render(spp=4, seed=0, subpixels=2)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        scene.place_board(facing(small_layout, small_board, 420.0))
        second = scene.render(spp=9, seed=7)
        kernels = [entry for entry in dr.kernel_history() if "cache_hit" in entry]
    assert first.shape == (540, 960)
    assert second.shape == (270, 480)
    assert kernels
    assert all(entry["cache_hit"] for entry in kernels)


def test_the_same_seed_gives_the_same_bits_at_any_sample_count(small_layout: Layout, small_board: Charuco) -> None:
    scene = BoardScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS)
    scene.place_board(facing(small_layout, small_board))
    for spp in (1, 5, 16):
        np.testing.assert_array_equal(scene.render(spp=spp, seed=3), scene.render(spp=spp, seed=3))
    assert (scene.render(spp=5, seed=3) != scene.render(spp=5, seed=4)).any()
    # The value of a pixel does not depend on the rendered window.
    np.testing.assert_array_equal(
        scene.render(spp=5, seed=3, crop=(200, 90, 40, 30)), scene.render(spp=5, seed=3)[90:120, 200:240]
    )


def test_the_scalar_variant_renders_the_same_picture(small_layout: Layout, small_board: Charuco) -> None:
    crop = (210, 100, 24, 16)
    pictures = []
    for variant in (None, "scalar_rgb"):
        scene = BoardScene(small_layout.camera, small_layout.mirrors, small_board, SETTINGS, variant=variant)
        scene.place_board(facing(small_layout, small_board))
        pictures.append(scene.render(spp=4, seed=1, crop=crop))
    assert np.ptp(pictures[0]) > 0.5
    np.testing.assert_allclose(pictures[1], pictures[0], atol=1e-5)
