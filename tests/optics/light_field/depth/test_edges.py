"""Depth edges that follow the picture."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from mirrorcam.optics.light_field.depth.edges import follow_edges


def card() -> tuple[np.ndarray, np.ndarray]:
    """A near card that is a pixel too wide, and the picture, whose edge is where the card's is."""
    picture = np.full((40, 60, 3), 60.0, np.float32)
    picture[:, 30:] = 180.0
    planes = np.full((40, 60), 2.0, np.float32)
    planes[:, 29:] = 12.0
    return planes, picture


def test_an_edge_moves_to_that_of_the_picture() -> None:
    planes, picture = card()
    found = follow_edges(planes, picture, 1.2)
    assert (found[:, :30] == 2.0).all()
    assert (found[:, 30:] == 12.0).all()
    assert np.array_equal(found, follow_edges(planes, picture, 1.2, ThreadPoolExecutor(2).map))


def test_away_from_jumps_nothing_changes_and_without_a_picture_nothing_moves() -> None:
    planes, picture = card()
    slanted = (np.arange(60, dtype=np.float32) * 0.2)[None].repeat(40, axis=0)
    assert np.array_equal(follow_edges(slanted, picture, 1.2), slanted)
    assert np.array_equal(follow_edges(planes, np.full_like(picture, 90.0), 1.2)[:, [20, 40]], planes[:, [20, 40]])


def test_a_single_wrong_pixel_is_outvoted() -> None:
    planes = np.full((20, 20), 5.0, np.float32)
    planes[10, 10] = 15.0
    assert (follow_edges(planes, np.full((20, 20, 3), 90.0, np.float32), 1.2) == 5.0).all()
