"""Differences of calibrations against closed forms, and their predicted sigmas against fits with other noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import FloatArray
from mirrorcam.optics.calibration.diagnostics.calibration_difference import (
    CalibrationDifference,
    best_motion,
    calibration_difference,
    motion_jacobian,
    remove_motion,
    view_label,
    view_weights,
)
from mirrorcam.optics.calibration.diagnostics.calibration_result import tilted_to
from mirrorcam.optics.calibration.solver.levenberg_marquardt import fit
from mirrorcam.optics.calibration.solver.observations import DIRECT
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.layout import Layout, Uncertainty
from mirrorcam.optics.geometry.lenses.families import LensName
from mirrorcam.optics.geometry.mirror import Mirror
from mirrorcam.optics.geometry.nearest_lens import nearest_lens
from mirrorcam.optics.geometry.transforms import rigid, transform
from tests.optics.calibration.diagnostics.conftest import JOINT, Scene

RANGE_MM = 420.0
PINHOLE = Camera(width_px=800, height_px=600, fx_px=900.0, fy_px=900.0, cx_px=399.5, cy_px=299.5)
FOCAL_PX = 600.0
CENTRES = np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0], [0.0, 60.0, 0.0], [60.0, 60.0, 5.0]])


@pytest.fixture(scope="module")
def refitted(scene: Scene, calibrated: Layout) -> list[Layout]:
    """Return the calibration, and others from the same boards with different noise."""
    return [calibrated, *(scene.calibrated(fit(scene.start, scene.noisy(seed), JOINT)) for seed in range(1, 8))]


def mirrors_about(line: FloatArray, turns_deg: tuple[float, ...], lefts: tuple[float, ...]) -> tuple[Mirror, ...]:
    """Return mirrors whose planes share a line along y through the point (3,), cut along image coordinates."""
    mirrors = []
    for turn, left in zip(turns_deg, lefts, strict=True):
        normal = Rotation.from_euler("y", turn, degrees=True).as_matrix() @ [0.0, 0.0, -1.0]
        rays = np.array([[left, -0.1, 1], [left + 0.15, -0.1, 1], [left + 0.15, 0.1, 1], [left, 0.1, 1]])
        mirrors.append(
            Mirror.from_plane(line, normal, outline_in_rig_mm=rays * (line @ normal / (rays @ normal))[:, None])
        )
    return tuple(mirrors)


def lengths_px(difference: CalibrationDifference) -> list[float]:
    return [float(view.length_px.max()) for view in difference.views]


def test_a_calibration_does_not_differ_from_itself(calibrated: Layout) -> None:
    found = calibration_difference(calibrated, calibrated, range_mm=RANGE_MM)
    assert [view.view for view in found.views] == [0, 1, 2, 3]
    assert max(lengths_px(found)) < 1e-9
    np.testing.assert_allclose(found.b_from_a, np.eye(4), atol=1e-9)
    assert found.metrics(found.views)["sigma_px"].value > 0.0


@pytest.mark.parametrize("turn_deg", [0.3, 4.0])
def test_mirrors_rotated_about_their_common_line_rotate_the_scene_by_twice_the_angle(turn_deg: float) -> None:
    """Two reflections in planes that meet at an angle are a rotation by twice that angle about their line."""
    line, lefts = np.array([0.0, 0.0, 100.0]), (-0.17, 0.02)
    a, b = (
        Layout(rows=1, cols=2, camera=PINHOLE, mirrors=mirrors_about(line, turns, lefts))
        for turns in ((-20.0, 20.0), (-20.0 + turn_deg, 20.0 + turn_deg))
    )
    found = calibration_difference(a, b, range_mm=RANGE_MM)
    assert max(lengths_px(found)) < 1e-6
    np.testing.assert_allclose(found.rotation_deg, [0.0, 2.0 * turn_deg, 0.0], atol=1e-7)
    np.testing.assert_allclose(found.b_from_a @ [*line, 1.0], [*line, 1.0], atol=1e-5)
    assert found.motion["motion_turn_deg"].value == pytest.approx(2.0 * turn_deg)


def test_a_tilted_mirror_differs_in_its_own_view_alone(parabola_layout: Layout) -> None:
    tilt_deg, tilted = 0.1, 4
    nominal = parabola_layout.replaced(kind="as-built")
    mirror = nominal.mirrors[tilted]
    middle = mirror.outline_in_rig_mm.mean(axis=0)
    turn = Rotation.from_euler("x", tilt_deg, degrees=True).as_matrix()  # within the plane of incidence
    normal = turn @ mirror.normal_in_rig
    tilted_mirror = tilted_to(mirror, 2.0 * (middle @ normal) * normal)
    mirrors = (*nominal.mirrors[:tilted], tilted_mirror, *nominal.mirrors[tilted + 1 :])
    found = calibration_difference(nominal, nominal.replaced(mirrors=mirrors), range_mm=RANGE_MM)
    assert max(np.delete(lengths_px(found), tilted)) < 1e-4
    np.testing.assert_allclose(found.b_from_a, np.eye(4), atol=1e-5)
    # Computed here: points on the mirror's rays, reflected in the tilted plane, through a pinhole.
    seen = found.views[tilted]
    camera = nominal.camera
    rays = np.column_stack([(seen.pixels - [camera.cx_px, camera.cy_px]) / camera.fx_px, np.ones(len(seen.pixels))])
    images = RANGE_MM * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    points = images - 2.0 * np.outer((images - middle) @ mirror.normal_in_rig, mirror.normal_in_rig)
    x, y, z = (points - 2.0 * np.outer((points - middle) @ normal, normal)).T
    expected = camera.fx_px * np.column_stack([x / z, y / z]) + [camera.cx_px, camera.cy_px] - seen.pixels
    np.testing.assert_allclose(seen.difference_px, expected, atol=1e-3)
    # A ray rotates by twice the tilt, about the mirror, which is nearer to the point than the camera.
    arm = 1.0 - np.linalg.norm(middle) / RANGE_MM
    assert seen.length_px.mean() == pytest.approx(2.0 * camera.fx_px * np.tan(np.radians(tilt_deg)) * arm, rel=0.1)
    assert seen.difference_mm.mean() == pytest.approx(seen.length_px.mean() * RANGE_MM / camera.fx_px, rel=0.1)


def test_fits_of_one_truth_differ_by_as_much_as_predicted(refitted: list[Layout]) -> None:
    pairs = zip(refitted[::2], refitted[1::2], strict=True)
    found = [calibration_difference(a, b, range_mm=RANGE_MM) for a, b in pairs]
    ratios = np.array([each.metrics(each.views)["ratio"].value for each in found])
    assert 0.6 < np.sqrt(np.mean(ratios**2)) < 1.5
    assert ((ratios > 0.4) & (ratios < 2.5)).all()


def test_the_truth_differs_by_as_much_as_predicted_for_one(refitted: list[Layout], scene: Scene) -> None:
    found = [calibration_difference(scene.truth, each, range_mm=RANGE_MM) for each in refitted]
    assert {each.predicted for each in found} == {(False, True)}
    mean_square = np.mean([each.metrics(each.views)["ratio"].value ** 2 for each in found])
    assert 0.6 < np.sqrt(mean_square) < 1.5


def test_predicted_sigmas_match_the_scatter_of_fits(refitted: list[Layout], scene: Scene) -> None:
    """Each view's predicted sigma, in px and mm, matches the scatter within the error of eight fits."""
    found = [calibration_difference(scene.truth, each, range_mm=RANGE_MM) for each in refitted]
    for view in range(4):
        figures = [each.metrics([each.views[view]]) for each in found]
        for unit in ("px", "mm"):
            scatter = np.sqrt(np.mean([each[f"rms_{unit}"].value ** 2 for each in figures]))
            assert scatter == pytest.approx(figures[0][f"sigma_{unit}"].value, rel=0.5)


