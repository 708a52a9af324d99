"""Verification: it passes a valid layout and refuses each kind of invalid one, naming the constraint."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon
from shapely.ops import nearest_points

from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.design.assess.chief_rays import blocked_light, length_inside_mm, sampled
from mirrorcam.optics.design.assess.verify import require_passed, verify
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.program.seeds import faceted_parabola
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import area_mm2


def spec_of(layout: Layout) -> DesignSpec:
    assert layout.spec is not None
    return layout.spec


def with_mirror(layout: Layout, index: int, mirror: Mirror) -> Layout:
    return layout.replaced(mirrors=(*layout.mirrors[:index], mirror, *layout.mirrors[index + 1 :]))


def recut(mirror: Mirror, corners: FloatArray) -> Mirror:
    """The mirror's plane with another outline, given in normalized coordinates."""
    return mirror.replaced(outline_in_rig_mm=mirror.intersect(corners))


def slid(mirror: Mirror, along: float) -> Mirror:
    """The mirror with the same sub-image at another distance: all lengths scaled by `along`."""
    return mirror.replaced(
        virtual_centre_in_rig_mm=mirror.virtual_centre_in_rig_mm * along,
        outline_in_rig_mm=mirror.outline_in_rig_mm * along,
    )


def with_second_surfaces(layout: Layout, thickness_mm: float) -> Layout:
    """Second-surface mirrors whose apparent mirrors are the (first-surface) mirrors of a layout."""
    mirrors = [
        Mirror.second_surface(
            m.virtual_centre_in_rig_mm, m.outline_in_rig_mm, thickness_mm=thickness_mm, refractive_index=1.49
        )
        for m in layout.mirrors
    ]
    return layout.replaced(mirrors=tuple(mirrors))


def failures(layout: Layout, spec: DesignSpec) -> set[str]:
    return {name for name, metric in verify(layout, spec).items() if not metric.passed}


def test_the_default_layout_passes_in_every_figure(default_layout: Layout) -> None:
    verdict = verify(default_layout, spec_of(default_layout))
    require_passed(verdict)
    assert all(metric.passed and metric.limit is not None for metric in verdict.values())
    assert set(verdict) == {
        "unlike_spec",
        "outside_sensor_px",
        "shortest_edge_mm",
        "smallest_area_mm2",
        "smallest_seen_gap_mm",
        "smallest_gap_mm",
        "beyond_depth_mm",
        "common_area_300mm",
        "common_area_500mm",
        "blocked_light",
        "light_on_body",
        "smallest_body_gap_mm",
        "off_rectangle_mm",
        "off_size_mm",
    }
    assert verdict["smallest_gap_mm"].value == pytest.approx(1.0, abs=1e-3)
    assert verdict["smallest_gap_mm"].limit == pytest.approx(1.0 - 1e-4)
    assert verdict["smallest_seen_gap_mm"].value == pytest.approx(0.5, abs=1e-3)
    assert verdict["smallest_seen_gap_mm"].limit == pytest.approx(0.5 - 1e-4)


def test_a_mirror_nearer_to_the_camera_blocks_light(default_layout: Layout) -> None:
    # Its sub-image is unchanged, so only the beams that leave its neighbour meet it.
    broken = with_mirror(default_layout, 1, slid(default_layout.mirrors[1], 0.85))
    assert "blocked_light" in failures(broken, spec_of(default_layout).replaced(spacing_mm=0.0))
    blocked = blocked_light(broken.mirrors, 500.0)
    assert {(found.mirror, found.occluder, found.leg) for found in blocked} >= {(4, 1, "out")}


def test_a_thick_second_surface_mirror_blocks_light(free_layout: Layout) -> None:
    spec = spec_of(free_layout).replaced(spacing_mm=0.0, surface="second", thickness_mm=8.0)
    assert "blocked_light" in failures(with_second_surfaces(free_layout, 8.0), spec)


def test_mirrors_too_close_fail(default_layout: Layout) -> None:
    assert failures(default_layout, spec_of(default_layout).replaced(spacing_mm=1.5)) == {"smallest_gap_mm"}


def test_the_gap_between_sub_images_is_that_between_their_outlines(parabola_layout: Layout) -> None:
    # Cells are a third of the sensor, with a gap of a tenth: the smaller gap, between rows, in mm at 80 mm.
    gap_mm = 0.1 * (540 - 1) / 680.0 / 3 * 80.0
    spec = spec_of(parabola_layout)
    for layout in (parabola_layout, with_second_surfaces(parabola_layout, 3.0)):
        assert verify(layout, spec)["smallest_seen_gap_mm"].value == pytest.approx(gap_mm, rel=1e-6)
    larger = verify(parabola_layout, spec.replaced(scale_mm=160.0))
    assert larger["smallest_seen_gap_mm"].value == pytest.approx(2.0 * gap_mm)
    assert "smallest_seen_gap_mm" in failures(parabola_layout, spec.replaced(seen_gap_mm=gap_mm + 0.001))
    assert "smallest_seen_gap_mm" not in failures(parabola_layout, spec.replaced(seen_gap_mm=gap_mm))


