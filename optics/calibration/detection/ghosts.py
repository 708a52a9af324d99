"""What the front of a sheet does to corners that its coating shows, and how they are found in spite of it.

The bare front of a mirror that is coated behind reflects some hundredths of the light itself, and sends as much of what
comes back from the coating to it once more. So the picture has a faint copy on either side, a few pixels off in the
plane of incidence. At an edge one copy is white already (or the other one still black), which moves its middle by some
hundredths of a pixel: alike in all views, as if the sheet were thicker.

From the nominal layout and the board's pose in the view it is known where the copies are, and by Fresnel's equations
how strong. What coating and front are really like is told by the view: one factor for each copy, by all its corners.
"""

from __future__ import annotations

import numpy as np

from optics.calibration import bootstrap
from optics.calibration.detection.corners import Corners
from optics.calibration.detection.refinement import Copies, Image
from optics.calibration.detection.sheet import again, corner_places, smooth
from optics.camera import Camera
from optics.image import Surfaces, images
from optics.mirror import Mirror
from optics.slab import surface_reflectance
from optics.targets import Charuco, Checkerboard
from optics.transforms import transform
from optics.values import FloatArray

REFLECTANCE = 0.92  # of the coating: what a factor for each copy makes good
PASSES = (0, 2)  # of the copies, to the coating and back; the picture has one, three have a five hundredth of the light
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
    if len(corners) >= FEWEST_CORNERS:
        factors = np.clip(np.median(free.copies, axis=0), 0.0, STRONGEST)
        copies = Copies(copies.offsets_px, copies.parts * factors)
    seen = again(picture, corners, target, copies, blur_cells=float(np.median(free.blur_cells)))
    if seen is None:
        return corners
    found = np.isfinite(seen.pixels).all(axis=1)
    ids, pixels = corners.ids[found], seen.pixels[found]
    good = smooth(corner_places(target)[ids], pixels)
    return Corners(ids[good], pixels[good])


def copies_of(corners: Corners, camera: Camera, mirror: Mirror, target: Charuco | Checkerboard) -> Copies | None:
    """The copies of corners (n) that a second-surface mirror shows; None where no pose fits them.

    Unfolded, light that goes k times to the coating and back passes 2 k t of the sheet, as in one k times as thick
    with the same front.
    """
    board = target.corners_in_board_mm
    pose = bootstrap.rig_from_board(camera, corners, board, mirror.apparent.virtual_centre_in_rig_mm)
    if pose is None:
        return None
    points = transform(pose, board[corners.ids])
    thickness, distance = mirror.thickness_mm, mirror.distance_mm
    pixels = {}
    for passes in (1, *PASSES):
        centre = mirror.virtual_centre_in_rig_mm * (1.0 + (passes - 1) * thickness / distance)
        surfaces = Surfaces(
            centre=centre[:, None],
            middle=mirror.outline_in_rig_mm.mean(axis=0)[:, None],
            thickness=np.array([passes * thickness]),
            index=np.array([mirror.refractive_index]),
            curvature=np.zeros((3, 1)),
        )
        pixels[passes] = camera.project(images(points.T, surfaces).image.T)
    along = -_directions(camera, corners.pixels) @ mirror.normal_in_rig
    lost = surface_reflectance(np.sqrt(np.maximum(along**-2 - 1.0, 0.0)), mirror.refractive_index)
    parts = {0: lost / ((1.0 - lost) ** 2 * REFLECTANCE), 2: REFLECTANCE * lost}
    offsets = np.stack([pixels[passes] - pixels[1] for passes in PASSES], axis=1)
    if not np.isfinite(offsets).all():
        return None
    return Copies(offsets, np.stack([parts[passes] for passes in PASSES], axis=1))


def _directions(camera: Camera, pixels: FloatArray) -> FloatArray:
    rays = camera.unproject(pixels)
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
