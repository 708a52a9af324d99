"""Ghost images of second-surface mirrors, and corner refinement that accounts for them.

The uncoated front of a second-surface mirror reflects a few percent of the incoming light, and the same fraction of the
light coming back from the coating. So the picture has a faint ghost image on either side, displaced by a few pixels in
the plane of incidence. At an edge, one ghost image is already white (or the other still black), which shifts the edge
by some hundredths of a pixel: in the same direction in all views, as if the plate were thicker.

The layout and the board's pose give the offsets of the ghost images; Fresnel's equations give their strengths. One
ghost image ends before the picture does, where its light would leave the plate beyond the edge. The exact position
depends on how the plate was cut and glued, so corners near it are left out if the edges are known.

Offsets must be accurate: an error of a tenth of a pixel across an edge shifts the edge by some thousandths of a pixel.
So the mirrors come from a first estimate, not from the nominal layout.

The strengths of ghost images depend on the coating, and their appearance on the camera's encoding of light. Both are
the same in all frames, and are estimated from the frames that show the board largest, where ghost images are farthest
from their edges.

Light adds, grey values do not: a camera that encodes light by a power law shows light added to black several times as
strongly as light added to white. So the fit uses linear light, with the power at which ghost images are equally strong
on black and on white.

The better the coating reflects, the fainter is one ghost image and the stronger the other, relative to the picture:
their ratio gives the reflectance. Their sum is less informative, because a blur that is not Gaussian resembles a pair
of ghost images.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.images.pictures import read_image
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image
from mirrorcam.optics.calibration.detection.board_growing import (
    MIN_BLUR_PX,
    expected_corners,
    first_blur_px,
    on_smooth_surface,
    softened,
)
from mirrorcam.optics.calibration.detection.board_warp import corner_print_xy
from mirrorcam.optics.calibration.detection.checkerboard import Grey, cell_px
from mirrorcam.optics.calibration.detection.corner_patches import (
    MAX_HALF_PX,
    Appearance,
    ExpectedCorners,
    GhostImages,
    half_cells,
)
from mirrorcam.optics.calibration.detection.corner_refinement import RefinedCorners, refine
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners, IntArray, Observations
from mirrorcam.optics.geometry.boards import CalibrationBoard
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import surface_reflectance
from mirrorcam.optics.geometry.transforms import transform

REFLECTANCE = 0.92  # assumed for the coating; `refine_with_ghosts` corrects it
PASSES = (0, 2, 3)  # of each ghost image's light, to the coating and back; the picture itself has one
KINDS = (0, 1, 1)  # 0: reflected at the front from outside; 1: reflected back to the coating
MAX_COMPLETE_PASSES = 2  # of ghost images that must be complete; those with more passes carry 1/500 of the light
MARGIN_PX = 2.0
EDGE_POINTS = 8  # along each edge of an outline, which lens distortion curves
SAMPLE_CORNERS = 60  # corners of a view that determine its blur and strengths
MAX_FRAMES = 4  # frames that determine the encoding and the strengths
MIN_CORNERS_FOR_STRENGTH = 40  # with fewer in total, the strengths are those of Fresnel's equations
BLUR_ROUNDS = 2  # of estimating strengths and blur in turn: a wrong blur resembles stronger ghost images
GAMMA_ROUNDS = 5
FIRST_GAMMA, MAX_GAMMA = 1.5, 3.0
GAMMA_GAIN = 0.7  # too large a power strengthens ghost images on white by about half the logarithm of white / black
MIN_STRENGTH = 0.5  # relative to Fresnel's equations: a fainter ghost image is treated as absent
MAX_COATING_FACTOR = 1.15  # by which a coating strengthens or weakens a ghost image


@dataclass(frozen=True)
class GhostedView:
    """A view's corners (n) with complete ghost images: ids, expected positions, ghost images, and blur."""

    ids: IntArray
    expected: ExpectedCorners
    ghosts: GhostImages
    blur_px: float

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def sample(self) -> GhostedView:
        """About `SAMPLE_CORNERS` of the corners, spread over the board."""
        kept = np.arange(len(self)) % max(round(len(self) / SAMPLE_CORNERS), 1) == 0
        return replace(self, ids=self.ids[kept], expected=self.expected.where(kept), ghosts=self.ghosts.where(kept))

    def with_kinds(self, mask: NDArray[np.bool_]) -> GhostedView:
        """Select some kinds of ghost images."""
        return replace(self, ghosts=self.ghosts.of_kinds(mask))

    def scaled(self, factors: FloatArray) -> GhostedView:
        """Scale the strengths of the ghost images by a factor for each kind."""
        return replace(self, ghosts=self.ghosts.scaled(factors))

    def fitted(
        self, light: Image, board: CalibrationBoard, *, fit_encoding: bool = False
    ) -> tuple[GhostedView, RefinedCorners]:
        """Fit a picture in linear light; return the view at the fitted positions and blur, and the fit."""
        appearance = Appearance(board, self.blur_px, self.ghosts, fit_strengths=True, fit_encoding=fit_encoding)
        fit = refine(light, self.expected, appearance)
        pixels = np.where(np.isfinite(fit.pixels), fit.pixels, self.expected.pixels)
        expected = replace(self.expected, pixels=pixels)
        return replace(self, expected=expected, blur_px=max(float(np.median(fit.blur_px)), MIN_BLUR_PX)), fit

    def corners(self, light: Image, board: CalibrationBoard) -> Corners:
        """Return the corners in a picture in linear light, without those off the smooth surface through the others."""
        fit = refine(light, self.expected, Appearance(board, self.blur_px, self.ghosts))
        converged = np.asarray(np.isfinite(fit.pixels).all(axis=1))
        refined = Corners(self.ids, fit.pixels, fit.sigma_px).where(converged)
        return refined.where(on_smooth_surface(corner_print_xy(board)[refined.ids], refined.pixels, board.longest_step))


