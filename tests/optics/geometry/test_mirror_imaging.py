"""Images in mirrors of all kinds: where there is none, and their derivatives against finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.mirror_arrays import MirrorArrays
from mirrorcam.optics.geometry.mirror_imaging import images
from tests.optics.geometry.followed_rays import (
    mirror,
    scene_points,
)


def test_a_point_behind_a_second_surface_or_a_bent_mirror_has_no_image() -> None:
    behind = mirror().virtual_centre_in_rig_mm * np.array([[0.6], [0.9]])
    for kind in (mirror(surface="second"), mirror(curvature_per_m=[0.1, 0.0, 0.0])):
        assert np.isnan(kind.image_of(behind)).all()
        assert np.isfinite(kind.image_of(scene_points(3)[None])).all()


KINDS = {
    "plain": (0.0, 0.0, False),
    "plate": (2.0, 0.0, False),
    "flat, curvature free": (0.0, 0.0, True),
    "bent": (0.0, 0.5, True),
    "bent plate": (2.0, 0.5, True),
}


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_agree_with_finite_differences(kind: str) -> None:
    thickness, bend, bent = KINDS[kind]
    random = np.random.default_rng(2)
    points = scene_points(7).T
    centre = np.array([[9.0], [-80.0], [84.0]]) + random.normal(0, 6.0, (3, 7))
    at = {
        "point": points,
        "centre_mm": centre,
        "middle_mm": centre / 2 + random.normal(0, 5.0, (3, 7)),
        "thickness_mm": np.full(7, thickness),
        "refractive_index": np.full(7, 1.49),
        "curvature_per_m": bend * random.normal(size=(3, 7)),
    }
    rows = random.normal(size=(2, 3, 7))

    def value(changed: dict[str, FloatArray]) -> FloatArray:
        mirrors = MirrorArrays(**{name: array for name, array in changed.items() if name != "point"})
        return np.einsum("akn,kn->an", rows, images(changed["point"], mirrors, bent=bent).image_mm)

    def difference(name: str, direction: FloatArray, h: float = 1e-4) -> FloatArray:
        ahead, back = (value(at | {name: at[name] + sign * h * direction}) for sign in (1, -1))
        return (ahead - back) / (2 * h)

    mirrors = MirrorArrays(**{name: array for name, array in at.items() if name != "point"})
    found = images(points, mirrors, bent=bent).vjp(rows)
    checked: dict[str, Callable[[], FloatArray]] = {"point": lambda: found.point, "centre_mm": lambda: found.centre}
    if bent:
        checked["curvature_per_m"] = lambda: found.curvature
    for name, of in checked.items():
        for axis in range(3):
            expected = difference(name, np.eye(3)[:, axis : axis + 1] * np.ones(7))
            assert_allclose(of()[:, axis], expected, atol=1e-7 * np.abs(expected).max(), err_msg=f"{name} {axis}")
    if thickness:
        expected = difference("thickness_mm", np.ones(7))
        assert_allclose(found.thickness, expected, atol=1e-7 * np.abs(expected).max())
