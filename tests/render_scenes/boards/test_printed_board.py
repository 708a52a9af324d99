"""Prints of boards: exact with few texels, and where they lie on the board."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.optics.geometry.targets import AprilGrid, Charuco, Checkerboard
from mirrorcam.optics.geometry.transforms import rigid, transform
from mirrorcam.render_scenes.boards.printed_board import (
    board_from_texels,
    print_on_paper,
    printed_radiance,
    rig_from_rectangle,
)
from mirrorcam.render_scenes.settings import RenderSettings


@pytest.mark.parametrize(
    ("target", "texels"),
    [
        (Checkerboard(cols=6, rows=5, square_mm=24.0), 1),
        (Charuco(cols=6, rows=5, square_mm=12.0, marker_mm=9.0), 8),
        (Charuco(cols=6, rows=5, square_mm=10.0, marker_mm=7.0, dictionary="DICT_5X5_100"), 20),
        (Charuco(cols=6, rows=5, square_mm=16.0, marker_mm=12.0, dictionary="DICT_4X4_50"), 8),
    ],
)
def test_the_print_is_exact_with_few_texels(target: Checkerboard | Charuco, texels: int) -> None:
    page = print_on_paper(target)
    assert page.shape == ((5 + 2) * texels, (6 + 2) * texels)
    printed = page[texels:-texels, texels:-texels]
    fine = target.image(8 * texels)
    np.testing.assert_array_equal(np.kron(printed, np.ones((8, 8), dtype=np.uint8)), fine)
    assert (np.delete(page, np.s_[texels:-texels], axis=0) == 255).all()


def test_markers_that_fit_no_texels_keep_their_squares() -> None:
    page = print_on_paper(Charuco(cols=6, rows=5, square_mm=12.0, marker_mm=8.7))
    texels = page.shape[0] // 7
    assert 8 < texels <= 64
    squares = page[texels:-texels, texels:-texels].reshape(5, texels, 6, texels)
    black = (np.add.outer(np.arange(5), np.arange(6)) % 2) == 0
    np.testing.assert_array_equal(squares.max(axis=(1, 3))[black], 0)
    np.testing.assert_array_equal(squares[:, 0, :, 0][~black], 255)  # the white rim around a marker


@pytest.mark.parametrize(
    "target", [Checkerboard(cols=6, rows=5, square_mm=24.0), Charuco(cols=6, rows=5, square_mm=12.0, marker_mm=9.0)]
)
def test_texels_and_mitsubas_rectangle_span_the_print_with_its_margin(target: Checkerboard | Charuco) -> None:
    rows, columns = print_on_paper(target).shape
    width, height = target.size_mm
    margin = target.square_mm
    corners = np.array([[0.0, 0.0, 1.0], [columns, rows, 1.0]]) @ board_from_texels(target).T
    np.testing.assert_allclose(corners[:, :2], [[-margin, -margin], [width + margin, height + margin]], atol=1e-9)
    # v is up, so that the rectangle's (-1, 1) is the top left corner; it emits along -z of the board.
    pose = rigid(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), [1.0, 2.0, 300.0])
    affine = rig_from_rectangle(target, pose)
    found = np.array([[-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]) @ affine[:3, :3].T + affine[:3, 3]
    on_board = np.column_stack([corners[:, :2], [0.0, 0.0]])
    np.testing.assert_allclose(found, transform(pose, on_board), atol=1e-9)
    np.testing.assert_allclose(affine[:3, :3] @ [0.0, 0.0, 1.0], -pose[:3, 2], atol=1e-12)


def test_radiance_is_that_of_paper_and_ink() -> None:
    radiance = printed_radiance(Checkerboard(cols=6, rows=5, square_mm=24.0), RenderSettings(paper=0.7, ink=0.1))
    assert set(np.unique(radiance.round(9))) == {0.1, 0.7}
    assert radiance[0, 0] == 0.7
    assert radiance[1, 1] == 0.1


@pytest.mark.parametrize(("spacing", "texels"), [(0.3, 10), (0.25, 20), (0.33, 100), (1 / 3, 30)])
def test_corners_of_an_aprilgrid_fall_on_texels(spacing: float, texels: int) -> None:
    target = AprilGrid(cols=3, rows=2, tag_mm=24.0, spacing=spacing)
    page = print_on_paper(target)
    board_from_page = board_from_texels(target)
    assert board_from_page[0, 0] == pytest.approx(24.0 / texels)
    at = np.linalg.solve(board_from_page, np.column_stack([target.corners_in_board_mm[:, :2], np.ones(24)]).T)[:2]
    np.testing.assert_allclose(at, at.round(), atol=1e-9)
    x, y = at.round().astype(int)
    # Black and white cross there.
    np.testing.assert_array_equal(page[y, x] == page[y - 1, x - 1], np.ones(24, dtype=bool))
    np.testing.assert_array_equal(page[y - 1, x] == page[y, x - 1], np.ones(24, dtype=bool))
    np.testing.assert_array_equal(page[y, x] == page[y - 1, x], np.zeros(24, dtype=bool))
