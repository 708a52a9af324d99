"""What the front of a sheet does to corners that its coating shows, and how they are found in spite of it.

The bare front of a mirror that is coated behind reflects some hundredths of the light itself, and sends as much of what
comes back from the coating to it once more. So the picture has a faint copy on either side, a few pixels off in the
plane of incidence. At an edge one copy is white already (or the other one still black), which moves its middle by some
hundredths of a pixel: alike in all views, as if the sheet were thicker.

From the nominal layout and the board's pose in the view it is known where the copies are, and by Fresnel's equations
how strong. What coating and front are really like is told by the view: one factor for each copy, by all its corners.
One copy ends before the picture does, where its light would leave the sheet past the edge. Just where depends on how
the sheet was cut and glued, so corners near that place are left out.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from mirrorcam.optics.calibration.detection.board_growing import again, corner_places, smooth
from mirrorcam.optics.calibration.detection.checkerboard import cell_px
from mirrorcam.optics.calibration.detection.corner_refinement import HALF, MOST_PX, GhostImages, Image
from mirrorcam.optics.calibration.solver import initial_estimates
from mirrorcam.optics.calibration.solver.observations import MIN_CORNERS, Corners
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.plate import surface_reflectance
from mirrorcam.optics.geometry.targets import Target
from mirrorcam.optics.geometry.transforms import transform

REFLECTANCE = 0.92  # of the coating: what a factor for each copy makes good
PASSES = (0, 2)  # of the copies, to the coating and back; the picture has one, three have a five hundredth of the light
MARGIN_PX = 2.0
EDGE_POINTS = 8  # along each edge of an outline, which a lens bends
FEWEST_CORNERS = 40  # that tell how strong copies are; of fewer, Fresnel's equations are believed
STRONGEST = 2.0  # times what they say


def refine_with_ghost_images(
    picture: Image, corners: Corners, camera: Camera, mirror: Mirror, target: Target
) -> Corners:
    """Corners of a mirror's view, refined once more where its sheet has a front that reflects.

    Of a second-surface mirror only those that all copies are whole around.
    """
    if not mirror.is_second_surface:
        return corners
    whole = _inside(corners, camera, _passed(mirror, max(PASSES)))
    corners = Corners(corners.ids[whole], corners.pixels[whole])
    copies = ghost_images_of(corners, camera, mirror, target) if len(corners) >= MIN_CORNERS else None
    free = None if copies is None else again(picture, corners, target, copies, fit_strengths=True)
    if copies is None or free is None:
        return Corners(corners.ids[:0], corners.pixels[:0])
    if len(corners) >= FEWEST_CORNERS:
        factors = np.clip(np.median(free.copies, axis=0), 0.0, STRONGEST)
        copies = GhostImages(copies.offsets_px, copies.parts * factors)
    seen = again(picture, corners, target, copies, blur_cells=float(np.median(free.blur_cells)))
    if seen is None:
        return Corners(corners.ids[:0], corners.pixels[:0])
    found = np.isfinite(seen.pixels).all(axis=1)
    ids, pixels = corners.ids[found], seen.pixels[found]
    good = smooth(corner_places(target)[ids], pixels)
    return Corners(ids[good], pixels[good])


def ghost_images_of(corners: Corners, camera: Camera, mirror: Mirror, target: Target) -> GhostImages | None:
    """The copies of corners (n) that a second-surface mirror shows; None where no pose of the board fits them."""
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
    parts = np.stack([lost / ((1.0 - lost) ** 2 * REFLECTANCE), REFLECTANCE * lost], axis=1)
    return GhostImages(offsets, parts)


def _passed(mirror: Mirror, passes: int) -> Mirror:
    """The mirror that light shows which goes so many times to the coating and back.

    Unfolded, it passes 2 k t of the sheet, as in one that is k times as thick and has the same front.
    """
    deeper_mm = (passes - 1) * mirror.thickness_mm
    return mirror.replaced(
        virtual_centre_in_rig_mm=mirror.virtual_centre_in_rig_mm * (1.0 + deeper_mm / mirror.distance_mm),
        outline_in_rig_mm=mirror.outline_in_rig_mm - deeper_mm * mirror.normal_in_rig,
        surface="second" if passes else "first",
        thickness_mm=passes * mirror.thickness_mm if passes else mirror.thickness_mm,
    )


def _inside(corners: Corners, camera: Camera, mirror: Mirror) -> NDArray[np.bool_]:
    """Which corners (n) a mirror shows with all that they are refined by."""
    outline = mirror.usable_normalized
    if not len(outline) or len(corners) < 2:
        return np.zeros(len(corners), dtype=np.bool_)
    part = (np.arange(EDGE_POINTS) / EDGE_POINTS)[:, None]
    edges = outline[:, None] * (1.0 - part) + np.roll(outline, -1, axis=0)[:, None] * part
    pixels = camera.pixels_from_normalized(edges.reshape(-1, 2))
    shown = shapely.Polygon(pixels[np.isfinite(pixels).all(axis=1)])
    points = shapely.points(corners.pixels)
    # To the corners of the square that is compared with the print.
    reach = np.sqrt(2.0) * np.minimum(HALF * cell_px(corners.pixels), MOST_PX) + MARGIN_PX
    return np.asarray(shapely.contains(shown, points) & (shapely.distance(shown.exterior, points) > reach))
