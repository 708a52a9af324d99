"""The parameterisation of a calibration: the free parameters of a model, and the prior on pairs of mirrors.

No picture determines the common rotation of two mirrors about the line where their planes meet. Rotated about that line
together with the boards, they produce exactly the same pictures: with virtual images S_i B of boards B, S_i Q is a
reflection for every rotation Q about a line in plane i, and (S_i Q)(Q^-1 B) = S_i B. The relative poses of the views do
not depend on it, but every measured position rotates with it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import IntArray, Observations
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, global_names
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.tolerances import Tolerances

PAIR_DEG = Tolerances().tilt_deg
"""Standard deviation of that rotation from the design: the assembly tolerance of mirrors."""
MIN_SINE = 1e-3


@dataclass(frozen=True)
class FrameTerms:
    """Per-frame parameters besides the board's pose, each with a normal prior around zero.

    A prior is the weight that converts a value to an equally improbable standardised residual: the scale of such
    residuals over the standard deviation of the value.

    Attributes
    ----------
    rotation_per_rad
        Prior of the camera's rotation vector; None if the camera is not rotated.
    bow_per_mm
        Prior of the bow of the board; None if the board is the same in all frames.
    motion_per_rad, motion_per_mm, acceleration_per_rad, acceleration_per_mm
        Priors of the velocity and the acceleration of the board during a readout, of its rotation and its translation;
        None if the board rests.
    """

    rotation_per_rad: float | None = None
    bow_per_mm: float | None = None
    motion_per_rad: float | None = None
    motion_per_mm: float | None = None
    acceleration_per_rad: float | None = None
    acceleration_per_mm: float | None = None

    @property
    def has_motion(self) -> bool:
        """Whether the board moves during a readout."""
        return self.motion_per_mm is not None

    @property
    def _priors(self) -> tuple[float | None, ...]:
        """The prior of each group of three parameters, after the pose."""
        return tuple(getattr(self, prior.name) for prior in fields(self))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the priors of the free parameters, of three each."""
        return tuple(prior.name for prior in fields(self) if getattr(self, prior.name) is not None)

    @property
    def free(self) -> IntArray:
        """Indices of the free parameters among the 24 of a frame, in the order of `Estimate.moved`."""
        groups = [range(6 + 3 * n, 9 + 3 * n) for n, prior in enumerate(self._priors) if prior is not None]
        return np.array([*range(6), *(index for group in groups for index in group)], dtype=np.int64)

    @property
    def weights(self) -> FloatArray:
        """Priors (d,) of a frame's free parameters; 0 for the pose."""
        return np.concatenate([np.zeros(6), np.repeat([prior for prior in self._priors if prior is not None], 3)])

    def values(self, estimate: Estimate) -> FloatArray:
        """Weighted values (f, d) of the free parameters of all frames; their squares add to the cost."""
        pose = np.zeros((len(estimate.rig_from_board), 6))
        values = np.concatenate([pose, estimate.camera_rotation, estimate.bow_mm, estimate.motion], axis=1)
        return np.asarray(values[:, self.free] * self.weights)


@dataclass(frozen=True, eq=False)
class CentresPrior:
    """Normal prior on a linear combination of the virtual centres, with `coefficients` (m, 3), per mm.

    It has the mean `expected` and a standard deviation of 1.
    """

    coefficients: FloatArray
    expected: float

    def value(self, centres_mm: FloatArray) -> float:
        """Deviation of centres (m, 3) from the mean, in standard deviations; its square adds to the cost."""
        return float(np.sum(self.coefficients * centres_mm)) - self.expected


@dataclass(frozen=True)
class Model:
    """Free parameters of a fit besides the board's poses, which are always free.

    Attributes
    ----------
    intrinsics
        Free intrinsics, from `Camera.intrinsic_names`; empty in the original paper's calibration.
    thickness
        Whether one correction, in mm, applies to the thickness of all plates of second-surface mirrors. Their
        refractive index is fixed: only t (1 - tan' / tan) is observable, in which thickness and index are nearly
        degenerate.
    curvature
        Whether each mirror has three curvatures of its reflecting surface.
    board
        The corners as drawn, and the modes by which they may deviate; every mode is free.
    mirrors
        Whether the virtual centres are free; otherwise a fit only estimates the board's poses.
    frame_terms
        Free per-frame parameters besides the pose.
    centres_prior
        Prior on the virtual centres in a direction that no picture determines; None if there is no such direction.
    index_sigma
        Standard deviation of the plates' refractive index, which the covariance includes; 0 if the layout states it.
    """

    intrinsics: tuple[str, ...]
    thickness: bool
    curvature: bool
    board: Board
    mirrors: bool = True
    frame_terms: FrameTerms = FrameTerms()
    centres_prior: CentresPrior | None = None
    index_sigma: float = 0.0

    @property
    def prior_of_centres(self) -> CentresPrior | None:
        """The prior on the virtual centres, if they are free."""
        return self.centres_prior if self.mirrors else None

    def intrinsic_priors(self, camera: Camera) -> FloatArray:
        """Priors (i,) of the free intrinsics around zero, in the form of `FrameTerms`; 0 without a prior."""
        free = [name in self.intrinsics for name in camera.intrinsic_names]
        return np.asarray(1.0 / camera.prior_sigmas[free])

    def intrinsic_values(self, camera: Camera) -> FloatArray:
        """Weighted values (i,) of the free intrinsics; their squares add to the cost."""
        free = [name in self.intrinsics for name in camera.intrinsic_names]
        return np.asarray(self.intrinsic_priors(camera) * camera.intrinsics[free])

    def prior_squares(self, estimate: Estimate) -> float:
        """Cost of the priors of frames, intrinsics and centres."""
        intrinsics, prior = self.intrinsic_values(estimate.camera), self.prior_of_centres
        centres = 0.0 if prior is None else prior.value(estimate.virtual_centres_in_rig_mm)
        return float(np.sum(self.frame_terms.values(estimate) ** 2) + np.sum(intrinsics**2) + centres**2)

    def parameters(self, camera: Camera, mirrors: int) -> tuple[str, ...]:
        """Names of the free global parameters of a camera with `mirrors` mirrors, in the order of `global_names`."""
        names = np.array(global_names(camera.intrinsic_names, mirrors, len(self.board.modes)))
        return tuple(names[self.free(camera, mirrors)].tolist())

    def free(self, camera: Camera, mirrors: int) -> NDArray[np.int64]:
        """Indices (g,) of the free global parameters among `global_names`, increasing.

        Raises ValueError if a free intrinsic is unknown to the camera.
        """
        all_names = camera.intrinsic_names
        if unknown := [name for name in self.intrinsics if name not in all_names]:
            raise ValueError(f"unknown intrinsics {', '.join(unknown)}, expected some of {', '.join(all_names)}")

        def is_free(name: str) -> bool:
            if name.startswith("mirror "):
                return self.curvature if "curvature" in name else self.mirrors
            return name in self.intrinsics or (self.thickness if name == "sheet_mm" else name.startswith("board "))

        names = global_names(all_names, mirrors, len(self.board.modes))
        return np.array([index for index, name in enumerate(names) if is_free(name)], dtype=np.int64)


