"""Ghost images of second-surface mirrors, and refinement of corners in their presence.

The uncoated front of a second-surface mirror reflects a few percent of the light itself, and reflects as much of what
comes back from the coating to the coating again. So the picture has a faint ghost image on either side, a few pixels
off in the plane of incidence. At an edge one ghost image is white already (or the other one still black), which moves
the edge by some hundredths of a pixel: the same way in all views, as if the plate were thicker.

The layout and the board's pose give the offsets of the ghost images, and Fresnel's equations their strengths. One ghost
image ends before the picture does, where its light would leave the plate past the edge. Exactly where depends on how
the plate was cut and glued, so corners near that place are left out.

Offsets must be known well: along an edge, a ghost image that is wrong by a tenth of a pixel across it moves the edge by
some thousandths of a pixel. So `ghost_removal` uses mirrors as they were estimated, not as they are nominally.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.detection.blurred_print import Image
from mirrorcam.optics.calibration.detection.board_growing import expected_corners, first_blur_px, smooth
from mirrorcam.optics.calibration.detection.board_warp import corner_places
from mirrorcam.optics.calibration.detection.checkerboard import cell_px
from mirrorcam.optics.calibration.detection.corner_patches import (
    MAX_HALF_PX,
    Appearance,
    ExpectedCorners,
    GhostImages,
    half_cells,
)
from mirrorcam.optics.calibration.detection.corner_refinement import RefinedCorners, refine
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners, IntArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import surface_reflectance
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import transform

REFLECTANCE = 0.92  # of the coating, assumed; `ghost_removal` corrects it
PASSES = (0, 2, 3)  # to the coating and back, of the ghost images; the picture itself has one
KIND = (0, 1, 1)  # light that the front reflects from outside; light that it reflects back to the coating
COMPLETE = 2  # passes of the ghost images that must be complete; more carry 1/500 of the light
MARGIN_PX = 2.0
EDGE_POINTS = 8  # along each edge of an outline, which lens distortion curves
FEW = 60  # corners of a view that tell its blur and strengths


@dataclass(frozen=True)
class GhostedView:
    """The corners (n) of a view with complete ghost images: where they are expected, these, and the blur."""

    ids: IntArray
    expected: ExpectedCorners
    ghosts: GhostImages
    blur_px: float

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def few(self) -> GhostedView:
        """About `FEW` of the corners, from all over the board."""
        kept = np.arange(len(self)) % max(round(len(self) / FEW), 1) == 0
        return replace(self, ids=self.ids[kept], expected=self.expected.where(kept), ghosts=self.ghosts.where(kept))

    def of_ghosts(self, mask: NDArray[np.bool_]) -> GhostedView:
        """The same with some kinds of ghost images."""
        return replace(self, ghosts=self.ghosts.of_kinds(mask))

    def times(self, factors: FloatArray) -> GhostedView:
        """The same with ghost images of other strengths, by a factor for each kind."""
        return replace(self, ghosts=self.ghosts.times(factors))

    def fitted(self, light: Image, target: Target, *, fit_encoding: bool = False) -> tuple[GhostedView, RefinedCorners]:
        """The same where, and as blurred as, a picture of light shows them, and the fit, which tells the strengths."""
        look = Appearance(target, self.blur_px, self.ghosts, fit_strengths=True, fit_encoding=fit_encoding)
        seen = refine(light, self.expected, look)
        pixels = np.where(np.isfinite(seen.pixels), seen.pixels, self.expected.pixels)
        expected = replace(self.expected, pixels=pixels)
        return replace(self, expected=expected, blur_px=float(np.median(seen.blur_px))), seen

    def corners(self, light: Image, target: Target) -> Corners:
        """The corners as a picture of light shows them, without those that do not lie smoothly among the others."""
        seen = refine(light, self.expected, Appearance(target, self.blur_px, self.ghosts))
        found = np.asarray(np.isfinite(seen.pixels).all(axis=1))
        refined = Corners(self.ids, seen.pixels, seen.sigma_px).where(found)
        return refined.where(smooth(corner_places(target)[refined.ids], refined.pixels, target.longest_step))


def ghosted_view(
    corners: Corners, rig_from_board: FloatArray, camera: Camera, mirror: Mirror, target: Target
) -> GhostedView | None:
    """The corners (n) that a second-surface mirror shows with complete ghost images, at a pose (4, 4) of the board.

    None where too few are left.
    """
    corners = corners.where(_inside(corners, camera, _passed(mirror, COMPLETE), target))
    if len(corners) < MIN_CORNERS:
        return None
    ghosts = ghost_images_of(corners, rig_from_board, camera, mirror, target)
    expected = expected_corners(corners, target)
    if ghosts is None or expected is None:
        return None
    return GhostedView(corners.ids, expected, ghosts, first_blur_px(expected.places, expected.pixels))


def ghost_images_of(
    corners: Corners, rig_from_board: FloatArray, camera: Camera, mirror: Mirror, target: Target
) -> GhostImages | None:
    """The ghost images that a second-surface mirror adds at corners (n); None where it does not show these."""
    points = transform(rig_from_board, target.corners_in_board_mm[corners.ids])
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
