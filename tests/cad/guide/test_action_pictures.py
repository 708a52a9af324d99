"""Close-ups of actions: they show what they are about, and film and ties keep the measures of their kind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.guide.action_pictures import (
    TIE_WIDTH_MM,
    action_names,
    glue_beads,
    peeled_film,
    tie_loops,
    tie_solids,
)
from mirrorcam.cad.guide.picture_views import rendering_of
from mirrorcam.cad.parts.ties import TIE_THICK_MM
from mirrorcam.cad.plan.device_names import CLOSE_UPS
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_gaps import area_mm2
from mirrorcam.optics.geometry.transforms import inverse, transform
from tests.cad.guide.conftest import Made


def test_a_peeled_film_keeps_its_area_and_its_free_corner_leads_away(made: Made) -> None:
    mirror = made.device.layout.mirrors[0]
    film, corner, pull = peeled_film(mirror)
    areas = np.linalg.norm(np.cross(film[:, 1] - film[:, 0], film[:, 2] - film[:, 0]), axis=1) / 2.0
    # Chords of the roll are a little shorter than its arcs.
    assert areas.sum() == pytest.approx(area_mm2(mirror), rel=0.01)
    heights = (film.reshape(-1, 3) - mirror.outline_in_rig_mm[0]) @ mirror.normal_in_rig
    assert heights.min() > 0.0
    assert heights.max() > 5.0
    assert np.linalg.norm(film.reshape(-1, 3) - corner, axis=1).min() == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(pull) == pytest.approx(1.0)


def test_a_tie_surrounds_the_cable_and_passes_both_slots(made: Made) -> None:
    ((content, z, pull),) = tie_loops(made.device)
    left, right, slot_z = made.device.clip.tie_mm
    assert z == slot_z
    assert {left, right} <= set(content[:, 0].tolist())
    band, _, end = tie_solids(content, z, pull)
    corners = band.reshape(-1, 3)
    assert np.ptp(corners[:, 2]) == pytest.approx(TIE_WIDTH_MM)
    outside = Polygon(corners[np.argsort(np.arctan2(*(corners[:, :2] - content.mean(axis=0)).T)), :2]).convex_hull
    assert outside.area == pytest.approx(Polygon(content).convex_hull.buffer(TIE_THICK_MM).area, rel=0.02)
    assert end[:2] @ pull > (content @ pull).max()


@pytest.mark.parametrize("mirrors", ["glue", "screws"])
def test_each_mirror_has_beads_of_glue_clear_of_its_pads(make_parabola: Callable[..., Layout], mirrors: str) -> None:
    layout = make_parabola(2, 2, gap_mm=4.0)
    device = plan_device(layout, HARDWARE.replaced(holder=HARDWARE.holder.replaced(mirrors=mirrors)))
    for index, mirror in enumerate(layout.mirrors):
        beads = glue_beads(device, index)
        assert len(beads) >= 2
        in_plane = transform(inverse(mirror.rig_from_plane), np.concatenate(beads).reshape(-1, 3))
        assert np.abs(in_plane[:, 0]).max() < np.abs(mirror.outline_in_plane_mm[:, 0]).max()


@pytest.mark.parametrize("name", CLOSE_UPS)
def test_a_close_up_shows_all_that_it_adds_to_the_parts(made: Made, name: str) -> None:
    assert name in action_names(made.device)
    (picture,) = [picture for picture in made.pictures if picture.name == name]
    shot = rendering_of(picture)
    assert shot.image.shape[:2] == picture.size_px[::-1]
    pixels = np.bincount(shot.bodies[shot.bodies >= 0], minlength=len(picture.items))
    # Arrows, and everything that is neither a printed part nor a mirror in place.
    drawn = [count for item, count in zip(picture.items, pixels, strict=True) if len(item.body.triangles) < 400]
    assert sum(count > 100 for count in drawn) >= 2
    last = [count for item, count in zip(picture.items, pixels, strict=True) if item.body.rgb == (0.86, 0.16, 0.12)]
    assert last and max(last) > 100
