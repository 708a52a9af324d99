"""Points of the working volume, and where the true device shows them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from mirrorcam.bench.scores.matched_views import MatchedView
from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.calibration.diagnostics.projection_uncertainty import grid_px, points_at_pixels
from mirrorcam.optics.geometry.layout import VOLUME, Layout

STEP_MM = 1e-3
"""Step of central differences: their error grows with its square, that of rounding with its inverse."""


@dataclass(frozen=True, eq=False)
class ScorePoints:
    """Points in the true rig, each as one view shows it.

    Attributes
    ----------
    view
        Mirror index (n,) of each.
    points_in_rig
        (n, 3), mm.
    pixels
        Where the true device shows them (n, 2), px of the frame.
    by_point
        Derivatives (n, 2, 3) of the pixels by the points, px/mm.
    at_distance
        Which of them (n,) are at the working distance itself.
    """

    view: NDArray[np.int64]
    points_in_rig: FloatArray
    pixels: FloatArray
    by_point: FloatArray
    at_distance: NDArray[np.bool_]

    def where(self, mask: NDArray[np.bool_]) -> ScorePoints:
        """The points of a boolean mask (n,)."""
        return ScorePoints(
            self.view[mask], self.points_in_rig[mask], self.pixels[mask], self.by_point[mask], self.at_distance[mask]
        )


def score_points(truth: Layout, views: Sequence[int], distance_mm: float) -> ScorePoints:
    """A grid over the part of each sub-image that shows the scene, at three distances from the view's centre.

    Raises InputError where a view shows nothing there.
    """
    parts = []
    for view in views:
        pixels = grid_px(truth, view)
        pixels = pixels[_shown_on_sensor(truth, view, pixels)]
        for factor in VOLUME:
            points = points_at_pixels(truth, view, pixels, factor * distance_mm)
            shown, by_point = with_slopes(partial(truth.project, mirror_index=view), points)
            count = len(points)
            parts.append((np.full(count, view), points, shown, by_point, np.full(count, factor == 1.0)))
    found = ScorePoints(*(np.concatenate(each) for each in zip(*parts, strict=True)))
    kept = np.isfinite(found.pixels).all(axis=1) & np.isfinite(found.by_point).all(axis=(1, 2))
    found = found.where(np.asarray(kept))
    for view in views:
        if not (found.at_distance & (found.view == view)).any():
            raise InputError(f"mirror {truth.mirror_names[view]} shows nothing {distance_mm:g} mm away")
    return found


def _shown_on_sensor(truth: Layout, view: int, pixels: FloatArray) -> NDArray[np.bool_]:
    size = np.array([truth.camera.width_px, truth.camera.height_px])
    on_sensor = np.all((pixels >= -0.5) & (pixels <= size - 0.5), axis=1)
    outline = truth.outline_px(view, usable=True)
    return np.asarray(on_sensor & contains_xy(Polygon(outline), pixels[:, 0], pixels[:, 1]))


def shown_by_all(truth: Layout, views: Sequence[int], points_in_rig: FloatArray) -> NDArray[np.bool_]:
    """Which of points (n, 3) all the views show within their sub-images."""
    shown = np.ones(len(points_in_rig), dtype=bool)
    for view in views:
        pixels = truth.project(points_in_rig, view)
        pixels = np.where(np.isfinite(pixels), pixels, -1e9)
        shown &= _shown_on_sensor(truth, view, pixels)
    return shown


def with_slopes(
    project: Callable[[FloatArray], FloatArray], points: FloatArray, step: float = STEP_MM
) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of points (n, 3), and their derivatives (n, 2, 3) by central differences."""
    slopes = np.empty((len(points), 2, 3))
    for axis, along in enumerate(step * np.eye(3)):
        slopes[:, :, axis] = (project(points + along) - project(points - along)) / (2.0 * step)
    return project(points), slopes


def project_each(
    views: Sequence[MatchedView], view: NDArray[np.int64], points_in_rig: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of points (n, 3) in a calibration's rig, each by its view, and their derivatives (n, 2, 3)."""
    pixels, slopes = np.full((len(view), 2), np.nan), np.full((len(view), 2, 3), np.nan)
    for each in views:
        at = view == each.view
        pixels[at], slopes[at] = with_slopes(each.project_in_rig, points_in_rig[at])
    return pixels, slopes
