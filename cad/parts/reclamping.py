"""Repeatability of a camera's pose when it is removed from its clip and reinserted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirrorcam.cad.parts.camera_box import body_box, error_jacobian
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.cad.plan.hardware import Hardware
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.camera_body import BoardHoles
from mirrorcam.optics.geometry.layout import Layout, working_distance_mm

# Assumed standard deviation of a contact point along its normal: the 0.2 mm lines of a clean pad of printed plastic
# touch the moulded body at the same points again.
CONTACT_MM = 0.02
# Grid points along each axis over which the motions of a board within the play of its holes are averaged.
GRID_POINTS = 61


@dataclass(frozen=True)
class Repeatability:
    """Standard deviations of the motion of a camera that is removed from its clip and reinserted.

    They are the pupil's shift, the body's rotation, and the motion of the sub-image that moves most: its total motion,
    and its motion relative to the mean of all sub-images, which changes the views' disparities.
    """

    shift_mm: float
    rotation_deg: float
    image_px: float
    between_views_px: float


def repeatability(clip: ClipPlan, layout: Layout, hardware: Hardware) -> Repeatability:
    """Repeatability of a camera in a nest, or of a board on its posts.

    A nest has independent errors of `CONTACT_MM` at its six points. A board has the same errors along the axes of its
    posts, and is uniformly distributed in its plane within the play of its holes round the screws.
    """
    held_by = hardware.camera.held_by
    if clip.nest is not None:
        motion = CONTACT_MM * error_jacobian(clip.nest)
    elif isinstance(held_by, BoardHoles):
        posts = np.array([(*screw.head[:2], _back_mm(hardware)) for screw in clip.screws])
        motion = np.hstack([CONTACT_MM * _post_error_jacobian(posts), _motion_in_play(posts[:, :2], held_by.play_mm)])
    else:
        raise ValueError("the clip has no nest for this body, expected the clip of this camera")
    motion_px = _image_jacobian(layout, working_distance_mm(layout) or hardware.holder.depth_without_spec_mm) @ motion
    relative_px = motion_px - motion_px.mean(axis=0)
    return Repeatability(
        shift_mm=float(np.linalg.norm(motion[:3])),
        rotation_deg=float(np.degrees(np.linalg.norm(motion[3:]))),
        image_px=_max_sigma_px(motion_px),
        between_views_px=_max_sigma_px(relative_px),
    )


def _back_mm(hardware: Hardware) -> float:
    return float(body_box(hardware.camera).low[2])


def _post_error_jacobian(posts: FloatArray) -> FloatArray:
    """Jacobian (6, n) of a board's motion, mm and rad in the rig frame, with respect to errors in mm of post heights.

    The board is in the least-squares plane of the posts' ends (n, 3); with two posts, it does not rotate about the line
    between them. Points at the posts do not move within the plane, so a pupil in front of it moves laterally.
    """
    x, y, z = posts[:, 0], posts[:, 1], float(posts[:, 2].mean())
    # The board's heights at the posts for a shift along z and rotations about x and y.
    heights = np.column_stack([np.ones(len(posts)), y, -x])
    motion = np.zeros((6, len(posts)))
    motion[2:5] = np.linalg.pinv(heights)
    motion[0], motion[1] = -z * motion[4], z * motion[3]
    return motion


def _motion_in_play(centres: FloatArray, play: float) -> FloatArray:
    """A square root (6, 3) of the covariance of a board's in-plane motion within the play of its holes, in mm and rad.

    The motions (t, w), in the rig frame, are uniformly distributed where |t + w x p| <= play at the centre p of every
    hole (n, 2). The mean over the holes gives |t| <= play about their centroid; w is at most 2 play over their largest
    distance.
    """
    motion = np.zeros((6, 3))
    if play == 0.0:
        return motion
    centroid = centres.mean(axis=0)
    arms = centres - centroid
    spacing = np.linalg.norm(centres[:, None] - centres[None], axis=2).max()
    grid = np.linspace(-1.0, 1.0, GRID_POINTS)
    shifts, rotations = play * grid, 2.0 * play / spacing * grid
    x, y, w = (axis.ravel() for axis in np.meshgrid(shifts, shifts, rotations, indexing="ij"))
    free = np.ones(len(w), dtype=bool)
    for arm in arms:
        free &= np.hypot(x - w * arm[1], y + w * arm[0]) <= play * (1.0 + 1e-12)
    possible = np.column_stack([x, y, w])[free]
    # The root along the eigenvectors; the pupil moves with the centroid, and rotates about it.
    variances, axes = np.linalg.eigh(possible.T @ possible / len(possible))
    root = axes * np.sqrt(np.maximum(variances, 0.0))
    motion[0] = root[0] + root[2] * centroid[1]
    motion[1] = root[1] - root[2] * centroid[0]
    motion[5] = root[2]
    return motion


def _max_sigma_px(motion_px: FloatArray) -> float:
    """The largest standard deviation, over views, of motions (n, 2, k) due to independent unit errors."""
    return float(np.sqrt((motion_px**2).sum(axis=(1, 2))).max())


def _image_jacobian(layout: Layout, distance_mm: float) -> FloatArray:
    """Jacobian (n, 2, 6) of the pixel of a point at the centre of each view, with respect to the camera's motion.

    The point is at the working distance. The columns are for a shift t in mm and a rotation w in rad. In the camera's
    frame, the point's mirror image p moves by -(t + w x p), and its pixel by f (dx - x/z dz) / z, without distortion.
    """
    camera, rows = layout.camera, []
    for mirror in layout.mirrors:
        centre = mirror.outline_in_rig_mm.mean(axis=0)
        distance = float(np.linalg.norm(centre))
        point = centre / distance * (distance + distance_mm)
        x, y, z = point
        cross_matrix = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        in_camera = -np.hstack([np.eye(3), cross_matrix])
        pixel = np.array([[camera.fx_px, 0.0, -camera.fx_px * x / z], [0.0, camera.fy_px, -camera.fy_px * y / z]]) / z
        rows.append(pixel @ in_camera)
    return np.array(rows)
