"""The components of the assembled device: closed, in place, and with the masses of closed forms.

Solids of purchased items: volumes in closed form.
"""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from shapely import Polygon

from mirrorcam.cad.assembly.components import (
    CABLE_STUB_MM,
    Component,
    camera_component,
    camera_solid,
    combined,
    components_of,
    item_components,
    item_solid,
    item_title,
    mesh_of,
    mirror_components,
)
from mirrorcam.cad.assembly.device_plan import Device
from mirrorcam.cad.plan.hardware import HARDWARE, MIRROR_DENSITIES
from mirrorcam.cad.plan.part_plan import BoughtKind, BuiltPart, MassProperties
from mirrorcam.cad.plan.seats import Frustum
from mirrorcam.cad.plan.threads import COUNTERSUNK
from mirrorcam.optics.geometry.camera_body import Lips
from mirrorcam.optics.geometry.camera_library import read_body
from tests.cad.assembly.bought import item


@pytest.fixture(scope="module")
def parts(built_block: BuiltPart, tmp_path_factory: pytest.TempPathFactory) -> list[BuiltPart]:
    """The block in place of holder, clip and fit coupon: these tests do not depend on their shape."""
    folder = tmp_path_factory.mktemp("components")
    names = ("mirror_holder", "camera_clip", "fit_coupon", "dust_cover")
    for name in names:
        shutil.copy(built_block.stl, folder / f"{name}.stl")
    return [built_block.replaced(name=name, folder=folder) for name in names]


def box(width: float, height: float, depth: float, centre: tuple[float, float, float], mass: float) -> MassProperties:
    squares = np.array([width, height, depth]) ** 2
    inertia = mass / 12.0 * np.diag(squares.sum() - squares)
    return MassProperties(
        volume_mm3=width * height * depth, mass_g=mass, centre_in_rig_mm=np.array(centre), inertia_g_mm2=inertia
    )


def test_halves_composed_are_the_whole() -> None:
    halves = [box(10.0, 20.0, 30.0, (x, 7.0, -3.0), 4.0) for x in (-5.0, 5.0)]
    whole, expected = combined(halves), box(20.0, 20.0, 30.0, (0.0, 7.0, -3.0), 8.0)
    assert whole.mass_g == expected.mass_g
    assert whole.volume_mm3 == expected.volume_mm3
    np.testing.assert_allclose(whole.centre_in_rig_mm, expected.centre_in_rig_mm, atol=1e-12)
    np.testing.assert_allclose(whole.inertia_g_mm2, expected.inertia_g_mm2, rtol=1e-12)


def test_two_points_are_a_dumbbell() -> None:
    point = np.zeros((3, 3))
    ends = [
        MassProperties(volume_mm3=1.0, mass_g=mass, centre_in_rig_mm=np.array(at), inertia_g_mm2=point)
        for mass, at in ((3.0, (0.0, 0.0, 0.0)), (1.0, (0.0, 4.0, 4.0)))
    ]
    whole = combined(ends)
    np.testing.assert_allclose(whole.centre_in_rig_mm, [0.0, 1.0, 1.0])
    # Reduced mass 3/4 at the distance (0, 4, 4).
    np.testing.assert_allclose(whole.inertia_g_mm2, 0.75 * np.array([[32, 0, 0], [0, 16, -16], [0, -16, 16]]))


def test_every_piece_is_closed_named_once_and_in_the_device(device: Device, parts: list[BuiltPart]) -> None:
    components = components_of(device, parts)
    names = [component.name for component in components]
    assert len(set(names)) == len(names)
    assert {"mirror_holder", "mirror_0-0", "mirror_2-2", "camera"} <= set(names)
    assert not {"fit_coupon", "dust_cover"} & set(names)
    for component in components:
        assert component.mesh.is_volume, component.name
        np.testing.assert_allclose(component.mesh.center_mass, component.mass.centre_in_rig_mm, atol=1e-3)
        assert np.linalg.eigvalsh(component.mass.inertia_g_mm2).min() > 0.0


def test_a_mirror_is_a_prism_between_seat_and_light(device: Device, parts: list[BuiltPart]) -> None:
    components = mirror_components(device, components_of(device, parts)[:1])
    for component, mirror in zip(components, device.layout.mirrors, strict=True):
        volume = Polygon(mirror.outline_in_plane_mm).area * mirror.thickness_mm
        assert component.mass.mass_g == pytest.approx(volume * MIRROR_DENSITIES["glass"] / 1000.0, rel=1e-9)
        heights = component.mesh.vertices @ mirror.normal_in_rig + mirror.distance_mm
        # First surface: the front is the reflecting plane, the back is one thickness behind it.
        np.testing.assert_allclose([heights.min(), heights.max()], [-mirror.thickness_mm, 0.0], atol=1e-9)
        away = component.explode_mm - parts[0].explode_mm
        np.testing.assert_allclose(away / np.linalg.norm(away), mirror.normal_in_rig, atol=1e-9)


