"""What no picture tells of two mirrors: how they are turned together about the line where their planes meet.

Turned together about that line, with the boards, they show exactly the same pictures: with virtual images S_i B of
boards B, S_i Q is a reflection for every rotation Q about a line in plane i, and (S_i Q)(Q^-1 B) = S_i B. What the
views are to each other does not depend on it; all that is measured in space is turned by it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mirrorcam.core.values import FloatArray, InputError
from mirrorcam.optics.calibration.solver.parameterisation import CentresPrior
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances

PAIR_DEG = Tolerances().tilt_deg
"""Standard deviation of that rotation about the design, which is that of mirrors as they are assembled."""
LEAST_SINE = 1e-3


def pair_prior(layout: Layout, sigma_deg: float = PAIR_DEG) -> CentresPrior | None:
    """A prior that holds the rotation near that of a layout; None for more than two mirrors.

    Raises InputError for one mirror, of which no picture tells anything, and for parallel ones, whose planes do not
    meet.
    """
    if len(layout.mirrors) > 2:
        return None
    if len(layout.mirrors) < 2:
        raise InputError("one mirror without a direct view of the board, expected two or more mirrors")
    centres = layout.virtual_centres_in_rig_mm
    by_turn = _Line.of(layout).by_turn(centres)
    along = by_turn / (np.sum(by_turn**2) * np.deg2rad(sigma_deg))
    return CentresPrior(along, float(np.sum(along * centres)))


def turned_like(layout: Layout, other: Layout) -> tuple[Layout, float]:
    """A layout of two mirrors, turned about the line where their planes meet to have the normals of another.

    The angle, in rad, is returned beside it. Views are turned along, so that they are to each other what they were.
    """
    line = _Line.of(layout)
    cosines, sines = [], []
    for mirror, like in zip(layout.mirrors, other.mirrors, strict=True):
        across = mirror.normal_in_rig - (mirror.normal_in_rig @ line.direction) * line.direction
        cosines.append(across @ like.normal_in_rig)
        sines.append(np.cross(line.direction, across) @ like.normal_in_rig)
    angle = float(np.arctan2(sum(sines), sum(cosines)))
    return line.turned(layout, angle), angle


@dataclass(frozen=True, eq=False)
class _Line:
    """The line where the planes of two mirrors meet: a point (3,) in mm, and its unit direction."""

    point: FloatArray
    direction: FloatArray

    @classmethod
    def of(cls, layout: Layout) -> _Line:
        centres = layout.virtual_centres_in_rig_mm
        lengths = np.linalg.norm(centres, axis=1)
        normals = centres / lengths[:, None]
        direction = np.cross(normals[0], normals[1])
        sine = float(np.linalg.norm(direction))
        if sine < LEAST_SINE:
            raise InputError("both mirrors are parallel, expected two whose planes meet")
        direction = direction / sine
        return cls(np.linalg.solve(np.vstack([normals, direction]), [*lengths / 2.0, 0.0]), direction)

    def by_turn(self, centres: FloatArray) -> FloatArray:
        """Displacements (2, 3), mm per rad, of virtual centres (2, 3) as the planes turn about the line."""
        lengths = np.linalg.norm(centres, axis=1)[:, None]
        normals = centres / lengths
        turned = np.cross(self.direction, normals)
        return np.asarray(2.0 * (turned @ self.point)[:, None] * normals + lengths * turned)

    def turned(self, layout: Layout, angle: float) -> Layout:
        """A layout turned about the line."""
        rotation = Rotation.from_rotvec(angle * self.direction).as_matrix()
        mirrors = tuple(
            mirror.moved(rotation, (rotation - np.eye(3)) @ (mirror.outline_in_rig_mm.mean(axis=0) - self.point))
            for mirror in layout.mirrors
        )
        return layout.replaced(mirrors=mirrors, view_from_rig=layout.view_from_rig @ rotation.T)
