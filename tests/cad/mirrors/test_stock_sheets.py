"""The face of the stock that is up: never the coating, and the side from which drawings are seen.

Engraved marks: as high as requested or as fits, inside, upright and different from their mirror images.

Mirrors on sheets: correct shape, side and size, including the kerf, and separate sheets for each kind.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely import LineString, Polygon, union_all

from mirrorcam.cad.assembly.device_plan import plan_device
from mirrorcam.cad.checks.cut_outlines import fits
from mirrorcam.cad.mirrors.stock_sheets import (
    FACINGS,
    LINE_GAP_MM,
    TEST,
    StockSheet,
    Surface,
    facing_of,
    line_gap_mm,
    mark,
    offset_outline,
    outline_from_back,
    plan_sheets,
    sheet_metrics,
)
from mirrorcam.cad.plan.hardware import HARDWARE, Cutting
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror_stock import Material


@pytest.mark.parametrize("material", ["acrylic", "glass"])
@pytest.mark.parametrize("surface", ["first", "second"])
def test_the_laser_meets_the_face_that_is_glued(free_layout: Layout, surface: Surface, material: Material) -> None:
    """The back, at the lower of the two heights over the reflecting surface; the coating is never engraved."""
    facing = facing_of(surface, material)
    mirror = free_layout.mirrors[0].replaced(surface=surface)
    assert facing.up == "back"
    assert mirror.back_mm < mirror.front_mm
    coating_is_up = mirror.is_second_surface
    assert ("paint" in facing.marked.replace("paint marker", "")) == coating_is_up
    if material == "acrylic":
        assert ("not the paint" in facing.marked) == coating_is_up
    else:
        assert "marker" in facing.marked
    np.testing.assert_array_equal(
        facing.laser_view(mirror.outline_in_plane_mm), outline_from_back(mirror, Cutting(material=material))
    )


def test_a_drawing_from_the_front_is_the_mirror_image() -> None:
    facing = FACINGS["acrylic", "first"]
    outline = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 1.0)])
    np.testing.assert_array_equal(
        replace(facing, up="front").laser_view(outline), facing.laser_view(outline) * (1.0, -1.0)
    )


WIDE = np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 40.0], [0.0, 40.0]])


def test_a_mark_has_its_height_and_points_up_from_the_centre() -> None:
    strokes = mark("0-1", WIDE, 5.0)
    np.testing.assert_allclose(strokes[0][1] - strokes[0][0], [0.0, 5.0])
    corners = np.vstack(strokes)
    np.testing.assert_allclose((corners.min(axis=0) + corners.max(axis=0)) / 2.0, [30.0, 20.0])
    # One arrow of two strokes, and one stroke for each of 0, -, 1.
    assert len(strokes) == 5


@pytest.mark.parametrize("outline", [WIDE / 8.0, WIDE[::-1] / 8.0, np.array([[0.0, 0.0], [9.0, 1.0], [2.0, 12.0]])])
def test_a_mark_shrinks_until_it_keeps_the_line_gap(outline: np.ndarray) -> None:
    strokes = mark("10-11", outline, 5.0)
    assert np.ptp(np.vstack(strokes)[:, 1]) < 3.0
    gaps = [Polygon(outline).exterior.distance(LineString(stroke)) for stroke in strokes]
    assert all(Polygon(outline).contains(LineString(stroke)) for stroke in strokes)
    assert min(gaps) == pytest.approx(LINE_GAP_MM, abs=1e-9)


def test_a_narrow_mirror_is_marked_down_a_column() -> None:
    tall = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 30.0], [0.0, 30.0]])
    across, up = np.ptp(np.vstack(mark("2-0", tall, 5.0)), axis=0)
    assert across == pytest.approx(3.0 - 2.0 * LINE_GAP_MM)
    assert up > 3.0 * across


def test_glyphs_of_a_small_mirror_stay_apart() -> None:
    # Space for 3.5 x 1 mm within the line gap: an arrow, two digits and a dash, 0.5 mm apart.
    small = np.array([[0.0, 0.0], [4.6, 0.0], [4.6, 2.2], [0.0, 2.2]])
    arrow, head, *signs = (LineString(stroke) for stroke in mark("5-0", small, 5.0))
    figures = [union_all([arrow, head]), *signs]
    gaps = [figure.distance(other) for i, figure in enumerate(figures) for other in figures[i + 1 :]]
    assert min(gaps) >= LINE_GAP_MM - 1e-9


CUTTING = HARDWARE.cutting.replaced(material="acrylic")


def test_seen_from_the_back_right_is_rig_x_and_up_is_rig_z(free_layout: Layout) -> None:
    for mirror in free_layout.mirrors:
        flat = outline_from_back(mirror, CUTTING)
        rig = mirror.outline_in_rig_mm - mirror.outline_in_rig_mm.mean(axis=0)
        # The axes of the drawing in rig: (right, up, towards someone behind the mirror) must be right-handed.
        right, up = (np.linalg.lstsq(rig, flat[:, axis], rcond=None)[0] for axis in (0, 1))
        assert right[0] > 0.8
        assert up[2] > 0.3
        assert np.cross(right, up) @ mirror.normal_in_rig < -0.999


def test_every_mirror_is_cut_once_in_its_own_shape(free_layout: Layout) -> None:
    (sheet,) = plan_sheets(free_layout, CUTTING)
    assert tuple(cut.name for cut in sheet.cuts) == (*free_layout.mirror_names, TEST)
    np.testing.assert_allclose(sorted(np.ptp(sheet.cuts[-1].outline, axis=0)), [15.2, 20.2])
    for cut, mirror in zip(sheet.cuts[:-1], free_layout.mirrors, strict=True):
        finished = offset_outline(cut.outline, -CUTTING.kerf_mm / 2.0)
        expected = outline_from_back(mirror, CUTTING)
        assert min(fit.error_mm for fit in fits(finished, expected)) < 1e-9
        assert Polygon(finished).area == pytest.approx(Polygon(expected).area, rel=1e-12)
        assert all(Polygon(finished).contains(LineString(stroke)) for stroke in cut.strokes)


def test_the_arrow_rotates_with_its_mirror(free_layout: Layout) -> None:
    (sheet,) = plan_sheets(free_layout, CUTTING)
    for cut, mirror in zip(sheet.cuts[:-1], free_layout.mirrors, strict=True):
        upright = outline_from_back(mirror, CUTTING)
        path = cut.outline if Polygon(cut.outline).exterior.is_ccw else cut.outline[::-1]
        loop = offset_outline(upright, CUTTING.kerf_mm / 2.0)
        # The rotation by nesting, from corresponding corners; the arrow must have the same.
        turn = np.linalg.lstsq(loop - loop.mean(axis=0), path - path.mean(axis=0), rcond=None)[0].T
        np.testing.assert_allclose(turn @ turn.T, np.eye(2), atol=1e-9)
        shaft = cut.strokes[0][1] - cut.strokes[0][0]
        np.testing.assert_allclose(shaft / np.linalg.norm(shaft), turn @ [0.0, 1.0], atol=1e-9)


def test_an_offset_is_that_of_every_edge() -> None:
    triangle = np.array([[0.0, 0.0], [0.0, 30.0], [40.0, 0.0]])
    grown = offset_outline(triangle, 2.0)
    # A triangle offset by d has its inradius (10 here) larger by d, and remains similar.
    assert Polygon(grown).area == pytest.approx(600.0 * (12.0 / 10.0) ** 2)
    np.testing.assert_allclose(offset_outline(grown, -2.0)[:, 0].max(), 40.0)
    # A corner of 180 deg moves along the normal.
    flat = np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    np.testing.assert_allclose(sorted(map(tuple, offset_outline(flat, 1.0)))[1:3], [[-1.0, 11.0], [5.0, -1.0]])


def test_kinds_do_not_share_a_sheet(free_layout: Layout) -> None:
    first, *others = free_layout.mirrors
    mixed = free_layout.replaced(mirrors=(first.replaced(thickness_mm=2.0), *others))
    thin, thick = plan_sheets(mixed, CUTTING)
    assert (thin.thickness_mm, thick.thickness_mm) == (1.0, 2.0)
    assert [cut.name for cut in thick.cuts] == ["0-0", TEST]
    assert len(thin.cuts) == 8
    assert (thin.stem, thick.stem) == ("mirrors_1", "mirrors_2")
    assert "first-surface acrylic mirror, 2 mm" in " ".join(thick.notes)


def test_many_mirrors_take_several_sheets(make_parabola: Callable[..., Layout]) -> None:
    layout = make_parabola(3, 4, scale_mm=150.0)
    sheets = plan_sheets(layout, CUTTING.replaced(sheet_mm=(160.0, 130.0)))
    assert len(sheets) > 1
    assert sorted(cut.name for sheet in sheets for cut in sheet.cuts) == sorted([*layout.mirror_names, TEST])
    assert sum(sheet.use * 160.0 * 130.0 for sheet in sheets) == pytest.approx(
        20.2 * 15.2
        + sum(Polygon(offset_outline(outline_from_back(mirror, CUTTING), 0.1)).area for mirror in layout.mirrors)
    )


def test_a_mirror_too_large_or_too_narrow_is_refused_with_its_measure(make_flat_pair: Callable[..., Layout]) -> None:
    layout = make_flat_pair(gap_mm=2.0)
    with pytest.raises(InputError, match=r"mirror 0-0 is 30\.2 x 20\.2 mm as cut, expected at most 24 x 24 mm"):
        plan_sheets(layout, CUTTING.replaced(sheet_mm=(30.0, 30.0)))
    with pytest.raises(InputError, match=r"mirror 0-0 is 0\.90 mm across, expected at least its thickness, 1 mm"):
        plan_sheets(make_flat_pair(gap_mm=2.0, width_mm=0.9), CUTTING)


def test_the_limits_of_a_laser_are_measured(make_parabola: Callable[..., Layout]) -> None:
    sheets = plan_sheets(make_parabola(2, 2), CUTTING)
    metrics = sheet_metrics(sheets)
    assert all(metric.passed for metric in metrics.values())
    # Glyphs are 0.6 of half the mark's height apart, the arrow and the first glyph 0.7.
    assert metrics["line_gap_mm"].value == pytest.approx(0.6 * CUTTING.mark_mm / 2.0, abs=1e-5)


def test_broken_sheets_fail_their_metrics(make_parabola: Callable[..., Layout]) -> None:
    (sheet,) = plan_sheets(make_parabola(2, 2), CUTTING)

    def moved(sheet: StockSheet, by: tuple[float, float]) -> StockSheet:
        first, *others = sheet.cuts
        return replace(sheet, cuts=(replace(first, strokes=tuple(s + by for s in first.strokes)), *others))

    first = sheet.cuts[0]
    to_edge = first.outline[:, 0].min() + 0.2 - min(stroke[:, 0].min() for stroke in first.strokes)
    assert line_gap_mm(moved(sheet, (to_edge, 0.0))) < 0.5
    assert not sheet_metrics((moved(sheet, (to_edge, 0.0)),))["line_gap_mm"].passed
    assert not sheet_metrics((replace(sheet, thickness_mm=50.0),))["feature_of_thickness"].passed


def test_a_device_with_mirrors_that_cannot_be_cut_is_refused_first(make_flat_pair: Callable[..., Layout]) -> None:
    hardware = HARDWARE.replaced(cutting=CUTTING.replaced(sheet_mm=(30.0, 30.0)))
    with pytest.raises(InputError, match="mirror 0-0 is"):
        plan_device(make_flat_pair(gap_mm=2.0), hardware)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.integers(1, 4),
    cols=st.integers(1, 4),
    scale_mm=st.floats(40.0, 200.0),
    gap_mm=st.floats(0.5, 3.0),
    surface=st.sampled_from(["first", "second"]),
    thickness_mm=st.floats(1.0, 3.0),
    sheet_mm=st.sampled_from([(300.0, 200.0), (150.0, 100.0)]),
)
def test_any_layout_is_cut_completely_or_refused(
    make_parabola: Callable[..., Layout],
    rows: int,
    cols: int,
    scale_mm: float,
    gap_mm: float,
    surface: str,
    thickness_mm: float,
    sheet_mm: tuple[float, float],
) -> None:
    # Second-surface mirrors appear larger through their glass: at a smaller gap their outlines would overlap.
    gap_mm += thickness_mm if surface == "second" else 0.0
    layout = make_parabola(
        rows, cols, scale_mm=scale_mm, gap_mm=gap_mm, surface=surface, thickness_mm=round(thickness_mm, 1)
    )
    cutting = CUTTING.replaced(sheet_mm=sheet_mm)
    try:
        sheets = plan_sheets(layout, cutting)
    except InputError as refusal:
        measures = r"mirror (\d-\d|test) is [\d.]+ (mm across|x [\d.]+ mm as cut), expected at (most|least)"
        assert re.search(measures, str(refusal))
        return
    cuts = {cut.name: cut for sheet in sheets for cut in sheet.cuts}
    assert sorted(cuts) == sorted([*layout.mirror_names, TEST])
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        finished = offset_outline(cuts[name].outline, -cutting.kerf_mm / 2.0)
        assert min(fit.error_mm for fit in fits(finished, outline_from_back(mirror, CUTTING))) < 1e-8
        assert all(Polygon(finished).contains(LineString(stroke)) for stroke in cuts[name].strokes)
    metrics = sheet_metrics(sheets)
    assert metrics["feature_of_thickness"].passed
    for sheet in sheets:
        paths = [Polygon(cut.outline) for cut in sheet.cuts]
        assert all(a.distance(b) >= cutting.gap_mm - 1e-6 for i, a in enumerate(paths) for b in paths[i + 1 :])


def test_glass_is_cut_to_the_lines_themselves_and_by_no_laser(free_layout: Layout) -> None:
    glass = CUTTING.replaced(material="glass")
    thick = free_layout.replaced(mirrors=tuple(m.replaced(thickness_mm=2.0) for m in free_layout.mirrors))
    (sheet,) = plan_sheets(thick, glass)
    assert sheet.kind == "first-surface glass mirror, 2 mm"
    area = sum(Polygon(cut.outline).area for cut in sheet.cuts if cut.name != TEST)
    assert area == pytest.approx(sum(Polygon(m.outline_in_plane_mm).area for m in thick.mirrors), rel=1e-9)
    notes = "\n".join(sheet.notes)
    assert "no kerf is included. Glass is not cut by a laser" in notes
    assert "paint marker" in notes
    assert sheet_metrics((sheet,))["feature_of_thickness"].limit == 4.0


def test_glass_too_narrow_to_break_or_of_another_index_is_refused(make_flat_pair: Callable[..., Layout]) -> None:
    glass = CUTTING.replaced(material="glass")
    narrow = make_flat_pair(gap_mm=5.0, height_mm=7.0, thickness_mm=2.0)
    assert plan_sheets(narrow, CUTTING)
    with pytest.raises(
        InputError, match=r"mirror 0-0 is 7\.00 mm across, expected at least 4 times its thickness, 8 mm"
    ):
        plan_sheets(narrow, glass)
    layout = make_flat_pair(gap_mm=5.0, thickness_mm=2.0)
    acrylic = layout.replaced(
        mirrors=tuple(m.replaced(surface="second", refractive_index=1.49) for m in layout.mirrors)
    )
    with pytest.raises(InputError, match=r"refractive index of 1\.49, expected glass"):
        plan_sheets(acrylic, glass)
    assert plan_sheets(
        layout.replaced(mirrors=tuple(m.replaced(refractive_index=1.52) for m in acrylic.mirrors)), glass
    )
