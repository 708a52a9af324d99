"""A linear elastic solid, condensed to its screws: second-order tetrahedra, by scikit-fem and SciPy.

All results are for a modulus of 1 MPa: displacements due to forces scale with 1 / modulus; expansion does not.
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
    """A rigid body on a solid: the nodes under it, its reference point, and its weight in N at `centre`.

    Its motion is reported at the reference point. `glue` (n, 3, 3) are springs in N/mm between each node and the body,
    scaled to a modulus of 1 MPa of the solid; the body then expands about that point. Without glue, the body follows
    the mean motion of the nodes.
    """

    nodes: NDArray[np.int64]
    point: FloatArray
    weight_n: float
    centre: FloatArray
    glue: FloatArray | None = None


@dataclass(frozen=True)
class CondensedSolid:
    """Forces on rigid screws, and motions of carried bodies, per motion of the screws and per load, for 1 MPa.

    With the motions q (6 n,) of the screws, the forces on them are `stiffness` q - `forces` loads. The motion of a
    carried body (shift in mm of its point, rotation in rad) is `per_screws[name]` q + `per_load[name]` loads.
    """

    stiffness: FloatArray
    forces: FloatArray
    per_screws: Mapping[str, FloatArray]
    per_load: Mapping[str, FloatArray]


class Solid:
    """The finite elements of a solid; `nodes` (n, 3), in mm, are the corners and the midpoints of edges."""

    def __init__(self, mesh: Tetrahedra) -> None:
        from skfem import Basis, ElementTetP2, ElementVector, MeshTet

        self._basis = Basis(
            MeshTet(mesh.points.T.copy(), mesh.corners.T.copy()), ElementVector(ElementTetP2()), intorder=2
        )
        numbers = np.hstack([self._basis.nodal_dofs, self._basis.edge_dofs])
        self._dofs: NDArray[np.int64] = np.asarray(numbers.T, dtype=np.int64)
        self.nodes: FloatArray = np.asarray(self._basis.doflocs[:, self._dofs[:, 0]].T, dtype=np.float64)

    def condensed(
        self, screws: Sequence[NDArray[np.int64]], centres: FloatArray, carried: Mapping[str, Carried]
    ) -> CondensedSolid:
        """Condense the solid to screws, each a set of nodes that moves rigidly about its centre (n, 3).

        A set also expands with the solid about its centre: the bodies joined there are of one material.
        """
        if any(len(nodes) < 3 for nodes in screws):
            raise InputError("a screw clamps fewer than 3 nodes of the mesh, expected at least 3 (finer elements)")
        if len(np.unique(np.concatenate(screws))) < sum(len(nodes) for nodes in screws):
            raise ValueError("screws share nodes, expected each node in one screw only")
        stiffness, loads, first_dofs = self._with_glue(*self._assembled(carried), tuple(carried.values()))
        count = stiffness.shape[0]
        fixed = np.concatenate([self._dofs[nodes].ravel() for nodes in screws])
        rigid, expanded = np.zeros((count, 6 * len(screws))), np.zeros((count, LOADS))
        for k, (nodes, point) in enumerate(zip(screws, centres, strict=True)):
            dofs, arms = self._dofs[nodes].ravel(), self.nodes[nodes] - point
            rigid[dofs, 6 * k : 6 * k + 6] = rigid_motions(arms)
            expanded[dofs, 6] = arms.ravel()
        free = np.setdiff1d(np.arange(count), fixed)
        inner = stiffness[free][:, free].tocsc()
        factor = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        coupling = stiffness[free] @ rigid
        per_screws, per_load = rigid.copy(), expanded.copy()
        per_screws[free] = -factor.solve(coupling)
        loads = loads - stiffness @ expanded
        per_load[free] = factor.solve(loads[free])
        reduced = per_screws.T @ (stiffness @ per_screws)
        motions = {
            name: self._motion_of(body, first, count)
            for (name, body), first in zip(carried.items(), first_dofs, strict=True)
        }
        return CondensedSolid(
            stiffness=(reduced + reduced.T) / 2.0,
            forces=per_screws.T @ loads,
            per_screws={name: motion @ per_screws for name, motion in motions.items()},
            per_load={name: motion @ per_load for name, motion in motions.items()},
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
        for body in carried.values():
            if body.glue is None:
                loads[:, 3:6] += self._motion(body).T @ _weights(body)
        return stiffness, loads

    def _with_glue(
        self, stiffness: Any, loads: FloatArray, carried: Sequence[Carried]
    ) -> tuple[Any, FloatArray, list[int | None]]:
        """Stiffness and loads with six more displacements for each glued body, and the index of the first, or None."""
        from scipy.sparse import block_diag, csr_matrix

        solid_dofs = stiffness.shape[0]
        first_dofs: list[int | None] = []
        added = 6 * sum(body.glue is not None for body in carried)
        total = block_diag([stiffness, csr_matrix((added, added))], format="csr")
        loads = np.vstack([loads, np.zeros((added, LOADS))])
        for body in carried:
            if body.glue is None:
                first_dofs.append(None)
                continue
            first = solid_dofs + 6 * sum(index is not None for index in first_dofs)
            first_dofs.append(first)
            arms = self.nodes[body.nodes] - body.point
            # Elongation of the springs: nodes minus the rigid motion and the expansion of the body.
            dofs = np.concatenate([self._dofs[body.nodes].ravel(), np.arange(first, first + 6)])
            stretch = np.hstack([np.eye(arms.size), -rigid_motions(arms)])
            springs = block_diag(body.glue)
            body_stiffness = stretch.T @ (springs @ stretch)
            rows, columns = np.meshgrid(dofs, dofs, indexing="ij")
            total = total + csr_matrix((body_stiffness.ravel(), (rows.ravel(), columns.ravel())), shape=total.shape)
            loads[dofs, 7] += stretch.T @ (springs @ arms.ravel())
            loads[first : first + 6, 3:6] += _weights(body)
        return total, loads, first_dofs

    def _motion_of(self, body: Carried, first: int | None, count: int) -> FloatArray:
        """Matrix (6, count) from all displacements to the motion of a body: its own from `first` on, or a mean."""
        motion = np.zeros((6, count))
        if first is None:
            motion[:, : self._dofs.size] = self._motion(body)
        else:
            motion[:, first : first + 6] = np.eye(6)
        return motion

    def _motion(self, body: Carried) -> FloatArray:
        """Matrix (6, dofs) to the best-fit rigid motion of a body's nodes; its transpose distributes forces on them."""
        fit = np.linalg.pinv(rigid_motions(self.nodes[body.nodes] - body.point))
        motion = np.zeros((6, self._dofs.size))
        motion[:, self._dofs[body.nodes].ravel()] = fit
        return motion


def _weights(body: Carried) -> FloatArray:
    """Forces and moments (6, 3) about a body's point due to its weight along x, y and z."""
    force = body.weight_n * np.eye(3)
    return np.vstack([force, np.cross(body.centre - body.point, force).T])


def rigid_motions(arms: FloatArray) -> FloatArray:
    """Matrix (3 n, 6) from a shift and a rotation to the displacements of points at arms (n, 3) from the centre."""
    motions = np.zeros((len(arms), 3, 6))
    motions[:, :, :3] = np.eye(3)
    motions[:, :, 3:] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
    return motions.reshape(-1, 6)