def test_a_mirror_goes_with_the_nearest_piece_of_a_split_holder(device: Device, parts: list[BuiltPart]) -> None:
    whole = components_of(device, parts)[0]

    def half(name: str, x: float) -> Component:
        mass = whole.mass.replaced(centre_in_rig_mm=np.array([x, 0.0, 90.0]))
        return replace(whole, name=name, mass=mass, explode_mm=np.array([x, 0.0, 0.0]))

    components = mirror_components(device, [half("mirror_holder_1", -60.0), half("mirror_holder_2", 60.0)])
    for component, mirror in zip(components, device.layout.mirrors, strict=True):
        expected = 60.0 if mirror.outline_in_rig_mm[:, 0].mean() > 0.0 else -60.0
        sideways = (component.explode_mm - 35.0 * mirror.normal_in_rig)[0]
        if abs(mirror.outline_in_rig_mm[:, 0].mean()) > 1.0:
            assert sideways == pytest.approx(expected)


@pytest.mark.parametrize(("name", "out"), [("c920", (0.0, 29.0 + 15.0, 0.0)), ("board_38", (0.0, 0.0, 40.0))])
def test_the_camera_has_its_mass_and_its_front_before_the_pupil(
    device: Device, parts: list[BuiltPart], name: str, out: tuple[float, float, float]
) -> None:
    camera = read_body(name)
    clip = components_of(device, parts)[1]
    component = camera_component(replace(device, hardware=HARDWARE.replaced(camera=camera)), clip)
    np.testing.assert_allclose(component.explode_mm, clip.explode_mm + out)
    assert component.mass.mass_g == pytest.approx(camera.mass_g)
    assert component.title == camera.name
    solid = camera_solid(camera)
    box = solid.bounding_box()
    assert pytest.approx(camera.pupil_behind_front_mm + camera.lens_protrusion_mm, abs=1e-6) == box.max.Z
    assert pytest.approx(camera.width_mm, abs=1e-6) == box.size.X
    assert solid.is_valid


def test_fasteners_are_where_they_are_told(device: Device) -> None:
    place = np.array([[0.0, 0.0, 1.0, 10.0], [0.0, 1.0, 0.0, 20.0], [-1.0, 0.0, 0.0, 30.0], [0.0, 0.0, 0.0, 1.0]])
    screw, other, insert = item_components(
        [item("screw", "M3", 12.0, place), item("screw", "M3", 8.0), item("insert", "M3", 5.7)]
    )
    assert [component.name for component in (screw, other, insert)] == ["screw_01", "screw_02", "insert_01"]
    assert (screw.title, insert.title) == ("M3 x 12 screw", "M3 x 5.7 heat-set insert")
    # The item's z is the rig's x here: a shank of 12 mm behind the origin, a head of 3 mm in front of it.
    np.testing.assert_allclose(screw.mesh.bounds[:, 0], [-2.0, 13.0], atol=1e-9)
    np.testing.assert_allclose(screw.mesh.bounds.mean(axis=0)[1:], [20.0, 30.0], atol=0.02)


def test_bought_items_have_trade_names() -> None:
    assert item_title(item("screw", "M3", 8.0)) == "M3 x 8 screw"
    assert item_title(item("screw", f"M3{COUNTERSUNK}", 10.0)) == "M3 x 10 countersunk screw"
    assert item_title(item("nut", "M3", 2.4)) == "M3 nut"
    assert item_title(item("pin", "3", 16.0)) == "3 x 16 pin"


def test_a_convex_volume_is_meshed_whole() -> None:
    square = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 3.0, 0.0], [0.0, 3.0, 0.0]])
    mesh = mesh_of(Frustum(square, np.array([[1.0, 1.0, 4.0]])))
    assert mesh.is_volume
    assert mesh.volume == pytest.approx(9.0 * 4.0 / 3.0)


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
    """Each corner loses the square of the radius but for a quarter of a circle."""
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
    with pytest.raises(ValueError, match="size='steel' does not name a thread, expected one of M1"):
        item_solid(item("pin", "steel", 16.0))


def test_the_foot_of_a_webcam_lies_folded_against_its_scene_side() -> None:
    """As high as published, no deeper than the body, and clear of the clip, which has no wall there."""
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
