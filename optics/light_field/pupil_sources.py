"""Where on the sensor the light of a decoded pixel is, and which part of the pupil its mirror serves there.

Towards the border of a sub-image a lens sees less and less of the scene in its mirror, past whose edge it sees what
lies beside: the gap, taken as dark, or another mirror. What is left of the pupil is seen from its centroid.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.pupil import HalfPlanes, Pupil, disc_part, served_through
from mirrorcam.optics.geometry.sub_images import whole_pupil_outline

LEAST_SHARE = 1.0 / 3.0
"""Share of the pupil below which a pixel is left out: brightened by more than its inverse, noise would show."""
MOST_CROSSTALK = 0.01
"""Share of the pupil up to which light of another mirror is left in a pixel."""
POINTS_AT_ONCE = 2**16


def served_sources(
    layout: Layout, mirror_index: int, points_in_rig: FloatArray, margin_px: float
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Sensor positions (..., 2) of points (..., 3) that a mirror shows, and its shares (...) of the pupil there.

    The share is 0 where the point is left out: where the mirror serves less than `LEAST_SHARE` within `margin_px`, or
    any other serves more than `MOST_CROSSTALK`.
    """
    points = points_in_rig.reshape(-1, 3)
    parts = [
        _served(layout, mirror_index, points[start : start + POINTS_AT_ONCE], margin_px)
        for start in range(0, len(points), POINTS_AT_ONCE)
    ]
    pixels, shares = (np.concatenate(found) for found in zip(*parts, strict=True))
    shape = points_in_rig.shape[:-1]
    return pixels.reshape(*shape, 2), shares.reshape(shape)


def _served(
    layout: Layout, mirror_index: int, points: FloatArray, margin_px: float
) -> tuple[FloatArray, NDArray[np.float32]]:
    mirror, camera = layout.mirrors[mirror_index], layout.camera
    image = mirror.image_of(points)
    axial = np.where(image[:, 2:] > 0.0, image[:, 2:], np.nan)
    normalized = image[:, :2] / axial
    pupil, share = camera.pupil, np.zeros(len(points))
    within = Polygon(whole_pupil_outline(mirror, pupil)).buffer(-2.0 * margin_px / min(camera.fx_px, camera.fy_px))
    shapely.prepare(within)
    share[shapely.contains_xy(within, normalized)] = 1.0
    border = np.flatnonzero((share == 0.0) & _near(mirror, pupil, normalized))
    normalized[border], share[border] = _partial(mirror, camera, normalized[border], axial[border], margin_px)
    pixels = camera.pixels_from_normalized(normalized)
    u, v = pixels.T
    share[~((u >= 0.0) & (u <= camera.width_px - 1.0) & (v >= 0.0) & (v <= camera.height_px - 1.0))] = 0.0
    for other in (*layout.mirrors[:mirror_index], *layout.mirrors[mirror_index + 1 :]):
        asked = np.flatnonzero(share)
        asked = asked[_near(other, pupil, normalized[asked])]
        crosstalk = disc_part(served_through(other, normalized[asked], pupil.focus_mm), pupil.radius_mm).share
        share[asked[crosstalk > MOST_CROSSTALK]] = 0.0
    return pixels, share.astype(np.float32)


def _partial(
    mirror: Mirror, camera: Camera, chief: FloatArray, axial_mm: FloatArray, margin_px: float
) -> tuple[FloatArray, FloatArray]:
    """Where (n, 2) the light of images is whose chief rays and distances (n, 1) along the axis are known, and shares.

    From a place in the pupil, an image out of focus is seen beside where its chief ray is.
    """
    pupil = camera.pupil
    centroid = disc_part(served_through(mirror, chief, pupil.focus_mm), pupil.radius_mm).centroid
    normalized = chief - pupil.radius_mm * centroid * (1.0 / axial_mm - 1.0 / pupil.focus_mm)
    planes = served_through(mirror, normalized, pupil.focus_mm)
    share = disc_part(planes, pupil.radius_mm).share
    margin_mm = margin_px * _mm_of_a_px(mirror, camera, normalized)
    farther_out = HalfPlanes(planes.direction, planes.distance - margin_mm)
    least = disc_part(farther_out, pupil.radius_mm).share
    return normalized, np.where(least >= LEAST_SHARE, share, 0.0)


def _mm_of_a_px(mirror: Mirror, camera: Camera, normalized: FloatArray) -> FloatArray:
    """How far (n, m) a px across the image of an edge moves the border of its half-plane in the pupil.

    0 where the ray leads away from the mirror.
    """
    here, right, down = (
        served_through(mirror, normalized + step, camera.focus_mm).distance
        for step in ((0.0, 0.0), (1.0 / camera.fx_px, 0.0), (0.0, 1.0 / camera.fy_px))
    )
    ahead = np.isfinite(here) & np.isfinite(right) & np.isfinite(down)
    across, along = (np.subtract(there, here, out=np.zeros_like(here), where=ahead) for there in (right, down))
    return np.hypot(across, along)


def _near(mirror: Mirror, pupil: Pupil, normalized: FloatArray) -> NDArray[np.bool_]:
    """Chief rays (n, 2) so near the outline of a mirror that it may serve some of the pupil."""
    corners = mirror.outline_in_rig_mm + mirror.front_mm * mirror.normal_in_rig
    outline = corners[:, :2] / corners[:, 2:]
    reach = pupil.radius_mm * np.abs(1.0 / corners[:, 2] - 1.0 / pupil.focus_mm).max()
    (left, top), (right, bottom) = outline.min(axis=0) - reach, outline.max(axis=0) + reach
    x, y = normalized.T
    return np.asarray((x >= left) & (x <= right) & (y >= top) & (y <= bottom))
