"""Compute everything that the pages draw of a design: shapes, curves, figures and devices as built."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from shapely import Polygon

from mirrorcam.cad.plan.estimates import estimate_device
from mirrorcam.core.errors import InputError
from mirrorcam.core.figures.figure_labels import LABELS
from mirrorcam.core.figures.figure_texts import NONE, label_text, limit_text, sentence_case, value_text
from mirrorcam.core.values import FloatArray, Metric
from mirrorcam.optics.design.assess.depth_sigma import GRID_POINTS, mean_depth_sigma_mm
from mirrorcam.optics.design.assess.layout_metrics import evaluate, fitted_grid
from mirrorcam.optics.design.assess.monte_carlo import study
from mirrorcam.optics.design.assess.verify import verify
from mirrorcam.optics.geometry.design_spec import DesignSpec, box_corners
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.sub_images import FieldsOfView, fields_of_view, images_in_rig, vertices
from mirrorcam.optics.geometry.tolerances import Tolerances
from mirrorcam.optics.geometry.violation import LeastViolation
from mirrorcam.studio.design_values import (
    COMPARED,
    Curves,
    DesignDrawing,
    FigureText,
    Kind,
    MirrorDrawing,
    ToleranceBar,
    ToleranceBars,
    ViewRays,
    ViolationDrawing,
)

FIELD = "Field and depth range"
GROUPS: Mapping[str, Sequence[str]] = {
    "Overlap of the views": ("usable_efficiency", "pixel_efficiency", "overlap_iou", "whole_pupil", "grid_error"),
    FIELD: ("fov", "depth_nearest", "depth_farthest", "baseline"),
    "Depth": ("depth_sigma", "depth_resolution", "disparity"),
    "Focus of the camera": ("circle", "best_focus"),
    "Mirrors": ("shortest", "longest", "smallest", "largest", "slab"),
}
DEVICE = "Device on a desk, estimated \N{PLUS-MINUS SIGN} standard deviation of the error"
"""Titles of the groups of figures, with the prefixes of their figures' names."""

NEUTRAL = ("best_focus_mm",)
"""Figures of which neither the lower nor the higher is better."""

CURVE_POINTS, COARSE_CURVE_POINTS = 33, 9
COARSE_GRID_POINTS = 5
"""Points along each side of the grid over which the standard deviation of depth is averaged in previews."""
MAX_DEPTH_RATIO = 2.2
"""Largest depth of the curves, relative to the farthest working depth."""
MM_DECIMALS, PX_DECIMALS, RAY_DECIMALS = 2, 1, 5


def design_drawing(layout: Layout, spec: DesignSpec, kind: Kind) -> DesignDrawing:
    """Return the drawing of a layout for a spec, with the figures of the layout if it has them.

    Previews, drawn while a slider moves, have no checks, coarser curves and a rougher standard deviation of depth.
    Raises InputError if a working depth is nearer than the mirrors.
    """
    depths_mm = sorted(spec.depths_mm)
    views = fields_of_view(layout, layout.camera.pupil)
    coarse = kind != "exact"
    grid_points = COARSE_GRID_POINTS if coarse else GRID_POINTS
    metrics = layout.metrics or evaluate(layout, depths_mm, views, grid_points=grid_points)
    verdict = layout.verdict or ({} if coarse else verify(layout, spec))
    grid, spacings = fitted_grid(layout)
    return DesignDrawing(
        kind=kind,
        title=f"{layout.arrangement.text}, {spec.scale_mm:g} mm",
        identity=layout.identity,
        spec=spec.model_dump(mode="json"),
        depths_mm=depths_mm,
        view_from_rig=_rounded(layout.view_from_rig, RAY_DECIMALS + 3),
        sensor_px=(layout.camera.width_px, layout.camera.height_px),
        body_mm=_rounded(_body(layout) @ layout.view_from_rig.T, MM_DECIMALS),
        mirrors=_mirrors(
            layout.mirrors,
            layout.mirror_names,
            layout.view_from_rig.T,
            [_outline_px(layout, k) for k in range(len(layout.mirrors))],
            [layout.camera.pixels_from_normalized(vertices(part)) for part in views.sub_images],
        ),
        rays=_rays(views),
        common_px=[_common_px(layout, views, depth) for depth in depths_mm],
        centres_mm=_rounded(layout.virtual_centres_in_view_mm.reshape(-1, 3), MM_DECIMALS),
        grid_mm=_rounded(grid.reshape(-1, 3), MM_DECIMALS),
        neighbours=layout.arrangement.neighbours,
        central=layout.central_index,
        curves=_curves(layout, views, spacings, depths_mm, coarse=coarse),
        figures=_with_fields(grouped_figures(metrics), views, depths_mm) | {DEVICE: device_figures(layout)},
        verdict=[_figure(name, metric) for name, metric in verdict.items()],
    )