def test_sub_images_too_close_fail_though_their_mirrors_are_far_apart(default_layout: Layout) -> None:
    spec = spec_of(default_layout).replaced(spacing_mm=0.0)
    assert failures(default_layout, spec.replaced(seen_gap_mm=0.6)) == {"smallest_seen_gap_mm"}
    upper, lower = (default_layout.mirrors[k].outline_normalized for k in (0, 3))
    start, end = (np.array(point.coords[0]) for point in nearest_points(Polygon(upper), Polygon(lower)))
    nearer = upper + (end - start) * (1.0 - 0.2 / 80.0 / np.linalg.norm(end - start))
    verdict = verify(with_mirror(default_layout, 0, recut(default_layout.mirrors[0], nearer)), spec)
    assert verdict["smallest_seen_gap_mm"].value == pytest.approx(0.2, abs=1e-3)
    with pytest.raises(InfeasibleDesign, match=r"two sub-images are 0\.2 mm apart, 0\.3 mm too close") as refusal:
        require_passed({"smallest_seen_gap_mm": verdict["smallest_seen_gap_mm"]})
    assert refusal.value.constraint == "seen gap"


def test_mirrors_too_small_to_cut_fail(default_layout: Layout) -> None:
    outlines = [mirror.outline_in_rig_mm for mirror in default_layout.mirrors]
    shortest = min(float(np.linalg.norm(o - np.roll(o, 1, axis=0), axis=1).min()) for o in outlines)
    requested = spec_of(default_layout).replaced(min_edge_mm=shortest + 0.01)
    assert failures(default_layout, requested) == {"shortest_edge_mm"}
    assert failures(default_layout, requested.replaced(min_edge_mm=shortest - 0.01)) == set()
    larger = min(area_mm2(mirror) for mirror in default_layout.mirrors) + 1.0
    assert failures(default_layout, requested.replaced(min_edge_mm=0.0, min_area_mm2=larger)) == {"smallest_area_mm2"}


def test_a_sub_image_off_the_sensor_fails_by_how_far_it_leaves(free_layout: Layout) -> None:
    corners = free_layout.mirrors[3].outline_normalized.copy()
    corners[[0, 3], 0] -= 10.0 / free_layout.camera.fx_px
    broken = with_mirror(free_layout, 3, recut(free_layout.mirrors[3], corners))
    assert "outside_sensor_px" in failures(broken, spec_of(free_layout))
    assert verify(broken, spec_of(free_layout))["outside_sensor_px"].value == pytest.approx(10.0, abs=0.1)


def test_a_sub_image_beyond_the_lens_model_fails(default_layout: Layout) -> None:
    # The lens folds outside the sensor; a mirror beyond that has no pixels there.
    camera = default_layout.camera.replaced(distortion=[-0.2, 0.0, 0.0, 0.0, 0.0])
    corners = default_layout.mirrors[3].outline_normalized.copy()
    corners[[0, 3], 0] = -1.1 * camera.valid_radius
    alone = Layout(rows=1, cols=1, camera=camera, mirrors=(recut(default_layout.mirrors[3], corners),))
    verdict = verify(alone, spec_of(default_layout).replaced(camera=camera))
    assert not {"smallest_gap_mm", "smallest_seen_gap_mm"} & set(verdict)
    assert verdict["outside_sensor_px"].value == pytest.approx(np.hypot(1920, 1080))


def test_views_without_a_common_region_fail(default_layout: Layout) -> None:
    corner = default_layout.mirrors[0].outline_normalized
    tiny = recut(default_layout.mirrors[0], corner[3] + 0.02 * (corner - corner[3]))
    broken = with_mirror(default_layout, 0, tiny)
    spec = spec_of(default_layout).replaced(min_edge_mm=0.0, min_area_mm2=0.0)
    assert failures(broken, spec) >= {"common_area_300mm"}
    assert verify(broken, spec)["common_area_300mm"].value == 0.0


