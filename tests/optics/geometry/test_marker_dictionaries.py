"""The marker dictionaries are OpenCV's, and smaller ones are the start of larger ones in a family."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mirrorcam.optics.geometry.marker_dictionaries import (
    FAMILIES,
    NAMES,
    canonical_name,
    count,
    dictionary,
    family,
    modules,
    smallest,
    white_modules,
)


def test_every_predefined_dictionary_of_opencv_is_known() -> None:
    numbers = {getattr(cv2.aruco, name) for name in dir(cv2.aruco) if name.startswith("DICT_")}
    assert {getattr(cv2.aruco, name) for name in NAMES} == numbers
    for name in (name for name in dir(cv2.aruco) if name.startswith("DICT_")):
        known = canonical_name(name)
        assert known is not None
        assert getattr(cv2.aruco, known) == getattr(cv2.aruco, name)
    assert canonical_name("DICT_9X9_50") is None


@pytest.mark.parametrize("name", NAMES)
def test_markers_are_as_opencv_draws_them(name: str) -> None:
    side = modules(name)
    drawn = white_modules(name)
    assert drawn.shape == (count(name), side, side)
    last = count(name) - 1
    np.testing.assert_array_equal(drawn[last], dictionary(name).generateImageMarker(last, side, borderBits=1) > 0)
    np.testing.assert_array_equal(dictionary(name, 5).bytesList, dictionary(name).bytesList[:5])
    assert not drawn[:, [0, -1]].any(), "the border is black"
    np.testing.assert_array_equal(white_modules(family(name))[: count(name)], drawn)


def test_the_smallest_of_a_family_that_has_so_many_markers() -> None:
    assert {family(name) for name in NAMES} == set(FAMILIES)
    assert smallest("DICT_5X5_1000", 35) == "DICT_5X5_50"
    assert smallest("DICT_5X5_1000", 51) == "DICT_5X5_100"
    assert smallest("DICT_APRILTAG_36h11", 35) == "DICT_APRILTAG_36h11"
