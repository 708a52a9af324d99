"""Mirrors as cut, read back from the laser's files and measured against the layout.

This check uses only the files' layers CUT and ENGRAVE and their groups `mirror_ROW-COLUMN`. Mirrors are drawn from the
back, larger than finished by half the kerf, anywhere on the stock sheet and rotated, but never flipped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import manifold3d
import numpy as np
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.filemanagement import readfile
from ezdxf.units import MM
from shapely import LineString, Polygon, STRtree, box
from shapely.geometry.polygon import orient

from mirrorcam.cad.plan.hardware import Cutting
from mirrorcam.cad.plan.rectangles import coupon_mirror_mm
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.transforms import transform

TEST = "test"
"""Name of the test mirror in the files."""
# Minimum distance between the laser's lines: closer lines merge.
MIN_LINE_GAP_MM = 0.5
# Upper limit of measured gaps between outlines.
MAX_GAP_MM = 10.0
MITRE_LIMIT = 100.0
# Fits whose errors differ by less are equally good: a rectangle fits in two orientations.
SAME_FIT_MM = 1e-3
MAX_ARROW_ERROR_DEG = 0.1


@dataclass(frozen=True)
class MirrorCut:
    """A mirror in its file: the laser's path (n, 2) and the engraved strokes (m, 2), the arrow's shaft first."""

    sheet: int
    path: FloatArray
    strokes: tuple[FloatArray, ...]

    def finished_outline(self, cutting: Cutting) -> FloatArray:
        """The outline (n, 2) of the cut mirror, without the kerf, counter-clockwise."""
        shrunk = orient(Polygon(self.path)).buffer(-cutting.allowance_mm, join_style="mitre", mitre_limit=MITRE_LIMIT)
        return np.array(orient(shrunk).exterior.coords)[:-1]


@dataclass(frozen=True)
class OutlineFit:
    """A rigid fit of one polygon onto another: corners (n, 2) in the order of the second, rotation (2, 2) and error."""

    corners: FloatArray
    rotation: FloatArray
    error_mm: float


def fits(polygon: FloatArray, expected: FloatArray) -> list[OutlineFit]:
    """Best rigid fits of a polygon's corners (n, 2) onto others (n, 2), for every starting corner and both orders.

    Empty if the counts differ. The same corners in reverse order are the same shape; a mirror image is not.
    """
    if len(polygon) != len(expected):
        return []
    candidates = []
    centre = expected.mean(axis=0)
    centred = expected - centre
    for corners in (polygon, polygon[::-1]):
        for start in range(len(corners)):
            source = np.roll(corners, start, axis=0)
            source = source - source.mean(axis=0)
            # Closed form of the best rotation in the plane.
            sine_sum = (source[:, 0] * centred[:, 1] - source[:, 1] * centred[:, 0]).sum()
            angle = np.arctan2(sine_sum, (source * centred).sum())
            rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            rotated = source @ rotation.T
            candidates.append(
                OutlineFit(rotated + centre, rotation, float(np.linalg.norm(rotated - centred, axis=1).max()))
            )
    return candidates


def read_cuts(paths: Sequence[Path]) -> tuple[dict[str, MirrorCut], dict[str, int]]:
    """Read the mirrors of all stock sheets, by row and column, and count errors in the files.

    Errors are lines on CUT that are not the closed outline of a named mirror, duplicate names, and files not in mm.
    """
    cuts: dict[str, MirrorCut] = {}
    errors = {"stray_cuts": 0, "names_twice": 0, "files_not_in_mm": 0}
    for sheet, path in enumerate(paths):
        drawing = readfile(path)
        errors["files_not_in_mm"] += drawing.units != MM
        errors["stray_cuts"] += sum(entity.dxf.layer == "CUT" for entity in drawing.modelspace())
        for group_name, group in drawing.groups:
            name = group_name.removeprefix("mirror_")
            # Groups are read as unordered sets; handles preserve the order of drawing.
            entities = sorted(group, key=lambda entity: int(entity.dxf.handle, 16))
            lines = [line for line in entities if isinstance(line, LWPolyline)]
            closed = [line for line in lines if line.dxf.layer == "CUT" and line.closed]
            if name == group_name or len(closed) != 1:
                continue
            errors["stray_cuts"] -= 1
            errors["names_twice"] += name in cuts
            strokes = tuple(np.array(line.get_points("xy")) for line in lines if line.dxf.layer == "ENGRAVE")
            cuts[name] = MirrorCut(sheet, np.array(closed[0].get_points("xy")), strokes)
    return cuts, errors


def mirror_fits(cuts: Mapping[str, MirrorCut], layout: Layout, cutting: Cutting) -> dict[str, OutlineFit]:
    """The fit of every finished outline in the files onto its mirror in the layout, both seen from the back."""
    best_fits = {}
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        if name not in cuts:
            continue
        candidates = fits(cuts[name].finished_outline(cutting), _from_back(mirror))
        min_error = min((fit.error_mm for fit in candidates), default=0.0)
        best = [fit for fit in candidates if fit.error_mm <= min_error + SAME_FIT_MM]
        if best:
            best_fits[name] = min(best, key=lambda fit: _arrow_error_deg(cuts[name], fit))
    return best_fits


def check_cuts(paths: Sequence[Path], layout: Layout, cutting: Cutting) -> dict[str, Metric]:
    """Check that every mirror occurs once, has its shape and an upright mark, and is on its sheet, clear of others."""
    cuts, errors = read_cuts(paths)
    best_fits = mirror_fits(cuts, layout, cutting)
    expected = {*layout.mirror_names, TEST}
    test_errors = [_test_error_mm(cuts[TEST], layout, cutting)] if TEST in cuts else []
    outlines = [(cut.sheet, Polygon(cut.path)) for cut in cuts.values()]
    tree = STRtree([outline for _, outline in outlines])
    gaps = [
        outline.distance(outlines[other][1])
        for index, (sheet, outline) in enumerate(outlines)
        for other in tree.query(outline.buffer(MAX_GAP_MM))
        if other != index and outlines[other][0] == sheet
    ]
    stock = box(0.0, 0.0, *cutting.sheet_mm)
    arrows = [_arrow_error_deg(cuts[name], fit) for name, fit in best_fits.items()]
    return {
        "outlines_missing": Metric(value=len(expected - {*best_fits, *cuts.keys() & {TEST}}), unit="", limit=0),
        "outlines_too_many": Metric(value=len(set(cuts) - expected), unit="", limit=0),
        **{name: Metric(value=count, unit="", limit=0) for name, count in errors.items()},
        "outline_error_um": Metric(
            value=max([*(fit.error_mm for fit in best_fits.values()), *test_errors], default=0.0) * 1000.0,
            unit="um",
            limit=1.0,
        ),
        "outline_gap_mm": Metric(
            value=min(gaps, default=MAX_GAP_MM), unit="mm", limit=MIN_LINE_GAP_MM, lower_is_better=False
        ),
        "outlines_off_sheet": Metric(
            value=sum(not stock.contains(outline) for _, outline in outlines), unit="", limit=0
        ),
        "marks_missing": Metric(value=sum(not cut.strokes for cut in cuts.values()), unit="", limit=0),
        "marks_off_mirror": Metric(
            value=sum(
                not Polygon(cut.finished_outline(cutting)).contains(LineString(stroke))
                for cut in cuts.values()
                for stroke in cut.strokes
            ),
            unit="",
            limit=0,
        ),
        "arrow_error_deg": Metric(value=max(arrows, default=0.0), unit="deg", limit=MAX_ARROW_ERROR_DEG),
    }


def _test_error_mm(cut: MirrorCut, layout: Layout, cutting: Cutting) -> float:
    """Error of the test mirror's outline; infinite for another number of corners."""
    expected = np.array(box(0.0, 0.0, *coupon_mirror_mm(layout)).exterior.coords)[:-1]
    return min((fit.error_mm for fit in fits(cut.finished_outline(cutting), expected)), default=np.inf)


