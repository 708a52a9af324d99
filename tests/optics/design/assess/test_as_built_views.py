"""Views of many devices equal the views of each device; without tolerances they equal the design's."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Literal

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.optics.design.assess.as_built_views import BuiltViews, built_views
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import Perturbations, draw_as_built, draw_perturbations
from mirrorcam.optics.geometry.pupil import PINHOLE, Pupil
from mirrorcam.optics.geometry.sub_images import FieldsOfView, fields_of_view
from mirrorcam.optics.geometry.tolerances import Tolerances

WITH_CAMERA = Tolerances(tilt_deg=0.6, offset_mm=0.5, sheet_thickness_mm=0.1)
DEPTHS_MM = (320.0, 600.0)


def exact(layout: Layout, devices: int = 1) -> Perturbations:
    return draw_perturbations(Tolerances.none(), len(layout.mirrors), devices, np.random.default_rng(0))


def hexagonal(layout: Layout) -> Layout:
    """Two corners of every second mirror cut off: mirrors of four and of six corners in one layout."""
    mirrors = list(layout.mirrors)
    for k in range(0, len(mirrors), 2):
        a, b, c, d = mirrors[k].outline_in_rig_mm
        corners = [0.8 * a + 0.2 * d, 0.8 * a + 0.2 * b, b, 0.8 * c + 0.2 * b, 0.8 * c + 0.2 * d, d]
        mirrors[k] = mirrors[k].replaced(outline_in_rig_mm=np.array(corners))
    return layout.replaced(mirrors=tuple(mirrors))


def with_second_surfaces(layout: Layout) -> Layout:
    return layout.replaced(mirrors=tuple(m.replaced(surface="second", thickness_mm=1.5) for m in layout.mirrors))


def looking_aside(layout: Layout) -> Layout:
    """The same mirrors with rotated view axes, so that planes of constant depth are slanted."""
    return layout.replaced(view_from_rig=Rotation.from_rotvec([0.08, 0.12, 0.05]).as_matrix() @ layout.view_from_rig)


Kind = Literal["first", "second", "hexagonal", "crooked", "looking aside"]


@pytest.fixture(params=["first", "second", "hexagonal", "crooked", "looking aside"])
def layout(request: pytest.FixtureRequest, default_layout: Layout, crooked_layout: Layout) -> Layout:
    kind: Kind = request.param
    if kind == "crooked":
        return crooked_layout
    kinds: dict[Kind, Layout] = {
        "first": default_layout,
        "second": with_second_surfaces(default_layout),
        "hexagonal": hexagonal(default_layout),
        "looking aside": looking_aside(default_layout),
    }
    return kinds[kind]


def assert_same_views(layout: Layout, perturbations: Perturbations, built: Layout) -> None:
    """The views of the first device equal `fields_of_view` of its layout (whose rig frame is the holder's)."""
    views = built_views(layout, perturbations)
    assert_allclose(views.centres_mm[0], built.virtual_centres_in_view_mm.reshape(-1, 3), atol=1e-9)
    for pupil, depth_mm in product((PINHOLE, Pupil(1.8, 500.0)), DEPTHS_MM):
        assert_same_overlap(views.unvignetted(pupil), fields_of_view(built, pupil), depth_mm)


def assert_same_overlap(views: BuiltViews, alone: FieldsOfView, depth_mm: float) -> None:
    camera = views.layout.camera
    regions, footprints = views.common_regions(depth_mm)
    region, seen = alone.common_region(depth_mm)
    assert region.area > 100.0
    assert regions[0].symmetric_difference(region).area < 1e-6 * region.area
    assert_allclose(shapely.area(footprints[0]), shapely.area(seen), rtol=1e-9)
    share = views.pixel_count(regions, depth_mm)[0].sum() / (camera.width_px * camera.height_px)
    assert share == pytest.approx(alone.pixel_efficiency(region, depth_mm), rel=1e-9)


def test_a_device_without_a_fault_sees_what_the_design_sees(layout: Layout) -> None:
    assert_same_views(layout, exact(layout), layout)


def test_a_device_sees_what_its_own_layout_sees(layout: Layout) -> None:
    """Errors of mirrors and lens: the camera is in its nominal pose, so its rig frame is the holder's."""
    built = draw_as_built(layout, WITH_CAMERA, np.random.default_rng(8))
    perturbations = draw_perturbations(WITH_CAMERA, len(layout.mirrors), 1, np.random.default_rng(8))
    assert_same_views(layout, perturbations, built)


def test_devices_do_not_disturb_each_other(layout: Layout) -> None:
    many = draw_perturbations(WITH_CAMERA, len(layout.mirrors), 5, np.random.default_rng(9))
    third = Perturbations(**{name: values[3:4] for name, values in vars(many).items()})
    together, alone = built_views(layout, many), built_views(layout, third)
    (regions, _), (region, _) = (views.common_regions(DEPTHS_MM[0]) for views in (together, alone))
    assert_allclose(
        together.pixel_count(regions, DEPTHS_MM[0])[3], alone.pixel_count(region, DEPTHS_MM[0])[0], rtol=1e-12
    )
    assert len(set(together.pixel_count(regions, DEPTHS_MM[0]).sum(axis=1))) == 5


def test_pixels_are_those_of_the_layout_as_built(layout: Layout) -> None:
    """With a shifted and rotated camera: the rig frame follows it."""
    tolerances = WITH_CAMERA.replaced(camera_offset_mm=1.0, camera_turn_deg=1.0)
    count = len(layout.mirrors)
    perturbations = draw_perturbations(tolerances, count, 1, np.random.default_rng(2))
    built = draw_as_built(layout, tolerances, np.random.default_rng(2))
    points = np.random.default_rng(11).normal([0.0, 450.0, 90.0], [40.0, 40.0, 30.0], (20, 3))
    turn = Rotation.from_rotvec(perturbations.camera_rotations_rad[0]).as_matrix()
    in_rig = (points - perturbations.camera_shifts_mm[0]) @ turn
    expected = np.array([built.camera.project(mirror.apparent.reflect(in_rig)) for mirror in built.mirrors])
    found = built_views(layout, perturbations).pixels(
        points @ layout.view_from_rig.T, np.array(0), np.arange(count)[:, None]
    )
    assert np.isfinite(expected).mean() > 0.9
    assert_allclose(found, expected, atol=1e-7)


def test_a_pixel_lands_on_the_point_that_it_shows(layout: Layout) -> None:
    tolerances = WITH_CAMERA.replaced(camera_offset_mm=1.0, camera_turn_deg=1.0)
    perturbations = draw_perturbations(tolerances, len(layout.mirrors), 3, np.random.default_rng(12))
    views = built_views(layout, perturbations)
    points = np.array([[5.0, -85.0, 400.0], [-20.0, -95.0, 400.0], [15.0, -70.0, 400.0]])
    for device, camera in enumerate(views.cameras):
        pixels = views.pixels(points, np.array(device), np.array(1))
        landed = views.points_at_depth(camera.normalized_from_pixels(pixels), np.array(device), np.array(1), 400.0)
        assert_allclose(landed, points[:, :2], atol=1e-6)


def test_a_turn_of_the_camera_alone_moves_pictures_and_not_what_they_show(default_layout: Layout) -> None:
    wide = default_layout.camera.replaced(width_px=14000, height_px=8000, cx_px=6999.5, cy_px=3999.5)
    layout = default_layout.replaced(camera=wide)
    turned = replace(exact(layout), camera_rotations_rad=np.array([[0.01, -0.02, 0.03]]))
    views, design = built_views(layout, turned), built_views(layout, exact(layout))
    for depth_mm in DEPTHS_MM:
        region, before = views.common_regions(depth_mm)[0][0], design.common_regions(depth_mm)[0][0]
        assert region.symmetric_difference(before).area < 1e-9 * before.area
    moved = shapely.distance(shapely.centroid(views.outlines), shapely.centroid(design.outlines))
    assert moved.min() > 0.01


def test_light_that_does_not_head_for_the_scene_is_left_out() -> None:
    """A mirror at 45 degrees tilted by 45 degrees shows the camera itself, and beyond that the space behind it."""
    layout = faceted_parabola(DesignSpec(fold_deg=90.0))
    tilts = np.zeros((1, 9, 2))
    tilts[0, 1, 0], tilts[0, 4, 0] = -1.2, -0.75
    views = built_views(layout, replace(exact(layout), tilts_rad=tilts))
    assert shapely.is_empty(views.sub_images[0, 1])
    part, all_of_it = views.sub_images[0, 4], views.usable[0, 4]
    assert 0.1 < part.area / all_of_it.area < 0.9
    normal = views.normals[0, 4] @ layout.view_from_rig
    for region, heads_forward in ((part, True), (all_of_it.difference(part).buffer(-1e-4), False)):
        corners = shapely.get_coordinates(region)
        rays = np.column_stack([corners, np.ones(len(corners))])
        heading = rays[:, 1] - 2.0 * (rays @ normal) * normal[1]
        assert ((heading > 0.0) == heads_forward).all()
    assert shapely.is_empty(views.common_regions(400.0)[0][0])


def test_mirrors_that_hide_others_are_found(default_layout: Layout) -> None:
    perturbations = exact(default_layout, devices=3)
    perturbations.shifts_mm[1, 4] = 8.0
    assert built_views(default_layout, perturbations).hidden().tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("thickness_mm", -3.2, r"a sampled mirror is -0\.2 mm thick"),
        ("shifts_mm", 90.0, "a sampled mirror reaches past the pupil"),
        ("tilts_rad", 1.2, "a sampled mirror reaches past the pupil"),
        ("camera_rotations_rad", 2.0, "a sampled mirror reaches behind the camera"),
    ],
)
def test_impossible_devices_are_refused(default_layout: Layout, name: str, value: float, complaint: str) -> None:
    perturbations = exact(default_layout)
    with pytest.raises(InputError, match=complaint):
        built_views(default_layout, replace(perturbations, **{name: getattr(perturbations, name) + value}))
