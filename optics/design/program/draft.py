"""A design's nonlinear program under construction: its mirrors, their common parameters, and margins for tolerances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from mirrorcam.core.bounds import FOLD_DEG
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.program import constraints
from mirrorcam.optics.design.program.mirror_variables import Kind, expressible
from mirrorcam.optics.design.program.nonlinear_program import Program
from mirrorcam.optics.design.program.seeds import Seed, sensor_bounds
from mirrorcam.optics.design.program.terms import Indices, Term
from mirrorcam.optics.geometry.design_spec import FIRST_FOLD_DEG, DesignSpec

TIE_BREAK = 1e-3
"""Small weight that resolves ties in the objective, so that unconstrained corners move outward."""
MAX_CENTRE_SHIFT = 0.6
"""Limit on the change of a virtual centre along each axis, in units of the design scale."""
MirrorUnknowns = tuple[Indices, Indices]
"""Virtual centre (3) and corners (2 sides) of a mirror."""
SAFE_SIGMAS = 3.0
"""Separation of neighbouring sub-images, in standard deviations, so that none of 200 devices violates it."""
SEED = 15
DEVICES = 8
"""Number of devices as built in the objective of a robust design, in addition to the exact device."""


@dataclass(frozen=True)
class Draft:
    """A program with the mirrors of a seed as its first unknowns; in view axes, in units of the design scale.

    `fold`, `mirrors` and `sizes` are indices of unknowns; mirrors are in the order of the layout. `sizes` (n, 2) belong
    to rectangles and are the same for all mirrors of one size; (0, 2) for free outlines.
    """

    spec: DesignSpec
    seed: Seed
    program: Program
    fold: Indices
    mirrors: tuple[MirrorUnknowns, ...]
    sizes: Indices

    @classmethod
    def of(cls, spec: DesignSpec, seed: Seed) -> Self:
        """The program of a spec with only the mirrors and their individual constraints."""
        program = Program()
        fold = program.unknown(*np.deg2rad(_start_and_range_deg(spec)))
        low, high = sensor_bounds(spec.camera)
        centres = [
            program.unknown(centre, centre - MAX_CENTRE_SHIFT, centre + MAX_CENTRE_SHIFT)
            for centre in _spread(seed.centres, spec.arrangement.steps)
        ]
        corners = [
            program.unknown(polygon.ravel(), np.tile(low, spec.sides), np.tile(high, spec.sides))
            for polygon in seed.corners
        ]
        sizes = _sizes(spec, seed, program)
        draft = cls(spec, seed, program, fold, tuple(zip(centres, corners, strict=True)), sizes)
        limits = [spec.min_edge_mm / spec.scale_mm, spec.min_area_mm2 / spec.scale_mm**2]
        nearest, reward = min(spec.depths_mm) / spec.scale_mm, TIE_BREAK / len(draft.mirrors)
        for mirror in draft.mirrors:
            parameters: list[ArrayLike] = [*draft.lens, limits, nearest, draft.tile_area, reward]
            draft.add(constraints.mirror_term(draft.kind), [*mirror], parameters)
        for mirror, size in zip(draft.mirrors, sizes, strict=False):
            draft.add(constraints.rectangle_term(draft.kind), [*mirror, size], [])
        return draft

    @property
    def kind(self) -> Kind:
        """The form of the mirrors' expressions."""
        return Kind.of(self.spec)

    @property
    def centres(self) -> list[Indices]:
        """Indices of the virtual centres (3 each)."""
        return [centre for centre, _ in self.mirrors]

    @property
    def optics(self) -> list[float]:
        """Thickness, refractive index, radius of the pupil, 1 / focus."""
        spec = self.spec
        return [
            spec.thickness_mm / spec.scale_mm,
            spec.refractive_index,
            spec.camera.pupil.radius_mm / spec.scale_mm,
            spec.scale_mm / spec.camera.focus_mm,
        ]

    @property
    def lens(self) -> list[ArrayLike]:
        """Intrinsics (k) and sensor px (2)."""
        camera = expressible(self.spec.camera)
        return [camera.intrinsics, [camera.width_px, camera.height_px]]

    @property
    def tile_area(self) -> float:
        """Normalized area of a tile of the sensor."""
        return 4.0 * float(np.prod(self.seed.half_tile))

    def add(self, term: Term, parts: list[Indices], parameters: list[ArrayLike]) -> None:
        """Add a term whose unknowns are the fold and `parts`, and whose first parameters are `optics`."""
        self.program.add(term, [self.fold, *parts], [self.optics, *parameters])


