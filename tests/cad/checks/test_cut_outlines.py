"""Mirrors read back from their sheets, and errors found in altered sheets."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from ezdxf.document import Drawing
from ezdxf.entities.lwpolyline import LWPolyline
from shapely import Polygon
from shapely.ops import nearest_points

from mirrorcam.cad.checks.cut_outlines import check_cuts, fits, mirror_fits, mirrors_as_cut, read_cuts
from mirrorcam.cad.mirrors.sheet_files import draw_sheet
from mirrorcam.cad.mirrors.stock_sheets import plan_sheets
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import mirror_prism
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout

CUTTING = HARDWARE.cutting.replaced(material="acrylic")
Spoil = Callable[[Drawing, list[LWPolyline]], None]


def failed(checks: dict[str, Metric]) -> set[str]:
    return {name for name, check in checks.items() if not check.passed}


def lines_on(drawing: Drawing, layer: str) -> list[LWPolyline]:
    return [line for line in drawing.modelspace() if isinstance(line, LWPolyline) and line.dxf.layer == layer]


def written(layout: Layout, folder: Path, spoil: Spoil | None = None) -> list[Path]:
    """The layout's sheets as files; a function of its drawing and its lines on CUT alters the first."""
    paths: list[Path] = []
    for planned in plan_sheets(layout, CUTTING):
        drawing = draw_sheet(planned)
        if spoil and not paths:
            spoil(drawing, lines_on(drawing, "CUT"))
        paths.append(folder / f"{planned.stem}.dxf")
        drawing.saveas(paths[-1])
    return paths


def spoilt(layout: Layout, folder: Path, spoil: Spoil) -> dict[str, Metric]:
    return check_cuts(written(layout, folder, spoil), layout, CUTTING)


def redraw(line: LWPolyline, corners: FloatArray) -> None:
    line.set_points(corners.tolist(), format="xy")


def points_of(line: LWPolyline) -> FloatArray:
    return np.array(line.get_points("xy"))


def test_sheets_as_written_pass(free_layout: Layout, tmp_path: Path) -> None:
    checks = check_cuts(written(free_layout, tmp_path), free_layout, CUTTING)
    assert failed(checks) == set()
    assert checks["outline_error_um"].value < 1e-3


def test_mirrors_as_cut_fill_the_layouts_sheets(free_layout: Layout, tmp_path: Path) -> None:
    laid = mirror_fits(read_cuts(written(free_layout, tmp_path))[0], free_layout, CUTTING)
    solids = mirrors_as_cut(laid, free_layout)
    assert list(solids) == [f"{t}-{s}" for t in range(3) for s in range(3)]
    for solid, mirror in zip(solids.values(), free_layout.mirrors, strict=True):
        area = Polygon(mirror.outline_in_plane_mm).area
        assert solid.volume() == pytest.approx(area * mirror.thickness_mm, rel=1e-9)
        corners = np.vstack([mirror_prism(mirror).base, mirror_prism(mirror).top])
        box = np.array(solid.bounding_box()).reshape(2, 3)
        np.testing.assert_allclose(box, [corners.min(axis=0), corners.max(axis=0)], atol=1e-9)


def test_several_kinds_of_mirrors_are_found_on_their_sheets(free_layout: Layout, tmp_path: Path) -> None:
    first, *others = free_layout.mirrors
    mixed = free_layout.replaced(mirrors=(first.replaced(thickness_mm=2.0), *others))
    paths = written(mixed, tmp_path)
    assert len(paths) == 2
    assert failed(check_cuts(paths, mixed, CUTTING)) == set()
    assert failed(check_cuts(paths[1:], mixed, CUTTING)) == {"outlines_missing"}
    assert failed(check_cuts([*paths, paths[0]], mixed, CUTTING)) == {"names_twice"}


def test_an_outline_cut_with_another_kerf_is_found(free_layout: Layout, tmp_path: Path) -> None:
    """Edges that are off by half of 0.02 mm move corners by more."""
    paths = written(free_layout, tmp_path)
    checks = check_cuts(paths, free_layout, CUTTING.replaced(kerf_mm=CUTTING.kerf_mm + 0.02))
    assert failed(checks) == {"outline_error_um"}
    assert 10.0 < checks["outline_error_um"].value < 30.0


