"""Intersections with the objects and rays of pinholes, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.transforms import rigid
from mirrorcam.optics.light_field.decoder import Decoder
from mirrorcam.render_scenes.tabletop.objects import SceneObject
from mirrorcam.render_scenes.tabletop.tabletop import Tabletop, arrange_tabletop
from mirrorcam.render_scenes.tabletop.tabletop_scene import NOTHING, TabletopScene, pinhole_rays
from mirrorcam.render_scenes.variant import SCALAR


def test_rays_meet_the_nearest_object_where_a_formula_says(small_layout: Layout) -> None:
    wall = SceneObject(
        name="wall",
        kind="rectangle",
        material="matte",
        view_from_object=rigid(np.eye(3), [0.0, 0.0, 500.0]),
        size_mm=np.array([200.0, 200.0, 0.0]),
    )
    ball = SceneObject(
        name="ball",
        kind="sphere",
        material="matte",
        view_from_object=rigid(np.eye(3), [30.0, 0.0, 400.0]),
        size_mm=np.array([40.0, 0.0, 0.0]),
    )
    tabletop = Tabletop((wall, ball), np.array([0.0, 0.0, 400.0]), 200.0)
    scene = TabletopScene(small_layout, tabletop, mirror_reflectance=0.9)
    forward = small_layout.view_from_rig[2]
    starts = np.array([[0.0, 0.0, 300.0], [30.0, 0.0, 300.0], [150.0, 0.0, 300.0], [np.nan] * 3])
    hits = scene.hits(starts @ small_layout.view_from_rig, np.tile(forward, (4, 1)))
    assert hits.object_index.tolist() == [0, 1, NOTHING, NOTHING]
    np.testing.assert_allclose(hits.path_mm, [200.0, 80.0, np.inf, np.inf], atol=1e-3)
    np.testing.assert_allclose(
        hits.points[:2] @ small_layout.view_from_rig.T, [[0.0, 0.0, 500.0], [30.0, 0.0, 380.0]], atol=1e-3
    )


def test_rays_of_a_view_start_at_a_depth_and_meet_on_the_reference_plane(small_layout: Layout) -> None:
    views = Decoder(small_layout).views
    forward = views.view_from_rig[2]
    corners = []
    for t, s in ((0, 0), (1, 1), (2, 2)):
        start, direction = pinhole_rays(views, t, s, 200.0)
        np.testing.assert_allclose(start @ forward, 200.0, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(direction, axis=-1), 1.0)
        plane = views.plane_points_in_rig(views.reference_depth_mm, views.pixel_grid())
        along = ((plane - start) * direction).sum(axis=-1)
        np.testing.assert_allclose(start + along[..., None] * direction, plane, atol=1e-8)
        corners.append(start[0, 0])
    assert np.linalg.norm(corners[0] - corners[2]) > 1.0


def test_without_a_compiler_a_scene_is_refused(small_layout: Layout) -> None:
    with pytest.raises(InputError, match=r"^a scene in colour needs a GPU or an LLVM"):
        TabletopScene(small_layout, arrange_tabletop(small_layout, (400.0,), 0), 0.9, variant=SCALAR)