def ghosted_view(
    corners: Corners,
    rig_from_board: FloatArray,
    camera: Camera,
    mirror: Mirror,
    board: CalibrationBoard,
    *,
    edges_known: bool = True,
) -> GhostedView | None:
    """Return the corners (n) in a second-surface mirror with complete ghost images, given the board's pose (4, 4).

    If the mirror's edges are unknown, all ghost images are assumed to be complete. None if too few corners remain.
    """
    if edges_known:
        corners = corners.where(_inside(corners, camera, _unfolded(mirror, MAX_COMPLETE_PASSES), board))
    if len(corners) < MIN_CORNERS:
        return None
    ghosts = ghost_images_of(corners, rig_from_board, camera, mirror, board)
    expected = expected_corners(corner_print_xy(board)[corners.ids], corners.pixels)
    if ghosts is None or expected is None:
        return None
    return GhostedView(corners.ids, expected, ghosts, first_blur_px(expected.print_xy, expected.pixels))


def ghost_images_of(
    corners: Corners, rig_from_board: FloatArray, camera: Camera, mirror: Mirror, board: CalibrationBoard
) -> GhostImages | None:
    """Return the ghost images that a second-surface mirror adds at corners (n); None if it cannot show them."""
    points = transform(rig_from_board, board.corners_in_board_mm[corners.ids])
    picture = camera.project(mirror.image_of(points))
    mirrors = [_unfolded(mirror, passes) for passes in PASSES]
    offsets = np.stack([camera.project(ghost.image_of(points)) - picture for ghost in mirrors], axis=1)
    if not np.isfinite(offsets).all():
        return None
    rays = camera.unproject(corners.pixels)
    cosine = (rays @ mirror.normal_in_rig) / np.linalg.norm(rays, axis=1)
    reflected = surface_reflectance(np.sqrt(np.maximum(cosine**-2 - 1.0, 0.0)), mirror.refractive_index)
    returned = REFLECTANCE * reflected
    strengths = np.stack([reflected / ((1.0 - reflected) ** 2 * REFLECTANCE), returned, returned**2], axis=1)
    return GhostImages(offsets, strengths, KINDS)


def _unfolded(mirror: Mirror, passes: int) -> Mirror:
    """Return the mirror that shows the image formed by light with `passes` passes to the coating and back.

    Unfolded, light with k passes crosses 2 k t of the plate, as in a plate k times as thick with the same front.
    """
    extra_mm = (passes - 1) * mirror.thickness_mm
    return mirror.replaced(
        virtual_centre_in_rig_mm=mirror.virtual_centre_in_rig_mm * (1.0 + extra_mm / mirror.distance_mm),
        outline_in_rig_mm=mirror.outline_in_rig_mm - extra_mm * mirror.normal_in_rig,
        surface="second" if passes else "first",
        thickness_mm=passes * mirror.thickness_mm if passes else mirror.thickness_mm,
    )


