"""The family of nested calibration models, from three parameters per mirror upwards.

`paper`: virtual centres and board poses, with the camera fixed. `joint`: intrinsics as well. Further additions, in any
order: `sheet`: the plate thickness of second-surface mirrors. `bend`: the curvature of each mirror. `warp`: two bows of
the board. `bow`: a bow of the board in each frame. `motion`: a motion of the board in each frame, while a rolling
shutter reads it. `turn`: a rotation of the camera in each frame. `board`: free corners of the board. `turn` needs
frames that show the board both directly and in mirrors; `board` needs these, or frames without mirrors. `rational`,
`prism`: further lens parameters; `spline`: a field over the view; `fisheye`: a different lens (`LENS_ADDITIONS`).
`walk`: the pupil walks along the axis (`Camera.pupil_walk_mm`). `colour`: grey pictures grow out of focus, as their
colours have different sizes (`Camera.defocus_growth_mm2`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.levenberg_marquardt import Solution, UndeterminedError, fit
from mirrorcam.optics.calibration.solver.normal_equations import Grouped, normal_equations
from mirrorcam.optics.calibration.solver.observations import Observations
from mirrorcam.optics.calibration.solver.parameterisation import CentresPrior, FrameTerms, Model
from mirrorcam.optics.calibration.solver.residuals import Board, Estimate
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.nearest_lens import nearest_lens, with_lens
from mirrorcam.optics.geometry.plate import rise_mm

PRIOR_ROUNDS = 3
"""Number of fits after which a prior's width, which follows the fit, has converged."""
ROTATION_SIGMA_PX = 0.5
"""Standard deviation of the camera's rotation that remains after removing the background's rotation, px."""
INITIAL_BOW, MIN_BOW = 0.02, 1e-4
"""Initial and minimum standard deviation of the bow of boards, relative to a board's longer side."""
INITIAL_MOTION, MIN_MOTION = 0.01, 1e-5
"""The same of the velocity and the acceleration of boards per readout: of translations, and of rotations in rad."""
PLATE_MM, PLATE_INDEX = 1.0, 1.49
"""Initial thickness and refractive index (acrylic) of plates if the layout has first-surface mirrors."""
PLATE_FRACTION, GLASS_INDEX = 0.01, 1.52
"""The same without a layout: thickness relative to the mirrors' mean distance, and index of soda-lime glass."""
INDEX_SIGMA = 0.02
"""Standard deviation of the index without a layout: float glass has 1.51 to 1.53, acrylic 1.49."""
LENS_ADDITIONS: Mapping[str, LensName] = MappingProxyType(
    {"rational": "rational", "prism": "thin_prism", "fisheye": "fisheye", "spline": "spline"}
)
"""Lens model of each addition. A fisheye is not an extension but a different lens model."""
DEPTH_ADDITIONS: Mapping[str, str] = MappingProxyType({"walk": "pupil_walk_mm", "colour": "defocus_growth_mm2"})
"""Intrinsic of each addition to the camera that depends on depth."""
CAMERA_ADDITIONS = (*DEPTH_ADDITIONS, *LENS_ADDITIONS)
MOTION = "motion"
ADDITIONS = ("sheet", "bend", "warp", "bow", MOTION, *CAMERA_ADDITIONS)
PLAIN_ADDITIONS = ("warp", "bow", "board", MOTION, *CAMERA_ADDITIONS)
"""Additions without mirrors."""
IN_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "sheet": "the thickness of the mirrors' plates",
        "bend": "bent mirrors",
        "warp": "a warped board",
        "bow": "a board bowed differently in each picture",
        MOTION: "boards in motion before a rolling shutter",
        "turn": "a camera that turns",
        "board": "a board with free corners",
        "walk": "a pupil that moves with the angle (walk)",
        "colour": "colours of different size",
        "rational": "more radial distortion",
        "prism": "thin-prism distortion",
        "fisheye": "a fisheye lens",
        "spline": "an irregular lens (spline)",
    }
)
"""What each addition adds, for a sentence."""
_FURTHER: Mapping[LensName, tuple[str, ...]] = MappingProxyType(
    {
        "brown_conrady": ("rational", "prism", "fisheye", "spline"),
        "rational": ("prism",),
        "thin_prism": (),
        "fisheye": (),
        "spline": (),
    }
)


@dataclass(frozen=True)
class Fitted:
    """A fitted model with its name, such as `joint+bend`."""

    name: str
    model: Model
    solution: Solution


def fit_as(name: str, start: Estimate, observations: Observations, model: Model) -> Fitted:
    """Fit a model and name it; raises UndeterminedError if the corners do not determine it."""
    return Fitted(name, model, fit(start, observations, model))


