"""Images in mirrors behind sheets and in bent ones, against rays followed surface by surface and the quickest path."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from mirrorcam.optics.base.values import FloatArray
from mirrorcam.optics.geometry.mirror import Mirror, cut
from mirrorcam.optics.geometry.mirror_arrays import MirrorArrays
from mirrorcam.optics.geometry.mirror_imaging import images
from mirrorcam.optics.geometry.transforms import transform

SQUARE = np.array([[-0.18, -0.15], [0.12, -0.15], [0.12, 0.15], [-0.18, 0.15]])
FOCAL_PX = 1360.38


def mirror(**fields: object) -> Mirror:
    centre = np.array([9.0, -80.0, 84.0])
    return Mirror(virtual_centre_in_rig_mm=centre, outline_in_rig_mm=cut(SQUARE, centre), **fields)


def scene_points(count: int = 60) -> FloatArray:
    """Points (n, 3) that this mirror shows to the camera, 200 to 900 mm away."""
    random = np.random.default_rng(5)
    plain = mirror()
    through = plain.cut(random.uniform(SQUARE.min(axis=0), SQUARE.max(axis=0), (count, 2)))
    rays = through - plain.virtual_centre_in_rig_mm
    return through + rays / np.linalg.norm(rays, axis=1, keepdims=True) * random.uniform(200.0, 900.0, (count, 1))


def height(of: Mirror, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Height (...) of a bent face over its plane, mm, and its upward normals (..., 3), in the mirror's own frame."""
    xx, yy, xy = of.curvature_per_m / 1e3
    normal = np.stack([-(xx * x + xy * y), -(yy * y + xy * x), np.ones_like(x)], axis=-1)
    return 0.5 * xx * x**2 + 0.5 * yy * y**2 + xy * x * y, normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def above(of: Mirror, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far points (n, 3) in the mirror's own frame stand from the coating along its normals, and these (n, 3)."""
    foot = points[:, :2]
    for _ in range(12):
        z, normal = height(of, foot[:, 0], foot[:, 1])
        far = (points[:, 2] - z) / normal[:, 2]
        foot = points[:, :2] - far[:, None] * normal[:, :2]
    return far, normal


def followed(of: Mirror, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where light from the pupil along directions (n, 3) last leaves the mirror, and unit vectors along it, in rig.

    Face by face: Snell's law in vectors at the front, which is as far from the coating everywhere as a sheet that was
    bent leaves it; the law of reflection behind.
    """
    frame = of.rig_from_plane
    at = np.broadcast_to(-frame[:3, 3] @ frame[:3, :3], directions.shape)
    way = directions @ frame[:3, :3] / np.linalg.norm(directions, axis=1, keepdims=True)
    sheet = of.front_mm
    faces = [(sheet, "in"), (0.0, "mirror"), (sheet, "out")] if sheet else [(0.0, "mirror")]
    for lift, what in faces:
        length = (lift - at[:, 2]) / way[:, 2]
        for _ in range(12):
            far, normal = above(of, at + length[:, None] * way)
            length = length - (far - lift) / np.sum(way * normal, axis=1)
        at = at + length[:, None] * way
        normal = above(of, at)[1]
        upright = np.sum(way * normal, axis=1, keepdims=True)
        if what == "mirror":
            way = way - 2.0 * upright * normal
        else:
            ratio = 1.0 / of.refractive_index if what == "in" else of.refractive_index
            along = ratio * (way - upright * normal)
            way = along + np.sign(upright) * np.sqrt(1.0 - np.sum(along**2, axis=1, keepdims=True)) * normal
    return transform(frame, at), way @ frame[:3, :3].T


def missed_px(of: Mirror, points: FloatArray) -> FloatArray:
    """By how many pixels of a C920 the light seen at the images of points (n, 3) passes those points."""
    seen = of.image_of(points)
    leaves, way = followed(of, seen)
    passed = np.linalg.norm(np.cross(points - leaves, way), axis=1)
    return FOCAL_PX * passed / np.linalg.norm(seen, axis=1)


BENDS = {
    "bowl": (0.3, 0.3, 0.0),
    "dome": (-0.3, -0.3, 0.0),
    "saddle": (0.25, -0.2, 0.15),
    "roll": (0.0, 0.35, 0.0),
}


@pytest.mark.parametrize("index", [1.0, 1.49, 1.9])
@pytest.mark.parametrize("thickness_mm", [0.5, 3.0])
def test_light_seen_at_the_image_in_a_flat_sheet_comes_from_the_point(thickness_mm: float, index: float) -> None:
    sheet = mirror(surface="second", thickness_mm=thickness_mm, refractive_index=index)
    assert missed_px(sheet, scene_points()).max() < 1e-8
    assert (missed_px(sheet.replaced(surface="first"), scene_points()) < 1e-8).all()
    if index > 1.0:  # and what a plane mirror in the coating's place would show is elsewhere
        apart = np.cross(sheet.image_of(scene_points()), sheet.reflect(scene_points()))
        assert np.linalg.norm(apart, axis=1).min() > 1.0


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
def test_a_bent_sheet_is_nearly_exact(bend: tuple[float, float, float], thickness_mm: float) -> None:
    """What is neglected, that the front leans where light enters and leaves, grows with the square of the thickness."""
    sheet = mirror(surface="second", thickness_mm=thickness_mm, curvature_per_m=bend)
    assert missed_px(sheet, scene_points()).max() < 1.1e-3 * thickness_mm**2


def test_curvature_sets_in_smoothly() -> None:
    sheet = mirror(surface="second", thickness_mm=2.0)
    barely = sheet.replaced(curvature_per_m=[1e-9, 0.0, 0.0])
    assert_allclose(barely.image_of(scene_points()), sheet.image_of(scene_points()), atol=1e-4)
    plain = mirror()
    assert_allclose(
        plain.replaced(curvature_per_m=[0.0, 1e-9, 0.0]).image_of(scene_points()),
        plain.image_of(scene_points()),
        atol=1e-4,
    )


def test_a_point_behind_a_sheet_or_a_bent_mirror_has_no_image() -> None:
    behind = mirror().virtual_centre_in_rig_mm * np.array([[0.6], [0.9]])
    for kind in (mirror(surface="second"), mirror(curvature_per_m=[0.1, 0.0, 0.0])):
        assert np.isnan(kind.image_of(behind)).all()
        assert np.isfinite(kind.image_of(scene_points(3)[None])).all()


def test_a_mirror_moved_as_a_body_bends_as_before() -> None:
    bent = mirror(curvature_per_m=BENDS["saddle"])
    turn = Rotation.from_rotvec([0.02, -0.03, 0.25]).as_matrix()
    shift = np.array([0.4, -0.3, 0.8])
    moved = bent.moved(turn, shift)
    corners = bent.outline_in_rig_mm
    assert_allclose(moved.sag_mm(moved.outline_in_rig_mm), bent.sag_mm(corners), atol=1e-12)
    assert np.abs(bent.sag_mm(corners)).max() > 0.02
    assert np.abs(moved.curvature_per_m - bent.curvature_per_m).max() > 0.01


def test_a_flat_mirror_is_filed_as_it_was_before_mirrors_could_bend() -> None:
    assert "curvature" not in mirror().model_dump_json()
    bent = mirror(curvature_per_m=BENDS["roll"])
    assert Mirror.model_validate_json(bent.model_dump_json()) == bent


def test_a_bowl_is_no_mirror_of_a_layout() -> None:
    with pytest.raises(
        ValidationError, match=r"curvature_per_m reaches 2, expected a mirror nearly flat: 1\.72 at most"
    ):
        mirror(curvature_per_m=[0.0, -2.0, 0.0])
    strong = mirror(curvature_per_m=[1.7, -1.7, 1.7])
    assert missed_px(strong, scene_points()).max() < 1e-8


KINDS = {
    "plain": (0.0, 0.0, False),
    "sheet": (2.0, 0.0, False),
    "flat, curvature free": (0.0, 0.0, True),
    "bent": (0.0, 0.5, True),
    "bent sheet": (2.0, 0.5, True),
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
