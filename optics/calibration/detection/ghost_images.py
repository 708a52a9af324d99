"""Ghost images of second-surface mirrors, and refinement of corners in their presence.

The uncoated front of a second-surface mirror reflects a few percent of the light itself, and reflects as much of what
comes back from the coating to the coating again. So the picture has a faint ghost image on either side, a few pixels
off in the plane of incidence. At an edge one ghost image is white already (or the other one still black), which moves
the edge by some hundredths of a pixel: the same way in all views, as if the plate were thicker.

The nominal layout and the board's pose in the view give the offsets of the ghost images, and Fresnel's equations their
strengths. How coating and front deviate from that is estimated from the frame: one factor for each ghost image, from
all corners of all views, with the blur that these show. One ghost image ends before the picture does, where its light
would leave the plate past the edge. Exactly where depends on how the plate was cut and glued, so corners near that
place are left out.

Light adds, grey values do not: a camera that encodes light by a power shows what is added to black several times as
strong as what is added to white. So everything is done in light, as the power that the frame shows encodes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image
from mirrorcam.optics.calibration.detection.board_growing import expected_corners, first_blur_px, smooth
from mirrorcam.optics.calibration.detection.board_warp import corner_places
from mirrorcam.optics.calibration.detection.checkerboard import Grey, cell_px
from mirrorcam.optics.calibration.detection.corner_patches import (
    MAX_HALF_PX,
    Appearance,
    ExpectedCorners,
    GhostImages,
    half_cells,
)
from mirrorcam.optics.calibration.detection.corner_refinement import RefinedCorners, refine
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners, IntArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import surface_reflectance
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import transform

REFLECTANCE = 0.92  # of the coating; the factor for each ghost image corrects it
PASSES = (0, 2, 3)  # to the coating and back, of the ghost images; the picture itself has one
KIND = (0, 1, 1)  # light that the front reflects from outside; light that it reflects back to the coating
COMPLETE = 2  # passes of the ghost images that must be complete; more carry 1/500 of the light
MARGIN_PX = 2.0
EDGE_POINTS = 8  # along each edge of an outline, which lens distortion curves
MIN_CORNERS_FOR_STRENGTH = 40  # with fewer in a frame, the strengths are those of Fresnel's equations
FEW = 60  # corners of a view that tell its blur, strengths, and the picture's power of light
ROUNDS = 2  # of estimating strengths and blur: wrong blur looks like ghost images that are stronger
MAX_STRENGTH = 2.0  # relative to those
GAMMAS = (1.0, 1.6, 2.2, 2.8)
VIEWS_FOR_GAMMA = 2


@dataclass(frozen=True)
class _Ghosted:
    """The corners (n) of a view with complete ghost images, where they are expected, these, and the blur."""

    ids: IntArray
    expected: ExpectedCorners
    ghosts: GhostImages
    blur_px: float

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def few(self) -> _Ghosted:
        """About `FEW` of the corners, from all over the board."""
        kept = np.arange(len(self)) % max(round(len(self) / FEW), 1) == 0
        return replace(self, ids=self.ids[kept], expected=self.expected.where(kept), ghosts=self.ghosts.where(kept))

    def refined(self, light: Image, target: Target, *, fit_strengths: bool = False) -> RefinedCorners:
        """The corners as a picture of light shows them."""
        return refine(light, self.expected, Appearance(target, self.blur_px, self.ghosts, fit_strengths))

    def fitted(self, light: Image, target: Target) -> tuple[_Ghosted, RefinedCorners]:
        """The same where, and as blurred as, a picture of light shows them, and the fit, which tells the strengths."""
        seen = self.refined(light, target, fit_strengths=True)
        pixels = np.where(np.isfinite(seen.pixels), seen.pixels, self.expected.pixels)
        return replace(
            self, expected=replace(self.expected, pixels=pixels), blur_px=float(np.median(seen.blur_px))
        ), seen

    def of_ghosts(self, mask: NDArray[np.bool_]) -> _Ghosted:
        """The same with some kinds of ghost images."""
        return replace(self, ghosts=self.ghosts.of_kinds(mask))

    def times(self, factors: FloatArray) -> _Ghosted:
        """The same with ghost images of other strengths, by a factor for each kind."""
        return replace(self, ghosts=self.ghosts.times(factors))


def refine_with_ghost_images(
    grey: Grey, views: Sequence[tuple[int, Corners]], layout: Layout, target: Target
) -> list[tuple[int, Corners]]:
    """Refine the corners of the views in second-surface mirrors once more, with their ghost images.

    Only corners with complete ghost images are kept. Corners in a first-surface mirror are returned as they are.

    Parameters
    ----------
    grey
        Picture (h, w).
    views
        Mirrors and the corners of the board that each shows.
    layout
        Where mirrors and camera are, nearly.
    target
        The board.
    """
    refined, ghosted = list(views), {}
    for place, (mirror, corners) in enumerate(views):
        if layout.mirrors[mirror].is_second_surface:
            refined[place] = (mirror, Corners.none())
            view = _ghosted(corners, layout.camera, layout.mirrors[mirror], target)
            if view is not None:
                ghosted[place] = view
    if ghosted:
        known = _known(in_light(grey, GAMMAS[1]), list(ghosted.values()), target)
        light = in_light(grey, _gamma(grey, known, target))
        if known:
            blur_px = float(np.median([view.blur_px for view in known]))
            ghosted = {place: replace(view, blur_px=blur_px) for place, view in ghosted.items()}
        for place, view in _with_strengths(light, ghosted, target).items():
            refined[place] = (refined[place][0], _refined(light, view, target))
    return refined


def in_light(grey: Grey, gamma: float) -> Image:
    """The light behind grey values that its power 1 / gamma encodes, of the same white."""
    white = max(int(grey.max()), 1)
    return np.asarray(cv2.LUT(grey, (white * (np.arange(256) / white) ** gamma).astype(np.float32)))


def _ghosted(corners: Corners, camera: Camera, mirror: Mirror, target: Target) -> _Ghosted | None:
    corners = corners.where(_inside(corners, camera, _passed(mirror, COMPLETE), target))
    if len(corners) < MIN_CORNERS:
        return None
    ghosts, expected = ghost_images_of(corners, camera, mirror, target), expected_corners(corners, target)
    if ghosts is None or expected is None:
        return None
    return _Ghosted(corners.ids, expected, ghosts, first_blur_px(expected.places, expected.pixels))


def _known(light: Image, views: Sequence[_Ghosted], target: Target) -> list[_Ghosted]:
    """Some corners of the largest views, as blurred as they are."""
    shown = sorted((view for view in views if len(view) >= MIN_CORNERS_FOR_STRENGTH), key=len)
    return [view.few.fitted(light, target)[0] for view in shown[-VIEWS_FOR_GAMMA:]]


def _gamma(grey: Grey, known: Sequence[_Ghosted], target: Target) -> float:
    """The power of light for which the print explains views best.

    The vertex of the parabola through the best of `GAMMAS` and its neighbours; `GAMMAS[0]` where there is no view.
    """
    unexplained: list[float] = []
    for gamma in GAMMAS:
        light = in_light(grey, gamma)
        unexplained.append(sum(1.0 - float(np.mean(view.fitted(light, target)[1].explained)) for view in known))
        if unexplained[-1] > min(unexplained):
            break
    best = int(np.argmin(unexplained))
    if best in {0, len(GAMMAS) - 1}:
        return GAMMAS[best]
    before, here, after = unexplained[best - 1 : best + 2]
    return GAMMAS[best] + 0.5 * (GAMMAS[1] - GAMMAS[0]) * (before - after) / (before - 2.0 * here + after)


def _with_strengths(light: Image, views: Mapping[int, _Ghosted], target: Target) -> dict[int, _Ghosted]:
    """The views with their blur, and with the strengths that all their corners together show.

    Coating and front are of one kind in all mirrors. A ghost image that comes out negative is not there, and the others
    are fitted without it. Of few corners, the strengths are those of Fresnel's equations.
    """
    found, factors = _fitted(light, views, target)
    if not len(factors):
        return found
    if (factors <= 0.0).any():
        there = {place: view.of_ghosts(factors > 0.0) for place, view in views.items()}
        return _with_strengths(light, there, target) if (factors > 0.0).any() else there
    return {place: view.times(np.minimum(factors, MAX_STRENGTH)) for place, view in found.items()}


def _fitted(light: Image, views: Mapping[int, _Ghosted], target: Target) -> tuple[dict[int, _Ghosted], FloatArray]:
    """The views with their blur, and the median factor on each kind of ghost image; (0,) where few corners show it."""
    found, factors = {}, []
    for place, view in views.items():
        few = view.few
        for _ in range(ROUNDS):
            few, seen = few.fitted(light, target)
        found[place] = replace(view, blur_px=few.blur_px)
        factors.append(seen.ghost_strengths[np.isfinite(seen.pixels).all(axis=1)])
    if sum(map(len, views.values())) < MIN_CORNERS_FOR_STRENGTH:
        return found, np.empty(0)
    return found, np.median(np.concatenate(factors), axis=0)


def _refined(light: Image, view: _Ghosted, target: Target) -> Corners:
    """The corners of a view whose blur and ghost images are known."""
    seen = view.refined(light, target)
    found = np.asarray(np.isfinite(seen.pixels).all(axis=1))
    refined = Corners(view.ids, seen.pixels, seen.sigma_px).where(found)
    return refined.where(smooth(corner_places(target)[refined.ids], refined.pixels, target.longest_step))


def ghost_images_of(corners: Corners, camera: Camera, mirror: Mirror, target: Target) -> GhostImages | None:
    """The ghost images that a second-surface mirror adds at corners (n); None where no pose of the board fits these."""
    board = target.corners_in_board_mm
    pose = initial_estimates.rig_from_board(camera, corners, board, mirror.apparent.virtual_centre_in_rig_mm)
    if pose is None:
        return None
    points = transform(pose, board[corners.ids])
    picture = camera.project(mirror.image_of(points))
    mirrors = [_passed(mirror, passes) for passes in PASSES]
    offsets = np.stack([camera.project(each.image_of(points)) - picture for each in mirrors], axis=1)
    if not np.isfinite(offsets).all():
        return None
    rays = camera.unproject(corners.pixels)
    along = (rays @ mirror.normal_in_rig) / np.linalg.norm(rays, axis=1)
    lost = surface_reflectance(np.sqrt(np.maximum(along**-2 - 1.0, 0.0)), mirror.refractive_index)
    again = REFLECTANCE * lost
    strengths = np.stack([lost / ((1.0 - lost) ** 2 * REFLECTANCE), again, again**2], axis=1)
    return GhostImages(offsets, strengths, KIND)


def _passed(mirror: Mirror, passes: int) -> Mirror:
    """The mirror that shows the same image as light that makes `passes` passes to the coating and back.

    Unfolded, light with k passes crosses 2 k t of the plate, as in a plate k times as thick with the same front.
    """
    deeper_mm = (passes - 1) * mirror.thickness_mm
    return mirror.replaced(
        virtual_centre_in_rig_mm=mirror.virtual_centre_in_rig_mm * (1.0 + deeper_mm / mirror.distance_mm),
        outline_in_rig_mm=mirror.outline_in_rig_mm - deeper_mm * mirror.normal_in_rig,
        surface="second" if passes else "first",
        thickness_mm=passes * mirror.thickness_mm if passes else mirror.thickness_mm,
    )


def _inside(corners: Corners, camera: Camera, mirror: Mirror, target: Target) -> NDArray[np.bool_]:
    """Mask (n,) of the corners that a mirror shows together with the whole patch that they are refined with."""
    outline = mirror.usable_normalized
    if not len(outline) or len(corners) < 2:
        return np.zeros(len(corners), dtype=np.bool_)
    part = (np.arange(EDGE_POINTS) / EDGE_POINTS)[:, None]
    edges = outline[:, None] * (1.0 - part) + np.roll(outline, -1, axis=0)[:, None] * part
    pixels = camera.pixels_from_normalized(edges.reshape(-1, 2))
    shown = shapely.Polygon(pixels[np.isfinite(pixels).all(axis=1)])
    points = shapely.points(corners.pixels)
    # To the corners of the patch compared with the print; the nearest neighbour is across a gap of an AprilGrid.
    half_px = half_cells(target) / (2.0 - target.longest_step) * cell_px(corners.pixels)
    reach = np.sqrt(2.0) * np.minimum(half_px, MAX_HALF_PX) + MARGIN_PX
    return np.asarray(shapely.contains(shown, points) & (shapely.distance(shown.exterior, points) > reach))