def mirrors_as_cut(outlines: Mapping[str, OutlineFit], layout: Layout) -> dict[str, manifold3d.Manifold]:
    """The finished mirrors in their positions in the rig frame: right prisms from back to front, by row and column."""
    solids = {}
    for name, mirror in zip(layout.mirror_names, layout.mirrors, strict=True):
        if name in outlines:
            back = mirror.back_mm
            solids[name] = prism(mirror, outlines[name].corners, back, back + mirror.thickness_mm)
    return solids


def prism(mirror: Mirror, outline: FloatArray, low_mm: float, high_mm: float) -> manifold3d.Manifold:
    """The solid in the rig frame between two heights over the mirror plane, with an outline (n, 2) seen from behind."""
    in_plane = outline * (1.0, -1.0)
    ends = [np.column_stack([in_plane, np.full(len(in_plane), height)]) for height in (low_mm, high_mm)]
    return manifold3d.Manifold.hull_points(transform(mirror.rig_from_plane, np.concatenate(ends)))


def _arrow_error_deg(cut: MirrorCut, fit: OutlineFit) -> float:
    """Angle between the engraved arrow and the up direction, with the mirror as in the device; 180 without an arrow."""
    if not cut.strokes or len(cut.strokes[0]) != 2:
        return 180.0
    x, y = fit.rotation @ (cut.strokes[0][1] - cut.strokes[0][0])
    return float(np.degrees(abs(np.arctan2(x, y))))


def _from_back(mirror: Mirror) -> FloatArray:
    """The outline (n, 2) seen from the back: x as in the mirror's frame, y up, opposite to the frame's y."""
    return mirror.outline_in_plane_mm * (1.0, -1.0)
