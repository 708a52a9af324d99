"""The best chains of one or two flat mirrors per view in a box of a given size, found by IPOPT.

Light is unfolded: reflected back at the mirrors that it has met, it runs straight from the pupil, and a point on its
way has the normalized coordinates of its pixel. Unknowns are the planes of the mirrors, the part of the sensor that
each view uses with the whole pupil, the outlines that serve it, the regions that all views see, the box's place, and
planes between mirrors and everything that they must not touch. Lengths in here are in units of 100 mm.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import linprog

from benchmarks.two_bounces_chains import SQUARE, THICKNESS_MM, Chain, Found, Question
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.design_spec import DesignSpec

UNIT_MM = 100.0
GAP_MM = 1.0
CLEAR_OF_LIGHT_MM = 0.05
LEAST_TANGENT = 0.02
LEAST_COSINE = 0.15
"""Of the angle between light and the normal of a mirror."""
NEAREST_MM = 8.0
"""Nearest mirror to the pupil along the axis, and shortest way from one mirror to the next."""


def _mirrored(points: Any, normal: Any, offset: Any) -> Any:
    """Rows of points (n, 3) reflected at a plane."""
    return points - 2.0 * ca.mtimes(ca.mtimes(points, normal) - offset, normal.T)


def _crosses(first: Any, second: Any, point: Any) -> Any:
    return (second[0] - first[0]) * (point[1] - first[1]) - (second[1] - first[1]) * (point[0] - first[0])


class Program:
    """The nonlinear program of a question, written from a seed."""

    def __init__(self, question: Question, seed: list[Chain]) -> None:
        self.question = question
        self.unknowns: list[Any] = []
        self.start: list[FloatArray] = []
        self.rules: list[Any] = []
        self.low: list[float] = []
        self.high: list[float] = []
        self.mirrors: dict[tuple[int, int], Any] = {}
        self.legs: dict[tuple[int, int], Any] = {}
        self.planes: list[list[tuple[Any, Any]]] = []
        self.cells: list[Any] = []
        rotation = question.view_from_rig
        self.box = self._unknown(np.zeros((1, 3)))
        self.regions = []
        for depth in question.depths_mm:
            start = SQUARE * 0.15 + self._middle_of(seed, depth) / UNIT_MM
            across = self._unknown(start)
            self.regions.append(ca.horzcat(across, np.full(4, depth / UNIT_MM)) @ rotation)
            self._convex(across)
        self.efficiency, self.quality = 0.0, 0.0
        for view, chain in enumerate(seed):
            self._write_view(view, chain)
        self._write_objective()
        self._write_box(rotation)
        self._write_separations()

    def _middle_of(self, seed: list[Chain], depth_mm: float) -> FloatArray:
        """Where the middles of the views meet a depth, on average (2,), view axes, mm."""
        met = []
        for chain in seed:
            ray = np.append(chain.cell.mean(axis=0), 1.0)
            first, second = (
                chain.scene_from_unfolded(reach * ray) @ self.question.view_from_rig.T for reach in (500.0, 600.0)
            )
            met.append(first + (second - first) * (depth_mm - first[2]) / (second[2] - first[2]))
        return np.asarray(np.mean(met, axis=0)[:2])

    def _unknown(self, start: FloatArray) -> Any:
        made = ca.SX.sym(f"x{len(self.unknowns)}", *start.shape)
        self.unknowns.append(ca.reshape(made, -1, 1))
        self.start.append(start.ravel(order="F"))
        return made

    def _between(self, expression: Any, low: float = 0.0, high: float = np.inf) -> None:
        expression = ca.reshape(expression, -1, 1)
        self.rules.append(expression)
        self.low += [low] * expression.shape[0]
        self.high += [high] * expression.shape[0]

    def _convex(self, polygon: Any) -> None:
        for k in range(4):
            a, b, c = (polygon[(k + step) % 4, :] for step in range(3))
            self._between(_crosses(a, b, c), LEAST_TANGENT**2)

    def _write_view(self, view: int, seed: Chain) -> None:
        q = self.question
        cell = self._unknown(seed.cell)
        self.cells.append(cell)
        self._convex(cell)
        for axis in range(2):
            self._between(cell[:, axis], -q.half_field[axis], q.half_field[axis])
        planes: list[tuple[Any, Any]] = []
        far: Any = 0.0
        for bounce in range(q.bounces):
            normal = self._unknown(seed.normals[bounce][:, None])
            offset = self._unknown(np.array([[seed.offsets_mm[bounce] / UNIT_MM]]))
            self._between(ca.sumsqr(normal), 1.0, 1.0)
            outer = self._unknown(seed.cell.mean(axis=0) + 1.2 * (seed.cell - seed.cell.mean(axis=0)))
            self._convex(outer)
            turned, reach = normal, offset
            for before, height in reversed(planes):
                reach = reach - 2.0 * height * ca.dot(before, turned)
                turned = turned - 2.0 * ca.dot(before, turned) * before
            rays, inner = (ca.horzcat(corners, np.ones(4)) for corners in (outer, cell))
            cosine = ca.mtimes(rays, turned)
            self._between(cosine, LEAST_COSINE)
            depth = reach / cosine
            self._between(depth - far, NEAREST_MM / UNIT_MM)
            self._serve(cell, outer, reach / ca.mtimes(inner, turned))
            corners = rays * ca.repmat(depth, 1, 3)
            for plane in planes:
                corners = _mirrored(corners, *plane)
            self.mirrors[view, bounce] = ca.vertcat(
                corners, corners + ca.repmat(THICKNESS_MM / UNIT_MM * normal.T, 4, 1)
            )
            planes.append((normal, offset))
            far = depth
        self.planes.append(planes)
        radius = q.camera.pupil.radius_mm / UNIT_MM
        pupil = np.column_stack([radius * SQUARE, np.zeros(4)])
        fronts = [self.mirrors[view, bounce][:4, :] for bounce in range(q.bounces)]
        for bounce, (first, second) in enumerate(
            zip([pupil, *fronts], [*fronts, ca.vertcat(*self.regions)], strict=True)
        ):
            self.legs[view, bounce] = ca.vertcat(first, second)

    def _serve(self, cell: Any, outer: Any, depth: Any) -> None:
        """An outline serves the whole pupil all over a part of the sensor."""
        pupil = self.question.camera.pupil
        for k in range(4):
            a, b = outer[k, :], outer[(k + 1) % 4, :]
            length = ca.sqrt(ca.sumsqr(b - a))
            for j in range(4):
                band = pupil.radius_mm / UNIT_MM * (1.0 / depth[j] - UNIT_MM / pupil.focus_mm)
                self._between(_crosses(a, b, cell[j, :]) - band * length)

    def _seen(self, view: int, region: Any) -> Any:
        for plane in reversed(self.planes[view]):
            region = _mirrored(region, *plane)
        self._between(region[:, 2], 1.0)
        return region[:, :2] / ca.repmat(region[:, 2], 1, 2)

    def _write_objective(self) -> None:
        q = self.question
        sign = (-1.0) ** q.bounces
        centres, shares = [], []
        for view, cell in enumerate(self.cells):
            share = 0.0
            for region in self.regions:
                seen = self._seen(view, region)
                for corner in range(4):
                    for k in range(4):
                        self._between(_crosses(cell[k, :], cell[(k + 1) % 4, :], seen[corner, :]))
                twice = sum(seen[k, 0] * seen[(k + 1) % 4, 1] - seen[k, 1] * seen[(k + 1) % 4, 0] for k in range(4))
                share += sign * twice / 2.0 / len(self.regions)
            shares.append(share / (4.0 * q.half_field.prod()))
            centre = ca.SX.zeros(1, 3)
            for plane in self.planes[view]:
                centre = _mirrored(centre, *plane)
            centres.append(ca.mtimes(centre, q.view_from_rig.T)[:, :2])
        mean = sum(centres) / len(centres)
        for region in self.regions:
            self._between(ca.mtimes(ca.sum1(region) / 4.0, q.view_from_rig.T)[:, :2] - mean, 0.0, 0.0)
        spread = sum(share * ca.sumsqr(centre - mean) for share, centre in zip(shares, centres, strict=True))
        for share in shares:
            self._between(share, 1e-4)
        self._between(sum(shares), q.least_efficiency)
        self.objective = -0.5 * ca.log(spread)

    def _write_box(self, rotation: FloatArray) -> None:
        for corners in self.mirrors.values():
            inside = ca.mtimes(corners[:4, :], rotation.T) - ca.repmat(self.box, 4, 1)
            for axis, size in enumerate(self.question.box_mm):
                self._between(inside[:, axis], 0.0, size / UNIT_MM)

    def _write_separations(self) -> None:
        body = DesignSpec(camera=self.question.camera).kept_free_in_rig_mm / UNIT_MM
        pairs = [(self.mirrors[i], self.mirrors[j], GAP_MM) for i, j in combinations(self.mirrors, 2)]
        for (view, leg), light in self.legs.items():
            ends = {(view, leg - 1), (view, leg)}
            pairs += [(light, mirror, CLEAR_OF_LIGHT_MM) for at, mirror in self.mirrors.items() if at not in ends]
            if leg > 0:
                pairs.append((light, ca.DM(body), CLEAR_OF_LIGHT_MM))
        pairs += [(mirror, ca.DM(body), CLEAR_OF_LIGHT_MM) for mirror in self.mirrors.values()]
        evaluated = ca.Function("f", [ca.vertcat(*self.unknowns)], [part for a, b, _ in pairs for part in (a, b)])
        values = [np.array(value) for value in evaluated.call([ca.DM(np.concatenate(self.start))])]
        for (first, second, gap), a, b in zip(pairs, values[::2], values[1::2], strict=True):
            normal, height = separator(a, b)
            plane = self._unknown(normal[:, None])
            level = self._unknown(np.array([[height]]))
            self._between(ca.sumsqr(plane), -np.inf, 1.0)
            self._between(level - ca.mtimes(first, plane), gap / 2.0 / UNIT_MM)
            self._between(ca.mtimes(second, plane) - level, gap / 2.0 / UNIT_MM)

    def solve(self, seconds: float = 120.0) -> Found | None:
        """The optimum near the seed, or None where IPOPT finds none."""
        x = ca.vertcat(*self.unknowns)
        options: dict[str, Any] = {
            "ipopt.print_level": 0,
            "print_time": False,
            "ipopt.sb": "yes",
            "ipopt.max_iter": 1500,
            "ipopt.tol": 1e-6,
            "ipopt.max_wall_time": seconds,
            "ipopt.mu_init": 0.01,
        }
        solver = ca.nlpsol("solver", "ipopt", {"x": x, "f": self.objective, "g": ca.vertcat(*self.rules)}, options)
        answer = solver(x0=np.concatenate(self.start), lbg=self.low, ubg=self.high)
        self.status = solver.stats()["return_status"]
        self.iterations = solver.stats()["iter_count"]
        if self.status not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return None
        return self._found(x, answer["x"])

    def _found(self, x: Any, values: Any) -> Found:
        def value(expression: Any) -> FloatArray:
            return np.array(ca.Function("g", [x], [expression])(values))

        chains = []
        for view, planes in enumerate(self.planes):
            normals = np.array([value(normal)[:, 0] for normal, _ in planes])
            offsets = np.array([float(value(offset)[0, 0]) for _, offset in planes]) * UNIT_MM
            outlines = [value(self.mirrors[view, bounce][:4, :]) * UNIT_MM for bounce in range(len(planes))]
            chains.append(Chain(normals, offsets, np.array(outlines), value(self.cells[view])))
        regions = np.array([value(region) for region in self.regions]) * UNIT_MM
        return Found(self.question, tuple(chains), regions)


def separator(first: FloatArray, second: FloatArray) -> tuple[FloatArray, float]:
    """The plane (3,), height between two sets of points that is farthest from both; between their means if none is."""
    a, b = (np.column_stack([points, -np.ones(len(points))]) for points in (first, second))
    above = np.vstack([np.column_stack([a, np.ones(len(a))]), np.column_stack([-b, np.ones(len(b))])])
    side = 1.0 / np.sqrt(3.0)
    answer = linprog(
        np.array([0.0, 0.0, 0.0, 0.0, -1.0]),
        A_ub=above,
        b_ub=np.zeros(len(above)),
        bounds=[(-side, side)] * 3 + [(None, None)] * 2,
    )
    if answer.status == 0 and answer.x[4] > 1e-6:
        return answer.x[:3], float(answer.x[3])
    middles = first.mean(axis=0), second.mean(axis=0)
    normal = middles[1] - middles[0]
    normal /= max(float(np.linalg.norm(normal)), 1e-9)
    return normal, float(normal @ (middles[0] + middles[1]) / 2.0)
