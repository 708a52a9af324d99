"""Statistics of a calibration's pictures, by view and by frame: counts, coverage, distances, tilts and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_result import Calibration
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.layout import Layout

CELLS = (6, 5)  # across and down the bounding rectangle of a view, to measure its coverage
MIN_CELL_FRACTION = 0.25  # minimum fraction of a cell inside the view, for the cell to count
ARROWS_ACROSS = 60  # cells across the sensor over which residuals are averaged
SYSTEMATIC_CHANCE = 0.01


@dataclass(frozen=True)
class ViewFigures:
    """Statistics of one view.

    Attributes
    ----------
    view
        Mirror index, or DIRECT.
    name
        "mirror 1-2"; for DIRECT, "direct view" if a picture shows the board both directly and in a mirror, "picture"
        without mirrors, else "bare camera".
    corners, outliers, frames
        Number of inliers, of outliers, and of frames with a board in the view.
    rms_px, rms_sigmas
        Rms residual (2,) per axis, in pixels and in standard deviations of the corners.
    outline_px
        Outline (n, 2) on the sensor.
    cells_px, cell_counts
        Left, top, right, bottom (k, 4) of the cells that count, and the number (k,) of corners in each.
    distances_mm, tilts_deg
        Per frame (f,): distance of the visible part of the board from the view's centre, and tilt of the board relative
        to the line of sight. Empty without a board.
    """

    view: int
    name: str
    corners: int
    outliers: int
    frames: int
    rms_px: FloatArray
    rms_sigmas: FloatArray
    outline_px: FloatArray
    cells_px: FloatArray
    cell_counts: NDArray[np.int64]
    distances_mm: FloatArray
    tilts_deg: FloatArray

    @property
    def name_in_sentence(self) -> str:
        """The view's name in a sentence: "mirror 1-2", "the bare camera"."""
        return f"the {self.name}" if self.view == DIRECT else self.name

    @property
    def coverage(self) -> float:
        """Fraction of the cells with at least one corner."""
        return float((self.cell_counts > 0).mean())


def view_outline_px(layout: Layout, view: int) -> FloatArray:
    """Outline (n, 2) of a view's sub-image on the sensor; the complete sensor for DIRECT."""
    if view != DIRECT:
        return layout.outline_px(view)
    right, bottom = layout.camera.width_px - 0.5, layout.camera.height_px - 0.5
    return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])


def view_figures(calibration: Calibration) -> tuple[ViewFigures, ...]:
    """Return the statistics of every mirror, then of the direct view if there is one."""
    views = list(range(len(calibration.layout.mirrors)))
    if (calibration.observations.view == DIRECT).any():
        views.append(DIRECT)
    return tuple(_figures(calibration, view) for view in views)


def calibrated_views(views: Sequence[ViewFigures]) -> list[ViewFigures]:
    """The views of the mirrors; for a bare camera, its pictures."""
    return [view for view in views if view.view != DIRECT] or list(views)


def _figures(calibration: Calibration, view: int) -> ViewFigures:
    observations, inliers = calibration.observations, calibration.inliers
    view_rows = observations.view == view
    in_view = view_rows & inliers
    outline = view_outline_px(calibration.layout, view)
    cells = _cells(outline)
    pixels = observations.pixels[in_view]
    inside = [((pixels >= cell[:2]) & (pixels < cell[2:])).all(axis=1).sum() for cell in cells]
    frames = np.unique(observations.frame[in_view])
    boards = [
        _distance_and_tilt(calibration, view, observations.pixels[in_view & (observations.frame == f)], int(f))
        for f in (frames if len(calibration.rig_from_board) else ())
    ]
    return ViewFigures(
        view=view,
        name=_name(calibration, view),
        corners=int(in_view.sum()),
        outliers=int((view_rows & ~inliers).sum()),
        frames=len(frames),
        rms_px=_rms(calibration.residuals_px[in_view]),
        rms_sigmas=_rms(calibration.standardised[in_view]),
        outline_px=outline,
        cells_px=cells,
        cell_counts=np.array(inside, dtype=np.int64),
        distances_mm=np.array([distance for distance, _ in boards]),
        tilts_deg=np.array([tilt for _, tilt in boards]),
    )


@dataclass(frozen=True)
class FrameFigures:
    """Statistics of one frame.

    `corners` and `outliers` are counts, `views` the number of views with corners. `rms_px` and `rms_sigmas` are the
    rms residual of all corners, outliers included, per axis: in pixels, and in standard deviations of the corners.
    """

    frame: int
    name: str
    views: int
    corners: int
    outliers: int
    rms_px: float
    rms_sigmas: float


