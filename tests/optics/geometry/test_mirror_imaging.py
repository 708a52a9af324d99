"""Images in mirrors of all kinds: missing images, and derivatives against finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from mirrorcam.core.values import FloatArray, InvalidValue
from mirrorcam.optics.geometry.mirror_arrays import MirrorArrays
from mirrorcam.optics.geometry.mirror_imaging import images
from tests.optics.geometry.followed_rays import (
    BENDS,
    FOCAL_PX,
    height,
    mirror,
    missed_px,
    scene_points,
)

KINDS = {
    "plain": (0.0, 0.0, False),
    "plate": (2.0, 0.0, False),
    "flat, curvature free": (0.0, 0.0, True),
    "bent": (0.0, 0.5, True),
    "bent plate": (2.0, 0.5, True),
}


def test_a_point_behind_a_second_surface_or_a_bent_mirror_has_no_image() -> None:
    behind = mirror().virtual_centre_in_rig_mm * np.array([[0.6], [0.9]])
    for kind in (mirror(surface="second"), mirror(curvature_per_m=[0.1, 0.0, 0.0])):
        assert np.isnan(kind.image_of(behind)).all()
        assert np.isfinite(kind.image_of(scene_points(3)[None])).all()


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_agree_with_finite_differences(kind: str) -> None:
    thickness, bend, bent = KINDS[kind]
    random = np.random.default_rng(2)
    points = scene_points(7).T
    centre = np.array([[9.0], [-80.0], [84.0]]) + random.normal(0, 6.0, (3, 7))
    at = {
        "point": points,
        "centre_mm": centre,
        "centroid_mm": centre / 2 + random.normal(0, 5.0, (3, 7)),
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


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_light_seen_at_the_image_in_a_bent_mirror_comes_from_the_point(bend: tuple[float, float, float]) -> None:
    bent = mirror(curvature_per_m=bend)
    assert missed_px(bent, scene_points()).max() < 1e-8
    # The curvature matters: a plane has errors of pixels.
    points = scene_points()
    plane = mirror().image_of(points)
    seen = bent.image_of(points)
    apart = FOCAL_PX * np.abs(plane[:, :2] / plane[:, 2:] - seen[:, :2] / seen[:, 2:])
    assert apart.max() > 3.0


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_light_reflected_by_a_bent_mirror_takes_the_shortest_optical_path(bend: tuple[float, float, float]) -> None:
    bent = mirror(curvature_per_m=bend)
    frame = bent.rig_from_plane

    def surface(at: FloatArray) -> FloatArray:
        return np.asarray(frame[:3, :3] @ [*at, float(height(bent, at[:1], at[1:])[0][0])] + frame[:3, 3])

    for point in scene_points(8):

        def length(at: FloatArray, point: FloatArray = point) -> float:
            return float(np.linalg.norm(surface(at)) + np.linalg.norm(point - surface(at)))

        found = minimize(length, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-14})
        ray = surface(found.x) / np.linalg.norm(surface(found.x))
        seen = bent.image_of(point)
        # The optical path is stationary at its minimum: rounding of the lengths leaves 1e-5 mm.
        assert np.linalg.norm(np.cross(ray, seen / np.linalg.norm(seen))) * np.linalg.norm(surface(found.x)) < 1e-5


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
@pytest.mark.parametrize("thickness_mm", [1.0, 2.0, 3.0])
def test_a_bent_plate_is_nearly_exact(bend: tuple[float, float, float], thickness_mm: float) -> None:
    """The neglected tilt of the front causes errors that grow with the square of the thickness."""
    plate = mirror(surface="second", thickness_mm=thickness_mm, curvature_per_m=bend)
    assert missed_px(plate, scene_points()).max() < 1.1e-3 * thickness_mm**2


def test_curvature_sets_in_smoothly() -> None:
    plate = mirror(surface="second", thickness_mm=2.0)
    barely = plate.replaced(curvature_per_m=[1e-9, 0.0, 0.0])
    assert_allclose(barely.image_of(scene_points()), plate.image_of(scene_points()), atol=1e-4)
    plain = mirror()
    assert_allclose(
        plain.replaced(curvature_per_m=[0.0, 1e-9, 0.0]).image_of(scene_points()),
        plain.image_of(scene_points()),
        atol=1e-4,
    )


def test_a_bowl_is_no_mirror_of_a_layout() -> None:
    with pytest.raises(InvalidValue, match=r"curvature_per_m reaches 2, expected a nearly flat mirror: at most 1\.72"):
        mirror(curvature_per_m=[0.0, -2.0, 0.0])
    strong = mirror(curvature_per_m=[1.7, -1.7, 1.7])
    assert missed_px(strong, scene_points()).max() < 1e-8
