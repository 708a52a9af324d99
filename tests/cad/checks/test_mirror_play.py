"""The play of mirrors: the measured slide of a mirror in a made pocket, and the order in a made device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from mirrorcam.cad.assembly.components import mesh_of
from mirrorcam.cad.checks.exported_mesh import solid_of
from mirrorcam.cad.checks.mirror_play import DIRECTIONS, seat_order, slides_mm
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import Frustum, mirror_prism, outline_at
from mirrorcam.optics.geometry.layout import Layout
from tests.cad.guide.conftest import make


def test_a_mirror_slides_only_where_its_pocket_is_open(default_layout: Layout) -> None:
    """A block around the mirror with a gap of 0.3 mm, cut away on the side of the mirror's x axis."""
    mirror = default_layout.mirrors[0]
    own = solid_of(mesh_of(mirror_prism(mirror)))
    pocket = solid_of(mesh_of(Frustum(outline_at(mirror, -9.0, 0.3), outline_at(mirror, 9.0, 0.3))))
    block = solid_of(mesh_of(Frustum(outline_at(mirror, -9.0, 20.0), outline_at(mirror, 9.0, 20.0))))
    assert slides_mm(mirror, own, [block - pocket]).max() == 0.0
    x = mirror.rig_from_plane[:3, 0]
    right = (block - pocket).trim_by_plane(tuple(-x), float(-x @ mirror.rig_from_plane[:3, 3]))
    slides = slides_mm(mirror, own, [right])
    assert slides[0] == 3.0
    assert slides[DIRECTIONS // 2] == 0.0


def test_every_mirror_is_in_the_order_and_loose_ones_lack_rims(
    make_parabola: Callable[..., Layout], tmp_path: Path
) -> None:
    made = make(make_parabola(2, 2, scale_mm=40.0, gap_mm=2.0), HARDWARE, tmp_path)
    seats = seat_order(made.device, made.components)
    assert sorted(seats.order) == sorted(made.device.layout.mirror_names)
    assert {name for name, _ in seats.loose_mm} <= set(seats.order)
    # Without its rims, nothing holds the first mirror.
    bare = [replace(c, mesh=made.components[1].mesh) if c.name == "mirror_holder" else c for c in made.components]
    first = seat_order(made.device, bare)
    assert first.loose_mm[0] == (first.order[0], 3.0)
