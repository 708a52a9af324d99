"""A linear elastic solid, condensed to its screws: second-order tetrahedra, by scikit-fem and SciPy.

All results are for a modulus of 1 MPa: displacements by forces scale with 1 / modulus, expansion does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from mirrorcam.cad.checks.elasticity.tetrahedra import Tetrahedra
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray

POISSON = 0.35
LOADS = 8
"""Number of loads: a solid's weight along x, y and z (of 1 N/mm3), the weight of carried bodies along x, y and z, unit
expansion of the solid, and unit expansion of the bodies glued to it.
"""


@dataclass(frozen=True)
class Carried:
    """A rigid body on a solid: the nodes under it, the point of its reported motion, and its weight in N at `middle`.

    `glue` (n, 3, 3) are springs in N/mm between each node and the body, scaled to a modulus of 1 MPa of the solid; the
    body then expands about the point. Without glue, the body follows the mean motion of the nodes.
    """

    nodes: NDArray[np.int64]
    at: FloatArray
    weight_n: float
    middle: FloatArray
    glue: FloatArray | None = None


@dataclass(frozen=True)
class CondensedSolid:
    """Forces on rigid screws, and motions of carried bodies, per motion of the screws and per load, for 1 MPa.

    With the motions q (6 n,) of the screws, the forces on them are `stiffness` q - `forces` loads. The motion of a
    carried body (shift in mm of its point, rotation in rad) is `by_screws` q + `by_loads` loads, by its name.
    """

    stiffness: FloatArray
    forces: FloatArray
    by_screws: Mapping[str, FloatArray]
    by_loads: Mapping[str, FloatArray]


class Solid:
    """The finite elements of a solid; `nodes` (n, 3), in mm, are the corners and the middles of edges."""

    def __init__(self, mesh: Tetrahedra) -> None:
        from skfem import Basis, ElementTetP2, ElementVector, MeshTet

        self._basis = Basis(
            MeshTet(mesh.points.T.copy(), mesh.corners.T.copy()), ElementVector(ElementTetP2()), intorder=2
        )
        numbers = np.hstack([self._basis.nodal_dofs, self._basis.edge_dofs])
        self._dofs: NDArray[np.int64] = np.asarray(numbers.T, dtype=np.int64)
        self.nodes: FloatArray = np.asarray(self._basis.doflocs[:, self._dofs[:, 0]].T, dtype=np.float64)

    def condensed(
        self, screws: Sequence[NDArray[np.int64]], at: FloatArray, carried: Mapping[str, Carried]
    ) -> CondensedSolid:
        """Condense the solid to screws, each a set of nodes that moves as a rigid body about its point of `at` (n, 3).

        A set also expands about its point with the solid: the bodies joined there are of one material.
        """
        if any(len(nodes) < 3 for nodes in screws):
            raise InputError("a screw has fewer than 3 nodes of the mesh, expected finer elements")
        if len(np.unique(np.concatenate(screws))) < sum(len(nodes) for nodes in screws):
            raise ValueError("screws share nodes, expected each node in only one")
        stiffness, loads, glued = self._with_glue(*self._assembled(carried), tuple(carried.values()))
        count = stiffness.shape[0]
        fixed = np.concatenate([self._dofs[nodes].ravel() for nodes in screws])
        rigid, expanded = np.zeros((count, 6 * len(screws))), np.zeros((count, LOADS))
        for k, (nodes, point) in enumerate(zip(screws, at, strict=True)):
            dofs, arms = self._dofs[nodes].ravel(), self.nodes[nodes] - point
            rigid[dofs, 6 * k : 6 * k + 6] = rigid_motions(arms)
            expanded[dofs, 6] = arms.ravel()
        free = np.setdiff1d(np.arange(count), fixed)
        inner = stiffness[free][:, free].tocsc()
        factor = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        coupling = stiffness[free] @ rigid
        by_screws, by_loads = rigid.copy(), expanded.copy()
        by_screws[free] = -factor.solve(coupling)
        loads = loads - stiffness @ expanded
        by_loads[free] = factor.solve(loads[free])
        reduced = by_screws.T @ (stiffness @ by_screws)
        motions = {
            name: self._motion_of(each, at, count) for (name, each), at in zip(carried.items(), glued, strict=True)
        }
        return CondensedSolid(
            stiffness=(reduced + reduced.T) / 2.0,
            forces=by_screws.T @ loads,
            by_screws={name: motion @ by_screws for name, motion in motions.items()},
            by_loads={name: motion @ by_loads for name, motion in motions.items()},
        )

    def _assembled(self, carried: Mapping[str, Carried]) -> tuple[Any, FloatArray]:
        """Stiffness (dofs, dofs) and loads (dofs, LOADS), without glue."""
        from skfem import LinearForm
        from skfem.helpers import div
        from skfem.models.elasticity import lame_parameters, linear_elasticity

        lame, shear = lame_parameters(1.0, POISSON)
        stiffness = linear_elasticity(lame, shear).assemble(self._basis).tocsr()
        loads = np.zeros((stiffness.shape[0], LOADS))
        volume = LinearForm(lambda v, _: v[0]).assemble(self._basis)
        for axis in range(3):
            loads[self._dofs[:, axis], axis] = volume[self._dofs[:, 0]]
        # A free isotropic strain e corresponds to a stress of 3 K e, with the bulk modulus K.
        bulk = lame + 2.0 / 3.0 * shear
        loads[:, 6] = LinearForm(lambda v, _: 3.0 * bulk * div(v)).assemble(self._basis)
        for each in carried.values():
            if each.glue is None:
                loads[:, 3:6] += self._motion(each).T @ _weights(each)
        return stiffness, loads

    def _with_glue(
        self, stiffness: Any, loads: FloatArray, carried: Sequence[Carried]
    ) -> tuple[Any, FloatArray, list[int | None]]:
        """Stiffness and loads with six more displacements for each glued body, and the index of the first, or None."""
        from scipy.sparse import block_diag, csr_matrix

        solid_dofs = stiffness.shape[0]
        glued: list[int | None] = []
        added = 6 * sum(each.glue is not None for each in carried)
        total = block_diag([stiffness, csr_matrix((added, added))], format="csr")
        loads = np.vstack([loads, np.zeros((added, LOADS))])
        for each in carried:
            if each.glue is None:
                glued.append(None)
                continue
            first = solid_dofs + 6 * sum(index is not None for index in glued)
            glued.append(first)
            arms = self.nodes[each.nodes] - each.at
            # Elongation of the springs: nodes minus the rigid motion and the expansion of the body.
            dofs = np.concatenate([self._dofs[each.nodes].ravel(), np.arange(first, first + 6)])
            stretch = np.hstack([np.eye(arms.size), -rigid_motions(arms)])
            springs = block_diag(each.glue)
            body_stiffness = stretch.T @ (springs @ stretch)
            rows, columns = np.meshgrid(dofs, dofs, indexing="ij")
            total = total + csr_matrix((body_stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=total.shape)
            loads[dofs, 7] += stretch.T @ (springs @ arms.ravel())
            loads[first : first + 6, 3:6] += _weights(each)
        return total, loads, glued

    def _motion_of(self, each: Carried, first: int | None, count: int) -> FloatArray:
        """Matrix (6, count) from all displacements to the motion of a body: its own from `first` on, or a mean."""
        motion = np.zeros((6, count))
        if first is None:
            motion[:, : self._dofs.size] = self._motion(each)
        else:
            motion[:, first : first + 6] = np.eye(6)
        return motion

    def _motion(self, each: Carried) -> FloatArray:
        """Matrix (6, dofs) to the best-fit rigid motion of a body's nodes; its transpose distributes forces on them."""
        fitted = np.linalg.pinv(rigid_motions(self.nodes[each.nodes] - each.at))
        motion = np.zeros((6, self._dofs.size))
        motion[:, self._dofs[each.nodes].ravel()] = fitted
        return motion


def _weights(each: Carried) -> FloatArray:
    """Forces and moments (6, 3) about a body's point due to its weight along x, y and z."""
    force = each.weight_n * np.eye(3)
    return np.vstack([force, np.cross(each.middle - each.at, force).T])


def rigid_motions(arms: FloatArray) -> FloatArray:
    """Matrix (3 n, 6) from a shift and a rotation to the displacements of points at arms (n, 3) from the centre."""
    motions = np.zeros((len(arms), 3, 6))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
    return motions.reshape(-1, 6)
