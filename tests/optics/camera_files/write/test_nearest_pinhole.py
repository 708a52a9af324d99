"""The nearest pinhole: exact for flat first-surface mirrors, nearly so for others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mirrorcam.core.values import Metric
from mirrorcam.optics.camera_files.write import virtual_cameras
from mirrorcam.optics.camera_files.write.virtual_cameras import flipped_pixels
from mirrorcam.optics.camera_files.write.write_exports import readme
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import Mirror
from tests.optics.camera_files.write.conftest import Case, seen_through, sideways_layout


def acrylic(layout: Layout) -> Layout:
    plates = tuple(
        Mirror.second_surface(
            mirror.virtual_centre_in_rig_mm, mirror.outline_in_rig_mm, thickness_mm=2.0, refractive_index=1.49
        )
        for mirror in layout.mirrors
    )
    return layout.replaced(mirrors=plates)


def bent(layout: Layout) -> Layout:
    """A sag of some 0.01 mm, and saddles."""
    return layout.replaced(
        mirrors=tuple(mirror.replaced(curvature_per_m=[0.08, -0.05, 0.04]) for mirror in layout.mirrors)
    )


def test_flat_first_surface_mirrors_are_pinholes(case: Case) -> None:
    for view in case.views:
        assert view.pinhole_error_px < 1e-9
        np.testing.assert_array_equal(view.camera.intrinsics[[0, 1]], case.layout.camera.intrinsics[[0, 1]])


@pytest.mark.parametrize("not_a_pinhole", [acrylic, bent])
def test_other_mirrors_are_nearly_pinholes_and_their_error_is_stated(
    parabola_layout: Layout, not_a_pinhole: Callable[[Layout], Layout]
) -> None:
    layout = not_a_pinhole(parabola_layout)
    assert layout.spec is not None
    low, high = min(layout.spec.depths_mm), max(layout.spec.depths_mm)
    for number, view in enumerate(virtual_cameras(layout)):
        apparent = layout.mirrors[number].apparent
        points = seen_through(layout, number, count=2000)
        away = np.linalg.norm(points - apparent.virtual_centre_in_rig_mm, axis=1)
        points = points[(away > low) & (away < high)]
        exact = flipped_pixels(layout.project(points, number), layout.camera, view.flip)
        off = np.linalg.norm(view.project(points) - exact, axis=1)
        assert 0.01 < off.max() <= 1.02 * view.pinhole_error_px
        plain = flipped_pixels(layout.camera.project(apparent.reflect(points)), layout.camera, view.flip)
        assert off.max() < 0.5 * np.linalg.norm(plain - exact, axis=1).max()
        turn = view.camera_from_rig[:3, :3]
        assert np.linalg.det(turn) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_a_layout_without_a_design_is_fitted_where_its_board_was() -> None:
    """Small mirrors, and a board much nearer than 300 mm."""
    working = {"working_distance_mm": Metric(value=120.0, unit="mm")}
    large = sideways_layout()
    small = (
        Mirror(
            virtual_centre_in_rig_mm=0.2 * mirror.virtual_centre_in_rig_mm,
            outline_in_rig_mm=0.2 * mirror.outline_in_rig_mm,
        )
        for mirror in large.mirrors
    )
    layout = acrylic(large.replaced(mirrors=tuple(small), kind="calibrated", metrics=working))
    views, elsewhere = virtual_cameras(layout), virtual_cameras(layout.replaced(metrics={}))
    for number, (view, other) in enumerate(zip(views, elsewhere, strict=True)):
        apparent = layout.mirrors[number].apparent
        points = seen_through(layout, number, count=300) - apparent.virtual_centre_in_rig_mm
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        points = apparent.virtual_centre_in_rig_mm + points * np.linspace(0.7 * 120.0, 1.4 * 120.0, 300)[:, None]
        exact = flipped_pixels(layout.project(points, number), layout.camera, view.flip)
        off = np.linalg.norm(view.project(points) - exact, axis=1).max()
        assert off <= 1.02 * view.pinhole_error_px
        assert off < 0.5 * np.linalg.norm(other.project(points) - exact, axis=1).max()
    assert "at 84 to 168 mm from its virtual centre" in readme(layout, views)
