"""A solid in linear elasticity, condensed to the screws that hold it: second-order tetrahedra, by scikit-fem and SciPy.

Everything is for a modulus of 1 MPa: displacements under a force go as 1 / modulus, those of expansion do not change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from mirrorcam.cad.elasticity.tetrahedra import Tetrahedra
from mirrorcam.optics.base.values import FloatArray, InputError

POISSON = 0.35
LOADS = 7
"""Loads of a solid: its weight along x, y and z (of 1 N/mm3), that of what it carries, and a strain of expansion."""


@dataclass(frozen=True)
class Carried:
    """What a solid carries: nodes that it rests on, a point whose motion is told, and a weight in N at its middle."""

    nodes: NDArray[np.int64]
    at: FloatArray
    weight_n: float
    middle: FloatArray


@dataclass(frozen=True)
class CondensedSolid:
    """How rigid screws and carried things move, per motion of the screws and per load, for a modulus of 1 MPa.

    With the motions q (6 n,) of the screws: forces on them are `stiffness` q - `forces` loads, and motions of what is
    carried (shift in mm of its point, turn in rad) are `by_screws` q + `by_loads` loads, for each by name.
    """

    stiffness: FloatArray
    forces: FloatArray
    by_screws: Mapping[str, FloatArray]
    by_loads: Mapping[str, FloatArray]


class Solid:
    """The elements of a solid: where its nodes are, before it is condensed.

    Each node is a corner or the middle of an edge; `nodes` (n, 3) are in mm.
    """

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
        """Hold the solid by screws: each a set of nodes that moves as a rigid body about its point of `at` (n, 3)."""
        if any(len(nodes) < 3 for nodes in screws):
            raise InputError("a screw holds fewer than 3 nodes of the mesh, expected finer elements")
        if len(np.unique(np.concatenate(screws))) < sum(len(nodes) for nodes in screws):
            raise ValueError("screws share nodes, expected each node to be held by one")
        stiffness, loads = self._assembled(carried)
        count = stiffness.shape[0]
        held = np.concatenate([self._dofs[nodes].ravel() for nodes in screws])
        rigid = np.zeros((count, 6 * len(screws)))
        for k, (nodes, point) in enumerate(zip(screws, at, strict=True)):
            rigid[self._dofs[nodes].ravel(), 6 * k : 6 * k + 6] = rigid_motions(self.nodes[nodes] - point)
        free = np.setdiff1d(np.arange(count), held)
        inner = stiffness[free][:, free].tocsc()
        factor = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        pulled = stiffness[free] @ rigid
        by_screws, by_loads = rigid.copy(), np.zeros((count, LOADS))
        by_screws[free] = -factor.solve(pulled)
        by_loads[free] = factor.solve(loads[free])
        own = by_screws.T @ (stiffness @ by_screws)
        told = {name: self._motion(each) for name, each in carried.items()}
        return CondensedSolid(
            stiffness=(own + own.T) / 2.0,
            forces=by_screws.T @ loads,
            by_screws={name: motion @ by_screws for name, motion in told.items()},
            by_loads={name: motion @ by_loads for name, motion in told.items()},
        )

    def _assembled(self, carried: Mapping[str, Carried]) -> tuple[Any, FloatArray]:
        """Stiffness, and the loads (dofs, LOADS)."""
        from skfem import LinearForm
        from skfem.helpers import div
        from skfem.models.elasticity import lame_parameters, linear_elasticity

        lame, shear = lame_parameters(1.0, POISSON)
        stiffness = linear_elasticity(lame, shear).assemble(self._basis).tocsr()
        loads = np.zeros((stiffness.shape[0], LOADS))
        volume = LinearForm(lambda v, _: v[0]).assemble(self._basis)
        for axis in range(3):
            loads[self._dofs[:, axis], axis] = volume[self._dofs[:, 0]]
        # A free strain e in all directions is a stress of 3 K e, with the bulk modulus K.
        bulk = lame + 2.0 / 3.0 * shear
        loads[:, 6] = LinearForm(lambda v, _: 3.0 * bulk * div(v)).assemble(self._basis)
        for each in carried.values():
            about = self._motion(each).T
            for axis in range(3):
                force = each.weight_n * np.eye(3)[axis]
                loads[:, 3 + axis] += about @ np.concatenate([force, np.cross(each.middle - each.at, force)])
        return stiffness, loads

    def _motion(self, each: Carried) -> FloatArray:
        """The rigid motion (6, dofs) that fits the nodes best about a point; its transpose spreads forces on them."""
        fitted = np.linalg.pinv(rigid_motions(self.nodes[each.nodes] - each.at))
        motion = np.zeros((6, self._dofs.size))
        motion[:, self._dofs[each.nodes].ravel()] = fitted
        return motion


def rigid_motions(arms: FloatArray) -> FloatArray:
    """Displacements (3 n, 6) of points at arms (n, 3) from the middle of a shift and a turn."""
    found = np.zeros((len(arms), 3, 6))
    found[:, :, :3] = np.eye(3)
    found[:, :, 3:] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
    return found.reshape(-1, 6)
