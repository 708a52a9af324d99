"""The second opinion: it passes a good layout and refuses each kind of broken one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from optics.design.errors import InfeasibleDesign
from optics.design.metrics import sheet_in_rig_mm
from optics.design.verify import blocked_light, half_spaces, length_inside_mm, sampled, seen_gap_mm, verify
from optics.layout import Layout
from optics.mirror import Mirror
from optics.spec import DesignSpec
from optics.values import FloatArray


def spec_of(layout: Layout) -> DesignSpec:
    assert layout.spec is not None
    return layout.spec


def with_mirror(layout: Layout, index: int, mirror: Mirror) -> Layout:
    return layout.replaced(mirrors=(*layout.mirrors[:index], mirror, *layout.mirrors[index + 1 :]))


def recut(mirror: Mirror, corners: FloatArray) -> Mirror:
    """The mirror's plane with another outline, given in normalized coordinates."""
    return mirror.replaced(outline_in_rig_mm=mirror.cut(corners))


def slid(mirror: Mirror, along: float) -> Mirror:
    """The mirror seen in the same place of the image from another distance: all lengths times `along`."""
    return mirror.replaced(
        virtual_centre_in_rig_mm=mirror.virtual_centre_in_rig_mm * along,
        outline_in_rig_mm=mirror.outline_in_rig_mm * along,
    )


def test_the_default_layout_stands(default_layout: Layout) -> None:
    verify(default_layout, spec_of(default_layout))
    assert blocked_light(default_layout.mirrors, 500.0) == []
    assert seen_gap_mm(default_layout) >= 1.0


def test_a_mirror_nearer_to_the_camera_blocks_light(default_layout: Layout) -> None:
    # It keeps its place in the image, so only the beams that leave its neighbour meet it.
    broken = with_mirror(default_layout, 1, slid(default_layout.mirrors[1], 0.85))
    with pytest.raises(
        InfeasibleDesign, match=r"occlusion constraint: mirror 1 stands in .*% of the light from mirror 4"
    ):
        verify(broken, spec_of(default_layout).replaced(spacing_mm=0.0))
    blocked = blocked_light(broken.mirrors, 500.0)
    assert {(found.light_of, found.sheet_of, found.leg) for found in blocked} >= {(4, 1, "out")}


def test_a_thick_sheet_before_its_mirror_blocks_light(default_layout: Layout) -> None:
    thick = [mirror.replaced(surface="second", thickness_mm=8.0) for mirror in default_layout.mirrors]
    with pytest.raises(InfeasibleDesign, match="occlusion constraint"):
        verify(default_layout.replaced(mirrors=tuple(thick)), spec_of(default_layout).replaced(spacing_mm=0.0))


def test_a_sheet_that_reaches_the_pupil_is_refused(default_layout: Layout) -> None:
    distance_mm = default_layout.mirrors[8].distance_mm
    thick = default_layout.mirrors[8].replaced(surface="second", thickness_mm=distance_mm + 2.5)
    with pytest.raises(InfeasibleDesign, match=r"the sheet of mirror 8 reaches 2.5 mm past the pupil"):
        verify(with_mirror(default_layout, 8, thick), spec_of(default_layout).replaced(spacing_mm=0.0))


def test_mirrors_too_close_are_refused(default_layout: Layout) -> None:
    with pytest.raises(InfeasibleDesign, match=r"spacing constraint: two mirrors are 1 mm apart, 0\.5 mm too close"):
        verify(default_layout, spec_of(default_layout).replaced(spacing_mm=1.5))


def test_mirrors_apart_in_space_but_not_in_the_image_are_refused(default_layout: Layout) -> None:
    # The upper mirror moves away and grows down to the very edge of the lower one, as the camera sees it.
    far = slid(default_layout.mirrors[1], 1.2)
    lower = default_layout.mirrors[4].outline_normalized
    corners = far.outline_normalized.copy()
    corners[:2] = [[-0.1, lower[:, 1].max() + 1e-4], [0.1, lower[:, 1].max() + 1e-4]]
    broken = with_mirror(default_layout, 1, recut(far, corners))
    with pytest.raises(InfeasibleDesign, match="as the camera sees them"):
        verify(broken, spec_of(default_layout).replaced(spacing_mm=0.5))


