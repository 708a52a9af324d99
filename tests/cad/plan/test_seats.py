"""Positions of seats, pockets and light, against the mirror's plane and the law of reflection."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from mirrorcam.cad.plan.hardware import HARDWARE, Hardware
from mirrorcam.cad.plan.seats import (
    Frustum,
    camera_cone,
    keep_outs,
    light_start_mm,
    mirror_prism,
    outline_at,
    pocket,
    reflected_beam,
    seat_distance_mm,
    working_distance_mm,
)
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.cad.taped import TAPED

CUBE = Frustum(
    np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]]),
    np.array([[0.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 2.0, 2.0], [0.0, 2.0, 2.0]]),
)


def volume(solid: Frustum) -> float:
    """By the divergence theorem over the outward faces."""
    total = 0.0
    for face in solid.faces:
        for a, b in pairwise(face[1:]):
            total += float(np.linalg.det([face[0], a, b])) / 6.0
    return total


def inside_points(mirror: Mirror) -> FloatArray:
    """Points (n, 3) strictly inside the outline, on the reflecting plane."""
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    return np.concatenate([middle + share * (mirror.outline_in_rig_mm - middle) for share in (0.999, 0.5, 0.0)])


def test_faces_of_a_frustum_point_outwards_whichever_way_its_corners_run() -> None:
    assert volume(CUBE) == pytest.approx(8.0)
    assert volume(Frustum(CUBE.base[::-1], CUBE.top[::-1])) == pytest.approx(8.0)
    assert volume(Frustum(CUBE.base, np.array([[1.0, 1.0, 3.0]]))) == pytest.approx(4.0)
    assert CUBE.contains(np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 2.1], [-0.1, 1.0, 1.0]])).tolist() == [
        True,
        False,
        False,
    ]
    assert CUBE.may_touch_ball(np.array([1.0, 1.0, 3.0]), 1.1)
    assert not CUBE.may_touch_ball(np.array([1.0, 1.0, 3.0]), 0.9)


@pytest.mark.parametrize(("hardware", "behind"), [(HARDWARE, 0.2), (TAPED, 0.4)])
def test_the_seat_is_behind_the_mirrors_back_by_pads_and_tape(
    default_layout: Layout, hardware: Hardware, behind: float
) -> None:
    for mirror in default_layout.mirrors:
        second = mirror.replaced(surface="second", thickness_mm=3.0)
        assert seat_distance_mm(second, hardware) == pytest.approx(mirror.distance_mm + behind)
        assert seat_distance_mm(mirror, hardware) == pytest.approx(mirror.distance_mm + mirror.thickness_mm + behind)
        for kind in (mirror, second):
            back = mirror_prism(kind).base
            np.testing.assert_allclose(back @ kind.normal_in_rig, behind - seat_distance_mm(kind, hardware), atol=1e-9)
            assert volume(mirror_prism(kind)) > 0.0
        np.testing.assert_allclose(mirror_prism(mirror).top @ mirror.normal_in_rig, -mirror.distance_mm, atol=1e-9)
        np.testing.assert_allclose(mirror_prism(second).top @ mirror.normal_in_rig, 3.0 - mirror.distance_mm, atol=1e-9)


def test_a_grown_outline_keeps_its_distance_to_every_edge(make_flat_pair: Callable[..., Layout]) -> None:
    mirror = make_flat_pair(gap_mm=5.0).mirrors[0]
    grown = outline_at(mirror, 0.25, 2.0)
    assert len(grown) == 4
    lengths = sorted(np.linalg.norm(np.roll(grown, -1, axis=0) - grown, axis=1))
    np.testing.assert_allclose(lengths, [24.0, 24.0, 34.0, 34.0])
    np.testing.assert_allclose(grown @ mirror.normal_in_rig, 0.25 - mirror.distance_mm)
    assert len(outline_at(mirror, 0.0, 2.0, bevelled=True)) == 8


@pytest.mark.parametrize("surface", ["first", "second"])
def test_light_between_pupil_mirror_and_scene_lies_in_the_cones(default_layout: Layout, surface: str) -> None:
    mirrors = tuple(mirror.replaced(surface=surface) for mirror in default_layout.mirrors)
    layout = default_layout.replaced(mirrors=mirrors)
    depth = working_distance_mm(layout, HARDWARE)
    assert depth == 500.0
    for index, mirror in enumerate(layout.mirrors):
        points = inside_points(mirror)
        outgoing = points @ mirror.reflection.T
        forward = layout.view_from_rig[2]
        scene = points + outgoing * ((depth - points @ forward) / (outgoing @ forward))[:, None]
        for share in (0.01, 0.5, 0.95):
            assert camera_cone(mirror, layout.camera.pupil, HARDWARE).contains(points * share).all()
            assert reflected_beam(layout, index, HARDWARE).contains(points + share * (scene - points)).all()
        # Light of a second-surface mirror is inside the sheet up to its front, and can leave the outline after that.
        beside = points * (1.0 - (light_start_mm(mirror) + np.array([-0.04, 0.04])[:, None, None]) / mirror.distance_mm)
        assert light_start_mm(mirror) == (0.05 if surface == "first" else mirror.thickness_mm)
        assert not camera_cone(mirror, layout.camera.pupil, HARDWARE).contains(beside[0]).any()
        assert camera_cone(mirror, layout.camera.pupil, HARDWARE).contains(beside[1]).all()
        assert not reflected_beam(layout, index, HARDWARE).contains(points * 0.5).any()


def test_no_keep_out_of_a_mirror_is_behind_its_seat(default_layout: Layout) -> None:
    for mirror, volumes in zip(default_layout.mirrors, keep_outs(default_layout, HARDWARE), strict=True):
        for solid in volumes:
            corners = np.vstack([solid.base, solid.top])
            assert (corners @ mirror.normal_in_rig + seat_distance_mm(mirror, HARDWARE) > -1e-9).all()
        assert pocket(mirror, HARDWARE).contains(mirror_prism(mirror).top * 0.99999).all()


def test_without_a_spec_the_working_distance_is_the_tables(make_flat_pair: Callable[..., Layout]) -> None:
    layout = make_flat_pair(gap_mm=5.0)
    assert working_distance_mm(layout, HARDWARE) == HARDWARE.holder.depth_without_spec_mm


def test_a_mirror_that_does_not_face_the_scene_is_refused(make_flat_pair: Callable[..., Layout]) -> None:
    layout = make_flat_pair(gap_mm=5.0)
    turned = layout.replaced(view_from_rig=[[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    with pytest.raises(InputError, match="mirror 0-0 does not reflect every ray to the plane 500 mm ahead"):
        keep_outs(turned, HARDWARE)
