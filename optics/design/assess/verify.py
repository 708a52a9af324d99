"""Independent verification of a layout by polygon clipping and ray casting; shares no code with the optimiser."""

from __future__ import annotations

import numpy as np

from mirrorcam.core.values import Metric
from mirrorcam.optics.design.assess.chief_rays import TOUCH_MM, blocked_light, length_inside_mm, traced_to
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign, box_corners
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import (
    area_mm2,
    edges_mm,
    hull_distance,
    smallest_gap_mm,
    smallest_sub_image_gap,
)
from mirrorcam.optics.geometry.sub_images import fields_of_view

LENGTH_TOLERANCE_MM = 1e-4
AREA_TOLERANCE_MM2 = 1e-3
SENSOR_TOLERANCE_PX = 0.05
AXES_TOLERANCE = 1e-9
MIN_COMMON_AREA_MM2 = 1.0

FINDINGS = {
    "unlike_spec": ("spec", "{value:g} properties (camera, counts, view axes, mirrors) differ from the spec"),
    "outside_sensor_px": ("sensor", "a sub-image extends {value:.3g} px beyond the sensor"),
    "smallest_gap_mm": ("spacing", "two mirrors are {value:.4g} mm apart, {missing:.3g} mm too close"),
    "smallest_seen_gap_mm": ("seen gap", "two sub-images are {value:.3g} mm apart, {missing:.3g} mm too close"),
    "beyond_depth_mm": ("depth", "the mirrors reach {value:.3g} mm past the nearest depth"),
    "common_area": ("overlap", "only {value:.3g} mm² are visible in all views at {depth}"),
    "blocked_light": ("occlusion", "a mirror blocks {value:.2%} of the light of another"),
    "light_on_body": ("body", "the camera with its clip blocks {value:.2%} of the light of a mirror"),
    "smallest_body_gap_mm": ("body", "a mirror is {value:.4g} mm from the camera's body, {missing:.3g} mm too close"),
    "shortest_edge_mm": ("edge", "a mirror has an edge of {value:.4g} mm, {missing:.3g} mm too short"),
    "smallest_area_mm2": ("area", "a mirror has {value:.4g} mm², {missing:.3g} mm² too little"),
    "off_rectangle_mm": ("shape", "a mirror is {value:.3g} mm off a rectangle"),
    "off_size_mm": ("size", "a mirror is {value:.3g} mm off an allowed size"),
    "size_spread_mm": ("size", "the sizes of the mirrors differ by {value:.3g} mm"),
}
"""Constraint and finding to report for a failed metric, by name without depth ("seen gap": between sub-images)."""


def _differs(mirror: Mirror, spec: DesignSpec) -> bool:
    """Whether a mirror has more corners than requested, a different reflecting surface, or different glass."""
    requested = (spec.surface, spec.thickness_mm, spec.refractive_index)
    actual = (mirror.surface, mirror.thickness_mm, mirror.refractive_index)
    return actual != requested or len(mirror.outline_in_rig_mm) > spec.sides


def _unlike_spec(layout: Layout, spec: DesignSpec) -> int:
    """Number of properties and mirrors that differ from the spec."""
    requested = spec.arrangement
    properties = (
        (layout.camera, spec.camera),
        (layout.rows, requested.rows),
        (layout.cols, requested.cols),
        (layout.pattern, requested.pattern),
    )
    rotated = not np.allclose(layout.view_from_rig, spec.view_from_rig, rtol=0.0, atol=AXES_TOLERANCE)
    return (
        sum(actual != expected for actual, expected in properties)
        + int(rotated)
        + sum(_differs(mirror, spec) for mirror in layout.mirrors)
    )


def _outside_sensor_px(layout: Layout) -> float:
    """Largest distance of a sub-image beyond the sensor; its diagonal if one exceeds the lens model's range."""
    size = np.array([layout.camera.width_px, layout.camera.height_px], dtype=np.float64)
    outlines = np.concatenate([layout.outline_px(k, points_per_edge=64) for k in range(len(layout.mirrors))])
    outside = np.maximum(-0.5 - outlines, outlines - (size - 0.5)).max()
    return float(np.linalg.norm(size)) if np.isnan(outside) else max(float(outside), 0.0)


