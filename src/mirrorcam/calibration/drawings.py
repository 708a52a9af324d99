"""Drawings of a calibration: residuals, coverage, poses of the board, and standard deviations of every view."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.stats import norm

from mirrorcam.core.figures.figure_texts import SIGMA, count_text
from mirrorcam.core.html.inline_svg import Scale, axes, coordinate, drawing, line, points, text
from mirrorcam.core.images.pictures import encoded_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration, ViewPicture
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import DepthUncertainty, ProjectionMap
from mirrorcam.optics.calibration.diagnostics.view_statistics import (
    ARROWS_ACROSS,
    ViewFigures,
    board_normals,
    calibrated_views,
    cell_means,
)
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.layout import Layout

WIDTH = 1030.0
HALF = 505.0
MARGIN = 0.03  # of the sensor's width, around the part shown
NEEDLE_CELLS = 0.9
"""Length of a needle of RMS size, in cells of the sensor."""
NEEDLE_FRACTION = 0.06
"""The same in a single view, as a fraction of the drawing's width."""
JPEG_QUALITY = 80


@dataclass(frozen=True)
class _Window:
    """The part of the sensor in a drawing: `corner_px` (2,) at its top left, `scale` units per px."""

    corner_px: FloatArray
    scale: float
    height: float

    def __call__(self, pixels: FloatArray) -> FloatArray:
        """Positions in the drawing of pixels (..., 2)."""
        return np.asarray((pixels - self.corner_px) * self.scale)


def _window(layout: Layout, views: Sequence[ViewFigures], width: float) -> _Window:
    """The part of the sensor that the views cover, with a margin, scaled to a width."""
    outlines = np.concatenate([view.outline_px for view in views])
    size = np.array([layout.camera.width_px, layout.camera.height_px])
    margin = MARGIN * layout.camera.width_px
    low = np.maximum(outlines.min(axis=0) - margin, -0.5)
    high = np.minimum(outlines.max(axis=0) + margin, size - 0.5)
    scale = width / float(high[0] - low[0])
    return _Window(low, scale, float(high[1] - low[1]) * scale)


def _outlines(views: Sequence[ViewFigures], window: _Window) -> str:
    return "".join(f'<polygon points="{points(window(view.outline_px))}" class="outline"/>' for view in views)


def _tags(views: Sequence[ViewFigures], window: _Window, *, label: Callable[[ViewFigures], str]) -> str:
    """Labels in the top left corner of every mirror's sub-image, to be drawn last; none for the complete sensor."""
    parts = []
    for view in views:
        if view.view != DIRECT:
            x, y = window(view.outline_px[np.argmin(view.outline_px.sum(axis=1))])
            parts.append(text(x + 7, y + 16, label(view), anchor="start", style="tag"))
    return "".join(parts)


def residual_needles(calibration: Calibration, views: Sequence[ViewFigures]) -> str:
    """Draw mean residuals in cells of the sensor as needles, red where noise does not explain them."""
    direct = len(views) == 1 and views[0].view == DIRECT
    width = HALF if direct else WIDTH
    window = _window(calibration.layout, views, width)
    cell = calibration.layout.camera.width_px / ARROWS_ACROSS * window.scale
    all_means = [cell_means(calibration, view.view) for view in views]
    lengths = np.concatenate([means.mean_px for means in all_means])
    rms = float(np.sqrt(np.mean(np.sum(lengths**2, axis=1)))) if len(lengths) else 1.0
    gain = NEEDLE_CELLS * cell / max(rms, 1e-12)
    parts = [_outlines(views, window)]
    for means in all_means:
        for point, mean, systematic in zip(means.centres_px, means.mean_px, means.systematic, strict=True):
            start, vector = window(point), mean * gain
            length = float(np.linalg.norm(vector))
            normal = np.array([-vector[1], vector[0]]) / max(length, 1e-9) * 1.3
            needle = points([start - normal, start + normal, start + vector])
            parts.append(f'<polygon points="{needle}" class="{"needle bad" if systematic else "needle"}"/>')
    parts.append(_tags(views, window, label=lambda view: view.name))
    step = float(f"{40.0 / gain:.0e}")
    y = window.height + 22
    parts.append(line(2, y - 4, 2 + step * gain, y - 4, "ruler"))
    parts.append(
        text(10 + step * gain, y, f"{step:g} px, scale {gain / window.scale:.0f}:1", anchor="start", style="tick")
    )
    return drawing(width, window.height + 30, "".join(parts), "Mean residuals over the sensor")


