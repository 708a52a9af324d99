"""Stiffness of the mount's structure: an angled sandwich beam in closed form, and folded plates by finite strips.

`FoldedPlates` are flat strips of one width, joined along straight edges parallel to x: the finite strip method with
polynomials across the width (Cheung 1976, Finite Strip Method in Structural Analysis). A strip is a thin plate
(Kirchhoff) and a membrane. Across the width, fields are Legendre polynomials; along the strip, from edge to edge, the
deflection is cubic and the in-plane displacement quadratic.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from mirrorcam.core.values import FloatArray

POISSON = 0.35
"""Poisson's ratio of PLA; the shear modulus is E / (2 (1 + POISSON))."""


@dataclass(frozen=True)
class Section:
    """Two skins, `depth_mm` from outside to outside, `width_mm` wide (along x), and webs at `web_deg` to them."""

    depth_mm: float
    width_mm: float
    skin_mm: float
    web_mm: float
    web_deg: float
    plastic_mpa: float

    @property
    def plastic_mm2(self) -> float:
        """Volume of plastic per length: both skins, and the webs, longer by 1 / cos of their angle."""
        return float(self.width_mm * (2.0 * self.skin_mm + self.web_mm / np.cos(np.deg2rad(self.web_deg))))

    @property
    def bending_nmm2(self) -> float:
        """E I about x: both skins about the mid-plane (parallel axis theorem)."""
        inside = self.depth_mm - 2.0 * self.skin_mm
        return self.plastic_mpa * self.width_mm * (self.depth_mm**3 - inside**3) / 12.0

    @property
    def lateral_bending_nmm2(self) -> float:
        """E I about the skins' normal, both skins bent on edge."""
        return self.plastic_mpa * 2.0 * self.skin_mm * self.width_mm**3 / 12.0

    @property
    def shear_n(self) -> float:
        """Shear force per shear angle: E A sin^2 a cos a for webs of area A at angle a (Timoshenko's laced columns)."""
        angle = np.deg2rad(self.web_deg)
        return float(self.plastic_mpa * self.web_mm * self.width_mm * np.sin(angle) ** 2 * np.cos(angle))

    @property
    def torsion_nmm2(self) -> float:
        """G J of two skins with open edges, a distance h apart, on a core that shears.

        With the skins' warping +-w(x), equilibrium of a skin is w'' = k^2 (w + h x phi' / 2), k^2 = 2 S / (G t h b h),
        where S is `shear_n`. Free edges give G J = 2 G t h^2 b (1 - tanh(k b / 2) / (k b / 2)).
        """
        modulus = self.plastic_mpa / (2.0 * (1.0 + POISSON))
        spacing = self.depth_mm - self.skin_mm
        core = self.shear_n / (self.width_mm * spacing)
        k_half = np.sqrt(2.0 * core / (modulus * self.skin_mm * spacing)) * self.width_mm / 2.0
        return float(2.0 * modulus * self.skin_mm * spacing**2 * self.width_mm * (1.0 - np.tanh(k_half) / k_half))


def beam_compliance(path: FloatArray, load: FloatArray, section: Section) -> tuple[FloatArray, FloatArray]:
    """Rotation in rad and shift in mm, both (3, 3), of a load at a point (3,) in the rig frame, per N of its weight.

    Column j is for a force along axis j. The beam follows a path (n, 2; y and z); its first point is clamped, and its
    last is rigidly connected to the load. By Castigliano's theorem: the moment (load - p) x F is linear along each
    straight piece, so Simpson's rule is exact for the quadratic energy. Shear of the truss shifts the load without
    rotation.
    """
    rotation, shift = np.zeros((3, 3)), np.zeros((3, 3))
    for start, end in pairwise(path):
        length = float(np.linalg.norm(end - start))
        tangent = np.array([0.0, *(end - start) / length])
        x_axis = np.array([1.0, 0.0, 0.0])
        normal = np.cross(x_axis, tangent)
        compliance = (
            np.outer(x_axis, x_axis) / section.bending_nmm2
            + np.outer(normal, normal) / section.lateral_bending_nmm2
            + np.outer(tangent, tangent) / section.torsion_nmm2
        )
        for point, weight in ((start, 1.0 / 6.0), ((start + end) / 2.0, 4.0 / 6.0), (end, 1.0 / 6.0)):
            moments = np.cross(load - np.array([0.0, *point]), np.eye(3)).T
            rotation += length * weight * compliance @ moments
            shift += length * weight * moments.T @ compliance @ moments
        shift += length * np.outer(normal, normal) / section.shear_n
    return rotation, shift


# Polynomials of degree 0 to 4 across the width: in-plane bending is linear, the warping of a twisted strip cubic.
MODES = 5
# Displacements of an edge, for each mode: along x, y and z, and the rotation about x.
EDGE = 4
# Stiffness of a rigid support, relative to the stiffest displacement of an edge.
RIGID_SUPPORT = 1e4
# Fields of a strip: displacement along x, along the strip (s), and normal to it. A term of the strain energy is a
# stiffness and two derivatives of fields: (field, order with respect to s, order with respect to x).
_X, _S, _NORMAL = 0, 1, 2