def verify(layout: Layout, spec: DesignSpec) -> dict[str, Metric]:
    """Compute each metric that a spec limits.

    Rays are cast to the farthest depth. Gaps are measured in space between the solids of mirrors, where walls are
    printed. Limits on lengths are relaxed by `LENGTH_TOLERANCE_MM`, far below manufacturing tolerances.

    Parameters
    ----------
    layout : the layout to verify.
    spec : the spec that it should meet.

    Returns
    -------
    Metrics by name, with their limits; `require_passed` raises an error for a missed limit.
    """
    mirrors = layout.mirrors
    verdict = {
        "unlike_spec": Metric(value=_unlike_spec(layout, spec), unit="parts", limit=0.0),
        "outside_sensor_px": Metric(value=_outside_sensor_px(layout), unit="px", limit=SENSOR_TOLERANCE_PX),
    }
    minima = {
        "shortest_edge_mm": (min(edges_mm(m).min() for m in mirrors), spec.min_edge_mm, LENGTH_TOLERANCE_MM, "mm"),
        "smallest_area_mm2": (min(area_mm2(m) for m in mirrors), spec.min_area_mm2, AREA_TOLERANCE_MM2, "mm²"),
    }
    verdict |= _rectangles(mirrors, spec)
    if len(mirrors) > 1:
        gap_mm = smallest_sub_image_gap(mirrors) * spec.scale_mm
        minima["smallest_seen_gap_mm"] = (gap_mm, spec.seen_gap_mm, LENGTH_TOLERANCE_MM, "mm")
        minima["smallest_gap_mm"] = (smallest_gap_mm(layout.mirrors), spec.spacing_mm, LENGTH_TOLERANCE_MM, "mm")
    for name, (value, requested, tolerance, unit) in minima.items():
        limit = max(requested - tolerance, 0.0)
        verdict[name] = Metric(value=float(value), unit=unit, limit=limit, lower_is_better=False)
    views = fields_of_view(layout)
    beyond_mm = max(views.mirror_depth_mm - min(spec.depths_mm), 0.0)
    verdict["beyond_depth_mm"] = Metric(value=beyond_mm, unit="mm", limit=0.0)
    for depth_mm in spec.depths_mm:
        area = views.common_region(depth_mm)[0].area if depth_mm > views.mirror_depth_mm else 0.0
        verdict[f"common_area_{depth_mm:g}mm"] = Metric(
            value=area, unit="mm²", limit=MIN_COMMON_AREA_MM2, lower_is_better=False
        )
    blocked = blocked_light(mirrors, max(spec.depths_mm), view_axis=layout.view_from_rig[2], pupil=layout.camera.pupil)
    fraction = max((occlusion.fraction for occlusion in blocked), default=0.0)
    verdict["blocked_light"] = Metric(value=fraction, unit="of the light", limit=0.0)
    return verdict | _clear_of_body(layout, spec)


def _rectangles(mirrors: tuple[Mirror, ...], spec: DesignSpec) -> dict[str, Metric]:
    """Differences of the mirrors from rectangles of the allowed sizes; empty for free outlines.

    A quadrilateral is a rectangle if opposite edges, and the diagonals, have equal lengths.
    """
    if (sizes := spec.rectangle_sizes) is None:
        return {}
    off_rectangle_mm, sizes_mm = [], []
    for mirror in mirrors:
        edges = edges_mm(mirror)
        if len(edges) != 4:
            return {"off_rectangle_mm": Metric(value=float(edges.max()), unit="mm", limit=LENGTH_TOLERANCE_MM)}
        diagonals = np.linalg.norm(mirror.outline_in_rig_mm[:2] - mirror.outline_in_rig_mm[2:], axis=1)
        off_rectangle_mm.append(np.abs([*(edges[:2] - edges[2:]), diagonals[0] - diagonals[1]]).max())
        sizes_mm.append(edges[:2])
    figures = {
        "off_rectangle_mm": float(max(off_rectangle_mm)),
        "off_size_mm": max(sizes.error_mm(size) for size in sizes_mm),
    }
    if spec.same_size:
        figures["size_spread_mm"] = float(np.ptp(np.sort(sizes_mm, axis=1), axis=0).max())
    return {name: Metric(value=value, unit="mm", limit=LENGTH_TOLERANCE_MM) for name, value in figures.items()}


def _clear_of_body(layout: Layout, spec: DesignSpec) -> dict[str, Metric]:
    """Fraction of rays that meet a box around the camera, and the smallest gap of a mirror from the camera's body."""
    body = spec.camera.body_mm
    if body is None:
        return {}
    faces = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = [
        np.concatenate([box.max(axis=0), -box.min(axis=0)]) - LENGTH_TOLERANCE_MM for box in spec.keep_outs_in_rig_mm
    ]
    fractions, gaps, corners_mm = [0.0], [], box_corners(*body)
    for mirror in layout.mirrors:
        _, _, starts, ends = traced_to(mirror, layout.camera.pupil, max(spec.depths_mm), layout.view_from_rig[2])
        if len(starts):
            inside_mm = [length_inside_mm(starts, ends, faces, box_offsets) for box_offsets in offsets]
            fractions.append(float(np.mean(np.max(inside_mm, axis=0) > TOUCH_MM)))
        gaps.append(hull_distance(mirror.solid.corners_in_rig_mm, corners_mm))
    limit = max(spec.body_clearance_mm - LENGTH_TOLERANCE_MM, 0.0)
    return {
        "light_on_body": Metric(value=max(fractions), unit="of the light", limit=0.0),
        "smallest_body_gap_mm": Metric(value=min(gaps), unit="mm", limit=limit, lower_is_better=False),
    }


def require_passed(verdict: dict[str, Metric]) -> None:
    """Raise InfeasibleDesign, which names the constraint, if a metric of a verdict misses its limit."""
    for name, metric in verdict.items():
        if metric.passed:
            continue
        stem, _, depth = name.rpartition("_") if name.startswith("common_area_") else (name, "", "")
        constraint, finding = FINDINGS[stem]
        missing = abs(metric.value - (metric.limit or 0.0))
        raise InfeasibleDesign(
            constraint, finding.format(value=metric.value, missing=missing, depth=depth.replace("mm", " mm"))
        )
