"""Observations of one frame: the bare camera's view of the target, or every sub-image of a mirror camera."""

from __future__ import annotations

import cv2
import numpy as np

from optics.calibration import bootstrap
from optics.calibration.detection.corners import (
    Corners,
    Grey,
    cell_px,
    find_charuco,
    find_checkerboards,
    orderings,
    refinement_window,
    spread_out,
)
from optics.calibration.observations import DIRECT, Observations
from optics.layout import Layout
from optics.mirror import Mirror
from optics.targets import Charuco, Checkerboard
from optics.transforms import transform
from optics.values import FloatArray

SLACK_PX = 6.0  # how far a built mirror's edge may stand from the nominal outline


def direct_view(grey: Grey, target: Checkerboard | Charuco) -> Observations:
    """Corners that the bare camera sees, as frame 0."""
    if isinstance(target, Charuco):
        corners = find_charuco(grey, target, mirrored=False)
        return Observations.of_view(0, DIRECT, corners.ids, corners.pixels)
    for board in find_checkerboards(grey, target, most=1):
        for ordering in orderings(grey, board, target, mirrored=False)[:1]:
            return Observations.of_view(0, DIRECT, np.arange(len(ordering)), ordering)
    return Observations.none()


def sub_images(grey: Grey, layout: Layout, target: Checkerboard | Charuco) -> Observations:
    """Corners in every mirror of a frame (h, w), as frame 0; a view that shows no board adds no rows.

    The nominal layout says where each sub-image lies. Corners whose refinement window would reach the outline are
    dropped: the mirror's edge would pull at them.
    """
    options: list[tuple[int, list[Corners]]] = []
    window = refinement_window(target)
    for index in range(len(layout.mirrors)):
        outline = layout.outline_px(index)
        crop, offset = _crop(grey, outline)
        if crop.size == 0:
            continue
        if isinstance(target, Charuco):
            found = [find_charuco(crop, target, mirrored=True)]
        else:
            found = [
                Corners(np.arange(len(ordering)), ordering)
                for board in find_checkerboards(crop, target, most=1)
                for ordering in orderings(crop, board, target, mirrored=True)
            ]
        kept = [_inside(Corners(corners.ids, corners.pixels + offset), outline, window) for corners in found]
        if kept and len(kept[0]):
            options.append((index, kept))
    chosen = _same_way_up(options, layout, target)
    return Observations.join([Observations.of_view(0, index, c.ids, c.pixels) for index, c in chosen])


def _crop(grey: Grey, outline: FloatArray) -> tuple[Grey, FloatArray]:
    """The outline's surroundings with everything outside it painted to its mean, and the crop's origin (2,)."""
    low = np.maximum(np.floor(outline.min(axis=0) - SLACK_PX), 0).astype(int)
    high = np.minimum(np.ceil(outline.max(axis=0) + SLACK_PX) + 1, grey.shape[::-1]).astype(int)
    crop = grey[low[1] : high[1], low[0] : high[0]].copy()
    if crop.size:
        mask = np.zeros(crop.shape, dtype=np.uint8)
        cv2.fillConvexPoly(mask, np.rint(outline - low).astype(np.int32), 255)
        mask = cv2.dilate(mask, np.ones((2 * int(SLACK_PX) + 1,) * 2, dtype=np.uint8)).astype(np.uint8)
        crop[mask == 0] = 0
    return crop, low.astype(np.float64)


def _inside(corners: Corners, outline: FloatArray, window: float) -> Corners:
    """The corners whose refinement window stays inside the outline by SLACK_PX."""
    if len(corners) < 2:
        return corners
    polygon = outline.astype(np.float32)[:, None]
    depth = np.array([cv2.pointPolygonTest(polygon, (float(x), float(y)), True) for x, y in corners.pixels])
    keep = depth > SLACK_PX + np.sqrt(2.0) * window * cell_px(corners.pixels)
    return spread_out(Corners(corners.ids[keep], corners.pixels[keep]))


def _same_way_up(
    options: list[tuple[int, list[Corners]]], layout: Layout, target: Checkerboard | Charuco
) -> list[tuple[int, Corners]]:
    """One numbering per view, such that all views of the frame agree on it under the nominal layout.

    Only a plain board that looks the same upside down offers a choice. Turning it over in every view at once changes
    nothing, so the view with most corners decides; where it fits no pose, the frame is left out.
    """
    if all(len(choices) == 1 for _, choices in options):
        return [(index, choices[0]) for index, choices in options]
    corners_mm = target.corners_in_board_mm
    index, choices = max(options, key=lambda option: len(option[1][0]))
    mirror: Mirror = layout.mirrors[index]
    pose = bootstrap.rig_from_board(layout.camera, choices[0], corners_mm, mirror.virtual_centre_in_rig_mm)
    if pose is None:
        return []
    points = transform(pose, corners_mm)

    def misfit(view: int, corners: Corners) -> float:
        return float(np.nansum(np.abs(layout.project(points[corners.ids], view) - corners.pixels)))

    return [(i, min(choices, key=lambda corners: misfit(i, corners))) for i, choices in options]