def violation_drawing(spec: DesignSpec, where: LeastViolation) -> ViolationDrawing:
    """Return the drawing of an infeasible request: its mirrors, whose sub-images may overlap, and the violations."""
    rotation, camera = spec.view_from_rig.T, spec.camera
    outlines = [camera.pixels_from_normalized(mirror.apparent.outline_normalized) for mirror in where.mirrors]
    body = next(iter(spec.keep_outs_in_rig_mm), np.zeros((0, 3)))
    return ViolationDrawing(
        sensor_px=(camera.width_px, camera.height_px),
        body_mm=_rounded(body @ rotation, MM_DECIMALS),
        mirrors=_mirrors(where.mirrors, spec.arrangement.names, rotation, outlines, [np.zeros((0, 2))] * len(outlines)),
        concerned=sorted({number for violation in where.violations for number in violation.mirrors}),
        places_mm=[_rounded(violation.place_in_rig_mm @ rotation, MM_DECIMALS) for violation in where.violations],
    )


def _rounded(points: FloatArray, decimals: int) -> list[list[float]]:
    rounded: list[list[float]] = (np.round(points, decimals) + 0.0).tolist()
    return rounded


def _body(layout: Layout) -> FloatArray:
    """Return corners (8, 3) of the camera's body in the rig frame, mm; empty if unknown."""
    return np.zeros((0, 3)) if layout.camera.body_mm is None else box_corners(*layout.camera.body_mm)


def _mirrors(
    mirrors: Sequence[Mirror],
    names: Sequence[str],
    rig_from_view: FloatArray,
    outlines_px: Sequence[FloatArray],
    usable_px: Sequence[FloatArray],
) -> list[MirrorDrawing]:
    """Return the drawing of each mirror; its chief ray extends as far beyond it as the farthest mirror is away."""
    beyond_mm = max(float(np.linalg.norm(mirror.outline_in_rig_mm.mean(axis=0))) for mirror in mirrors)
    return [
        MirrorDrawing(
            name=name,
            solid_mm=_rounded(mirror.solid.corners_in_rig_mm @ rig_from_view, MM_DECIMALS),
            chief_mm=_rounded(_chief(mirror, beyond_mm) @ rig_from_view, MM_DECIMALS),
            outline_px=_rounded(outline, PX_DECIMALS),
            usable_px=_rounded(usable, PX_DECIMALS),
        )
        for mirror, name, outline, usable in zip(mirrors, names, outlines_px, usable_px, strict=True)
    ]


def _outline_px(layout: Layout, index: int) -> FloatArray:
    straight = layout.camera.is_undistorted and not layout.mirrors[index].curvature_per_m.any()
    return layout.outline_px(index, points_per_edge=1 if straight else 8)


def _chief(mirror: Mirror, beyond_mm: float) -> FloatArray:
    """Return the chief ray (3, 3) in the rig frame, mm: the pupil, the mirror, and a point towards the scene."""
    apparent = mirror.apparent
    hit = apparent.intersect(apparent.outline_normalized.mean(axis=0))
    reflected = hit - apparent.virtual_centre_in_rig_mm
    return np.array([np.zeros(3), hit, hit + reflected * (beyond_mm / np.linalg.norm(reflected))])


def _rays(views: FieldsOfView) -> ViewRays:
    mirror = [k for k, part in views.corner_slices.items() for _ in range(part.start, part.stop)]
    directions = views.directions / views.directions[:, 2:]
    return ViewRays(
        mirror=mirror,
        points_mm=_rounded(views.origins_mm, MM_DECIMALS),
        directions=_rounded(directions, RAY_DECIMALS),
        reach_mm=round(views.mirror_depth_mm, MM_DECIMALS),
    )


def _common_px(layout: Layout, views: FieldsOfView, depth_mm: float) -> list[list[list[float]]]:
    region, _ = views.common_region(depth_mm)
    if region.is_empty:
        return []
    # With a distorted lens, edges are curved: draw a few points on each.
    outline = region if not layout.camera.is_undistorted else Polygon(vertices(region))
    return [_rounded(image, PX_DECIMALS) for image in layout.camera.project(images_in_rig(layout, outline, depth_mm))]


def _curves(
    layout: Layout, views: FieldsOfView, spacings: FloatArray, depths_mm: Sequence[float], *, coarse: bool
) -> Curves:
    nearest_mm = max(views.mirror_depth_mm * 1.02, 0.4 * depths_mm[0])
    farthest_mm = max(MAX_DEPTH_RATIO * depths_mm[-1], 1.1 * nearest_mm)
    sample_depths_mm = np.geomspace(nearest_mm, farthest_mm, COARSE_CURVE_POINTS if coarse else CURVE_POINTS)
    if not coarse:  # exact where designs are compared
        sample_depths_mm = np.unique(np.append(sample_depths_mm, depths_mm))
    focal_px = np.array([layout.camera.fx_px, layout.camera.fy_px])
    steps_px_mm = focal_px * np.abs(spacings)
    best_px_mm = float((steps_px_mm * layout.arrangement.extent).max())
    centre_mm = float(layout.virtual_centres_in_view_mm.reshape(-1, 3)[layout.central_index, 2])
    distances_mm = sample_depths_mm - centre_mm
    sigmas = [] if coarse else [mean_depth_sigma_mm(views, float(depth)) for depth in sample_depths_mm]
    return Curves(
        depths_mm=np.round(sample_depths_mm, 1).tolist(),
        usable=[round(views.pixel_efficiency(views.common_region(depth)[0], depth), 5) for depth in sample_depths_mm],
        disparity_px=np.round(steps_px_mm.max() / distances_mm, 4).tolist(),
        resolution_mm=np.round(distances_mm**2 / best_px_mm, 5).tolist(),
        sigma_mm=[None if sigma is None or not math.isfinite(sigma) else round(sigma, 5) for sigma in sigmas],
    )


