"""An optimum of a design's program, the constraints on pairs that it still violates, and its layout."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.chief_rays import blocked_light
from mirrorcam.optics.design.program.design_problem import OverlapDesign, Problem, depth_problem, overlap_problem
from mirrorcam.optics.design.program.nonlinear_program import MAX_ITERATIONS, SolverOutcome
from mirrorcam.optics.design.program.seeds import layout_of, mirrors_of
from mirrorcam.optics.design.program.separation import PairConstraint
from mirrorcam.optics.design.search import CONVERGENCE_DEPTHS, converging_seed
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.mirror_gaps import pairs_closer_than, sub_images_closer_than

Pairs = tuple[PairConstraint, ...]


@dataclass(frozen=True)
class Goal:
    """The program to solve: for overlap, over devices as built in addition to the exact one, or for depth.

    Attributes
    ----------
    spec : the requested design, with its fold.
    pairs : constraints on pairs of mirrors.
    devices : number of devices as built in the objective for overlap.
    target : the design for overlap that a design for depth keeps; None for overlap.
    max_iterations : iteration limit of a search for overlap.
    """

    spec: DesignSpec
    pairs: Pairs
    devices: int = 0
    target: OverlapDesign | None = None
    max_iterations: int = MAX_ITERATIONS

    def problem(self, convergence: float = CONVERGENCE_DEPTHS[0]) -> Problem:
        """The program, started from the seed whose chief rays converge at a multiple of the working depth."""
        seed = converging_seed(self.spec, convergence)
        if self.target is not None:
            return depth_problem(self.spec, seed, self.pairs, self.target)
        return overlap_problem(self.spec, seed, self.pairs, self.devices, max_iterations=self.max_iterations)


@dataclass(frozen=True)
class Optimum:
    """An optimum of a goal's program.

    Attributes
    ----------
    goal : the goal.
    problem : its program.
    outcome : what the solver found, which may be no optimum.
    """

    goal: Goal
    problem: Problem
    outcome: SolverOutcome

    @property
    def values(self) -> FloatArray:
        """Values of all unknowns."""
        return self.outcome.values

    @property
    def spec(self) -> DesignSpec:
        """The requested design, with its fold."""
        return self.goal.spec

    @property
    def mirrors(self) -> tuple[Mirror, ...]:
        """The mirrors, in the order of the layout."""
        centres, corners = self.problem.solution(self.values)
        return mirrors_of(self.spec, centres * self.spec.scale_mm, corners)

    @property
    def layout(self) -> Layout:
        """The nominal layout of the mirrors, without figures."""
        made_by = {"made_by": "optics.design.optimise.design", "solver": f"IPOPT of CasADi {version('casadi')}"}
        return layout_of(self.spec, self.mirrors, made_by)

    @property
    def sizes_mm(self) -> FloatArray:
        """Sizes (n, 2) of rectangles; (0, 2) for free outlines."""
        return self.values[self.problem.sizes] * self.spec.scale_mm

    @property
    def fold_deg(self) -> float:
        """The fold, rounded to degrees."""
        return float(np.rad2deg(self.values[self.problem.fold[0]]).round())

    @property
    def stricter(self) -> Goal:
        """The goal with the constraints on pairs that the mirrors violate; the same goal if they violate none."""
        spec, mirrors = self.spec, self.mirrors
        violated = {PairConstraint("gap", i, j) for i, j in pairs_closer_than(mirrors, spec.spacing_mm)}
        violated |= {
            PairConstraint("seen", i, j) for i, j in sub_images_closer_than(mirrors, spec.seen_gap_mm / spec.scale_mm)
        }
        light = blocked_light(mirrors, max(spec.depths_mm), view_axis=spec.view_from_rig[2], pupil=spec.camera.pupil)
        violated |= {PairConstraint(occlusion.leg, occlusion.mirror, occlusion.occluder) for occlusion in light}
        added = tuple(sorted(violated - set(self.goal.pairs)))
        return replace(self.goal, pairs=self.goal.pairs + added) if added else self.goal
