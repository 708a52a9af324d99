"""Images in bent mirrors against rays followed surface by surface and the shortest path."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from mirrorcam.core.values import FloatArray, InvalidValue
from tests.optics.geometry.followed_rays import (
    BENDS,
    FOCAL_PX,
    height,
    mirror,
    missed_px,
    scene_points,
)


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_light_seen_at_the_image_in_a_bent_mirror_comes_from_the_point(bend: tuple[float, float, float]) -> None:
    bent = mirror(curvature_per_m=bend)
    assert missed_px(bent, scene_points()).max() < 1e-8
    # The bend is worth modelling: a plane is off by pixels.
    points = scene_points()
    plane = mirror().image_of(points)
    seen = bent.image_of(points)
    apart = FOCAL_PX * np.abs(plane[:, :2] / plane[:, 2:] - seen[:, :2] / seen[:, 2:])
    assert apart.max() > 3.0


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_light_by_way_of_a_bent_mirror_takes_the_quickest_path(bend: tuple[float, float, float]) -> None:
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
        # The path is flat to first order where it is shortest: 1e-5 mm is what rounding of the lengths leaves.
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
    with pytest.raises(InvalidValue, match=r"curvature_per_m reaches 2, expected a mirror nearly flat: 1\.72 at most"):
        mirror(curvature_per_m=[0.0, -2.0, 0.0])
    strong = mirror(curvature_per_m=[1.7, -1.7, 1.7])
    assert missed_px(strong, scene_points()).max() < 1e-8