def prior_of(layout: Layout, observations: Observations) -> CentresPrior | None:
    """Return the prior on a layout's virtual centres that observations need: with a direct view of the board, none."""
    return None if observations.direct_and_mirrored else pair_prior(layout)


def pair_prior(layout: Layout, sigma_deg: float = PAIR_DEG) -> CentresPrior | None:
    """Return a prior that keeps the common rotation near a layout's; None for more than two mirrors, or none.

    Raises InputError for one mirror, which pictures cannot determine, and for parallel mirrors, whose planes do not
    meet.
    """
    if len(layout.mirrors) > 2 or not layout.mirrors:
        return None
    if len(layout.mirrors) < 2:
        raise InputError("one mirror without a direct view of the board, expected two or more mirrors")
    centres = layout.virtual_centres_in_rig_mm
    d_rotation = _Line.of(layout).d_rotation(centres)
    coefficients = d_rotation / (np.sum(d_rotation**2) * np.deg2rad(sigma_deg))
    return CentresPrior(coefficients, float(np.sum(coefficients * centres)))


def rotated_like(layout: Layout, other: Layout) -> tuple[Layout, float]:
    """Rotate a layout of two mirrors about their planes' line of intersection to best match another layout's normals.

    Returns the layout and the angle, rad. The views rotate with it, so their relative poses are unchanged.
    """
    line = _Line.of(layout)
    cosines, sines = [], []
    for mirror, reference in zip(layout.mirrors, other.mirrors, strict=True):
        perpendicular = mirror.normal_in_rig - (mirror.normal_in_rig @ line.direction) * line.direction
        cosines.append(perpendicular @ reference.normal_in_rig)
        sines.append(np.cross(line.direction, perpendicular) @ reference.normal_in_rig)
    angle = float(np.arctan2(sum(sines), sum(cosines)))
    return line.rotated(layout, angle), angle


@dataclass(frozen=True, eq=False)
class _Line:
    """The line where the planes of two mirrors meet: a point (3,), mm, and its unit direction (3,)."""

    point: FloatArray
    direction: FloatArray

    @classmethod
    def of(cls, layout: Layout) -> _Line:
        centres = layout.virtual_centres_in_rig_mm
        lengths = np.linalg.norm(centres, axis=1)
        normals = centres / lengths[:, None]
        direction = np.cross(normals[0], normals[1])
        sine = float(np.linalg.norm(direction))
        if sine < MIN_SINE:
            raise InputError("both mirrors are parallel, expected planes that meet")
        direction = direction / sine
        return cls(np.linalg.solve(np.vstack([normals, direction]), [*lengths / 2.0, 0.0]), direction)

    def d_rotation(self, centres: FloatArray) -> FloatArray:
        """Derivatives (2, 3), mm per rad, of virtual centres (2, 3) as the planes rotate about the line."""
        lengths = np.linalg.norm(centres, axis=1)[:, None]
        normals = centres / lengths
        d_normal = np.cross(self.direction, normals)
        return np.asarray(2.0 * (d_normal @ self.point)[:, None] * normals + lengths * d_normal)

    def rotated(self, layout: Layout, angle: float) -> Layout:
        """Rotate a layout about the line."""
        rotation = Rotation.from_rotvec(angle * self.direction).as_matrix()
        mirrors = tuple(
            mirror.moved(rotation, (rotation - np.eye(3)) @ (mirror.outline_in_rig_mm.mean(axis=0) - self.point))
            for mirror in layout.mirrors
        )
        return layout.replaced(mirrors=mirrors, view_from_rig=layout.view_from_rig @ rotation.T)