def _inside(corners: Corners, camera: Camera, mirror: Mirror, board: CalibrationBoard) -> NDArray[np.bool_]:
    """Mask (n,) of the corners that a mirror shows together with their patches used for refinement."""
    outline = mirror.usable_normalized
    if not len(outline) or len(corners) < 2:
        return np.zeros(len(corners), dtype=np.bool_)
    fraction = (np.arange(EDGE_POINTS) / EDGE_POINTS)[:, None]
    edges = outline[:, None] * (1.0 - fraction) + np.roll(outline, -1, axis=0)[:, None] * fraction
    pixels = camera.pixels_from_normalized(edges.reshape(-1, 2))
    visible = shapely.Polygon(pixels[np.isfinite(pixels).all(axis=1)])
    points = shapely.points(corners.pixels)
    # Distance to the corners of the patch; the nearest neighbour is across a gap of an AprilGrid.
    half_px = half_cells(board) / (2.0 - board.longest_step) * cell_px(corners.pixels)
    min_distance = np.sqrt(2.0) * np.minimum(half_px, MAX_HALF_PX) + MARGIN_PX
    return np.asarray(shapely.contains(visible, points) & (shapely.distance(visible.exterior, points) > min_distance))


@dataclass(frozen=True)
class _Rendering:
    """The power law of the camera's encoding, the blur, and a factor for each kind of ghost image; 0 if absent."""

    gamma: float
    factors: FloatArray
    blur_px: float | None = None


def refine_with_ghosts(
    detected: Sequence[Observations],
    pictures: Sequence[Grey | Path | None],
    rig_from_board: Mapping[int, FloatArray],
    layout: Layout,
    board: CalibrationBoard,
    *,
    edges_known: bool = True,
    workers: int = 1,
) -> list[Observations]:
    """Refine the corners of views in second-surface mirrors together with their ghost images.

    Only corners with complete ghost images are kept. Corners in first-surface mirrors are returned unchanged.

    Parameters
    ----------
    detected
        Corners of each frame, numbered as frame 0.
    pictures
        The frames; None if not available, which drops the frame's corners in second-surface mirrors.
    rig_from_board
        Pose (4, 4) of the board in each frame with corners.
    layout
        Camera and mirrors, estimated from corners that ghost images still shift by some hundredths of a pixel.
    board
        The board.
    edges_known
        Whether the layout's outlines are the mirrors' edges.
    workers
        Number of threads.

    Returns
    -------
    list of Observations
        One per frame.
    """
    ghosted = {
        number: _ghosted(rows, rig_from_board[number], layout, board, edges_known=edges_known)
        for number, rows in enumerate(detected)
        if number in rig_from_board and pictures[number] is not None
    }
    largest = sorted((number for number, views in ghosted.items() if views), key=lambda n: _size_px(ghosted[n]))

    def rendering_of(*, soften: bool) -> _Rendering:
        frames = [(_grey(pictures[n], soften=soften), list(ghosted[n].values())) for n in largest[-MAX_FRAMES:]]
        return _rendering(frames, board)

    soften, rendering = False, rendering_of(soften=False)
    if rendering.blur_px is not None and rendering.blur_px <= MIN_BLUR_PX:  # as where a camera sharpens
        soften, rendering = True, rendering_of(soften=True)

    def refined(number: int) -> Observations:
        light = linear_light(_grey(pictures[number], soften=soften), rendering.gamma)
        views = ((mirror, _refined(light, view, rendering, board)) for mirror, view in ghosted[number].items())
        return Observations.join(
            [Observations.of_view(0, mirror, found.ids, found.pixels, found.sigma_px) for mirror, found in views]
        )

    plain = [rows.where(~np.isin(rows.view, _second_surface(layout))) for rows in detected]
    with ThreadPoolExecutor(workers) as pool:
        found = dict(zip(largest, pool.map(refined, largest), strict=True))
    return [Observations.join([rows, found[n]]) if n in found else rows for n, rows in enumerate(plain)]


def linear_light(grey: Grey, gamma: float) -> Image:
    """Decode grey values to linear light with the power `gamma`, keeping the white level."""
    white = max(int(grey.max()), 1)
    return np.asarray(cv2.LUT(grey, (white * (np.arange(256) / white) ** gamma).astype(np.float32)))


def _second_surface(layout: Layout) -> list[int]:
    return [number for number, mirror in enumerate(layout.mirrors) if mirror.is_second_surface]