def frame_figures(calibration: Calibration) -> tuple[FrameFigures, ...]:
    """Return the statistics of every frame, that with the largest standardised residuals first."""
    observations = calibration.observations
    figures = []
    for frame in np.unique(observations.frame).tolist():
        rows = observations.frame == frame
        figures.append(
            FrameFigures(
                frame=frame,
                name=calibration.picture_names[frame] if calibration.pictures else f"frame {frame}",
                views=len(np.unique(observations.view[rows])),
                corners=int((rows & calibration.inliers).sum()),
                outliers=int((rows & ~calibration.inliers).sum()),
                rms_px=float(np.sqrt(np.mean(calibration.residuals_px[rows] ** 2))),
                rms_sigmas=float(np.sqrt(np.mean(calibration.standardised[rows] ** 2))),
            )
        )
    return tuple(sorted(figures, key=lambda figure: -figure.rms_sigmas))


def _rms(residuals: FloatArray) -> FloatArray:
    return np.sqrt(np.mean(residuals**2, axis=0)) if len(residuals) else np.full(2, np.nan)


def _name(calibration: Calibration, view: int) -> str:
    if view != DIRECT:
        return f"mirror {calibration.layout.mirror_names[view]}"
    if not calibration.layout.mirrors:
        return "picture"
    return "direct view" if calibration.observations.direct_and_mirrored else "bare camera"


def _cells(outline: FloatArray) -> FloatArray:
    """Cells (k, 4) of the bounding rectangle with a sufficient fraction inside the outline."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    x, y = (np.linspace(low[axis], high[axis], CELLS[axis] + 1) for axis in (0, 1))
    polygon = shapely.Polygon(outline)
    cells = [(x[i], y[j], x[i + 1], y[j + 1]) for j in range(CELLS[1]) for i in range(CELLS[0])]
    boxes = shapely.box(*np.array(cells).T)
    fraction = shapely.area(shapely.intersection(boxes, polygon)) / shapely.area(boxes)
    return np.array(cells)[fraction >= MIN_CELL_FRACTION]


def _distance_and_tilt(calibration: Calibration, view: int, pixels: FloatArray, frame: int) -> tuple[float, float]:
    """Median distance (mm) at which a view's rays hit the board, and median angle (deg) from its normal.

    Mirrors preserve distances and angles, so both are computed for the board's image in front of the base camera.
    """
    rig_from_board = calibration.rig_from_board[frame]
    point, normal = rig_from_board[:3, 3], rig_from_board[:3, 2]
    if view != DIRECT:
        mirror = calibration.layout.mirrors[view].apparent
        point, normal = mirror.reflect(point), mirror.reflection @ normal
    rays = calibration.layout.camera.unproject(pixels)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    distances = (point @ normal) / (rays @ normal)
    angles = np.degrees(np.arccos(np.clip(np.abs(rays @ normal), 0.0, 1.0)))
    return float(np.median(distances)), float(np.median(angles))


def board_normals(calibration: Calibration) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Unit normals (f, 3) of every frame's board, pointing into the print, and a mask (f,) of the mirrored frames.

    Normals of mirrored frames are in view axes, the others in the camera's axes. For a bare camera, the mask holds all.
    """
    observations = calibration.observations
    shown = (observations.view != DIRECT) | (not calibration.layout.mirrors)
    mirrored = np.isin(np.arange(len(calibration.rig_from_board)), observations.frame[shown])
    normals = calibration.rig_from_board[:, :3, 2]
    return np.where(mirrored[:, None], normals @ calibration.layout.view_from_rig.T, normals), mirrored


@dataclass(frozen=True)
class CellMeans:
    """Mean residuals in cells of the sensor: centres and means (k, 2); `systematic` (k,) marks significant means."""

    centres_px: FloatArray
    mean_px: FloatArray
    systematic: NDArray[np.bool_]


def cell_means(calibration: Calibration, view: int) -> CellMeans:
    """Average the residuals of one view in square cells, weighted by the inverse variances of the corners.

    The square of such a mean over its variance has a chi-squared distribution with two degrees of freedom; a cell is
    systematic if it exceeds the quantile of `SYSTEMATIC_CHANCE`.
    """
    used = calibration.inliers & (calibration.observations.view == view)
    pixels, residuals = calibration.observations.pixels[used], calibration.residuals_px[used]
    cell_px = calibration.layout.camera.width_px / ARROWS_ACROSS
    weights = calibration.corner_sigma_px[used, None] ** -2.0
    _, cell = np.unique(np.floor(pixels / cell_px), axis=0, return_inverse=True)
    sums = np.zeros((int(cell.max(initial=-1)) + 1, 5))
    np.add.at(sums, cell.ravel(), np.hstack([weights, weights * pixels, weights * residuals]))
    total = sums[:, :1]
    centres, mean = sums[:, 1:3] / total, sums[:, 3:] / total
    squared = np.sum(mean**2, axis=1) * total[:, 0]
    return CellMeans(centres, mean, squared > -2.0 * np.log(SYSTEMATIC_CHANCE))