@dataclass(frozen=True)
class FoldedPlates:
    """Strips in the rig frame, mm: lines between two edges in the y-z plane, extruded by `half_width_mm` either way.

    `edges` (n, 2) are y and z of the edges, `strips` (m, 2) the edges of each strip, `thickness_mm` (m,) its thickness
    and `modulus_mpa` (m,) its modulus of elasticity.
    """

    edges: FloatArray
    strips: NDArray[np.int64]
    thickness_mm: FloatArray
    modulus_mpa: FloatArray
    poisson: float
    half_width_mm: float

    def compliance(
        self,
        *,
        supports: tuple[NDArray[np.int64], FloatArray],
        attachments: tuple[NDArray[np.int64], FloatArray],
        load: FloatArray,
        support_stiffness: FloatArray | None = None,
    ) -> FloatArray:
        """Compliance of a rigid body that is attached to the plates.

        Parameters
        ----------
        supports, attachments : (k,) and (k,) arrays
            Edges, and x in mm, of the points that are supported and of those fixed to the body; the edges' rotation is
            fixed there too.
        load : (3,) array
            Point in the rig frame, mm, where forces act on the body and its shift is measured.
        support_stiffness : (4,) array or None
            Stiffness of each support: along x, y and z in N/mm, about x in N mm/rad. None: rigid.

        Returns
        -------
        (6, 6) array
            Column j: shift in mm and rotation in rad for a unit force (j < 3, N) or moment (N mm) along a rig axis.
        """
        stiffness = self._stiffness()
        supported, attached = self._displacements(*supports), self._displacements(*attachments)
        rigid = RIGID_SUPPORT * float(np.diagonal(stiffness).max())
        springs = np.tile(np.full(EDGE, rigid) if support_stiffness is None else support_stiffness, len(supports[0]))
        stiffness += supported.T @ (springs[:, None] * supported)
        factor = cho_factor(stiffness, lower=True, check_finite=False)
        flexibility = attached @ cho_solve(factor, attached.T, check_finite=False)
        body = self._rigid_body(*attachments, load)
        compliance = np.linalg.inv(body.T @ np.linalg.solve(flexibility, body))
        return np.asarray((compliance + compliance.T) / 2.0)

    def _displacements(self, edges: NDArray[np.int64], x_mm: FloatArray) -> FloatArray:
        """Matrix (k EDGE, n EDGE MODES) from the modes of all edges to the displacements of points on edges."""
        modes = legendre.legvander(x_mm / self.half_width_mm, MODES - 1)
        matrix = np.zeros((len(edges), EDGE, len(self.edges), EDGE, MODES))
        for point, edge in enumerate(edges):
            for component in range(EDGE):
                matrix[point, component, edge, component] = modes[point]
        return matrix.reshape(len(edges) * EDGE, -1)

    def _rigid_body(self, edges: NDArray[np.int64], x_mm: FloatArray, centre: FloatArray) -> FloatArray:
        """Matrix (k EDGE, 6) from a shift, and a rotation about a centre (3,), to the displacements of these points."""
        arms = np.column_stack([x_mm, self.edges[edges]]) - centre
        matrix = np.zeros((len(edges), EDGE, 6))
        matrix[:, :3, :3] = np.eye(3)
        matrix[:, :3, 3:] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
        matrix[:, 3, 3] = 1.0
        return matrix.reshape(-1, 6)

    def _stiffness(self) -> FloatArray:
        """Stiffness (n EDGE MODES, n EDGE MODES) of all edges, in N/mm, N and N mm."""
        ends = self.edges[self.strips]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        matrices = _condensed(_strip_stiffness(self, lengths))
        tangents = (ends[:, 1] - ends[:, 0]) / lengths[:, None]
        # A strip's own axes: along x, along the strip, and the normal x cross the strip.
        rotations = np.zeros((len(lengths), EDGE, EDGE))
        rotations[:, 0, 0] = rotations[:, 3, 3] = 1.0
        rotations[:, 1, 1:3] = tangents
        rotations[:, 2, 1], rotations[:, 2, 2] = -tangents[:, 1], tangents[:, 0]
        shape = (len(lengths), 2, EDGE, MODES, 2, EDGE, MODES)
        matrices = np.einsum("sia,seimfjo,sjb->seamfbo", rotations, matrices.reshape(shape), rotations, optimize=True)
        block = EDGE * MODES
        assembled = np.zeros((len(self.edges), block, len(self.edges), block))
        for strip, matrix in zip(self.strips, matrices.reshape(-1, 2, block, 2, block), strict=True):
            for i, row in enumerate(strip):
                for j, column in enumerate(strip):
                    assembled[row, :, column] += matrix[i, :, j]
        return assembled.reshape(len(self.edges) * block, -1)