def _ghosted(
    rows: Observations, rig_from_board: FloatArray, layout: Layout, board: CalibrationBoard, *, edges_known: bool
) -> dict[int, GhostedView]:
    """Return a frame's views in second-surface mirrors, by mirror index."""
    views = {}
    for mirror in np.intersect1d(rows.view, _second_surface(layout)).tolist():
        in_mirror = rows.where(rows.view == mirror)
        corners = Corners(in_mirror.corner, in_mirror.pixels, in_mirror.sigma_px)
        view = ghosted_view(
            corners, rig_from_board, layout.camera, layout.mirrors[mirror], board, edges_known=edges_known
        )
        if view is not None:
            views[mirror] = view
    return views


def _size_px(views: Mapping[int, GhostedView]) -> float:
    return float(np.median([np.median(cell_px(view.expected.pixels)) for view in views.values()]))


def _grey(picture: Grey | Path | None, *, soften: bool) -> Grey:
    if picture is None:
        raise ValueError("no picture available")
    grey = read_image(picture, grey=True) if isinstance(picture, Path) else picture
    return softened(grey) if soften else grey


def _rendering(frames: Sequence[tuple[Grey, list[GhostedView]]], board: CalibrationBoard) -> _Rendering:
    """Estimate encoding, blur and strengths jointly from corners of some frames."""
    samples = [(grey, [view.sample for view in views]) for grey, views in frames]
    present = np.ones(2, dtype=np.bool_)
    if sum(len(view) for _, views in samples for view in views) < MIN_CORNERS_FOR_STRENGTH:
        return _Rendering(1.0, present.astype(np.float64))
    while True:
        gamma, fitted = _gamma([(grey, [view.with_kinds(present) for view in views]) for grey, views in samples], board)
        lights = [(linear_light(grey, gamma), views) for grey, views in fitted]
        fits = [_blurred(view, light, board) for light, views in lights for view in views]
        factors = np.zeros(2)
        factors[present] = np.nanmedian(np.concatenate([fit.ghost_strengths for _, fit in fits]), axis=0)
        faint = present & (factors < MIN_STRENGTH)
        present &= ~faint
        if not faint.any() or not present.any():
            blur_px = float(np.median([view.blur_px for view, _ in fits]))
            return _Rendering(gamma, _coating_factors(factors * present), blur_px)


def _gamma(
    frames: Sequence[tuple[Grey, list[GhostedView]]], board: CalibrationBoard
) -> tuple[float, list[tuple[Grey, list[GhostedView]]]]:
    """Return the power at which ghost images are equally strong on white and black, and views with fitted blur."""
    gamma, fitted = FIRST_GAMMA, list(frames)
    for _ in range(GAMMA_ROUNDS):
        lights = [linear_light(grey, gamma) for grey, _ in fitted]
        fits = [
            [view.fitted(light, board, fit_encoding=True) for view in views]
            for light, (_, views) in zip(lights, fitted, strict=True)
        ]
        fitted = [(grey, [view for view, _ in frame_fits]) for (grey, _), frame_fits in zip(fitted, fits, strict=True)]
        on_white = np.concatenate([fit.ghost_strengths[:, -1] for frame_fits in fits for _, fit in frame_fits])
        gamma = float(np.clip(gamma * np.exp(-GAMMA_GAIN * np.nanmedian(on_white)), 1.0, MAX_GAMMA))
    return gamma, fitted


def _coating_factors(factors: FloatArray) -> FloatArray:
    """Return the factors (2,) that are nearest to the estimated ones and consistent with a coating's reflectance.

    Relative to the picture, light reflected at the front is inversely proportional to the reflectance, and light
    reflected back to the coating is proportional to it.
    """
    present = factors > 0.0
    if not present.all():
        return np.where(present, np.clip(factors, 1.0 / MAX_COATING_FACTOR, MAX_COATING_FACTOR), 0.0)
    reflectance_factor = float(np.clip(np.sqrt(factors[1] / factors[0]), 1.0 / MAX_COATING_FACTOR, MAX_COATING_FACTOR))
    return np.array([1.0 / reflectance_factor, reflectance_factor])


def _blurred(view: GhostedView, light: Image, board: CalibrationBoard) -> tuple[GhostedView, RefinedCorners]:
    """Fit a view's blur to a picture in linear light; return the view and the last fit."""
    for _ in range(BLUR_ROUNDS):
        view, fit = view.fitted(light, board)
    return view, fit


def _refined(light: Image, view: GhostedView, rendering: _Rendering, board: CalibrationBoard) -> Corners:
    """Return the corners of a view, with the blur estimated from some of them."""
    view = view.scaled(rendering.factors)
    start = view.sample if rendering.blur_px is None else replace(view.sample, blur_px=rendering.blur_px)
    return replace(view, blur_px=_blurred(start, light, board)[0].blur_px).corners(light, board)
