"""Solids of bought items: the volumes of their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from mirrorcam.cad.assembly.bought_solids import CABLE_STUB_MM, camera_solid, item_solid
from mirrorcam.cad.plan.part_plan import BoughtKind
from mirrorcam.optics.geometry.camera_body import Lips
from mirrorcam.optics.geometry.camera_library import read_body
from tests.cad.assembly.bought import item


@pytest.mark.parametrize(
    ("kind", "size", "length", "volume"),
    [
        ("screw", "M3", 12.0, np.pi * (1.5**2 * 12.0 + 2.75**2 * 3.0)),
        ("washer", "M3", 0.5, np.pi / 4.0 * (7.0**2 - 3.2**2) * 0.5),
        ("insert", "M3", 5.7, np.pi * (2.0**2 - 1.5**2) * 5.7),
        ("nut", "M3", 2.4, (np.sqrt(3.0) / 2.0 * 5.5**2 - np.pi * 1.5**2) * 2.4),
        ("screw", "M3 countersunk", 12.0, np.pi * (1.5**2 * 12.0 + (3.36**3 - 1.5**3) / 3.0 - 1.5**2 * 1.86)),
        ("screw", "M6", 16.0, np.pi * (3.0**2 * 16.0 + 5.0**2 * 6.0)),
        ("nut", "1/4-20 UNC", 5.56, (np.sqrt(3.0) / 2.0 * 11.11**2 - np.pi * 3.175**2) * 5.56),
        ("pin", "3", 16.0, np.pi * 1.5**2 * 16.0),
    ],
)
def test_fasteners_have_the_volume_of_their_formula(kind: BoughtKind, size: str, length: float, volume: float) -> None:
    assert item_solid(item(kind, size, length)).volume == pytest.approx(volume, rel=1e-9)


@pytest.mark.parametrize(
    ("width", "height", "radius"), [(94.0, 29.0, 0.0), (94.0, 29.0, 14.0), (90.0, 25.0, 12.5), (25.0, 90.0, 12.5)]
)
def test_a_body_with_round_ends_lacks_four_corners(width: float, height: float, radius: float) -> None:
    """Of each square of the radius, a quarter of a circle is left."""
    plain = read_body("d435").replaced(lens_x_mm=0.0, end_radius_mm=0.0)
    body = plain.replaced(width_mm=width, height_mm=height, end_radius_mm=radius, held_by=Lips(lip_mm=2.0))
    solid = camera_solid(body)
    cable = np.pi * (body.cable_mm / 2.0) ** 2 * CABLE_STUB_MM
    outline = width * height - (4.0 - np.pi) * radius**2
    assert solid.volume == pytest.approx(outline * body.depth_mm + cable, rel=1e-9)
    box, (low, high) = solid.bounding_box(), body.box_mm
    np.testing.assert_allclose([box.min.X, box.min.Y, *box.max], [*low[:2], *high], atol=1e-6)
    assert solid.is_valid


def test_a_size_without_a_diameter_is_refused() -> None:
    with pytest.raises(ValueError, match="size='steel' names no thread, expected one of M1"):
        item_solid(item("pin", "steel", 16.0))


def test_the_foot_of_a_webcam_lies_folded_against_its_scene_side() -> None:
    """As high as published, no deeper than the body, and in no clip: this has no wall there."""
    camera = read_body("c920")
    assert camera.foot_mm is not None
    box = camera_solid(camera).bounding_box()
    assert pytest.approx(43.3, abs=0.01) == box.max.Y - box.min.Y
    without = camera_solid(camera.replaced(foot_mm=None, hinge_mm=0.0))
    volume = camera_solid(camera.replaced(hinge_mm=0.0)).volume - without.volume
    assert volume == pytest.approx(40.3 * 14.3 * 24.0, rel=1e-6)


def test_a_ribbon_is_as_wide_and_thin_as_stated() -> None:
    camera = read_body("pi_camera_3")
    ribbon = camera_solid(camera).volume - camera_solid(camera.replaced(cable_thick_mm=1e-3)).volume
    assert ribbon == pytest.approx(16.0 * (0.3 - 1e-3) * 20.0, rel=1e-6)


def test_no_cable_is_drawn_out_of_a_display() -> None:
    phone = read_body("iphone_13")
    lowest = camera_solid(phone).bounding_box().min.Z
    assert lowest == pytest.approx(phone.pupil_behind_front_mm - phone.depth_mm)
    assert not phone.has_cable
    assert read_body("c920").has_cable