def paper_model(corners_in_board_mm: FloatArray, prior: CentresPrior | None = None) -> Model:
    """Return the model with a fixed camera: 3 parameters per mirror, and the board's poses."""
    board = Board.rigid(corners_in_board_mm)
    return Model((), thickness=False, curvature=False, board=board, centres_prior=prior)


def joint_model(camera: Camera, corners_in_board_mm: FloatArray, prior: CentresPrior | None = None) -> Model:
    """Return the model with all intrinsics of a camera free."""
    return replace(paper_model(corners_in_board_mm, prior), intrinsics=camera.intrinsic_names)


def first_fit(
    start: Estimate, observations: Observations, corners_in_board_mm: FloatArray, prior: CentresPrior | None
) -> Estimate:
    """Return the estimate of `joint`, or of `paper` if the corners do not determine the intrinsics."""
    paper = fit(start, observations, paper_model(corners_in_board_mm, prior)).estimate
    try:
        return fit(paper, observations, joint_model(paper.camera, corners_in_board_mm, prior)).estimate
    except UndeterminedError:
        return paper


def extended(model: Model, addition: str) -> Model:
    """Return the model extended by an addition whose parameters are common to all frames."""
    if addition in {"sheet", "glass", "plates"}:
        return replace(model, thickness=True)
    if addition == "bend":
        return replace(model, curvature=True)
    shapes = {"warp": Board.warped, "board": Board.free}[addition]
    return replace(model, board=shapes(model.board.corners_in_board_mm))


def fit_with(addition: str, smaller: Fitted, observations: Observations) -> Fitted:
    """Fit a fitted model extended by an addition.

    For first-surface mirrors, two additions replace "sheet": "glass", only for comparison, and "plates", if nothing is
    known about the mirrors. Raises InputError for "sheet" on them, and UndeterminedError if the corners do not
    determine the model.
    """
    estimate = smaller.solution.estimate
    name = f"{smaller.name}+{'sheet' if addition == 'plates' else addition}"
    if addition == "sheet" and not (estimate.thickness_mm > 0.0).any():
        raise InputError("model sheet: the layout has no second-surface mirror, expected one whose thickness can vary")
    if addition in {"turn", "bow", MOTION}:
        return _fit_with_terms(name, smaller, observations, addition)
    if addition in CAMERA_ADDITIONS:
        start, model = _with_camera(addition, smaller)
        return fit_as(name, start, observations, model)
    if addition == "glass":
        estimate = as_second_surface(estimate, PLATE_MM, PLATE_INDEX)
    if addition == "plates":
        distance = float(np.linalg.norm(estimate.virtual_centres_in_rig_mm, axis=1).mean()) / 2.0
        estimate = as_second_surface(estimate, PLATE_FRACTION * distance, GLASS_INDEX)
    model = extended(smaller.model, addition)
    if len(model.board.modes) != len(estimate.shape):
        bent = smaller.model.board.shaped(estimate.shape) - model.board.corners_in_board_mm
        # Free modes are orthonormal, and include the bows of a warped board.
        estimate = replace(estimate, shape=np.tensordot(model.board.modes, bent, axes=2))
    return fit_as(name, estimate, observations, model)


def _with_camera(addition: str, smaller: Fitted) -> tuple[Estimate, Model]:
    """Return estimate and model with an addition to the camera; raises InputError if the camera already has it."""
    estimate, additions = smaller.solution.estimate, smaller.name.split("+")
    if addition not in further_cameras(estimate.camera, additions):
        part = IN_WORDS[addition] if addition in DEPTH_ADDITIONS else f"a {estimate.camera.lens_model} lens"
        raise InputError(f"model {smaller.name}+{addition}: the camera already has {part}")
    camera = with_addition(estimate.camera, addition)
    return replace(estimate, camera=camera), replace(
        smaller.model, intrinsics=free_intrinsics(camera, [*additions, addition])
    )


def _fit_with_terms(name: str, smaller: Fitted, observations: Observations, addition: str) -> Fitted:
    """Fit with one more kind of per-frame parameters, under priors that adapt to the noise and the fitted values."""
    scale, terms = smaller.solution.scale, smaller.model.frame_terms
    estimate = smaller.solution.estimate
    size = float(np.ptp(smaller.model.board.corners_in_board_mm, axis=0).max())
    initial: dict[str, tuple[float, float]] = {}
    if addition == "bow" or terms.bow_per_mm is not None:
        initial["bow_per_mm"] = INITIAL_BOW * size, MIN_BOW * size
    if addition == MOTION or terms.has_motion:
        for order in ("motion", "acceleration"):
            initial[f"{order}_per_rad"] = INITIAL_MOTION, MIN_MOTION
            initial[f"{order}_per_mm"] = INITIAL_MOTION * size, MIN_MOTION * size
    has_rotations = addition == "turn" or terms.rotation_per_rad is not None
    sigmas = {prior: sigma for prior, (sigma, _) in initial.items()}
    for last in (*[False] * (PRIOR_ROUNDS - 1), True):
        if last:
            sigmas = {prior: sigma * _widening(prior, estimate) for prior, sigma in sigmas.items()}
        priors = FrameTerms(
            rotation_per_rad=scale * estimate.camera.fx_px / ROTATION_SIGMA_PX if has_rotations else None,
            **{prior: scale / sigma for prior, sigma in sigmas.items()},
        )
        fitted = fit_as(name, estimate, observations, replace(smaller.model, frame_terms=priors))
        scale, estimate = fitted.solution.scale, fitted.solution.estimate
        fitted_sigmas = _frame_sigmas(fitted, observations)
        sigmas = {prior: max(fitted_sigmas[prior], smallest) for prior, (_, smallest) in initial.items()}
    return fitted


