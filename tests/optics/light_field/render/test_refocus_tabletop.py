"""Refocusing a tabletop scene photographed through mirrors as built, unevenly, against what a pinhole sees."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.light_field_images import decoded, in_focus_everywhere, psnr, true_view
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.light_field.light_field import LightField
from mirrorcam.optics.light_field.render.refocusing import FocalPlane, refocus
from mirrorcam.render_scenes.settings import SENSORS
from mirrorcam.render_scenes.tabletop.tabletop_set import TabletopRequest, render_tabletop


@pytest.mark.slow
def test_a_plane_in_focus_is_within_35_db_of_the_pinhole(default_layout: Layout, tmp_path: Path) -> None:
    manifest = render_tabletop(
        TabletopRequest(layout=default_layout, seed=2, spp=16, sensor=SENSORS["ideal"]), tmp_path
    )
    light_field = decoded(tmp_path)
    t, s = manifest.central_view
    true = true_view(tmp_path, t, s)
    for depth_mm in (375.0, 600.0):
        where = in_focus_everywhere(tmp_path, light_field, depth_mm)
        assert where.sum() > 1000
        plane = FocalPlane.at_depth(light_field, depth_mm)
        assert psnr(refocus(light_field, plane).image * 255.0, true, where) > 35.0
        assert psnr(refocus(light_field, plane, combine="median").image * 255.0, true, where) > 35.0
        assert psnr(refocus(light_field, FocalPlane.at_depth(light_field, 300.0)).image * 255.0, true, where) < 30.0
    # As if views stood on the even grid that lies nearest: sharp on the reference plane alone.
    even = LightField.of(light_field.on_regular_grid(), light_field.samples, light_field.weights)
    assert psnr(refocus(even, plane).image * 255.0, true, where) < 35.0
