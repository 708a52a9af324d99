"""Ghost images of second-surface mirrors, and refinement of corners in their presence.

The uncoated front of a second-surface mirror reflects a few percent of the light itself, and reflects as much of what
comes back from the coating to the coating again. So the picture has a faint ghost image on either side, a few pixels
off in the plane of incidence. At an edge one ghost image is white already (or the other one still black), which moves
the edge by some hundredths of a pixel: the same way in all views, as if the plate were thicker.

The nominal layout and the board's pose in the view give the offsets of the ghost images, and Fresnel's equations their
strengths. How coating and front deviate from that is estimated from the view: one factor for each ghost image, from all
its corners. One ghost image ends before the picture does, where its light would leave the plate past the edge. Exactly
where depends on how the plate was cut and glued, so corners near that place are left out.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.optics.calibration.detection.blurred_print import Image
from mirrorcam.optics.calibration.detection.board_growing import refine_board, smooth
from mirrorcam.optics.calibration.detection.board_warp import corner_places
from mirrorcam.optics.calibration.detection.checkerboard import cell_px
from mirrorcam.optics.calibration.detection.corner_patches import HALF_CELLS, MAX_HALF_PX, GhostImages
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import surface_reflectance
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import transform

REFLECTANCE = 0.92  # of the coating; the factor for each ghost image corrects it
PASSES = (0, 2)  # to the coating and back, of the ghost images; the picture itself has one; three carry 1/500 of it
MARGIN_PX = 2.0
EDGE_POINTS = 8  # along each edge of an outline, which lens distortion curves
MIN_CORNERS_FOR_STRENGTH = 40  # with fewer corners, the strengths are those of Fresnel's equations
MAX_STRENGTH = 2.0  # relative to those


def refine_with_ghost_images(
    picture: Image, corners: Corners, camera: Camera, mirror: Mirror, target: Target
) -> Corners:
    """Refine the corners of a mirror's view once more, with the ghost images of a second-surface mirror.

    Only corners with complete ghost images are kept. Corners in a first-surface mirror are returned as they are.
    """
    if not mirror.is_second_surface:
        return corners
    whole = _inside(corners, camera, _passed(mirror, max(PASSES)))
    corners = corners.where(whole)
    ghosts = ghost_images_of(corners, camera, mirror, target) if len(corners) >= MIN_CORNERS else None
    free = None if ghosts is None else refine_board(picture, corners, target, ghosts, fit_strengths=True)
    if ghosts is None or free is None:
        return corners.where(np.zeros(len(corners), dtype=bool))
    if len(corners) >= MIN_CORNERS_FOR_STRENGTH:
        factors = np.clip(np.median(free.ghost_strengths, axis=0), 0.0, MAX_STRENGTH)
        ghosts = GhostImages(ghosts.offsets_px, ghosts.strengths * factors)
    seen = refine_board(picture, corners, target, ghosts, blur_cells=float(np.median(free.blur_cells)))
    if seen is None:
        return corners.where(np.zeros(len(corners), dtype=bool))
    found = np.asarray(np.isfinite(seen.pixels).all(axis=1))
    refined = Corners(corners.ids, seen.pixels, seen.sigma_px).where(found)
    return refined.where(smooth(corner_places(target)[refined.ids], refined.pixels))


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
    strengths = np.stack([lost / ((1.0 - lost) ** 2 * REFLECTANCE), REFLECTANCE * lost], axis=1)
    return GhostImages(offsets, strengths)


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


def _inside(corners: Corners, camera: Camera, mirror: Mirror) -> NDArray[np.bool_]:
    """Mask (n,) of the corners that a mirror shows together with the whole patch that they are refined with."""
    outline = mirror.usable_normalized
    if not len(outline) or len(corners) < 2:
        return np.zeros(len(corners), dtype=np.bool_)
    part = (np.arange(EDGE_POINTS) / EDGE_POINTS)[:, None]
    edges = outline[:, None] * (1.0 - part) + np.roll(outline, -1, axis=0)[:, None] * part
    pixels = camera.pixels_from_normalized(edges.reshape(-1, 2))
    shown = shapely.Polygon(pixels[np.isfinite(pixels).all(axis=1)])
    points = shapely.points(corners.pixels)
    # To the corners of the patch that is compared with the print.
    reach = np.sqrt(2.0) * np.minimum(HALF_CELLS * cell_px(corners.pixels), MAX_HALF_PX) + MARGIN_PX
    return np.asarray(shapely.contains(shown, points) & (shapely.distance(shown.exterior, points) > reach))