def test_without_a_covariance_nothing_is_predicted(device: Layout) -> None:
    found = calibration_difference(device, device, range_mm=RANGE_MM)
    assert found.predicted == (False, False)
    assert set(found.metrics(found.views)) == {"rms_px", "max_px", "rms_mm", "max_mm"}


@pytest.mark.parametrize("lens", ["rational", "thin_prism", "fisheye", "spline"])
def test_a_lens_of_any_family_is_compared(lens: LensName, calibrated: Layout) -> None:
    camera, _ = nearest_lens(calibrated.camera, lens)
    names = camera.intrinsic_names
    known = Uncertainty(parameters=names, covariance=np.diag([0.01, *np.zeros(len(names) - 1)]))
    found = calibration_difference(calibrated, calibrated.replaced(camera=camera, uncertainty=known), range_mm=RANGE_MM)
    assert max(lengths_px(found)) < 2.0
    alone = calibration_difference(calibrated.replaced(uncertainty=None), calibrated, range_mm=RANGE_MM)
    assert found.metrics(found.views)["sigma_px"].value > alone.metrics(alone.views)["sigma_px"].value


def test_views_along_the_cameras_axis_are_compared_with_the_direct_view(small_pair: Layout) -> None:
    direct = small_pair.replaced(view_from_rig=np.eye(3))
    longer = direct.camera.replaced(fx_px=909.0, fy_px=909.0)
    found = calibration_difference(direct, direct.replaced(camera=longer), range_mm=RANGE_MM)
    assert [view.view for view in found.views] == [0, 1, DIRECT]
    assert [view_label(direct, view.view) for view in found.views] == ["mirror 0-0", "mirror 0-1", "direct view"]


