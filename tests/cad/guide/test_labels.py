"""Labels of pictures: leaders that do not cross, anchors in the visible area, no labels of hidden bodies."""

from __future__ import annotations

from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from shapely import LineString

from mirrorcam.cad.guide.labels import Label, annotate, innermost_body_pixel, uncrossed_order
from mirrorcam.cad.guide.shading import Rendering, Screen


def rendering_of(bodies: NDArray[np.int32]) -> Rendering:
    height, width = bodies.shape
    screen = Screen(np.eye(3), np.zeros(2), 1.0, (width, height))
    white = np.full((height, width, 3), 255, dtype=np.uint8)
    return Rendering(white, bodies, np.zeros((height, width), dtype=np.float32), screen)


def test_leaders_of_random_places_never_cross() -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        starts = [np.array([0.0, float(y)]) for y in range(12)]
        ends = list(random.uniform((1.0, 0.0), (10.0, 12.0), (12, 2)))
        order = uncrossed_order(starts, ends)
        assert sorted(order) == list(range(12))
        lines = [LineString([start, ends[index]]) for start, index in zip(starts, order, strict=True)]
        assert not any(first.crosses(second) for first, second in combinations(lines, 2))


def test_an_anchor_is_the_innermost_visible_pixel_of_a_body() -> None:
    bodies = np.full((40, 60), -1, dtype=np.int32)
    bodies[10:31, 20:41] = 3
    bodies[0:2, 0:2] = 5
    point = innermost_body_pixel(rendering_of(bodies), 3)
    assert point is not None
    np.testing.assert_allclose(point, [30.0, 20.0], atol=1.0)
    assert innermost_body_pixel(rendering_of(bodies), 4) is None


def test_only_visible_bodies_have_labels() -> None:
    bodies = np.full((300, 400), -1, dtype=np.int32)
    bodies[120:180, 170:230] = 0
    rendering = rendering_of(bodies)
    assert (annotate(rendering, [Label(1, "hidden")]) == rendering.image).all()
    assert (annotate(rendering, [Label(0, "seen")]) != rendering.image).any()


def test_text_is_as_heavy_whatever_was_drawn_before() -> None:
    """OpenCV's font keeps the weight of the last text, also if an older function drew it."""
    bodies = np.zeros((120, 400), dtype=np.int32)
    before = annotate(rendering_of(bodies), [Label(0, "MC-01 Mirror holder")])
    cv2.putText(np.zeros((90, 90), dtype=np.uint8), "x", (9, 60), cv2.FONT_HERSHEY_SIMPLEX, 2.0, 255, 6, cv2.LINE_AA)
    cv2.putText(np.zeros((90, 90), dtype=np.uint8), "x", (9, 60), 255, cv2.FontFace("sans"), 30, 900)
    np.testing.assert_array_equal(annotate(rendering_of(bodies), [Label(0, "MC-01 Mirror holder")]), before)


def test_a_name_over_a_dark_body_is_as_on_white() -> None:
    bodies = np.full((120, 500), -1, dtype=np.int32)
    bodies[50:70, 20:40] = 0
    white = rendering_of(bodies)
    dark = Rendering(np.full_like(white.image, 20), bodies, white.z_mm, white.screen)
    labels = [Label(0, "Raspberry Pi Camera Module 2")]
    on_white, on_dark = annotate(white, labels), annotate(dark, labels)
    # The leader runs from the name to the dot in the middle of the body.
    rows, columns = np.nonzero((on_white < 120).all(axis=2))
    beyond = columns > 60
    around = (slice(rows[beyond].min() - 2, rows[beyond].max() + 3), slice(62, columns.max() + 3))
    assert (on_white[around] < 120).sum() > 500
    np.testing.assert_array_equal(on_dark[around], on_white[around])