def _figure(name: str, metric: Metric) -> FigureText:
    return FigureText(
        name=name,
        label=sentence_case(label_text(name, LABELS)),
        text=value_text(metric) if metric.known else NONE,
        value=metric.value if metric.known else None,
        reason=metric.reason,
        limit="" if metric.limit is None else limit_text(metric),
        passed=metric.passed,
        lower_is_better=None if name in NEUTRAL else metric.lower_is_better,
    )


def grouped_figures(metrics: Mapping[str, Metric]) -> dict[str, list[FigureText]]:
    """Return figures by the titles of their groups, in the order of `GROUPS`."""

    def figures_of(prefixes: Iterable[str]) -> list[FigureText]:
        return [_figure(n, m) for prefix in prefixes for n, m in metrics.items() if n.startswith(prefix)]

    return {title: members for title, prefixes in GROUPS.items() if (members := figures_of(prefixes))}


def _with_fields(
    groups: dict[str, list[FigureText]], views: FieldsOfView, depths_mm: Sequence[float]
) -> dict[str, list[FigureText]]:
    """Return groups of figures with the extent of the field that all views share at each depth."""
    fields = []
    for depth_mm in depths_mm:
        region, _ = views.common_region(depth_mm)
        left, top, right, bottom = region.bounds if not region.is_empty else (0.0, 0.0, 0.0, 0.0)
        fields.append(
            FigureText(
                name=f"common_field_{depth_mm:g}mm",
                label=f"Field of all views at {depth_mm:g} mm",
                text=f"{right - left:.0f} x {bottom - top:.0f} mm",
                value=right - left,
                lower_is_better=False,
            )
        )
    return {title: ([*fields, *figures] if title == FIELD else figures) for title, figures in groups.items()}


def device_figures(layout: Layout) -> list[FigureText]:
    """Return price, size, mass and printing time of a device, with the standard deviations of their errors."""
    labels = ("Price with the camera", "Width, height and depth", "Mass with the camera", "Printing time")
    names = ("device_price", "device_size", "device_mass", "device_print")
    reason, found = "", list[tuple[str, float | None]]([(NONE, None)] * len(names))
    try:
        device = estimate_device(layout)
        sides = " x ".join(f"{side:.0f}" for side in device.size_mm)
        price = f"{device.price_eur:.0f} EUR ± {device.price_error_eur:.1f} ({device.price_text})"
        found = [
            (price, device.price_eur),
            (f"{sides} mm ± {device.size_error_mm:.0f}", max(device.size_mm)),
            (f"{device.mass_g:.0f} g ± {device.mass_error_g:.0f}", device.mass_g),
            (f"{device.print_h:.1f} h ± {device.print_error_h:.1f}", device.print_h),
        ]
    except InputError as error:  # no device stands like this
        reason = str(error)
    return [
        FigureText(name=name, label=label, text=text, value=value, reason=reason)
        for name, label, (text, value) in zip(names, labels, found, strict=True)
    ]


def compared_values(figures: Mapping[str, Sequence[FigureText]]) -> dict[str, float | None]:
    """Return the means of the figures in `COMPARED`; None for those without a value."""
    values: dict[str, float | None] = {}
    for start in (compared.start for compared in COMPARED):
        found = [
            f.value for group in figures.values() for f in group if f.name.startswith(start) and f.value is not None
        ]
        values[start] = sum(found) / len(found) if found else None
    return values


def tolerance_bars(layout: Layout) -> ToleranceBars:
    """Return figures of devices built by hand, at the depths of the layout's spec. Raises InputError as `study`."""
    tolerances = Tolerances.hobby()
    results = study(layout, tolerances, sorted(layout.designed_spec.depths_mm))
    bars = []
    for name, spread in results.spreads[1.0].items():
        ends = [value_text(Metric(value=value, unit=spread.unit)) for value in (spread.low, spread.high)]
        bars.append(
            ToleranceBar(
                label=sentence_case(label_text(name, LABELS)),
                design=spread.nominal,
                low=spread.low,
                median=spread.median,
                high=spread.high,
                text=f"{ends[0]} to {ends[1]}",
            )
        )
    assumed = f"{results.devices} devices, standard deviations of {tolerances.workmanship}; 90 % of them lie in the bar"
    return ToleranceBars(assumed=assumed, hidden=results.hidden[1.0], bars=bars)
