"""Distances between the solids of mirrors and between their sub-images, against closed forms and all pairs."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon

from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import (
    area_mm2,
    edges_mm,
    hull_distance,
    pairs_closer_than,
    smallest_gap_mm,
    smallest_sub_image_gap,
    stacked,
    sub_images_closer_than,
)
from tests.optics.seeing_mirrors import mirror_seeing

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


@pytest.mark.parametrize(
    ("shift", "distance"),
    [
        ((3, 0.2, 0.1), 2.0),
        ((2, 2, 0), np.sqrt(2)),
        ((2, 2, 2), np.sqrt(3)),
        ((0.5, 0.5, 0.5), 0.0),
        ((1e3, 0, 0), 999.0),
    ],
)
def test_distance_between_cubes(shift: tuple[float, float, float], distance: float) -> None:
    assert hull_distance(CUBE, CUBE + np.array(shift)) == pytest.approx(distance, abs=1e-9)


def test_gap_between_crossing_edges() -> None:
    along_x, along_y = np.array([[-1.0, 0, 0], [1, 0, 0]]), np.array([[0, -1.0, 0.7], [0, 1, 0.7]])
    assert hull_distance(along_x, along_y) == pytest.approx(0.7)


def test_smallest_gap_counts_the_thickness_of_mirrors() -> None:
    # Two coplanar mirrors: the gap equals the gap of their outlines, whatever the thickness. If the planes lean towards
    # each other at the back, thicker mirrors come closer there.
    flat = Layout(
        rows=1,
        cols=2,
        camera=Camera.c920(),
        mirrors=(mirror_seeing((-60, -19, 60, 120), 80.0), mirror_seeing((19, 60, 60, 120), 80.0)),
    )
    gap_mm = 2.0 * 19.0 / 380.0 * float(flat.mirrors[0].outline_in_rig_mm[:, 2].min())
    assert smallest_gap_mm(flat.mirrors) == pytest.approx(gap_mm)
    assert smallest_gap_mm(with_thickness(flat, 4.0).mirrors) == pytest.approx(gap_mm)
    parabola = faceted_parabola(DesignSpec(rows=1, cols=2, spacing_mm=3.0))
    in_front = [mirror.replaced(surface="second") for mirror in with_thickness(parabola, 4.0).mirrors]
    assert (
        hull_distance(*(mirror.solid.corners_in_rig_mm for mirror in in_front))
        < smallest_gap_mm(parabola.mirrors) - 0.5
    )


def with_thickness(layout: Layout, thickness_mm: float) -> Layout:
    return layout.replaced(mirrors=tuple(mirror.replaced(thickness_mm=thickness_mm) for mirror in layout.mirrors))


def test_the_smallest_gap_is_that_of_the_closest_pair(default_layout: Layout) -> None:
    solids = [mirror.solid.corners_in_rig_mm for mirror in default_layout.mirrors]
    gaps = {(i, j): hull_distance(solids[i], solids[j]) for i, j in combinations(range(len(solids)), 2)}
    assert smallest_gap_mm(default_layout.mirrors) == min(gaps.values())
    for gap_mm in (0.5, 1.2, 5.0, 30.0):
        assert pairs_closer_than(default_layout.mirrors, gap_mm) == sorted(p for p, gap in gaps.items() if gap < gap_mm)
    assert len(pairs_closer_than(default_layout.mirrors, 30.0)) > 10


def test_bodies_of_different_numbers_of_corners_stack() -> None:
    both = stacked([np.eye(3), np.arange(6.0).reshape(2, 3)])
    assert both.shape == (2, 3, 3)
    assert (both[1, 2] == both[1, 1]).all()


def test_the_gap_between_sub_images_is_that_between_their_outlines(parabola_layout: Layout) -> None:
    found = smallest_sub_image_gap(parabola_layout.mirrors)
    outlines = [Polygon(mirror.outline_normalized) for mirror in parabola_layout.mirrors]
    gaps = {(i, j): outlines[i].distance(outlines[j]) for i, j in combinations(range(len(outlines)), 2)}
    assert found == min(gaps.values())
    for gap in (found, 1.001 * found, 0.1):
        assert sub_images_closer_than(parabola_layout.mirrors, gap) == sorted(
            p for p, apart in gaps.items() if apart < gap
        )
    assert smallest_sub_image_gap(parabola_layout.mirrors[:1]) == np.inf


def test_edges_and_area_are_those_of_the_outline() -> None:
    mirror = mirror_seeing((-40.0, 40.0, 60.0, 120.0), 80.0)
    corners = mirror.outline_in_rig_mm
    assert_allclose(edges_mm(mirror), np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1))
    crossed = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    assert area_mm2(mirror) == pytest.approx(np.linalg.norm(crossed) / 2.0)
