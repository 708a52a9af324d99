"""Mirrors of an asymmetric seed, as the optimiser's expressions and as values of `geometry`."""

from __future__ import annotations

import casadi as ca
import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program.mirror_variables import Kind, MirrorVariables, Optics, mirror_of
from mirrorcam.optics.design.program.seeds import mirrors_of, seed_of
from mirrorcam.optics.design.program.terms import Expression
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.mirror import Mirror

DISTORTION = [0.1, -0.2, 0.003, -0.004, 0.05]
KINDS = [
    Kind(4, False, False),
    Kind(5, True, False),
    Kind(6, False, True),
    Kind(4, True, True),
    Kind(4, False, False, pinhole=False),
    Kind(5, True, True, pinhole=False),
]
THICKNESS_MM, INDEX = 3.0, 1.49


def number(expression: Expression) -> FloatArray:
    return np.array(ca.evalf(ca.SX(expression)))


def spec_of(kind: Kind, fold_deg: float = 90.0) -> DesignSpec:
    camera = Camera.c920().replaced(
        aperture_mm=0.0 if kind.pinhole else 1.8, distortion=DISTORTION if kind.distorted else [0.0] * 5
    )
    return DesignSpec(
        rows=2,
        cols=2,
        sides=kind.sides,
        fold_deg=fold_deg,
        camera=camera,
        surface="second" if kind.second_surface else "first",
        thickness_mm=THICKNESS_MM,
    )


def optics_of(spec: DesignSpec) -> list[float]:
    """The first parameters of a term: glass and pupil."""
    glass = [spec.thickness_mm / spec.scale_mm, spec.refractive_index]
    pupil = [spec.camera.aperture_mm / 2.0 / spec.scale_mm, spec.scale_mm / spec.camera.focus_mm]
    return [*glass, *pupil]


def fold_of(spec: DesignSpec) -> FloatArray:
    """The first unknown of a term."""
    return np.array([np.arctan2(spec.view_from_rig[2, 1], spec.view_from_rig[2, 2])])


def seeded(spec: DesignSpec) -> tuple[FloatArray, FloatArray]:
    """Virtual centres (n, 3) and corners (n, 2 sides) of strictly convex, asymmetric mirrors."""
    seed, rng = seed_of(spec, 390.0), np.random.default_rng(3)
    centres = seed.centres + rng.normal(0.0, 0.02, seed.centres.shape)
    from_centre = seed.corners - (seed.corners.min(axis=1, keepdims=True) + seed.half_tile)
    on_edge = (np.abs(from_centre) < 0.5 * seed.half_tile).any(axis=2, keepdims=True)
    corners = seed.corners + from_centre * np.where(on_edge, 0.0, -0.2)
    return centres, (corners + rng.normal(0.0, 0.004, corners.shape)).reshape(len(centres), -1)


def expressed(spec: DesignSpec, kind: Kind, index: int) -> tuple[MirrorVariables, Mirror]:
    """One mirror as the optimiser's expression, evaluated in units of the scale, and as a `Mirror`."""
    centres, corners = seeded(spec)
    optics = Optics(ca.SX(spec.view_from_rig), *(ca.SX(number) for number in optics_of(spec)))
    expression = mirror_of(kind, optics, ca.SX(centres[index]), ca.SX(corners[index]))
    (mirror,) = mirrors_of(spec, centres[[index]] * spec.scale_mm, corners[[index]].reshape(1, -1, 2))
    return expression, mirror


def lens_of(spec: DesignSpec) -> list[FloatArray]:
    return [spec.camera.intrinsics, np.array([spec.camera.width_px, spec.camera.height_px], dtype=np.float64)]
