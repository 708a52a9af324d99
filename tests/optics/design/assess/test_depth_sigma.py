"""The bound of depth against a closed form and the information matrix of a texture's amplitudes and the depth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import dblquad

from mirrorcam.optics.design.assess.depth_sigma import (
    DEPTH_UNKNOWN,
    GRADIENT_GREY,
    NOISE_GREY,
    WINDOW_PX,
    depth_sigma_metrics,
    depth_sigma_mm,
)
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.pupil import SHARP_VARIANCE_PX2
from mirrorcam.optics.geometry.sub_images import fields_of_view
from tests.optics.seeing_mirrors import DEPTH_MM, mirror_seeing

F_PX = 1360.38


def upright_views(*heights_mm: float, camera: Camera | None = None) -> Layout:
    """A column of views normal to the scene: the image of a point at 300 mm has z = 300 + height."""
    mirrors = tuple(
        mirror_seeing((30.0 * k - 60.0, 30.0 * k - 40.0, 60.0, 110.0), height) for k, height in enumerate(heights_mm)
    )
    pinhole = Camera.c920().replaced(aperture_mm=0.0)
    return Layout(rows=len(mirrors), cols=1, camera=camera or pinhole, mirrors=mirrors)


def test_of_equal_views_it_is_the_closed_form() -> None:
    baselines = np.array([0.2, 0.1, 0.0])
    layout = upright_views(*(80.0 + baselines))
    ahead_mm = DEPTH_MM + 80.1
    spread = np.sqrt(np.sum((baselines - baselines.mean()) ** 2))
    expected = ahead_mm**2 / (F_PX * spread) * NOISE_GREY / (GRADIENT_GREY * np.sqrt(WINDOW_PX))
    (sigma,) = depth_sigma_mm(layout, np.array([[0.0, -80.1, DEPTH_MM]]))
    assert sigma == pytest.approx(expected, rel=2e-3)


def test_unequal_views_have_the_information_of_all_amplitudes_and_the_depth() -> None:
    heights, x, y = (110.0, 80.0, 65.0), 25.0, -70.0
    camera = Camera.c920().replaced(aperture_mm=4.0, focus_mm=300.0)
    layout = upright_views(*heights, camera=camera)
    away = np.array([DEPTH_MM + height for height in heights])
    moves = np.array([[x, y + height] for height in heights]) / away[:, None]
    circles = F_PX * 4.0 * np.abs(1.0 / away - 1.0 / 300.0)
    variances = (SHARP_VARIANCE_PX2 + circles**2 / 16.0) * (away / F_PX) ** 2
    density = (F_PX / away) ** 2

    def information(length: float, angle: float) -> float:
        k = length * np.array([np.cos(angle), np.sin(angle)])
        contrast = np.exp(-variances * length**2 / 2.0) * np.sqrt(density) / NOISE_GREY
        amplitude = contrast * np.exp(0j)
        columns = np.column_stack([amplitude, 1j * amplitude, 1j * amplitude * (moves @ k)])
        fisher = (columns.conj().T @ columns).real
        left = fisher[2, 2] - fisher[2, :2] @ np.linalg.solve(fisher[:2, :2] + 1e-300 * np.eye(2), fisher[:2, 2])
        return float(left / length**2 * length)

    longest = 8.0 / np.sqrt(variances.min())
    whole, _ = dblquad(information, 0.0, 2.0 * np.pi, 1e-6, longest, epsrel=1e-5)
    # A sharp picture of the spectrum of slopes 1 over frequencies in the plane has the mean square pi / (2 variance).
    spectrum = GRADIENT_GREY**2 / (np.pi / (2.0 * SHARP_VARIANCE_PX2))
    expected = 1.0 / np.sqrt(whole * spectrum * WINDOW_PX / density[1])
    (sigma,) = depth_sigma_mm(layout, np.array([[x, y, DEPTH_MM]]))
    assert sigma == pytest.approx(expected, rel=5e-3)


def test_it_grows_with_depth_and_with_blur(default_layout: Layout) -> None:
    def sigma(layout: Layout) -> list[float]:
        return [
            metric.value
            for metric in depth_sigma_metrics(fields_of_view(layout, layout.camera.pupil), (300.0, 500.0)).values()
        ]

    near, far = sigma(default_layout)
    assert far > 1.5 * near
    blurred = default_layout.replaced(camera=default_layout.camera.replaced(focus_mm=2000.0))
    assert sigma(blurred)[0] > 1.2 * near


def test_it_is_left_out_where_views_share_nothing() -> None:
    assert depth_sigma_metrics(fields_of_view(upright_views(80.0, 100.0)), (DEPTH_MM,)) == {}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("aperture_mm", [0.0, 1.0, 10.0, 100.0, 1e3])
def test_it_is_finite_or_none_with_a_reason_however_blurred_the_views_are(aperture_mm: float) -> None:
    layout = upright_views(110.0, 80.0, 65.0, camera=Camera.c920().replaced(aperture_mm=aperture_mm, focus_mm=1e5))
    (sigma,) = depth_sigma_mm(layout, np.array([[25.0, -70.0, DEPTH_MM]]))
    sharp = upright_views(110.0, 80.0, 65.0)
    assert sigma >= depth_sigma_mm(sharp, np.array([[25.0, -70.0, DEPTH_MM]]))[0]
    assert not np.isnan(sigma)


@pytest.mark.filterwarnings("error")
def test_frequencies_that_no_view_shows_add_nothing() -> None:
    """Contrasts underflow at the highest frequencies long before the lowest, which still determine depth."""
    at = np.array([[25.0, -70.0, DEPTH_MM]])
    sigmas = [
        depth_sigma_mm(upright_views(110.0, 80.0, camera=Camera.c920().replaced(aperture_mm=a, focus_mm=1e5)), at)[0]
        for a in np.linspace(1.0, 12.0, 45)
    ]
    assert np.isfinite(sigmas).all()
    assert (np.diff(sigmas) > 0.0).all()


@pytest.mark.filterwarnings("error")
def test_views_in_one_place_determine_no_depth() -> None:
    assert depth_sigma_mm(upright_views(80.0, 80.0), np.array([[0.0, -80.0, DEPTH_MM]]))[0] > 1e6


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("aperture_mm", [50.0, 200.0, 1e3])
def test_it_is_none_with_the_reason_where_it_would_exceed_the_depth(
    aperture_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "mirrorcam.optics.design.assess.depth_sigma._points", lambda *_: np.array([[25.0, -70.0, DEPTH_MM]])
    )
    layout = upright_views(110.0, 80.0, camera=Camera.c920().replaced(aperture_mm=aperture_mm, focus_mm=1e5))
    (metric,) = depth_sigma_metrics(fields_of_view(layout), (DEPTH_MM,)).values()
    assert not metric.known
    assert metric.reason == DEPTH_UNKNOWN