def test_a_sub_image_off_the_sensor_is_refused(default_layout: Layout) -> None:
    corners = default_layout.mirrors[3].outline_normalized.copy()
    corners[[0, 3], 0] -= 10.0 / default_layout.camera.fx_px
    broken = with_mirror(default_layout, 3, recut(default_layout.mirrors[3], corners))
    with pytest.raises(
        InfeasibleDesign, match=r"sensor constraint: the sub-image of mirror 3 leaves the sensor by 10 px"
    ):
        verify(broken, spec_of(default_layout))


def test_views_without_a_common_region_are_refused(default_layout: Layout) -> None:
    corner = default_layout.mirrors[0].outline_normalized
    tiny = recut(default_layout.mirrors[0], corner[3] + 0.02 * (corner - corner[3]))
    with pytest.raises(InfeasibleDesign, match="overlap constraint: no point at 300 mm is seen by all views"):
        verify(with_mirror(default_layout, 0, tiny), spec_of(default_layout))


def test_a_depth_among_the_mirrors_is_refused(default_layout: Layout) -> None:
    with pytest.raises(
        InfeasibleDesign, match=r"depth constraint: 40 mm is nearer than the mirrors, they reach 6\.\d+ mm"
    ):
        verify(default_layout, spec_of(default_layout).replaced(depths_mm=(40.0, 500.0)))


def test_half_spaces_hold_the_sheet(default_layout: Layout) -> None:
    for surface in ("first", "second"):
        mirror = default_layout.mirrors[2].replaced(surface=surface, thickness_mm=3.0)
        normals, offsets = half_spaces(mirror)
        heights = sheet_in_rig_mm(mirror) @ normals.T - offsets
        assert heights.max() < 1e-6
        # Each corner of a prism lies on three faces.
        assert_allclose(np.sum(np.abs(heights) < 1e-6, axis=1), 3)


def test_length_of_segments_inside_a_box() -> None:
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0])
    starts = np.array([[-1, 1, 1], [-1, 1, 1], [0.5, 0.5, 0.5], [-1, 5, 1], [0.5, -1, 1], [-1.0, 0.0, 0.0]])
    ends = np.array([[4, 1, 1], [0.25, 1, 1], [0.5, 0.5, 2.5], [4, 5, 1], [0.5, 9, 1], [0.0, 0.0, 0.0]])
    assert_allclose(length_inside_mm(starts, ends, normals, offsets), [1.0, 0.25, 2.0, 0.0, 2.0, 0.0], atol=1e-12)


def test_samples_cover_a_polygon_and_its_border() -> None:
    pentagon = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi * np.arange(5) / 5])
    points = sampled(pentagon, 12)
    for corner in pentagon:
        assert np.abs(points - corner).sum(axis=1).min() < 1e-12
    edge = np.roll(pentagon, -1, axis=0) - pentagon
    inside = [edge[:, 0] * (p - pentagon)[:, 1] - edge[:, 1] * (p - pentagon)[:, 0] for p in points]
    assert np.min(inside) > -1e-12


def test_a_mirror_before_another_takes_all_its_light(default_layout: Layout) -> None:
    # The same place of the image from 0.8 of the distance: every ray meets the nearer mirror first.
    behind, before = default_layout.mirrors[4], slid(default_layout.mirrors[4], 0.8)
    ways_in = {found.light_of: found for found in blocked_light((behind, before), 500.0) if found.leg == "in"}
    assert ways_in[0].sheet_of == 1
    assert ways_in[0].fraction > 0.8
    assert 1 not in ways_in
