"""Circles of confusion against rays from the pupil's rim, and the best focus against a search."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import fsolve, minimize_scalar

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.assess.focus import CIRCLE_LIMIT_PX, focus_metrics, out_of_focus
from mirrorcam.optics.design.assess.layout_metrics import evaluate
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.sub_images import common_region, fields_of_view, vertices
from tests.optics.seeing_mirrors import DEPTH_MM, mirror_seeing, two_rectangles

DEPTHS_MM = (DEPTH_MM, 500.0)
RIM = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)


def with_camera(layout: Layout, **fields: float) -> Layout:
    return layout.replaced(camera=layout.camera.replaced(**fields))


def largest_circle_px(layout: Layout, depths_mm: tuple[float, ...] = DEPTHS_MM) -> float:
    found = focus_metrics(fields_of_view(layout), depths_mm)
    return max(metric.value for name, metric in found.items() if name.startswith("circle_of_confusion"))


def circle_by_rays_px(camera: Camera, mirror: Mirror, point: FloatArray) -> float:
    """Diameter of the image of a point: rays from it that a flat mirror reflects to the rim of the pupil.

    A ray belongs to the pixel through whose chief ray it crosses the plane in focus.
    """
    a, b, c = mirror.outline_in_rig_mm[:3]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    along, across = b - a, np.cross(normal, b - a)
    spot = []
    for angle in RIM:
        rim = camera.aperture_mm / 2.0 * np.array([np.cos(angle), np.sin(angle), 0.0])

        def unequal(place: FloatArray, rim: FloatArray = rim) -> FloatArray:
            met = a + place[0] * along + place[1] * across
            leaving, arriving = (met - rim) / np.linalg.norm(met - rim), (point - met) / np.linalg.norm(point - met)
            difference = arriving - leaving  # the mirror's normal
            return np.array([difference @ along, difference @ across])

        place = fsolve(unequal, [0.5, 0.5], xtol=1e-11)
        assert np.abs(unequal(place)).max() < 1e-9
        ray = a + place[0] * along + place[1] * across - rim
        in_focus = rim + ray * (camera.focus_mm / ray[2])
        spot.append(camera.fx_px * in_focus[:2] / in_focus[2])
    opposite = np.array(spot[4:]) - spot[:4]
    return float(np.linalg.norm(opposite, axis=1).max())


@pytest.mark.parametrize("focus_mm", [300.0, 500.0])
def test_circles_are_those_of_rays_through_the_rim_of_the_pupil(default_layout: Layout, focus_mm: float) -> None:
    layout = with_camera(default_layout, focus_mm=focus_mm)
    found = focus_metrics(fields_of_view(layout), DEPTHS_MM)
    for depth_mm in DEPTHS_MM:
        outline = vertices(common_region(layout, depth_mm)[0])
        inside = np.concatenate([outline, outline * 0.5 + outline.mean(axis=0) * 0.5])
        points = np.column_stack([inside, np.full(len(inside), depth_mm)]) @ layout.view_from_rig
        circles = [[circle_by_rays_px(layout.camera, mirror, p) for p in points] for mirror in layout.mirrors]
        assert found[f"circle_of_confusion_{depth_mm:g}mm"].value == pytest.approx(np.max(circles), abs=1e-6)


def test_no_other_focus_has_a_smaller_largest_circle(default_layout: Layout) -> None:
    found = focus_metrics(fields_of_view(default_layout), DEPTHS_MM)
    best_mm, least_px = (found[name].value for name in ("best_focus_mm", "circle_at_best_focus_px"))
    searched = minimize_scalar(
        lambda inverse_depths: largest_circle_px(with_camera(default_layout, focus_mm=1.0 / inverse_depths)),
        bounds=(1e-3, 4e-3),
        method="bounded",
        options={"xatol": 1e-9},
    )
    assert 1.0 / searched.x == pytest.approx(best_mm, rel=1e-4)
    assert searched.fun == pytest.approx(least_px, rel=1e-4)
    assert largest_circle_px(with_camera(default_layout, focus_mm=best_mm)) == pytest.approx(least_px)
    assert found["circle_at_best_focus_px"].limit == CIRCLE_LIMIT_PX


def test_two_mirrors_at_45_degrees_in_closed_form() -> None:
    # 100 and 80 mm above the pupil, they show the plane at 300 mm upright, 400 and 380 mm away.
    found = focus_metrics(fields_of_view(two_rectangles()), [DEPTH_MM])
    scale = 1360.38 * 1.8
    assert found["circle_of_confusion_300mm"].value == pytest.approx(scale * (1 / 380 - 1 / 500))
    assert found["best_focus_mm"].value == pytest.approx(2.0 / (1 / 380 + 1 / 400))
    assert found["circle_at_best_focus_px"].value == pytest.approx(scale * (1 / 380 - 1 / 400) / 2.0)


def test_twice_the_aperture_is_twice_the_circle_past_the_limit(default_layout: Layout) -> None:
    once, twice = (
        focus_metrics(fields_of_view(with_camera(default_layout, aperture_mm=aperture_mm)), DEPTHS_MM)
        for aperture_mm in (1.8, 3.6)
    )
    assert twice["best_focus_mm"].value == pytest.approx(once["best_focus_mm"].value)
    for name in ("circle_of_confusion_300mm", "circle_at_best_focus_px"):
        assert twice[name].value == pytest.approx(2.0 * once[name].value)
    assert once["circle_at_best_focus_px"].passed
    assert not twice["circle_at_best_focus_px"].passed


def test_a_pinhole_has_no_focus(default_layout: Layout) -> None:
    assert focus_metrics(fields_of_view(with_camera(default_layout, aperture_mm=0.0)), DEPTHS_MM) == {}


def test_a_depth_without_a_common_region_has_no_circle() -> None:
    upper, lower = mirror_seeing((-40, 30, 110, 160), 80.0), mirror_seeing((-20, 50, 20, 105), 100.0)
    layout = Layout(rows=2, cols=1, camera=Camera.c920(), mirrors=(lower, upper))
    assert focus_metrics(fields_of_view(layout), [DEPTH_MM]) == {}
    assert set(focus_metrics(fields_of_view(layout), [DEPTH_MM, 100.0])) == {
        "circle_of_confusion_100mm",
        "best_focus_mm",
        "circle_at_best_focus_px",
    }


def test_circles_of_confusion_above_the_limit_are_reported_with_advice(fold_90_layout: Layout) -> None:
    def remark(**fields: float) -> str:
        layout = fold_90_layout.replaced(camera=fold_90_layout.camera.replaced(**fields))
        return out_of_focus(layout.replaced(metrics=evaluate(layout, DesignSpec().depths_mm)))

    assert remark().endswith("reach 3.12 px, more than 2 px: the focus at 402 mm reduces them to 1.92 px")
    assert remark(aperture_mm=3.6).endswith("3.84 px, and an aperture of 1.88 mm would reduce them to 2 px")
    assert remark(focus_mm=402.0) == ""
    assert remark(aperture_mm=0.0) == ""
