"""Second-surface mirrors traced by the reference, and the error of modelling them as planes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.mirror import reflect
from mirrorcam.render_scenes.fast.analytic_scene import FastScene
from mirrorcam.render_scenes.reference.board_scene import BoardScene
from mirrorcam.render_scenes.reference.integrator import CLEARANCE_MM
from mirrorcam.render_scenes.reference.mirror_shapes import mesh
from mirrorcam.render_scenes.settings import SENSORS, RenderSettings
from mirrorcam.render_scenes.truth.corners import CornerProjector
from mirrorcam.render_scenes.truth.light_rays import trace_via_mirror
from mirrorcam.render_scenes.truth.pixel_maps import board_maps, pixel_rays
from mirrorcam.render_scenes.variant import SCALAR, use_variant
from tests.render_scenes.corners import TARGET, errors_by_mirror, photographed, tilted_board, windows

FAST = RenderSettings(renderer="fast", sensor=SENSORS["ideal"])
REFERENCE = RenderSettings(sensor=SENSORS["ideal"])
CUT = FAST.subpixels
SEEN = (0, 7)

Pictures = dict[int, NDArray[np.float32]]


@pytest.fixture(scope="module")
def pose(plates: Layout) -> FloatArray:
    return tilted_board(plates)


@pytest.fixture(scope="module")
def traced(plates: Layout, pose: FloatArray) -> Pictures:
    """The windows of some plates of 2 mm acrylic by the reference."""
    scene = BoardScene(plates.camera, plates.mirrors, TARGET, REFERENCE)
    scene.place_board(pose)
    return {i: scene.render(spp=32, seed=1, subpixels=CUT, crop=windows(plates)[i]) for i in SEEN}


@pytest.fixture(scope="module")
def computed(plates: Layout, pose: FloatArray) -> Pictures:
    """The same by formula, each on a sensor of the window's size."""
    pictures = {}
    for index in SEEN:
        x, y, width, height = windows(plates)[index]
        camera = plates.camera.replaced(
            width_px=width, height_px=height, cx_px=plates.camera.cx_px - x, cy_px=plates.camera.cy_px - y
        )
        scene = FastScene(camera, (plates.mirrors[index],), TARGET, FAST)
        scene.place_board(pose)
        pictures[index] = scene.render()
    return pictures


def test_plates_look_the_same_by_both_renderers(
    plates: Layout, pose: FloatArray, traced: Pictures, computed: Pictures
) -> None:
    """Refraction, Fresnel's losses and the ghosts: flat areas to 0.5 %, corners to 0.02 px."""
    crops, errors = windows(plates), []
    for index in SEEN:
        window, kernel = computed[index], np.ones((3, 3))
        flat = cv2.dilate(window, kernel) - cv2.erode(window, kernel) < 2e-4
        assert flat.mean() > 0.4, index
        np.testing.assert_allclose(traced[index][flat], window[flat], rtol=0.005)
    for pictures in (traced, computed):
        found = {index: photographed(picture, CUT) for index, picture in pictures.items()}
        errors.append(errors_by_mirror(found, crops, plates, pose, misfit_allowed=0.05))
    for index in SEEN:
        assert len(errors[0][index]) >= 6
        assert np.abs(errors[0][index] - errors[1][index]).max() <= 0.02, index


def test_the_maps_tell_where_the_traced_light_left_the_board(plates: Layout, pose: FloatArray) -> None:
    """From face to face by Mitsuba's own intersections and BSDFs: the board's place in every pixel, to 1 um."""
    scene = BoardScene(plates.camera, plates.mirrors, TARGET, REFERENCE)
    scene.place_board(pose)
    import mitsuba as mi

    step = 8
    truth = board_maps(pixel_rays(plates, mirrors=True, step=step), TARGET, pose)
    y, x = np.nonzero(np.isfinite(truth["board.x"]))
    assert len(x) > 5000
    ray = scene.sensor.ray_through(mi.Float(x * step + 0.5), mi.Float(y * step + 0.5))
    hit = scene.scene.ray_intersect(mi.Ray3f(ray))
    travelled = np.array(hit.t)
    for lot in (2.0, 0.0, 2.0):  # through the front, off the coating, through the front
        sample, _ = hit.bsdf().sample(mi.BSDFContext(), hit, lot, mi.Point2f(0.5))
        direction = hit.to_world(sample.wo)
        hit = scene.scene.ray_intersect(mi.Ray3f(hit.p + CLEARANCE_MM * direction, direction))
        travelled += np.array(hit.t) + CLEARANCE_MM
    at = (np.array(hit.p).T - pose[:3, 3]) @ pose[:3, :3]
    inside = np.abs(at[:, 2]) < 1e-3  # light that meets an edge of a plate has not come to the board
    assert inside.mean() > 0.99
    for name, found in (("board.x", at[:, 0]), ("board.y", at[:, 1]), ("path", travelled)):
        np.testing.assert_allclose(found[inside], truth[name][y, x][inside], atol=1e-3, err_msg=name)