def _condensed(stiffness: FloatArray) -> FloatArray:
    """Stiffness of strips' edges alone: statically condenses the bubble functions, which come last."""
    edges = 2 * EDGE * MODES
    coupling = stiffness[:, edges:, :edges]
    bubbles = np.linalg.solve(stiffness[:, edges:, edges:], coupling)
    return np.asarray(stiffness[:, :edges, :edges] - coupling.transpose(0, 2, 1) @ bubbles)


def _strip_stiffness(plates: FoldedPlates, lengths: FloatArray) -> FloatArray:
    """Stiffness (m, 10 MODES, 10 MODES) of strips in their own axes.

    Order of the degrees of freedom: displacements of both edges (along x, along the strip, normal to it, rotation),
    then the bubbles (along x, along the strip), which are 0 at both edges; for each of these the modes.
    """
    membrane = plates.modulus_mpa * plates.thickness_mm / (1.0 - plates.poisson**2)
    plate = membrane * plates.thickness_mm**2 / 12.0
    shear = (1.0 - plates.poisson) / 2.0
    terms = [(membrane, (_X, 0, 1), (_X, 0, 1)), (membrane, (_S, 1, 0), (_S, 1, 0))]
    terms += _both(membrane * plates.poisson, (_X, 0, 1), (_S, 1, 0))
    terms += [(membrane * shear, (_X, 1, 0), (_X, 1, 0)), (membrane * shear, (_S, 0, 1), (_S, 0, 1))]
    terms += _both(membrane * shear, (_X, 1, 0), (_S, 0, 1))
    terms += [(plate, (_NORMAL, 0, 2), (_NORMAL, 0, 2)), (plate, (_NORMAL, 2, 0), (_NORMAL, 2, 0))]
    terms += _both(plate * plates.poisson, (_NORMAL, 0, 2), (_NORMAL, 2, 0))
    terms.append((plate * 4.0 * shear, (_NORMAL, 1, 1), (_NORMAL, 1, 1)))
    fields, weights = _strip_fields(lengths)
    modes, mode_weights = _width_modes(plates.half_width_mm)
    stiffness = np.zeros((len(lengths), 10, MODES, 10, MODES))
    for factor, (a, s_order_a, x_order_a), (b, s_order_b, x_order_b) in terms:
        over_s = np.einsum("sp,spi,spj->sij", factor[:, None] * weights, fields[a, s_order_a], fields[b, s_order_b])
        over_x = np.einsum("p,pk,pl->kl", mode_weights, modes[x_order_a], modes[x_order_b])
        stiffness += over_s[:, :, None, :, None] * over_x[:, None, :]
    return stiffness.reshape(len(lengths), 10 * MODES, 10 * MODES)


_Term = tuple[FloatArray, tuple[int, int, int], tuple[int, int, int]]


def _both(factor: FloatArray, a: tuple[int, int, int], b: tuple[int, int, int]) -> list[_Term]:
    return [(factor, a, b), (factor, b, a)]


def _width_modes(half_width: float) -> tuple[FloatArray, FloatArray]:
    """Modes (3, points, MODES) across the width with first and second derivatives, and quadrature weights (points,)."""
    points, weights = legendre.leggauss(MODES)
    orders = [legendre.legder(np.eye(MODES), order) if order else np.eye(MODES) for order in range(3)]
    return (
        np.stack([legendre.legval(points, modes).T / half_width**order for order, modes in enumerate(orders)]),
        weights * half_width,
    )


def _strip_fields(lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fields (3, 3, m, points, 10) along strips of lengths (m,), and quadrature weights (m, points).

    The first axis is the displacement (along x, along the strip, normal to it), the second the order of the derivative.
    """
    points, weights = legendre.leggauss(4)
    s, one = (points + 1.0) / 2.0, np.ones(4)
    linear = np.array([[1.0 - s, s, 4.0 * s * (1.0 - s)], [-one, one, 4.0 - 8.0 * s], [0.0 * s, 0.0 * s, -8.0 * one]])
    hermite = np.array(
        [
            [1.0 - 3.0 * s**2 + 2.0 * s**3, s - 2.0 * s**2 + s**3, 3.0 * s**2 - 2.0 * s**3, s**3 - s**2],
            [6.0 * s**2 - 6.0 * s, 1.0 - 4.0 * s + 3.0 * s**2, 6.0 * s - 6.0 * s**2, 3.0 * s**2 - 2.0 * s],
            [12.0 * s - 6.0, 6.0 * s - 4.0, 6.0 - 12.0 * s, 6.0 * s - 2.0],
        ]
    )
    fields = np.zeros((3, 3, len(lengths), 4, 10))
    for order in range(3):
        scale = lengths[:, None, None] ** -float(order)
        fields[_X, order][..., [0, 4, 8]] = linear[order].T * scale
        fields[_S, order][..., [1, 5, 9]] = linear[order].T * scale
        deflections = hermite[order].T * scale
        # The rotation modes of a cubic scale with the strip's length.
        deflections[..., [1, 3]] *= lengths[:, None, None]
        fields[_NORMAL, order][..., [2, 3, 6, 7]] = deflections
    return fields, lengths[:, None] * weights / 2.0
