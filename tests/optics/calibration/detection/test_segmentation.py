"""Outlines found where the picture changes, against those of the mirrors that made it."""

from __future__ import annotations

import numpy as np

from mirrorcam.optics.calibration.detection.segmentation import Extremes
from tests.optics.calibration.detection.mirror_frames import (
    BUILT,
    MEANT,
    frames,
    outlined_in,
    seen_in,
    worst_px,
)


def test_mirrors_cut_and_glued_elsewhere_get_the_outlines_that_are_seen() -> None:
    found, notes = outlined_in(MEANT, seen_in(frames(12)))
    for index in range(3):
        assert worst_px(MEANT, index) > 8.0
        assert worst_px(found, index) < 1.0
        assert np.array_equal(
            found.mirrors[index].virtual_centre_in_rig_mm, MEANT.mirrors[index].virtual_centre_in_rig_mm
        )
    assert len(notes) == 3
    assert all(
        f"mirror {name}: " in note and "moved there" in note
        for name, note in zip(MEANT.mirror_names, notes, strict=False)
    )
    # As it was meant, and seen there: not moved by what a blurred edge leaves open.
    assert found.mirrors[3] == MEANT.mirrors[3]


def test_where_a_board_ends_the_mirror_does_not() -> None:
    frames_of_boards = frames(8, MEANT, inner=BUILT)
    assert outlined_in(MEANT, seen_in(frames_of_boards)) == (MEANT, ())
    assert outlined_in(MEANT, seen_in(frames_of_boards[1::2]))[1], "the boards' own ends would be believed"


def test_where_nothing_changes_nothing_is_moved() -> None:
    assert outlined_in(MEANT, Extremes()) == (MEANT, ())
    assert outlined_in(MEANT, seen_in([np.full((1080, 1920), 90, np.uint8)] * 5)) == (MEANT, ())
    assert outlined_in(MEANT, seen_in(frames(3))) == (MEANT, ())
