"""Views as pinholes: their positions, and the plane of zero disparity from their principal points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.camera_array import pinhole_geometry
from mirrorcam.optics.light_field.io.pinholes import centres_in_rig_mm, view_name
from mirrorcam.optics.light_field.light_field import Views
from tests.optics.light_field.depth.surfaces import grid_views


def pinholes_of(views: Views, matrices: Any) -> Views:
    size = (views.width_px, views.height_px)
    geometry = pinhole_geometry(centres_in_rig_mm(views), views.view_from_rig, matrices, size, "a.json")
    return Views(**geometry)


@pytest.mark.parametrize("reference_depth_mm", [375.0, 2000.0, np.inf])
def test_views_are_recovered_from_their_pinholes(reference_depth_mm: float) -> None:
    views = grid_views(2, 3, reference_depth_mm=reference_depth_mm)
    found = pinholes_of(views, views.matrices)
    assert found.reference_depth_mm == pytest.approx(reference_depth_mm)
    assert (found.width_px, found.height_px) == (120, 90)
    for name in ("positions_mm", "centre_px", "focal_px", "reference_view_in_rig_mm", "view_from_rig"):
        np.testing.assert_allclose(getattr(found, name), getattr(views, name), atol=1e-9, err_msg=name)
    np.testing.assert_allclose(found.matrices, views.matrices, atol=1e-9)


def test_centres_are_positions_along_the_axes_of_the_view_frame() -> None:
    views = grid_views(2, 3)
    centres = centres_in_rig_mm(views)
    assert centres[1, 1].tolist() == views.reference_view_in_rig_mm.tolist()
    # Right in the views is right in rig, down is down, and forward is y.
    np.testing.assert_allclose(centres - centres[1, 1], views.positions_mm[..., [0, 2, 1]] * [1.0, 1.0, -1.0])


def test_one_principal_point_means_a_plane_at_infinity() -> None:
    views = grid_views(2, 2)
    same = np.broadcast_to(views.matrices[1, 1], (2, 2, 3, 3))
    assert pinholes_of(views, same).reference_depth_mm == np.inf


def test_pinholes_without_a_common_plane_are_refused() -> None:
    views = grid_views(2, 2)
    moved, stretched, behind = (views.matrices.copy() for _ in range(3))
    moved[0, 0, 0, 2] += 0.5
    stretched[..., 1, 1] += 0.5
    behind[..., :2, 2] = 2.0 * views.centre_px - behind[..., :2, 2]
    behind[..., [0, 1], [0, 1]] = 2.0 * views.focal_px - behind[..., [0, 1], [0, 1]]
    for matrices, reason in (
        (moved, r"off by 0\.3\d+ px"),
        (stretched, r"off by 0\.5 px"),
        (behind, "there is none in front of them"),
    ):
        with pytest.raises(InputError, match=rf"a\.json: views do not share a plane of zero disparity, {reason}"):
            pinholes_of(views, matrices)


def test_names_sort_row_by_row() -> None:
    names = [view_name(t, s) for t, s in np.ndindex(11, 12)]
    assert names[:2] == ["view_00_00", "view_00_01"]
    assert sorted(names) == names