@pytest.fixture
def small_pair() -> Layout:
    """Two mirrors of a pinhole."""
    mirrors = mirrors_about(np.array([0.0, 0.0, 100.0]), (-20.0, 20.0), (-0.17, 0.02))
    return Layout(rows=1, cols=2, camera=PINHOLE, mirrors=mirrors)


def test_other_devices_are_refused(small_pair: Layout, parabola_layout: Layout) -> None:
    smaller = small_pair.replaced(camera=PINHOLE.replaced(width_px=640))
    with pytest.raises(InputError, match="the second layout's pictures are 640x600 px, expected 800x600 px"):
        calibration_difference(small_pair, smaller, range_mm=RANGE_MM)
    single = small_pair.replaced(cols=1, mirrors=small_pair.mirrors[:1])
    with pytest.raises(InputError, match="the second layout has 1 x 1 mirrors, expected 1 x 2"):
        calibration_difference(small_pair, single, range_mm=RANGE_MM)
    known = Uncertainty(parameters=("fx_px", "zoom"), covariance=np.eye(2))
    with pytest.raises(InputError, match="the second layout's covariance has the parameter 'zoom', expected those of"):
        calibration_difference(small_pair, small_pair.replaced(uncertainty=known), range_mm=RANGE_MM)
    exchanged = small_pair.replaced(mirrors=small_pair.mirrors[::-1])
    with pytest.raises(InputError, match=r"mirror 0-0 is at pixel \(.*expected two calibrations of one device"):
        calibration_difference(small_pair, exchanged, range_mm=RANGE_MM)


def test_points_behind_a_mirror_are_left_out_and_a_view_without_any_is_refused(small_pair: Layout) -> None:
    nearer = calibration_difference(small_pair, small_pair, range_mm=97.0)  # the mirrors are 94 to 100 mm away
    assert (
        0
        < len(nearer.views[0].pixels)
        < len(calibration_difference(small_pair, small_pair, range_mm=RANGE_MM).views[0].pixels)
    )
    with pytest.raises(InputError, match="mirror 0-0 shows nothing 80 mm away in both layouts"):
        calibration_difference(small_pair, small_pair, range_mm=80.0)