def view_with_residuals(calibration: Calibration, view: ViewPicture, name: str) -> str:
    """Draw the residuals of a view's corners into its picture, red for outliers; `name` is unique in the page."""
    height, width = view.grey.shape
    scale = HALF / width
    shown = view.grey
    if scale < 1.0:
        shown = np.asarray(cv2.resize(shown, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    jpeg = base64.b64encode(encoded_image(shown, ".jpg", JPEG_QUALITY)).decode()
    observations = calibration.observations
    rows = (observations.frame == view.frame) & (observations.view == view.view)
    residuals, inliers = calibration.residuals_px[rows], calibration.inliers[rows]
    start = (observations.pixels[rows] - view.left_top_px + 0.5) * scale
    rms = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    gain = NEEDLE_FRACTION * HALF / max(rms, 1e-12)
    size = f'width="{coordinate(HALF)}" height="{coordinate(height * scale)}"'
    parts = [f'<image href="data:image/jpeg;base64,{jpeg}" {size} preserveAspectRatio="none"/>']
    parts.append(f'<clipPath id="{name}"><rect {size}/></clipPath><g clip-path="url(#{name})">')
    for point, residual, inlier in zip(start, residuals, inliers, strict=True):
        vector = residual * gain
        normal = np.array([-vector[1], vector[0]]) / max(float(np.linalg.norm(vector)), 1e-9) * 1.6
        needle = points([point - normal, point + normal, point + vector])
        parts.append(f'<polygon points="{needle}" class="{"needle" if inlier else "needle bad"}"/>')
    parts.append("</g>")
    step = float(f"{40.0 / gain:.0e}")
    y = height * scale + 20
    parts.append(line(2, y - 4, 2 + step * gain, y - 4, "ruler"))
    parts.append(text(10 + step * gain, y, f"{step:g} px", anchor="start", style="tick"))
    return drawing(HALF, height * scale + 28, "".join(parts), "Residuals of one view in its picture")


def residual_histogram(calibration: Calibration) -> str:
    """Draw histograms of the residuals in x and y, standardised, and the normal distribution."""
    used = calibration.standardised[calibration.inliers]
    typical_px = float(np.median(calibration.corner_sigma_px[calibration.inliers]))
    edges = np.linspace(-5.0, 5.0, 51)
    counts = [np.histogram(values, edges)[0] for values in used.T]
    expected = len(used) * 0.2 * norm.pdf(np.linspace(-5.0, 5.0, 201))
    top = float(np.ceil(np.log10(max(int(np.max(counts)), 10)) * 2.0) / 2.0)
    x, y = Scale(-5.0, 5.0, 60, HALF - 10), Scale(-0.3, top, 260, 14)
    parts = []
    for power in range(int(top) + 1):
        parts.append(line(x.start, y(power), x.end, y(power), "grid"))
        parts.append(text(x.start - 8, y(power) + 4, f"{10**power:,}", anchor="end", style="tick"))
    visible = expected > 10.0**y.low
    grid = np.linspace(-5.0, 5.0, 201)
    for axis, values in zip("xy", counts, strict=True):
        heights = np.log10(np.maximum(values, 10.0**y.low))
        steps = [(x(edges[0]), y(y.low))]
        for left, right, high in zip(edges[:-1], edges[1:], heights, strict=True):
            steps += [(x(left), y(high)), (x(right), y(high))]
        parts.append(f'<polyline points="{points([*steps, (x(edges[-1]), y(y.low))])}" class="steps {axis}"/>')
    curve = [(x(point), y(np.log10(value))) for point, value in zip(grid[visible], expected[visible], strict=True)]
    parts.append(f'<polyline points="{points(curve)}" class="normal"/>')
    for value in x.ticks(10):
        parts.append(line(x(value), y.start, x(value), y.start + 5, "axis"))
        parts.append(text(x(value), y.start + 20, f"{value:g}".replace("-", "\N{MINUS SIGN}"), style="tick"))
    parts.append(line(x.start, y.start, x.end, y.start, "axis"))
    parts.append(
        text(
            (x.start + x.end) / 2,
            y.start + 40,
            f"residual in {SIGMA} of its corner (median {typical_px:.3g} px)",
            style="name",
        )
    )
    keys = (("steps x", "x"), ("steps y", "y"), ("normal", "normal"))
    for row, (style, name) in enumerate(keys):
        parts.append(line(x.end - 92, 26 + 18 * row, x.end - 68, 26 + 18 * row, style))
        parts.append(text(x.end - 62, 30 + 18 * row, name, anchor="start", style="tick"))
    return drawing(HALF, 308, "".join(parts), "Distribution of residuals against the normal distribution")


def coverage_map(layout: Layout, views: Sequence[ViewFigures]) -> str:
    """Draw the number of corners in cells of every view: the more, the darker; red without any.

    Cells are clipped to the outline of their view, and opaque, so that overlapping views do not add up.
    """
    mirrors = calibrated_views(views)
    width = WIDTH if layout.mirrors else HALF
    window = _window(layout, mirrors, width)
    max_value = max(int(view.cell_counts.max()) for view in mirrors)
    parts = []
    for view in mirrors:
        outline, clip = points(window(view.outline_px)), f"coverage-{view.view}"
        parts.append(f'<clipPath id="{clip}"><polygon points="{outline}"/></clipPath><g clip-path="url(#{clip})">')
        parts.append(f'<polygon points="{outline}" class="ground"/>')
        for (left, top, right, bottom), count in zip(
            window(view.cells_px.reshape(-1, 2, 2)).reshape(-1, 4), view.cell_counts, strict=True
        ):
            corner = f'x="{coordinate(left)}" y="{coordinate(top)}"'
            size = f'width="{coordinate(right - left)}" height="{coordinate(bottom - top)}"'
            shade = _corners_shade(int(count), max_value)
            parts.append(f"<rect {corner} {size} {shade}><title>{view.name}: {count} corners</title></rect>")
        parts.append("</g>")
    parts.append(_outlines(mirrors, window))
    parts.append(_tags(mirrors, window, label=lambda view: f"{view.name}: {view.coverage:.0%}"))
    counts = {0, 1, (max_value + 1) // 2, max_value} if layout.mirrors else {0, 1, max_value}
    parts.append(_corners_legend(counts, window.height + 10))
    return drawing(width, window.height + 30, "".join(parts), "Coverage of every view by corners")


def _corners_shade(count: int, max_value: int, style: str = "cell") -> str:
    return f'class="{style}" fill-opacity="{0.12 + 0.75 * count / max_value:.2f}"' if count else f'class="{style} none"'


def _corners_legend(counts: set[int], top: float) -> str:
    """Swatches of cells: without a corner, with one corner, and up to the largest count."""
    parts, x = [], 2.0
    for count in sorted(counts):
        parts.append(f'<rect x="{coordinate(x)}" y="{coordinate(top)}" width="24" height="14" ')
        parts.append(f"{_corners_shade(count, max(counts), 'key')}/>")
        label = "no corner in the cell" if count == 0 else count_text(count, "corner")
        parts.append(text(x + 31, top + 12, label, anchor="start", style="tick"))
        x += 60 + 7.5 * len(label)
    return "".join(parts)


def board_tilts(calibration: Calibration) -> str:
    """Draw the tilt of every board as a dot, in the direction of its nearer edge."""
    normals, mirrored = board_normals(calibration)
    tilts = np.degrees(np.arccos(np.clip(normals[:, 2], -1.0, 1.0)))
    flat = np.linalg.norm(normals[:, :2], axis=1)
    tilt_vectors = (
        np.divide(normals[:, :2], flat[:, None], out=np.zeros((len(flat), 2)), where=flat[:, None] > 0) * tilts[:, None]
    )
    step = 15.0 if tilts.max() <= 60.0 else 30.0
    max_tilt = max(45.0, step * float(np.ceil(tilts.max() / step)))
    centre, radius, top = HALF / 2.0, 130.0, 28.0
    x, y = (
        Scale(-max_tilt, max_tilt, centre - radius, centre + radius),
        Scale(-max_tilt, max_tilt, top + 2 * radius, top),
    )
    parts = []
    rings = np.arange(step, max_tilt + 1.0, step)
    for ring in rings:
        r = coordinate(radius * ring / max_tilt)
        parts.append(f'<circle cx="{coordinate(centre)}" cy="{coordinate(top + radius)}" r="{r}" class="ring"/>')
    parts.append(line(x.start, y(0), x.end, y(0), "grid") + line(centre, y.start, centre, y.end, "grid"))
    for (right, down), through in zip(tilt_vectors, mirrored, strict=True):
        point = f'cx="{coordinate(x(right))}" cy="{coordinate(y(-down))}"'
        parts.append(f'<circle {point} r="5" class="{"dot" if through else "dot open"}"/>')
    for ring in rings:
        normal = ring * np.sqrt(0.5)
        parts.append(text(x(normal), y(-normal) + 4, f"{ring:g}°", style="tick on"))
    parts.append(text(centre, y.end - 10, "top edge nearer", style="name"))
    parts.append(text(centre, y.start + 20, "bottom edge nearer", style="name"))
    parts.append(text(x.start - 8, y(0) + 4, "left edge nearer", anchor="end", style="name"))
    parts.append(text(x.end + 8, y(0) + 4, "right edge nearer", anchor="start", style="name"))
    return drawing(HALF, y.start + 32, "".join(parts), "Tilts of the board in every frame")


def board_distances(views: Sequence[ViewFigures]) -> str:
    """Draw distances of the board from the centre of each view's camera, a row for each view."""
    max_mm = max(float(view.distances_mm.max(initial=0.0)) for view in views)
    min_mm = min(float(view.distances_mm.min(initial=max_mm)) for view in views)
    margin = 0.08 * (max_mm - min_mm) + 1.0
    row = min(34.0, 300.0 / len(views))
    bottom = 10 + row * len(views)
    x = Scale(min_mm - margin, max_mm + margin, 84, HALF - 10)
    parts = []
    for value in x.ticks(5):
        parts.append(line(x(value), 10, x(value), bottom, "grid"))
        parts.append(text(x(value), bottom + 20, f"{value:g}", style="tick"))
    for index, view in enumerate(views):
        y = 10 + row * (index + 0.5)
        parts.append(text(76, y + 4, view.name, anchor="end", style="tick"))
        for distance, tilt in zip(view.distances_mm, view.tilts_deg, strict=True):
            point = f'cx="{coordinate(x(distance))}" cy="{coordinate(y)}" r="{min(5.0, row / 3):.1f}"'
            parts.append(
                f'<circle {point} class="dot faint"><title>{distance:.0f} mm, tilted {tilt:.0f}°</title></circle>'
            )
    parts.append(line(x.start, bottom, x.end, bottom, "axis"))
    parts.append(
        text(
            (x.start + x.end) / 2,
            bottom + 42,
            "distance from the virtual camera, or from the camera, mm" if len(views) > 1 else "distance, mm",
            style="name",
        )
    )
    return drawing(HALF, bottom + 54, "".join(parts), "Distances of the board in every view")


def projection_sigmas(
    layout: Layout,
    views: Sequence[ViewFigures],
    maps: Sequence[ProjectionMap],
    values: Sequence[FloatArray],
    max_value: float,
    *,
    name: str,
) -> str:
    """Draw standard deviations of projected points in several views, darker where they are larger.

    Parameters
    ----------
    layout
        The layout, whose sensor is shown.
    views
        Figures of the views, with their outlines.
    maps
        The pixels at which points were projected, for each view.
    values
        Standard deviations (n,) in px, at the pixels of each map.
    max_value
        Standard deviation in px of the darkest shade.
    name
        Beginning of the identifiers in the drawing, unique in the page.
    """
    outlines = {view.view: view for view in views}
    visible = [outlines[projection_map.view] for projection_map in maps]
    window = _window(layout, visible, HALF)
    parts = []
    for projection_map, sigmas in zip(maps, values, strict=True):
        clip = f"{name}-{projection_map.view}"
        outline = window(outlines[projection_map.view].outline_px)
        parts.append(
            f'<clipPath id="{clip}"><polygon points="{points(outline)}"/></clipPath><g clip-path="url(#{clip})">'
        )
        point = window(projection_map.pixels)
        step = [float(np.diff(np.unique(point[:, axis].round(3))).max(initial=1.0)) for axis in (0, 1)]
        for (x, y), sigma in zip(point, sigmas, strict=True):
            corner = f'x="{coordinate(x - step[0] / 2)}" y="{coordinate(y - step[1] / 2)}"'
            size = f'width="{coordinate(step[0])}" height="{coordinate(step[1])}"'
            shade = f'fill-opacity="{min(0.04 + 0.9 * sigma / max_value, 1.0):.2f}"'
            parts.append(f'<rect {corner} {size} class="shade" {shade}><title>{sigma:.2g} px</title></rect>')
        parts.append("</g>")
    medians = {
        projection_map.view: f"{np.median(sigmas):.2g}" if sigmas.max() > 1e-9 else "reference"
        for projection_map, sigmas in zip(maps, values, strict=True)
    }
    parts.append(_outlines(visible, window))
    parts.append(_tags(visible, window, label=lambda view: f"{view.name}: {medians[view.view]}"))
    return drawing(HALF, window.height, "".join(parts), "Standard deviations of projected points in every view")


def depth_sigmas(depth: DepthUncertainty, range_mm: float) -> str:
    """Draw the standard deviation of depth over the range: from matching, from calibration, and in total."""
    valid = np.isfinite(depth.total_mm)
    ranges, total = depth.range_mm[valid], depth.total_mm[valid]
    x = Scale(float(ranges[0]), float(ranges[-1]), 64, WIDTH - 150)
    y = Scale(0.0, 1.05 * float(total.max()), 270, 12)
    parts = [axes(x, y, "distance from the reference view, mm", f"{SIGMA} of depth, mm", x_ticks=9)]
    named = (("both", total), ("matching", depth.matching_mm[valid]), ("calibration", depth.calibration_mm[valid]))
    ends = sorted(((y(float(values[-1])), name) for name, values in named), reverse=True)
    label_y: dict[str, float] = {}
    for point, name in ends:  # from the bottom up, so that no label overlaps the one below
        label_y[name] = min([point, *(y - 16 for y in label_y.values())])
    for name, values in named:
        curve = [(x(float(r)), y(float(value))) for r, value in zip(ranges, values, strict=True)]
        parts.append(f'<polyline points="{points(curve)}" class="curve {name}"/>')
        label = f"{name}, {depth.matching_px:g} px" if name == "matching" else name
        parts.append(text(x.end + 8, label_y[name] + 4, label, anchor="start", style="tick"))
    if x.low <= range_mm <= x.high:
        parts.append(line(x(range_mm), y.start, x(range_mm), y.end, "here"))
        parts.append(
            text(x(range_mm) + 6, y.end + 12, f"boards were here: {range_mm:.0f} mm", anchor="start", style="tick")
        )
    return drawing(WIDTH, 318, "".join(parts), "Standard deviation of depth against range")
