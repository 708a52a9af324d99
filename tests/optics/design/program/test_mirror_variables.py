"""Mirrors as CasADi expressions against the functions and values of `geometry`."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from shapely import Polygon

from mirrorcam.optics.design.program import mirror_variables
from mirrorcam.optics.design.program.mirror_variables import Kind
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.optics.geometry.nearest_lens import with_lens
from tests.optics.design.program.seeded_mirrors import DISTORTION, KINDS, expressed, number, spec_of
from tests.optics.geometry.lenses.cameras import LENSES, camera_of

BENT = Camera.c920().replaced(distortion=DISTORTION)
BY_FAMILY = [
    camera_of("rational", LENSES["rational"][0]),
    camera_of("thin_prism", LENSES["thin_prism"][0]),
    camera_of("fisheye", LENSES["fisheye"][1]),
]


@pytest.mark.parametrize("camera", [BENT, *BY_FAMILY], ids=lambda camera: camera.lens_model)
def test_pixels_are_those_of_the_camera(camera: Camera) -> None:
    for normalized in ([0.3, -0.2], [-0.6, 0.35], [0.0, 0.0]):
        expected = camera.pixels_from_normalized(np.array(normalized))
        found = mirror_variables.pixels(camera.lens_model, ca.SX(camera.intrinsics), ca.SX(normalized))
        assert_allclose(number(found).ravel(), expected)


def test_a_spline_lens_is_replaced_by_a_formula_with_a_sensor_within_its_own() -> None:
    assert mirror_variables.expressible(BENT) is BENT
    empty = with_lens(BENT, "spline")
    field = 2e-4 * np.random.default_rng(0).standard_normal(len(empty.distortion) - 5)
    camera = empty.replaced(distortion=np.append(BENT.distortion, field))
    near = mirror_variables.expressible(camera)
    assert near.lens_model == "thin_prism"
    width, height = near.width_px, near.height_px
    assert camera.width_px - 4 <= width < camera.width_px
    border = np.array([[x, y] for x in (-0.5, width - 0.5) for y in np.linspace(-0.5, height - 0.5, 50)])
    own = camera.project(near.unproject(border))
    assert (own >= -0.5).all()
    assert (own <= [camera.width_px - 0.5, camera.height_px - 0.5]).all()


def test_reflection_is_that_of_the_mirror() -> None:
    point, centre = np.array([12.0, 300.0, -40.0]), np.array([5.0, -80.0, 90.0])
    assert_allclose(number(mirror_variables.reflected(ca.SX(point), ca.SX(centre))).ravel(), reflect(point, centre))


@pytest.mark.parametrize("fold_deg", [60.0, 90.0, 110.0])
def test_the_fold_is_that_of_the_spec(fold_deg: float) -> None:
    turned = DesignSpec(fold_deg=fold_deg).view_from_rig
    assert_allclose(number(mirror_variables.view_from_rig(ca.SX(np.radians(fold_deg)))), turned, atol=1e-15)


def test_areas_and_outlines_are_those_of_polygons() -> None:
    corners = np.array([[0.0, 0.0], [3.0, 0.5], [4.0, 2.0], [2.0, 4.0], [-1.0, 1.0]])
    vertices = [ca.SX(corner) for corner in corners]
    assert number(mirror_variables.polygon_area(vertices)).item() == pytest.approx(Polygon(corners).area)
    assert number(mirror_variables.polygon_area(vertices[::-1])).item() == pytest.approx(-Polygon(corners).area)
    points = np.array([number(point).ravel() for point in mirror_variables.subdivided(vertices, 4)])
    assert points.shape == (20, 2)
    assert_allclose(points[::4], corners)
    assert_allclose(np.diff(points[:5], axis=0), np.tile(np.diff(points[:5], axis=0)[0], (4, 1)), atol=1e-12)
    assert Polygon(points).area == pytest.approx(Polygon(corners).area)


@pytest.mark.parametrize("fold_deg", [90.0, 110.0])
@pytest.mark.parametrize("kind", KINDS)
def test_faces_and_solids_are_those_of_the_mirror(kind: Kind, fold_deg: float) -> None:
    spec = spec_of(kind, fold_deg)
    for index in range(4):
        mine, theirs = expressed(spec, kind, index)
        assert theirs.surface == spec.surface
        face = number(ca.horzcat(*mine.face)).T * spec.scale_mm @ spec.view_from_rig
        assert_allclose(face, theirs.apparent.outline_in_rig_mm, atol=2e-5)
        normal = number(mine.normal).ravel() @ spec.view_from_rig
        assert_allclose(normal, -theirs.normal_in_rig, atol=1e-7)
        solid = number(ca.horzcat(*mine.solid)).T * spec.scale_mm @ spec.view_from_rig
        # `solid` lists the reflecting face first; from the pupil, a second-surface mirror's comes second.
        expected = theirs.solid.corners_in_rig_mm
        if kind.second_surface:
            expected = np.roll(expected, kind.sides, axis=0)
        assert_allclose(solid, expected, atol=2e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_a_tilted_mirror_is_turned_about_the_middle_of_its_face(kind: Kind) -> None:
    spec = spec_of(kind)
    mine, theirs = expressed(spec, kind, 1)
    middle = theirs.apparent.outline_in_rig_mm.mean(axis=0)
    for angles in ([0.0, 0.0], [0.01, 0.0], [0.0, -0.01]):
        normal = theirs.normal_in_rig
        axes = theirs.rig_from_plane[:3, :2]
        # The virtual centre is behind the mirror: turning it along an axis moves the normal in the opposite direction.
        turn = Rotation.from_rotvec(np.cross(normal, axes @ [-angles[0], angles[1]]))
        turned = turn.apply(normal)
        expected = 2.0 * (middle @ turned) * turned
        found = number(mine.tilted_centre(ca.SX(angles))).ravel() * spec.scale_mm @ spec.view_from_rig
        assert_allclose(found, expected, atol=1e-3)
