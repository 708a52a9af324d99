"""The terms of a design for depth against the bound, polygons, and differences."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.depth_sigma import depth_sigma_mm
from mirrorcam.optics.design.assess.layout_metrics import grid_error
from mirrorcam.optics.design.program import depth_terms
from mirrorcam.optics.design.program.constraints import region_directions
from mirrorcam.optics.design.program.seeds import mirrors_of
from mirrorcam.optics.design.program.terms import Term
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import SHARP_VARIANCE_PX2
from tests.optics.design.program.seeded_mirrors import KINDS, fold_of, number, seeded, spec_of

SPEC = spec_of(KINDS[4], 105.0)
SCALE_MM, CAMERA = SPEC.scale_mm, SPEC.camera
CENTRES, CORNERS = seeded(SPEC)
NEARNESS = SCALE_MM / CAMERA.focus_mm
BLUR = CAMERA.fx_px * CAMERA.aperture_mm / SCALE_MM / 4.0 / np.sqrt(SHARP_VARIANCE_PX2)
REGION = (region_directions() * [0.11, 0.08] + np.random.default_rng(5).normal(0.0, 0.005, (8, 2))).ravel()


def layout_of(centres: FloatArray) -> Layout:
    mirrors = mirrors_of(SPEC, centres * SCALE_MM, CORNERS.reshape(4, -1, 2))
    return Layout(rows=2, cols=2, camera=CAMERA, mirrors=mirrors, view_from_rig=SPEC.view_from_rig)


def sigma(centres: FloatArray, depth: float, tangents: list[float]) -> float:
    """The term's standard deviation, up to a factor."""
    term, unknowns = depth_terms.depth_sigma_term(4, 3), np.concatenate([fold_of(SPEC), centres.ravel()])
    return float(term.value(unknowns, [depth, *tangents, NEARNESS, BLUR, 1.0])[0])


@pytest.mark.parametrize("depth_mm", [300.0, 500.0])
@pytest.mark.parametrize("tangents", [[0.0, 0.0], [0.1, -0.06]])
def test_the_standard_deviation_changes_as_the_bound_does(depth_mm: float, tangents: list[float]) -> None:
    wider = CENTRES + 0.2 * (CENTRES - CENTRES.mean(axis=0)) * [1.0, 1.0, 0.0]
    across = SPEC.view_from_rig[:2, 2] * SCALE_MM + np.array(tangents) * (SCALE_MM + depth_mm)
    bounds = [depth_sigma_mm(layout_of(centres), np.array([[*across, depth_mm]]))[0] for centres in (CENTRES, wider)]
    found = [sigma(centres, depth_mm / SCALE_MM, tangents) for centres in (CENTRES, wider)]
    assert bounds[1] < 0.9 * bounds[0]
    # The term takes the views' mean shift for the same at all frequencies.
    assert found[1] / found[0] == pytest.approx(bounds[1] / bounds[0], rel=0.01)


def test_a_field_of_view_is_a_tangent_from_the_mean_virtual_centre() -> None:
    half = np.array([0.12, 0.07])
    corners = (np.sign(region_directions()) * half).ravel()
    size = number(depth_terms.field_of_view(ca.SX(corners), [ca.SX(c) for c in CENTRES], 5.0)).ravel()
    assert_allclose(size, 2.0 * half * 6.0 / (5.0 - CENTRES[:, 2].mean()))


USES: dict[str, tuple[Term, FloatArray, FloatArray]] = {
    "sigma": (
        depth_terms.depth_sigma_term(4, 3),
        np.concatenate([fold_of(SPEC), CENTRES.ravel()]),
        np.array([5.0, 0.1, -0.06, NEARNESS, BLUR, 0.5]),
    ),
    "field of view": (
        depth_terms.field_of_view_term(4),
        np.concatenate([REGION, CENTRES.ravel()]),
        np.array([5.0, 0.1, 0.05]),
    ),
    "grid limit": (
        depth_terms.grid_limit_term(SPEC.arrangement),
        CENTRES.ravel(),
        np.array([0.25]),
    ),
}


def test_the_limit_is_one_of_the_grid_error() -> None:
    term, x, p = USES["grid limit"]
    g = np.array(term.value(x, p)[1]).ravel()
    assert g[-1] == pytest.approx(p[0] ** 2 - grid_error(layout_of(CENTRES)) ** 2)


@pytest.mark.parametrize("name", USES)
def test_derivatives_agree_with_differences(name: str) -> None:
    term, x, p = USES[name]
    weight, multipliers = 0.6, np.random.default_rng(2).normal(0.0, 1.0, term.family.size)
    steps = 1e-6 * np.eye(x.size)

    def lagrangian(at: FloatArray) -> float:
        f, g = term.value(at, p)
        return float(weight * float(f) + multipliers @ np.array(g).ravel())

    def slopes(at: FloatArray) -> FloatArray:
        jacobian = np.zeros((term.family.size, term.unknowns))
        np.add.at(jacobian, (term.rows, term.cols), np.array(term.jacobian(at, p)).ravel())
        return np.asarray(weight * np.array(term.gradient(at, p)).ravel() + jacobian.T @ multipliers)

    differences = np.array([(lagrangian(x + by) - lagrangian(x - by)) / 2e-6 for by in steps])
    assert_allclose(slopes(x), differences, rtol=1e-6, atol=1e-7)
    upper = np.zeros((x.size, x.size))
    np.add.at(upper, (term.upper_rows, term.upper_cols), np.array(term.hessian(x, p, weight, multipliers)).ravel())
    second = np.array([(slopes(x + by) - slopes(x - by)) / 2e-6 for by in steps])
    assert_allclose(upper + np.triu(upper, 1).T, second, rtol=1e-6, atol=1e-6)