SHORTEST_MM = 3.0
"""Side of a rectangle that the search does not go below, unless shorter ones are allowed."""


def _sizes(spec: DesignSpec, seed: Seed, program: Program) -> Indices:
    """Add the sizes of rectangles; returns their indices (n, 2), or (0, 2) for free outlines.

    Sides vary freely, those of sizes that are sold between the smallest and the largest. The terms of the mirrors limit
    the smallest edge, so that the limit can be relaxed.
    """
    sizes = spec.rectangle_sizes
    if sizes is None:
        return np.zeros((0, 2), dtype=np.int64)
    low, high = min(spec.min_edge_mm, SHORTEST_MM) / spec.scale_mm, np.inf
    if sizes.is_stock:
        low, high = sizes.stock_mm.min() / spec.scale_mm, sizes.stock_mm.max() / spec.scale_mm
    starts = np.clip(seed.edges(spec.view_from_rig), low, high)
    if spec.same_size:
        starts = starts.min(axis=0, keepdims=True)
    indices = np.array([program.unknown(start, low, high) for start in starts])
    return np.broadcast_to(indices, (len(seed.centres), 2))


def _spread(centres: FloatArray, steps: FloatArray) -> FloatArray:
    """Spread centres (n, 3) along an axis along which the seed of a pattern hardly separates them.

    Otherwise the spacing that divides the grid error could be zero, for example if views on a slant have adjacent
    tiles.
    """
    spread = centres.copy()
    for axis, lines in enumerate(steps.T):
        if lines.any():
            spacing = spread[:, axis] @ lines / (lines @ lines)
            if spacing < constraints.MIN_GRID_SPACING / 2.0:
                spread[:, axis] += (constraints.MIN_GRID_SPACING - spacing) * lines
    return spread


def _start_and_range_deg(spec: DesignSpec) -> tuple[float, float, float]:
    """Start value, minimum and maximum of the fold angle."""
    if spec.fold_deg == "auto":
        return FIRST_FOLD_DEG, FOLD_DEG.min, FOLD_DEG.max
    return spec.fold_deg, spec.fold_deg, spec.fold_deg


def displacements(spec: DesignSpec, seed: Seed) -> FloatArray:
    """Displacement vectors (n, sides, 2) of one standard deviation, normalized, of the corners of each sub-image.

    A corner (u, v) at the depth z moves by (n_xy - n_z (u, v)) s / z if the mirror there moves by s along its normal n,
    because it is shifted or tilted about its centre.
    """
    centres = seed.centres @ spec.view_from_rig
    rays = np.concatenate([seed.corners, np.ones((*seed.corners.shape[:-1], 1))], axis=-1)
    depths = 0.5 * (centres**2).sum(axis=-1)[:, None] / (rays @ centres[..., None])[..., 0]
    corners = rays * depths[..., None]
    lever_arms = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=-1)
    shifts = np.hypot(spec.robust_offset_mm / spec.scale_mm, lever_arms * np.deg2rad(spec.robust_tilt_deg))
    normals = (centres / np.linalg.norm(centres, axis=-1, keepdims=True))[:, None]
    return np.asarray((normals[..., :2] - normals[..., 2:] * seed.corners) * (shifts / depths)[..., None])


def safe_gap(displacements: FloatArray, direction: FloatArray) -> float:
    """The gap, in normalized coordinates, that keeps two sub-images apart in devices as built.

    `displacements` (2, sides, 2) belong to their corners, `direction` (2,) is the unit vector from first to second.
    """
    return SAFE_SIGMAS * float(np.linalg.norm(np.abs(displacements @ direction).max(axis=1)))


def tilts(spec: DesignSpec, devices: int) -> FloatArray:
    """Tilts (1 + devices, mirrors, 2) about two axes in the plane of each mirror, radians; first the exact device.

    Each call returns the same samples. Devices come in pairs with opposite tilts, so that first-order effects cancel in
    the mean.
    """
    mirrors = len(spec.arrangement.steps)
    samples = np.random.default_rng(SEED).standard_normal(((devices + 1) // 2, mirrors, 2))
    pairs = np.stack([samples, -samples], axis=1).reshape(-1, mirrors, 2)[:devices]
    return np.concatenate([np.zeros((1, mirrors, 2)), np.deg2rad(spec.robust_tilt_deg) * pairs])