def test_corners_of_the_truth_lie_where_the_maps_see_them(plates: Layout, pose: FloatArray) -> None:
    """The traced ray of a corner's solved pixel passes through the plate and ends at the corner."""
    projector = CornerProjector(plates, TARGET)
    px, visible = projector.via_mirrors(pose)
    assert visible.sum() > 300
    board_from_rig = pose[:3, :3].T
    for index, mirror in enumerate(plates.mirrors):
        rays = plates.camera.unproject(px[index][visible[index]])
        _, start, direction, _ = trace_via_mirror(mirror, rays / np.linalg.norm(rays, axis=1, keepdims=True))
        start, direction = (start - pose[:3, 3]) @ board_from_rig.T, direction @ board_from_rig.T
        at = start[:, :2] - direction[:, :2] * (start[:, 2] / direction[:, 2])[:, None]
        np.testing.assert_allclose(at, TARGET.corners_in_board_mm[visible[index]][:, :2], atol=1e-5)
    # A part of a plate that light enters but does not leave is black.
    planes = plates.replaced(mirrors=tuple(mirror.apparent for mirror in plates.mirrors))
    assert visible.sum() < CornerProjector(planes, TARGET).via_mirrors(pose)[1].sum()


def plane_residuals(layout: Layout, index: int, *depths_mm: float) -> FloatArray:
    """Pixels (n, 2) by which the best-fitting plane misses points that fill a sub-image, at some depths."""
    mirror, camera = layout.mirrors[index], layout.camera
    low, high = mirror.usable_normalized.min(axis=0), mirror.usable_normalized.max(axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, 9).T, [1.0]), axis=-1).reshape(-1, 3)
    _, start, direction, _ = trace_via_mirror(mirror, grid / np.linalg.norm(grid, axis=1, keepdims=True))
    start, direction = (
        values[np.isfinite(start).all(axis=1)] @ layout.view_from_rig.T for values in (start, direction)
    )
    depths = np.array(depths_mm)[:, None, None]
    points = (start + direction * ((depths - start[:, 2:]) / direction[:, 2:])).reshape(-1, 3) @ layout.view_from_rig
    truth = camera.project(mirror.image_of(points))
    assert np.isfinite(truth).all()

    def missed(virtual_centre: FloatArray) -> FloatArray:
        return np.asarray((camera.project(reflect(points, virtual_centre)) - truth).ravel())

    found = least_squares(missed, mirror.apparent.virtual_centre_in_rig_mm, method="lm", xtol=1e-15, ftol=1e-15)
    return np.asarray(found.fun.reshape(-1, 2))


def test_a_plane_is_not_a_plate(plates: Layout) -> None:
    """The residual of 2 mm of acrylic after calibration with plane mirrors: a tenth of a pixel and more."""

    def rms(layout: Layout, *depths_mm: float) -> list[float]:
        return [float(np.sqrt(np.mean(plane_residuals(layout, index, *depths_mm) ** 2))) for index in range(9)]

    at_one, at_two = rms(plates, 450.0), rms(plates, 300.0, 500.0)
    assert min(at_one) > 0.05
    assert max(at_one) < 0.2
    assert np.median(at_one) == pytest.approx(0.14, abs=0.02)
    assert min(at_two) > 0.08
    assert max(at_two) < 0.3
    # The plate causes it: thin ones act as planes.
    thin = plates.replaced(mirrors=tuple(mirror.replaced(thickness_mm=0.02) for mirror in plates.mirrors))
    assert max(rms(thin, 300.0, 500.0)) < 0.004


def test_corners_traced_through_a_sheet_are_not_a_planes(plates: Layout, pose: FloatArray, traced: Pictures) -> None:
    """Rendered corners are where the exact projection puts them (ghosts pull a little), not the plane's."""
    crops, found = windows(plates), {index: photographed(picture, CUT) for index, picture in traced.items()}
    planes = plates.replaced(mirrors=tuple(mirror.apparent for mirror in plates.mirrors))
    by_sheet, by_plane = (
        errors_by_mirror(found, crops, layout, pose, misfit_allowed=0.05) for layout in (plates, planes)
    )
    for index in SEEN:
        assert np.sqrt(np.mean(by_sheet[index] ** 2)) < 0.02, index
        assert by_sheet[index].std(axis=0).max() < 0.01, index
        assert by_plane[index].std(axis=0).max() > 0.04, index


def test_the_scalar_variant_traces_plates_alike(plates: Layout, pose: FloatArray) -> None:
    x, y, width, height = windows(plates)[0]
    pictures = []
    for variant in (None, SCALAR):
        scene = BoardScene(plates.camera, plates.mirrors[:1], TARGET, REFERENCE, variant=variant)
        scene.place_board(pose)
        pictures.append(scene.render(spp=2, seed=1, crop=(x + width // 2, y + height // 2, 36, 10)))
    assert np.ptp(pictures[0]) > 0.5
    np.testing.assert_allclose(pictures[1], pictures[0], atol=1e-4)


def test_a_mesh_carries_the_places_of_its_corners_in_a_texture() -> None:
    use_variant(SCALAR)
    import mitsuba as mi

    corners = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    places = np.array([[0.5, 1.0], [2.5, 1.0], [0.5, 3.0]])
    grey = {"type": "diffuse"}
    shape = mesh("sheet", corners, np.array([[0, 1, 2]]), grey, texture_uv=places)
    scene = mi.load_dict({"type": "scene", "shape": shape})
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(1.0, 0.5, 9.0), mi.Vector3f(0.0, 0.0, -1.0)))
    np.testing.assert_allclose(np.array(hit.uv).ravel(), [1.0, 1.5], atol=1e-6)