@pytest.mark.parametrize("scale", [(1.0001, 1.0001), (-1.0, 1.0)])
def test_outlines_that_are_grown_or_turned_over_are_found(
    free_layout: Layout, tmp_path: Path, scale: tuple[float, float]
) -> None:
    def spoil(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        middle = np.array(CUTTING.sheet_mm) / 2.0
        for line in (*cuts, *lines_on(drawing, "ENGRAVE")):
            redraw(line, (points_of(line) - middle) * scale + middle)

    checks = spoilt(free_layout, tmp_path, spoil)
    assert "outline_error_um" in failed(checks)
    assert failed(checks) <= {"outline_error_um", "arrow_error_deg"}


def test_open_stray_and_missing_lines_are_found(free_layout: Layout, tmp_path: Path) -> None:
    def open_one(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        cuts[0].close(False)

    def add_one(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        drawing.modelspace().add_line((0.0, 0.0), (5.0, 5.0), dxfattribs={"layer": "CUT"})

    def drop_one(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        drawing.modelspace().delete_entity(cuts[0])

    assert failed(spoilt(free_layout, tmp_path, open_one)) == {"outlines_missing", "stray_cuts"}
    assert failed(spoilt(free_layout, tmp_path, add_one)) == {"stray_cuts"}
    assert failed(spoilt(free_layout, tmp_path, drop_one)) == {"outlines_missing"}


def test_a_file_in_inches_is_found(free_layout: Layout, tmp_path: Path) -> None:
    def spoil(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        drawing.header["$INSUNITS"] = 1

    assert failed(spoilt(free_layout, tmp_path, spoil)) == {"files_not_in_mm"}


@pytest.mark.parametrize(("gap_mm", "left"), [(0.4, 0.4), (-2.0, 0.0)])
def test_outlines_too_near_to_each_other_are_found(
    free_layout: Layout, tmp_path: Path, gap_mm: float, left: float
) -> None:
    def spoil(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        mine, other = Polygon(points_of(cuts[0])), Polygon(points_of(cuts[1]))
        start, end = (np.array(point.coords[0]) for point in nearest_points(mine, other))
        apart = np.linalg.norm(end - start)
        redraw(cuts[0], points_of(cuts[0]) + (end - start) * (1.0 - gap_mm / apart))

    checks = spoilt(free_layout, tmp_path, spoil)
    assert "outline_gap_mm" in failed(checks)
    assert checks["outline_gap_mm"].value <= left + 1e-9


def test_an_outline_off_its_sheet_is_found(free_layout: Layout, tmp_path: Path) -> None:
    def spoil(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        _, group = next(iter(drawing.groups))
        for line in group:
            assert isinstance(line, LWPolyline)
            redraw(line, points_of(line) - [1000.0, 0.0])

    assert failed(spoilt(free_layout, tmp_path, spoil)) == {"outlines_off_sheet"}


def test_marks_that_are_missing_outside_or_turned_are_found(free_layout: Layout, tmp_path: Path) -> None:
    def wiped(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        for line in lines_on(drawing, "ENGRAVE"):
            drawing.modelspace().delete_entity(line)

    def outside(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        line = lines_on(drawing, "ENGRAVE")[0]
        redraw(line, points_of(line) - np.array([0.0, 100.0]))

    def turned(drawing: Drawing, cuts: list[LWPolyline]) -> None:
        shaft = lines_on(drawing, "ENGRAVE")[0]
        redraw(shaft, points_of(shaft)[::-1])

    assert failed(spoilt(free_layout, tmp_path, wiped)) == {"marks_missing", "arrow_error_deg"}
    assert failed(spoilt(free_layout, tmp_path, outside)) == {"marks_off_mirror"}
    upside_down = spoilt(free_layout, tmp_path, turned)
    assert failed(upside_down) == {"arrow_error_deg"}
    assert upside_down["arrow_error_deg"].value == pytest.approx(180.0)


def test_the_arrow_tells_which_way_round_a_rectangle_lies(
    make_flat_pair: Callable[..., Layout], tmp_path: Path
) -> None:
    """A rectangle fits in two orientations, of which the one with the arrow up counts."""
    layout = make_flat_pair(gap_mm=8.0)
    cuts, _ = read_cuts(written(layout, tmp_path))
    for name, fit in mirror_fits(cuts, layout, CUTTING).items():
        up = fit.rotation @ (cuts[name].strokes[0][1] - cuts[name].strokes[0][0])
        assert up[1] > 0.0
        assert abs(up[0]) < 1e-9


def test_a_shape_is_the_same_when_moved_or_turned_but_not_when_mirrored_or_grown() -> None:
    def error(polygon: FloatArray) -> float:
        return min((fit.error_mm for fit in fits(polygon, shape)), default=np.inf)

    shape = np.array([[0.0, 0.0], [10.0, 1.0], [8.0, 7.0], [-1.0, 5.0]])
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    assert error(np.roll(shape @ turn.T + 5.0, 1, axis=0)[::-1]) < 1e-12
    assert error(shape * [-1.0, 1.0]) > 0.5
    assert 1e-3 < error(shape * 1.001) < 1e-2
    assert error(shape[:3]) == np.inf
    best = min(fits(shape @ turn.T + 5.0, shape), key=lambda fit: fit.error_mm)
    np.testing.assert_allclose(best.corners, shape, atol=1e-12)
    np.testing.assert_allclose(best.rotation, turn.T, atol=1e-12)
