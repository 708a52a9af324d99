"""Normal equations summed over groups, against the dense Jacobian, and the step that solves them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.solver.normal_equations import (
    Grouped,
    NormalEquations,
    normal_equations,
    residuals_of,
)
from mirrorcam.optics.calibration.solver.parameterisation import CentresPrior, FrameTerms, Model
from mirrorcam.optics.calibration.solver.residuals import residuals, residuals_with_jacobians
from tests.optics.calibration.solver.four_mirrors import MIRRORS, FourMirrors, four_mirrors


def dense(scene: FourMirrors, model: Model) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobian (r, g + d f) and residuals (r,) of noisy corners and priors, assembled without groups."""
    r, d_global, d_frame = residuals_with_jacobians(scene.truth, scene.noisy(0), model.board)
    frames, terms = len(scene.truth.rig_from_board), model.frame_terms
    own = np.zeros((len(r), 2, frames, len(terms.free)))
    for row, frame in enumerate(scene.clean.frame):
        own[row, :, frame] = d_frame[row][:, terms.free]
    columns = np.concatenate(
        [d_global[:, :, model.free(scene.truth.camera, MIRRORS)], own.reshape(len(r), 2, -1)], axis=2
    )
    columns = columns.reshape(2 * len(r), -1)
    priors = np.zeros((frames * len(terms.free), columns.shape[1]))
    priors[:, len(model.free(scene.truth.camera, MIRRORS)) :] = np.diag(np.tile(terms.weights, frames))
    every = np.array([*r.ravel(), *terms.values(scene.truth).ravel()])
    known = np.abs(priors).max(axis=1) > 0
    rows, values = np.concatenate([columns, priors[known]]), every[np.append(np.full(r.size, True), known)]
    if model.centres_prior is None:
        return rows, values
    names = model.parameters(scene.truth.camera, MIRRORS)
    places = [names.index(f"mirror {m} {axis}_mm") for m in range(MIRRORS) for axis in "xyz"]
    of_prior = np.zeros((1, columns.shape[1]))
    of_prior[0, places] = model.centres_prior.coefficients.ravel()
    value = model.centres_prior.value(scene.truth.virtual_centres_in_rig_mm)
    return np.concatenate([rows, of_prior]), np.append(values, value)


def assembled(normal: NormalEquations) -> tuple[FloatArray, FloatArray]:
    """Return the complete normal matrix and gradient."""
    size, (frames, own, _) = len(normal.u), normal.v.shape
    matrix = np.zeros((size + own * frames,) * 2)
    matrix[:size, :size] = normal.u
    for frame in range(frames):
        rows = slice(size + own * frame, size + own * (frame + 1))
        matrix[rows, rows] = normal.v[frame]
        matrix[rows, :size] = normal.w[frame]
        matrix[:size, rows] = normal.w[frame].T
    return matrix, np.concatenate([normal.gradient_global, normal.gradient_poses.ravel()])


@pytest.fixture(
    scope="module", params=["joint", "plates and a free board", "terms of frames", "a bow", "a motion", "a prior"]
)
def problem(request: pytest.FixtureRequest) -> tuple[FourMirrors, Model]:
    plain = "plates" not in request.param
    scene = four_mirrors(0 if plain else 3)
    if not plain:
        truth = replace(
            scene.truth, thickness_mm=np.array([2.0, 0.0, 3.0, 2.0]), refractive_index=np.full(MIRRORS, 1.5)
        )
        scene = replace(scene, truth=truth)
    terms = FrameTerms()
    if request.param == "terms of frames":
        terms = FrameTerms(rotation_per_rad=300.0, bow_per_mm=0.2)
    if request.param == "a bow":
        terms = FrameTerms(bow_per_mm=0.2)
    if request.param == "a motion":
        terms = FrameTerms(None, 0.2, 300.0, 3.0, 400.0, 4.0)
        motion = np.random.default_rng(3).normal(size=(len(scene.truth.rig_from_board), 12))
        scene = replace(scene, truth=replace(scene.truth, motion=motion * ([*[0.01] * 3, *[1.0] * 3] * 2)))
    if len(terms.free) > 6:
        turn, bow = np.random.default_rng(2).normal(size=(2, len(scene.truth.rig_from_board), 3))
        scene = replace(scene, truth=replace(scene.truth, camera_rotation=0.01 * turn, bow_mm=0.5 * bow))
    free = scene.truth.camera.intrinsic_names[:6]
    model = Model(free, thickness=not plain, curvature=not plain, board=scene.board, frame_terms=terms)
    if request.param == "a prior":
        along = np.random.default_rng(4).normal(size=(MIRRORS, 3))
        model = replace(model, centres_prior=CentresPrior(along, float(np.sum(along)) + 3.0))
    return scene, model


def test_sums_over_groups_equal_those_of_the_dense_jacobian(problem: tuple[FourMirrors, Model]) -> None:
    scene, model = problem
    grouped = Grouped.of(scene.noisy(0), model)
    columns, r = dense(scene, model)
    matrix, gradient = assembled(normal_equations(scene.truth, grouped, model))
    scale = np.sqrt(np.diag(columns.T @ columns))
    np.testing.assert_allclose(matrix / np.outer(scale, scale), columns.T @ columns / np.outer(scale, scale), atol=1e-9)
    np.testing.assert_allclose(gradient / scale, columns.T @ r / scale, atol=1e-8)


def test_the_undamped_step_solves_the_least_squares_problem(problem: tuple[FourMirrors, Model]) -> None:
    scene, model = problem
    columns, r = dense(scene, model)
    step_global, step_poses, predicted = normal_equations(scene.truth, Grouped.of(scene.noisy(0), model), model).step(
        0.0
    )
    step = np.concatenate([step_global, step_poses.ravel()])
    scale = np.sqrt(np.diag(columns.T @ columns))
    expected = np.linalg.lstsq(columns / scale, -r, rcond=None)[0]
    np.testing.assert_allclose(step * scale, expected, atol=1e-6 * np.abs(expected).max())
    assert predicted == pytest.approx(r @ r - np.sum((r + columns @ step) ** 2), rel=1e-6)


def test_weights_scale_the_rows(problem: tuple[FourMirrors, Model]) -> None:
    scene, model = problem[0], replace(problem[1], centres_prior=None)
    grouped = Grouped.of(scene.noisy(0), model)
    once = normal_equations(scene.truth, grouped, model)
    twice = normal_equations(scene.truth, grouped, model, np.full(len(scene.clean), 2.0))
    np.testing.assert_allclose(twice.u, 4.0 * once.u)
    np.testing.assert_allclose(twice.gradient_poses[:, :6], 4.0 * once.gradient_poses[:, :6])


def test_grouped_residuals_equal_the_residuals_in_group_order(problem: tuple[FourMirrors, Model]) -> None:
    scene, model = problem
    seen = scene.noisy(1)
    grouped = Grouped.of(seen, model)
    expected = residuals(scene.truth, seen, model.board)[grouped.order].T
    np.testing.assert_allclose(residuals_of(scene.truth, grouped, model), expected, atol=1e-9)
    np.testing.assert_array_equal(np.sort(grouped.order), np.arange(len(seen)))