def project(points: FloatArray, centres: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pixels of pinholes that look along z, and their derivatives by the points."""
    x, y, z = (points - centres).T
    slopes = np.zeros((len(points), 2, 3))
    slopes[:, 0, 0] = slopes[:, 1, 1] = FOCAL_PX / z
    slopes[:, 0, 2], slopes[:, 1, 2] = -FOCAL_PX * x / z**2, -FOCAL_PX * y / z**2
    return FOCAL_PX * np.column_stack([x / z, y / z]), slopes


def rig_points() -> tuple[np.ndarray, FloatArray]:
    """Views (n,) and points (n, 3)."""
    random = np.random.default_rng(3)
    view = np.repeat(np.arange(4), 40)
    return view, random.uniform([-80.0, -80.0, 300.0], [140.0, 140.0, 500.0], (160, 3))


@pytest.mark.parametrize(("scale", "scaled"), [(1.0, False), (1.0, True), (1.3, True)])
def test_a_motion_is_found(scale: float, scaled: bool) -> None:
    view, points = rig_points()
    b_from_a = rigid(scale * Rotation.from_rotvec([0.05, -0.1, 0.2]).as_matrix(), [20.0, -10.0, 30.0])
    a_from_b = np.asarray(np.linalg.inv(b_from_a), dtype=np.float64)
    shown, _ = project(points, CENTRES[view])

    def project_in_b(points_in_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        pixels, slopes = project(transform(a_from_b, points_in_b), CENTRES[view])
        return pixels, slopes @ a_from_b[:3, :3]

    found, weights = best_motion(shown, view, points, project_in_b, np.eye(4), scaled=scaled)
    np.testing.assert_allclose(found, b_from_a, atol=1e-8)
    assert weights.min() > 0.99


def test_one_bad_view_hardly_changes_the_motion() -> None:
    view, points = rig_points()
    shown, _ = project(points, CENTRES[view])
    shown += np.random.default_rng(0).normal(0.0, 0.01, shown.shape)
    shown[view == 2] += [3.0, -2.0]
    found, weights = best_motion(shown, view, points, lambda at: project(at, CENTRES[view]), np.eye(4))
    np.testing.assert_allclose(found, np.eye(4), atol=0.01)
    assert weights[view == 2].max() < 1e-4 < 0.1 < weights[view != 2].min()


def test_points_that_b_does_not_show_are_left_out() -> None:
    view, points = rig_points()
    shown, _ = project(points, CENTRES[view])

    def partly(points_in_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        pixels, slopes = project(points_in_b, CENTRES[view])
        pixels[::5] = np.nan
        return pixels, slopes

    start = rigid(np.eye(3), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(best_motion(shown, view, points, partly, start)[0], np.eye(4), atol=1e-7)


def test_columns_are_the_derivatives_by_the_motion() -> None:
    view, points = rig_points()
    middle, lever = points.mean(axis=0), 250.0
    _, slopes = project(points, CENTRES[view])
    columns = motion_jacobian(slopes, points, lever, scaled=True)
    for k in range(7):
        step = 1e-4
        shown = []
        for sign in (1.0, -1.0):
            d = sign * step * np.eye(7)[k]
            turn = np.exp(d[6] / lever) * Rotation.from_rotvec(d[:3] / lever).as_matrix()
            shown.append(project((points - middle) @ turn.T + middle + d[3:6], CENTRES[view])[0])
        np.testing.assert_allclose(columns[:, :, k], (shown[0] - shown[1]) / (2.0 * step), atol=1e-6)


def test_without_a_motion_differences_are_zero() -> None:
    view, points = rig_points()
    columns = motion_jacobian(project(points, CENTRES[view])[1], points, 250.0)
    weights = np.random.default_rng(1).uniform(0.5, 1.0, len(points))
    mixed = columns @ np.random.default_rng(2).normal(size=(6, 3))
    np.testing.assert_allclose(remove_motion(mixed, columns, weights), 0.0, atol=1e-9)


def test_weights_of_equal_views_are_one() -> None:
    view = np.repeat(np.arange(3), 5)
    np.testing.assert_allclose(view_weights(np.zeros((15, 2)), view), 1.0)