def _widening(prior: str, estimate: Estimate) -> float:
    """Factor by which a fitted width is too narrow for the mean over all frames.

    Boards in consecutive frames move alike, so the mean of their motions varies as much as a single one, not less by
    the root of their number as under independent priors.
    """
    return 1.0 if prior == "bow_per_mm" else float(np.sqrt(len(estimate.rig_from_board)))


def _frame_sigmas(fitted: Fitted, observations: Observations) -> dict[str, float]:
    """Standard deviation of each kind of per-frame parameters, from estimates and variances (a step of EM)."""
    solution, model = fitted.solution, fitted.model
    rows = observations.where(solution.inliers)
    frame_information = normal_equations(solution.estimate, Grouped.of(rows, model), model).v
    variance = solution.scale**2 * np.einsum("fii->fi", np.linalg.inv(frame_information))
    weights = model.frame_terms.weights
    values = np.divide(
        model.frame_terms.values(solution.estimate), weights, where=weights > 0.0, out=np.zeros_like(variance)
    )
    squares = np.mean(values**2 + variance, axis=0)[6:].reshape(-1, 3).mean(axis=1)
    return dict(zip(model.frame_terms.names, np.sqrt(squares).tolist(), strict=True))


def as_second_surface(estimate: Estimate, thickness_mm: float, index: float) -> Estimate:
    """Return the estimate with second-surface mirrors that look the same along each mirror's chief ray."""
    centres = estimate.virtual_centres_in_rig_mm
    distance = np.linalg.norm(centres, axis=1) / 2.0
    foot = centres / 2.0
    offset = estimate.centroids_in_rig_mm - foot
    normal_part = (
        np.sum(offset * centres, axis=1, keepdims=True) / np.sum(centres * centres, axis=1, keepdims=True) * centres
    )
    lateral = np.linalg.norm(offset - normal_part, axis=1)
    rise = rise_mm(lateral / distance, thickness_mm, index)
    mirrors = len(centres)
    return replace(
        estimate,
        virtual_centres_in_rig_mm=centres * (1.0 + rise / distance)[:, None],
        thickness_mm=np.full(mirrors, thickness_mm),
        refractive_index=np.full(mirrors, index),
    )


def plate_thickness(fitted: Fitted) -> tuple[float, float]:
    """Thickness of the thinnest plate and its standard deviation, mm."""
    index = fitted.solution.parameters.index("sheet_mm")
    thickness = fitted.solution.estimate.thickness_mm
    sigma = float(np.sqrt(fitted.solution.covariance[index, index]))
    return float(thickness[thickness > 0.0].min()), sigma


def further_cameras(camera: Camera, additions: Collection[str]) -> tuple[str, ...]:
    """Additions to a camera that a model with some additions still allows."""
    depth = [addition for addition, name in DEPTH_ADDITIONS.items() if getattr(camera, name) is None]
    if camera.lens_model == "thin_prism" and "prism" in additions and "rational" not in additions:
        return (*depth, "rational")
    return (*depth, *(name for name in _FURTHER[camera.lens_model] if name not in additions))


def with_addition(camera: Camera, addition: str) -> Camera:
    """Extend a camera by an addition: exactly, except for the nearest fisheye."""
    if addition in DEPTH_ADDITIONS:
        return camera.replaced(**{DEPTH_ADDITIONS[addition]: 0.0})
    model = LENS_ADDITIONS[addition]
    if model == "fisheye":
        return nearest_lens(camera, model)[0]
    return camera if addition == "rational" and camera.lens_model == "thin_prism" else with_lens(camera, model)


def free_intrinsics(camera: Camera, additions: Collection[str]) -> tuple[str, ...]:
    """Names of the free intrinsics of a model with some additions: all, or all but the denominator's coefficients."""
    without_denominator = "prism" in additions and "rational" not in additions
    return tuple(name for name in camera.intrinsic_names if not (without_denominator and name in {"k4", "k5", "k6"}))
