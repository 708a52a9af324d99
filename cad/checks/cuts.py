"""Outlines of the mirrors, read back from the file that they are cut by and measured against the layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.filemanagement import readfile
from shapely import Point, Polygon, STRtree, unary_union

from cad.cutting import outline_from_back
from optics.layout import Layout
from optics.values import FloatArray, Metric


def check_dxf(path: Path, layout: Layout) -> dict[str, Metric]:
    """Every mirror is one closed outline on CUT, the same shape as in the layout seen from the back; its mark inside.

    Outlines are compared in the layout's order, moved and turned onto each other but never mirrored.
    """
    model = readfile(path).modelspace()
    lines = [line for line in model if isinstance(line, LWPolyline)]
    cuts = [line for line in lines if line.dxf.layer == "CUT"]
    outlines = [np.array(line.get_points("xy")) for line in cuts]
    marks = [np.array(line.get_points("xy")) for line in lines if line.dxf.layer == "ENGRAVE"]
    closed = [Polygon(outline) for line, outline in zip(cuts, outlines, strict=True) if line.closed]
    errors = [
        shape_error_mm(outline, outline_from_back(mirror)) * 1000.0
        for outline, mirror in zip(outlines, layout.mirrors, strict=False)
    ]
    tree = STRtree(closed)
    gaps = [
        closed[i].distance(closed[j]) for i in range(len(closed)) for j in tree.query(closed[i].buffer(10.0)) if j != i
    ]
    material = unary_union(closed)
    return {
        "outlines_missing": Metric(value=abs(len(layout.mirrors) - len(closed)), unit="", limit=0),
        "outlines_open": Metric(value=len(cuts) - len(closed), unit="", limit=0),
        "outline_error_um": Metric(value=max(errors, default=0.0), unit="um", limit=1.0),
        "outline_gap_mm": Metric(value=min(gaps, default=10.0), unit="mm", limit=0.5, lower_is_better=False),
        "marks_off_mirror": Metric(
            value=sum(not material.contains(Polygon(mark) if len(mark) > 3 else Point(mark[0])) for mark in marks),
            unit="",
            limit=0,
        ),
    }


def shape_error_mm(polygon: FloatArray, expected: FloatArray) -> float:
    """Largest distance between corners (n, 2) after the best move and turn, over where to start and which way round.

    Going the other way round the same corners is the same shape; a mirror image is not.
    """
    if len(polygon) != len(expected):
        return float(np.ptp(expected, axis=0).max())
    errors = []
    centred = expected - expected.mean(axis=0)
    for corners in (polygon, polygon[::-1]):
        for start in range(len(corners)):
            moved = np.roll(corners, start, axis=0)
            moved = moved - moved.mean(axis=0)
            # Closed form of the best turn in the plane.
            across = (moved[:, 0] * centred[:, 1] - moved[:, 1] * centred[:, 0]).sum()
            angle = np.arctan2(across, (moved * centred).sum())
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            errors.append(np.linalg.norm(moved @ turn.T - centred, axis=1).max())
    return float(min(errors))