def test_a_depth_among_the_mirrors_fails() -> None:
    spec = DesignSpec(fold_deg=90.0, depths_mm=(40.0, 500.0), shape="free")
    layout = faceted_parabola(spec)
    reach_mm = max(float(mirror.outline_in_rig_mm[:, 1].max()) for mirror in layout.mirrors)
    verdict = verify(layout, spec)
    assert {name for name, metric in verdict.items() if not metric.passed} == {"beyond_depth_mm", "common_area_40mm"}
    assert verdict["beyond_depth_mm"].value == pytest.approx(reach_mm - 40.0)


@pytest.mark.parametrize(
    ("changes", "count"),
    [
        ({"surface": "second"}, 9),
        ({"thickness_mm": 2.0}, 9),
        ({"refractive_index": 1.5}, 9),
        ({"rows": 4}, 1),
        ({"cols": 4, "rows": 2}, 2),
        ({"camera": Camera.c920().replaced(fx_px=1300.0)}, 1),
        ({"sides": 6}, 0),
        ({"fold_deg": 120.0 + 1e-6}, 1),
        ({"fold_deg": 120.0 + 1e-8}, 0),
    ],
)
def test_deviations_from_the_spec_are_counted(free_layout: Layout, changes: dict[str, object], count: int) -> None:
    spec = spec_of(free_layout).replaced(**changes)
    assert verify(free_layout, spec)["unlike_spec"].value == count


def test_more_corners_than_requested_are_counted(free_layout: Layout) -> None:
    corners = free_layout.mirrors[4].outline_normalized
    middle = (corners[:1] + corners[-1:]) / 2.0
    pentagon = recut(free_layout.mirrors[4], np.concatenate([corners, middle]))
    broken = with_mirror(free_layout, 4, pentagon)
    assert failures(broken, spec_of(free_layout)) == {"unlike_spec"}
    assert failures(broken, spec_of(free_layout).replaced(sides=5)) == set()


@pytest.mark.parametrize(
    ("name", "value", "constraint", "message"),
    [
        ("outside_sensor_px", 10.04, "sensor", "a sub-image extends 10 px beyond the sensor"),
        ("smallest_gap_mm", 0.5, "spacing", "two mirrors are 0.5 mm apart, 0.5 mm too close"),
        ("smallest_seen_gap_mm", 0.1, "seen gap", "two sub-images are 0.1 mm apart, 0.4 mm too close"),
        ("beyond_depth_mm", 6.78, "depth", "the mirrors reach 6.78 mm past the nearest depth"),
        ("common_area_300mm", 0.25, "overlap", "only 0.25 mm² are visible in all views at 300 mm"),
        ("blocked_light", 0.0312, "occlusion", "a mirror blocks 3.12% of the light of another"),
        ("shortest_edge_mm", 2.0, "edge", "a mirror has an edge of 2 mm, 1 mm too short"),
        ("smallest_area_mm2", 15.0, "area", "a mirror has 15 mm², 5 mm² too little"),
        ("unlike_spec", 3.0, "spec", "3 properties (camera, counts, view axes, mirrors) differ from the spec"),
    ],
)
def test_a_failed_figure_becomes_a_refusal_in_words(
    default_layout: Layout, name: str, value: float, constraint: str, message: str
) -> None:
    verdict = verify(default_layout, spec_of(default_layout))
    failed = verdict | {name: verdict[name].replaced(value=value)}
    with pytest.raises(InfeasibleDesign, match=re.escape(f"{constraint} constraint: {message}") + "$") as refusal:
        require_passed(failed)
    assert refusal.value.constraint == constraint


def test_a_design_that_misses_a_limit_is_never_given_out(
    default_layout: Layout, monkeypatch: pytest.MonkeyPatch
) -> None:
    missed = {"blocked_light": Metric(value=0.1, unit="of the light", limit=0.0)}
    monkeypatch.setattr("mirrorcam.optics.design.optimise.verify", lambda layout, spec: missed)
    with pytest.raises(InfeasibleDesign, match=r"a mirror blocks 10\.00% of the light of another"):
        design(DesignSpec(rows=1, cols=2))


def test_every_figure_of_a_verdict_has_its_words(default_layout: Layout) -> None:
    for name, metric in verify(default_layout, spec_of(default_layout)).items():
        limit = metric.limit or 0.0
        with pytest.raises(InfeasibleDesign):
            require_passed({name: metric.replaced(value=limit + 1.0 if metric.lower_is_better else limit - 1.0)})


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
    # The same sub-image at 0.8 of the distance: every ray meets the nearer mirror first.
    behind, before = default_layout.mirrors[4], slid(default_layout.mirrors[4], 0.8)
    ways_in = {found.mirror: found for found in blocked_light((behind, before), 500.0) if found.leg == "in"}
    assert ways_in[0].occluder == 1
    assert ways_in[0].fraction > 0.8
    assert 1 not in ways_in
