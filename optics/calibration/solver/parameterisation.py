"""The parameterisation of a calibration: which parameters a model leaves free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.observations import IntArray
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate, global_names
from mirrorcam.optics.geometry.camera import PINHOLE_NAMES, Camera


@dataclass(frozen=True)
class FrameTerms:
    """What a fit may change in single frames besides the board's pose, each with a normal prior around zero.

    A prior is given as the standardised residual that is as improbable as a value of 1: the scale of such residuals
    over the standard deviation of the value.

    Attributes
    ----------
    turn_per_rad
        Prior of the camera's rotation vector; None where the camera is not turned.
    bow_per_mm
        Prior of the bow of the board; None where every frame has the same board.
    """

    turn_per_rad: float | None = None
    bow_per_mm: float | None = None

    @property
    def free(self) -> IntArray:
        """Which of the numbers of a frame (12), as `Estimate.moved` has them, are free."""
        turn, bow = (given is not None for given in (self.turn_per_rad, self.bow_per_mm))
        return np.array([*range(6), *range(6, 6 + 3 * turn), *range(9, 9 + 3 * bow)], dtype=np.int64)

    @property
    def weights(self) -> FloatArray:
        """The priors (d,) of the free numbers of a frame; 0 for the pose."""
        given = [weight for weight in (self.turn_per_rad, self.bow_per_mm) if weight is not None]
        return np.concatenate([np.zeros(6), np.repeat(given, 3)])

    def values(self, estimate: Estimate) -> FloatArray:
        """The weighted values (f, d) of the free numbers of all frames: their squares add to the cost."""
        every = np.concatenate([np.zeros((len(estimate.rig_from_board), 6)), estimate.camera_turn, estimate.bow_mm], 1)
        return np.asarray(every[:, self.free] * self.weights)


@dataclass(frozen=True, eq=False)
class CentresPrior:
    """A normal prior on a combination of the virtual centres: the sum of `along` (m, 3), per mm, times the centres.

    It is `expected` with a standard deviation of 1.
    """

    along: FloatArray
    expected: float

    def value(self, centres_mm: FloatArray) -> float:
        """The value of centres (m, 3) in standard deviations, whose square adds to the cost."""
        return float(np.sum(self.along * centres_mm)) - self.expected


@dataclass(frozen=True)
class Model:
    """Parameters that a fit may change besides the board's poses, which are always free.

    Attributes
    ----------
    intrinsics
        Free intrinsics, of `Camera.intrinsic_names`; none in the paper's calibration.
    thickness
        One correction, in mm, to the thickness of all plates of second-surface mirrors. Their refractive index is held:
        only t (1 - tan' / tan) is observable, in which thickness and index are nearly one number.
    curvature
        Three numbers per mirror, the curvature of its reflecting surface.
    board
        The corners as drawn and the modes by which they may differ; every mode is free.
    mirrors
        The virtual centres; where they are held, a fit only finds the board's poses.
    frame_terms
        What is free in single frames besides the pose.
    centres_prior
        Prior on the virtual centres, for what no picture determines; None where pictures can determine all.
    """

    intrinsics: tuple[str, ...]
    thickness: bool
    curvature: bool
    board: Board
    mirrors: bool = True
    frame_terms: FrameTerms = FrameTerms()
    centres_prior: CentresPrior | None = None

    @property
    def prior_of_centres(self) -> CentresPrior | None:
        """The prior on the virtual centres, where they are free."""
        return self.centres_prior if self.mirrors else None

    def intrinsic_priors(self, camera: Camera) -> FloatArray:
        """Priors (i,) of the free intrinsics around zero, as `FrameTerms` has them; 0 where there is none."""
        sigmas = [*[np.inf] * len(PINHOLE_NAMES), *camera.lens.prior_sigmas]
        free = [name in self.intrinsics for name in camera.intrinsic_names]
        return np.asarray(1.0 / np.array(sigmas)[free])

    def intrinsic_values(self, camera: Camera) -> FloatArray:
        """The weighted values (i,) of the free intrinsics: their squares add to the cost."""
        free = [name in self.intrinsics for name in camera.intrinsic_names]
        return np.asarray(self.intrinsic_priors(camera) * camera.intrinsics[free])

    def prior_squares(self, estimate: Estimate) -> float:
        """What the priors of frames, intrinsics and centres add to the cost."""
        intrinsics, prior = self.intrinsic_values(estimate.camera), self.prior_of_centres
        centres = 0.0 if prior is None else prior.value(estimate.virtual_centres_in_rig_mm)
        return float(np.sum(self.frame_terms.values(estimate) ** 2) + np.sum(intrinsics**2) + centres**2)

    def parameters(self, camera: Camera, mirrors: int) -> tuple[str, ...]:
        """Names of the free globals of a camera with `mirrors` mirrors, in the order of `global_names`."""
        names = np.array(global_names(camera.intrinsic_names, mirrors, len(self.board.modes)))
        return tuple(names[self.free(camera, mirrors)].tolist())

    def free(self, camera: Camera, mirrors: int) -> NDArray[np.int64]:
        """Indices (g,) of the free globals among `global_names`, increasing.

        Raises ValueError where a free intrinsic is none of the camera's.
        """
        every = camera.intrinsic_names
        if unknown := [name for name in self.intrinsics if name not in every]:
            raise ValueError(f"unknown intrinsics {', '.join(unknown)}, expected some of {', '.join(every)}")

        def is_free(name: str) -> bool:
            if name.startswith("mirror "):
                return self.curvature if "curvature" in name else self.mirrors
            return name in self.intrinsics or (self.thickness if name == "sheet_mm" else name.startswith("board "))

        names = global_names(every, mirrors, len(self.board.modes))
        return np.array([place for place, name in enumerate(names) if is_free(name)], dtype=np.int64)
