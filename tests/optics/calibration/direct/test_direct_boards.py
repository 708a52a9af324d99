"""Boards seen directly and in mirrors: their colours, their markers, and the confirmation of their corners."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.core.progress import no_progress
from mirrorcam.optics.calibration.detection.checkerboard import Grey
from mirrorcam.optics.calibration.direct.direct_boards import (
    boards_in,
    confirmed_corners,
    distance_note,
    first_estimate_of,
    fits_flipped,
    more_mirrors,
    negative,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.boards import Charuco, Checkerboard
from tests.optics.calibration.direct.two_mirrors import CAMERA, POSES, corner_of_two_mirrors, lying, picture_of

EVEN = Checkerboard(cols=8, rows=6, square_mm=20.0)
SIZE = {"width_px": CAMERA.width_px, "height_px": CAMERA.height_px}


@pytest.fixture(scope="module")
def pictures() -> list[Grey]:
    layout = corner_of_two_mirrors(90.0)
    return [picture_of(layout, lying(*pose), seed, EVEN) for seed, pose in enumerate(POSES[:4])]


def test_exchanged_colours_are_recognised_by_the_mirrors(pictures: list[Grey]) -> None:
    """A board of even columns and rows with black for white looks like its mirror image, at another pose."""
    centres = []
    for shown, exchanged in ((pictures, False), ([negative(picture) for picture in pictures], True)):
        boards = boards_in(shown, EVEN, max_boards=3, progress=no_progress)
        start, inverted = first_estimate_of(boards, EVEN, mirrors=2, **SIZE)
        assert inverted == exchanged
        centres.append(start.estimate.virtual_centres_in_rig_mm)
        seen, _ = confirmed_corners([negative(p) if inverted else p for p in shown], start, EVEN)
        assert set(seen.view.tolist()) == {DIRECT, 0, 1}
    np.testing.assert_allclose(centres[0], centres[1], atol=10.0)
    truth = np.array([mirror.virtual_centre_in_rig_mm for mirror in corner_of_two_mirrors(90.0).mirrors])
    np.testing.assert_allclose(centres[0], truth, atol=27.0)


def test_more_boards_than_the_stated_mirrors_show_are_reported(pictures: list[Grey]) -> None:
    boards = boards_in(pictures[:2], EVEN, max_boards=2, progress=no_progress)
    first = [len(some) for some in boards].index(max(len(some) for some in boards))
    said = f"; {'ab'[first]} shows {len(boards[first])} boards, expected more than --direct-view 1"
    assert more_mirrors(boards, ["a", "b"], 1) == said
    assert more_mirrors(boards, ["a", "b"], 2) == ""


def test_markers_distinguish_images_from_the_board_itself() -> None:
    board = Charuco(cols=5, rows=4, square_mm=34.0, marker_mm=27.0)
    layout = corner_of_two_mirrors(90.0)
    shown = [picture_of(layout, lying(*pose), seed, board) for seed, pose in enumerate(POSES[:2])]
    for in_picture in boards_in(shown, board, max_boards=3, progress=no_progress):
        assert [len(seen.stated.direct) for seen in in_picture] == [1, *[0] * (len(in_picture) - 1)]
        assert [len(seen.stated.image) for seen in in_picture] == [0, *[1] * (len(in_picture) - 1)]
        assert not any(seen.inverted.direct or seen.inverted.image for seen in in_picture)


@pytest.mark.slow
def test_flipped_pictures_of_markers_are_recognised() -> None:
    board = Charuco(cols=5, rows=4, square_mm=34.0, marker_mm=27.0)
    layout = corner_of_two_mirrors(90.0)
    shown = [picture_of(layout, lying(*pose), seed, board) for seed, pose in enumerate(POSES[:4])]
    turned = [np.ascontiguousarray(picture[:, ::-1]) for picture in shown]
    flipped = boards_in(turned, board, max_boards=3, progress=no_progress)
    with pytest.raises(InputError, match="show 0 mirrors"):
        first_estimate_of(flipped, board, mirrors=2, **SIZE)
    assert fits_flipped(flipped, board, mirrors=2, **SIZE)
    assert not fits_flipped(boards_in(shown, board, max_boards=3, progress=no_progress), board, mirrors=2, **SIZE)


@pytest.mark.slow
def test_a_board_whose_size_seems_to_be_in_another_unit_is_noted(pictures: list[Grey]) -> None:
    for side_mm, noted in ((20.0, False), (2.0, True), (2000.0, True)):
        board = EVEN.replaced(square_mm=side_mm)
        start, _ = first_estimate_of(
            boards_in(pictures, board, max_boards=3, progress=no_progress), board, mirrors=2, **SIZE
        )
        note = distance_note(start.estimate, board)
        assert any("is its size in mm?" in each for each in note) == noted
        assert bool(note) == noted


def test_pictures_without_a_board_are_refused() -> None:
    blank = np.full((300, 400), 90, dtype=np.uint8)
    with pytest.raises(InputError, match="no 8 x 6 checkerboard found in any of 1 pictures"):
        boards_in([blank], EVEN, max_boards=3, progress=no_progress)
    with pytest.raises(InputError, match="cannot be numbered"):
        first_estimate_of([[]], EVEN, mirrors=2, **SIZE)
