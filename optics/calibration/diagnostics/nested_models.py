"""The family of nested calibration models, from three numbers per mirror up.

`paper`: virtual centres and board poses, with the camera held. `joint`: intrinsics as well. Above that, in any order:
`sheet`: the plate thickness of second-surface mirrors. `bend`: the curvature of each mirror. `warp`: two bows of the
board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirrorcam.optics.base.values import FloatArray, InputError
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, UndeterminedError, fit
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.camera import INTRINSIC_NAMES
from mirrorcam.optics.geometry.plate import rise_mm

ADDITIONS = ("sheet", "bend", "warp")
PLATE_MM, PLATE_INDEX = 1.0, 1.49
"""The plate to start from where the layout has first-surface mirrors; its index is that of acrylic."""


@dataclass(frozen=True)
class Fitted:
    """A model under the name of its level, and its fit."""

    name: str
    model: Model
    solution: Solution


def fit_as(name: str, start: Estimate, observations: Observations, model: Model) -> Fitted:
    """Fit a model under the name of its level; raises UndeterminedError where the corners do not suffice."""
    return Fitted(name, model, fit(start, observations, model))


def additions_of(level: str) -> tuple[str, ...]:
    """The additions to `joint` that a level names, as in "joint+sheet+warp"; raises InputError for anything else.

    "glass" is an addition for comparison alone: its fit changes mirrors from first- to second-surface, which a layout
    states and a calibration does not change.
    """
    first, *additions = level.split("+")
    if "glass" in additions:
        raise InputError(
            f"level {level!r} serves only to detect second-surface mirrors that the layout has as first-surface: "
            f"state their surface, thickness and index in the layout and use {level.replace('glass', 'sheet')}"
        )
    known = first in {"paper", "joint"} and all(name in ADDITIONS for name in additions)
    if not known or (first == "paper" and additions) or len(set(additions)) < len(additions):
        raise InputError(f"level {level!r}, expected paper, or joint with any of {', '.join(ADDITIONS)} (joint+bend)")
    return tuple(additions)


def paper_model(corners_in_board_mm: FloatArray) -> Model:
    """The model with the camera held: 3 numbers per mirror and the board's poses."""
    return Model((), thickness=False, curvature=False, board=Board.rigid(corners_in_board_mm))


def joint_model(corners_in_board_mm: FloatArray, additions: Sequence[str] = ()) -> Model:
    """The model with free intrinsics and some additions."""
    return Model(
        INTRINSIC_NAMES,
        thickness="sheet" in additions or "glass" in additions,
        curvature="bend" in additions,
        board=Board.warped(corners_in_board_mm) if "warp" in additions else Board.rigid(corners_in_board_mm),
    )


def first_fit(start: Estimate, observations: Observations, corners_in_board_mm: FloatArray) -> Estimate:
    """The estimate of `joint`, or of `paper` where the corners leave the intrinsics open."""
    paper = fit(start, observations, paper_model(corners_in_board_mm)).estimate
    try:
        return fit(paper, observations, joint_model(corners_in_board_mm)).estimate
    except UndeterminedError:
        return paper


def fit_with(addition: str, smaller: Fitted, observations: Observations) -> Fitted:
    """Fit the next larger model: a fitted one with an addition.

    The addition "glass" stands for plates on mirrors that the layout describes as first-surface. Raises InputError for
    "sheet" on such a layout, and UndeterminedError where the corners do not suffice.
    """
    estimate = smaller.solution.estimate
    if addition == "sheet" and not (estimate.thickness_mm > 0.0).any():
        raise InputError("level sheet: the layout has no second-surface mirror, expected one whose thickness can vary")
    if addition == "warp":
        estimate = replace(estimate, shape=np.zeros(2))
    if addition == "glass":
        estimate = as_second_surface(estimate)
    name = f"{smaller.name}+{addition}"
    model = joint_model(smaller.model.board.corners_in_board_mm, name.split("+"))
    return fit_as(name, estimate, observations, model)


def as_second_surface(estimate: Estimate) -> Estimate:
    """The estimate with second-surface mirrors that look the same along the chief ray of each."""
    centres = estimate.virtual_centres_in_rig_mm
    distance = np.linalg.norm(centres, axis=1) / 2.0
    foot = centres / 2.0
    middles = estimate.middles_in_rig_mm
    across = np.linalg.norm(middles - foot - _projected(middles - foot, centres), axis=1)
    rise = rise_mm(across / distance, PLATE_MM, PLATE_INDEX)
    mirrors = len(centres)
    return replace(
        estimate,
        virtual_centres_in_rig_mm=centres * (1.0 + rise / distance)[:, None],
        thickness_mm=np.full(mirrors, PLATE_MM),
        refractive_index=np.full(mirrors, PLATE_INDEX),
    )


def _projected(vectors: FloatArray, axes: FloatArray) -> FloatArray:
    """The components (n, 3) of vectors along axes (n, 3)."""
    return np.asarray(np.sum(vectors * axes, axis=1, keepdims=True) / np.sum(axes * axes, axis=1, keepdims=True) * axes)


def plate_thickness(fitted: Fitted) -> tuple[float, float]:
    """Thickness of the thinnest plate and its standard deviation, mm."""
    place = fitted.solution.parameters.index("sheet_mm")
    thickness = fitted.solution.estimate.thickness_mm
    sigma = float(np.sqrt(fitted.solution.covariance[place, place]))
    return float(thickness[thickness > 0.0].min()), sigma
