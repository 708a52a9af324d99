"""What the front of a sheet does to corners that its coating shows, and how they are found in spite of it.

The bare front of a mirror that is coated behind reflects some hundredths of the light itself, and sends as much of what
comes back from the coating to it once more. So the picture has a faint copy on either side, a few pixels off in the
plane of incidence. At an edge one copy is white already (or the other one still black), which moves its middle by some
hundredths of a pixel: alike in all views, as if the sheet were thicker.

From the nominal layout and the board's pose in the view it is known where the copies are (one of them ends before the
picture does, where light would leave the sheet past its edge), and by Fresnel's equations how strong. What coating and
front are really like is told by the view: one factor for each copy, by all its corners.
"""

from __future__ import annotations

import cv2
import numpy as np

from optics.calibration import bootstrap
from optics.calibration.detection.corners import Corners, Grey
from optics.calibration.detection.refinement import Copies, Image
from optics.calibration.detection.sheet import again, corner_places, smooth
from optics.camera import Camera
from optics.mirror import Mirror
from optics.slab import surface_reflectance
from optics.targets import Charuco, Checkerboard
from optics.transforms import transform

REFLECTANCE = 0.92  # of the coating: what a factor for each copy makes good
PASSES = (0, 2)  # of the copies, to the coating and back; the picture has one, three have a five hundredth of the light
EDGE_POINTS = 8  # along each edge of an outline, which a lens bends
FEWEST_CORNERS = 40  # that tell how strong copies are; of fewer, Fresnel's equations are believed
STRONGEST = 2.0  # times what they say


def without_ghosts(
    picture: Image, corners: Corners, camera: Camera, mirror: Mirror, target: Charuco | Checkerboard
) -> Corners:
    """Corners of a mirror's view, refined once more where its sheet has a front that reflects."""
    copies = None if mirror.surface == "first" else copies_of(corners, camera, mirror, target)
    if copies is None:
        return corners
    free = again(picture, corners, target, copies, free_copies=True)
    if free is None:
        return corners
    factors = np.ones(len(PASSES))
    for k, strengths in enumerate(free.copies.T):
        told = strengths[np.isfinite(strengths)]
        if len(told) >= FEWEST_CORNERS:
            factors[k] = np.clip(np.median(told), 0.0, STRONGEST)
    copies = Copies(copies.offsets_px, copies.parts * factors, copies.shown)
    seen = again(picture, corners, target, copies, blur_cells=float(np.median(free.blur_cells)))
    if seen is None:
        return corners
    found = np.isfinite(seen.pixels).all(axis=1)
    ids, pixels = corners.ids[found], seen.pixels[found]
    good = smooth(corner_places(target)[ids], pixels)
    return Corners(ids[good], pixels[good])


def copies_of(corners: Corners, camera: Camera, mirror: Mirror, target: Charuco | Checkerboard) -> Copies | None:
    """The copies of corners (n) that a second-surface mirror shows; None where no pose of the board fits them."""
    board = target.corners_in_board_mm
    pose = bootstrap.rig_from_board(camera, corners, board, mirror.apparent.virtual_centre_in_rig_mm)
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
    return Copies(offsets, parts, tuple(_shown(camera, each) for each in mirrors))


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


def _shown(camera: Camera, mirror: Mirror) -> Grey:
    """Where a mirror shows the scene: 255, elsewhere 0."""
    shown = np.zeros((camera.height_px, camera.width_px), dtype=np.uint8)
    outline = mirror.usable_normalized
    if len(outline):
        part = (np.arange(EDGE_POINTS) / EDGE_POINTS)[:, None]
        edges = outline[:, None] * (1.0 - part) + np.roll(outline, -1, axis=0)[:, None] * part
        pixels = camera.pixels_from_normalized(edges.reshape(-1, 2))
        cv2.fillPoly(shown, [np.rint(pixels[np.isfinite(pixels).all(axis=1)]).astype(np.int32)], 255)
    return shown
