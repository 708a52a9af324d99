"""What the picture of the camera's step names on a clip: its points, slots, screws, and the end that goes in first."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.cad.assembly.pieces import Piece
from mirrorcam.cad.parts.camera_box import Nest
from mirrorcam.cad.parts.clip import ClipPlan
from mirrorcam.core.values import FloatArray

# A camera that goes into a nest is drawn turned by this, its first end still in reach of the V or the stop.
TILT_DEG = 14.0
# Where the viewer stands, in rig, with the nest's first end at the left; of another it is mirrored along x.
ABOVE_SCENE, BELOW_SCENE = (0.15, 0.45, 1.0), (-0.35, 1.0, -0.75)
FIRST_END = "this end goes in first"


def viewers(clip: ClipPlan) -> tuple[FloatArray, FloatArray]:
    """Directions (3,) in rig towards the two viewers: above the lens, and behind the camera."""
    mirrored = np.array([first_side(clip.nest) if clip.nest else -1.0, 1.0, 1.0]) * (-1.0, 1.0, 1.0)
    return np.array(ABOVE_SCENE) * mirrored, np.array(BELOW_SCENE) * mirrored


def first_side(nest: Nest) -> float:
    """The sign of x of the end that goes in first: that of the front's corner away from the mount."""
    return float(np.sign(nest.points[0, 0]))


def is_v(nest: Nest) -> bool:
    """Whether the first end rests in a V, as round ends do."""
    return bool(abs(nest.normals[4, 0]) > 0.1)


def notes_of(clip: ClipPlan) -> tuple[tuple[str, FloatArray], ...]:
    """What a clip's picture names, each with its point (3,) in rig: where the body rests, and the slots of the ties."""
    left, right, z = clip.tie_mm
    inner_y = clip.slide_y_mm + clip.slide.wall_mm
    notes = [("slot of the cable tie", np.array([x, inner_y, z])) for x in (left, right)]
    if clip.nest is None:
        return tuple(notes)
    points = clip.nest.points
    notes += [("front pad", point) for point in points[:3]]
    if is_v(clip.nest):
        return (*notes, ("V", points[3]), ("V", points[4]), ("side pad", points[5]))
    return (*notes, ("side pad", points[3]), ("side pad", points[4]), ("end pad", points[5]))


def screw_label(clip: ClipPlan, screw: Piece) -> str:
    """The title of a camera's screw, and of one of a nest where it is."""
    if clip.nest is None:
        return screw.title
    middle = np.asarray(screw.mesh.bounds).mean(axis=0)
    nearest = int(np.argmin([np.linalg.norm((one.head + one.tip) / 2.0 - middle) for one in clip.nest.screws]))
    return f"{('back', 'corner')[nearest]} screw, {screw.title.removesuffix(' screw')}"


def tilted(clip: ClipPlan, triangles: FloatArray) -> FloatArray:
    """The triangles (n, 3, 3) of a camera turned about its first end, as it goes into a nest; a board is not."""
    if clip.nest is None:
        return triangles
    side = first_side(clip.nest)
    pivot = end_point(clip.nest, triangles)
    turn = Rotation.from_euler("z", -side * TILT_DEG, degrees=True).as_matrix()
    return np.asarray((triangles - pivot) @ turn.T + pivot)


def end_point(nest: Nest, triangles: FloatArray) -> FloatArray:
    """The middle (3,) of a camera's first end."""
    corners = triangles.reshape(-1, 3)
    corner = corners[np.argmax(first_side(nest) * corners[:, 0])]
    return np.array([corner[0], corners[:, 1].mean(), nest.points[3, 2]])
