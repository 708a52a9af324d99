"""Devices as built deviate from their design by as much as the tolerances allow, and no more."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.seats import seat_distance_mm
from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.layout import Layout
from mirrorcam.optics.geometry.perturbations import draw_as_built, draw_perturbations, perturbed_camera
from mirrorcam.optics.geometry.sub_images import covers_sensor
from mirrorcam.optics.geometry.tolerances import Tolerances


def test_without_tolerances_it_is_the_design(default_layout: Layout) -> None:
    built = draw_as_built(default_layout, Tolerances.none(), np.random.default_rng(0))
    assert built.kind == "as-built"
    np.testing.assert_array_equal(built.camera.intrinsics, default_layout.camera.intrinsics)
    for mirror, designed in zip(built.mirrors, default_layout.mirrors, strict=True):
        np.testing.assert_allclose(mirror.virtual_centre_in_rig_mm, designed.virtual_centre_in_rig_mm, atol=1e-9)
        np.testing.assert_allclose(mirror.outline_in_rig_mm, designed.outline_in_rig_mm, atol=1e-9)
    assert built.metrics == {}


def test_draws_spread_as_the_tolerances_say(default_layout: Layout) -> None:
    tolerances = Tolerances(tilt_deg=0.3, offset_mm=0.2, focal_percent=1.5, centre_px=6.0)
    random = np.random.default_rng(1)
    tilts, offsets, cameras = [], [], []
    for _ in range(150):
        built = draw_as_built(default_layout, tolerances, random)
        cameras.append(built.camera.intrinsics - default_layout.camera.intrinsics)
        for mirror, designed in zip(built.mirrors, default_layout.mirrors, strict=True):
            in_plane = designed.rig_from_plane[:3, :2].T @ np.cross(designed.normal_in_rig, mirror.normal_in_rig)
            tilts.append(np.degrees(in_plane))
            moved = mirror.outline_in_rig_mm.mean(axis=0) - designed.outline_in_rig_mm.mean(axis=0)
            offsets.append(moved @ designed.normal_in_rig)
            assert np.linalg.norm(moved) == pytest.approx(abs(offsets[-1]), abs=1e-9)
    np.testing.assert_allclose(np.std(tilts, axis=0), 0.3, rtol=0.08)
    np.testing.assert_allclose(np.mean(tilts, axis=0), 0.0, atol=0.03)
    np.testing.assert_allclose(np.std(offsets), 0.2, rtol=0.08)
    camera = np.array(cameras)
    np.testing.assert_array_equal(camera[:, 0], camera[:, 1])  # square pixels stay square
    np.testing.assert_allclose(camera[:, 0].std() / default_layout.camera.fx_px, 0.015, rtol=0.2)
    np.testing.assert_allclose(camera[:, 2:4].std(axis=0), 6.0, rtol=0.2)
    np.testing.assert_allclose(camera[:, 4:].mean(axis=0), [0.05, -0.1, 0.0, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(camera[:, 4:8].std(axis=0), [0.02, 0.03, 5e-4, 5e-4], rtol=0.2)


def test_outlines_move_with_their_mirrors(default_layout: Layout) -> None:
    built = draw_as_built(default_layout, Tolerances(), np.random.default_rng(2))
    for mirror, designed in zip(built.mirrors, default_layout.mirrors, strict=True):
        sides, designed_sides = (
            np.linalg.norm(np.diff(m.outline_in_rig_mm, axis=0, append=m.outline_in_rig_mm[:1]), axis=1)
            for m in (mirror, designed)
        )
        np.testing.assert_allclose(sides, designed_sides, atol=1e-9)


@pytest.mark.parametrize(
    ("tolerances", "named"),
    [
        (Tolerances(tilt_deg=25.0), "tilt_deg 25.0"),
        (Tolerances(offset_mm=200.0), "offset_mm 200.0"),
        (Tolerances.none().replaced(centre_px=1e4), "centre_px 10000.0: mirror"),
        (Tolerances(distortion_mean=(-0.6, 0.0, 0.0, 0.0, 0.0)), "distortion_mean"),
    ],
)
def test_impossible_devices_are_refused_in_one_line(fold_90_layout: Layout, tolerances: Tolerances, named: str) -> None:
    with pytest.raises(InputError, match=named) as error:
        draw_as_built(fold_90_layout, tolerances, np.random.default_rng(0))
    assert "\n" not in str(error.value)


def test_a_lens_that_folds_in_the_outermost_half_pixel_is_drawn_again(default_layout: Layout) -> None:
    coarse = default_layout.replaced(camera=default_layout.camera.binned(0.125))
    first = draw_perturbations(Tolerances(), len(coarse.mirrors), 1, np.random.default_rng(127))
    assert not covers_sensor(perturbed_camera(coarse.camera, first, 0))
    assert covers_sensor(draw_as_built(coarse, Tolerances(), np.random.default_rng(127)).camera)


def test_no_device_is_drawn_around_bent_mirrors(default_layout: Layout) -> None:
    mirrors = list(default_layout.mirrors)
    mirrors[3] = mirrors[3].replaced(curvature_per_m=[0.0, 0.1, 0.0])
    bent = default_layout.replaced(mirrors=tuple(mirrors))
    with pytest.raises(InputError, match=r"^mirror 1-0 has a curvature_per_m, .* flat mirrors"):
        draw_as_built(bent, Tolerances.none(), np.random.default_rng(0))


def test_numbers_are_drawn_in_the_order_of_the_sets_that_exist() -> None:
    """Camera (focal length, centre, lens), then tilts and shift of each mirror; the rest has its own stream."""
    tolerances = Tolerances(sheet_thickness_mm=0.1, camera_offset_mm=0.4, camera_turn_deg=0.6)
    perturbations = draw_perturbations(tolerances, 2, 1, np.random.default_rng(3))
    one_by_one = np.random.default_rng(3)
    assert perturbations.focal[0] == 0.01 * one_by_one.standard_normal()
    np.testing.assert_array_equal(perturbations.centre_px[0], 8.0 * one_by_one.standard_normal(2))
    lens = np.array(tolerances.distortion_sigma) * one_by_one.standard_normal(5)
    np.testing.assert_array_equal(perturbations.lens[0], np.array(tolerances.distortion_mean) + lens)
    for mirror in range(2):
        np.testing.assert_array_equal(
            perturbations.tilts_rad[0, mirror], np.deg2rad(0.3) * one_by_one.standard_normal(2)
        )
        assert perturbations.shifts_mm[0, mirror] == 0.3 * one_by_one.standard_normal()
    placed = np.concatenate([perturbations.thickness_mm / 0.1, perturbations.camera_shifts_mm[0] / 0.4])
    assert not np.isin(placed, np.random.default_rng(3).standard_normal(40)).any()


def test_the_first_devices_do_not_depend_on_how_many_follow() -> None:
    few, many = (draw_perturbations(Tolerances.hobby(), 4, count, np.random.default_rng(0)) for count in (3, 50))
    for name, values in vars(few).items():
        np.testing.assert_array_equal(values, getattr(many, name)[:3])


@pytest.mark.parametrize("surface", ["first", "second"])
def test_the_back_of_a_mirror_stays_on_its_seat(default_layout: Layout, surface: Literal["first", "second"]) -> None:
    designed = default_layout.replaced(mirrors=tuple(m.replaced(surface=surface) for m in default_layout.mirrors))
    tolerances = Tolerances.none().replaced(sheet_thickness_mm=0.1)
    built = draw_as_built(designed, tolerances, np.random.default_rng(4))
    thicker_mm = built.mirrors[0].thickness_mm - designed.mirrors[0].thickness_mm
    assert 0.01 < abs(thicker_mm) < 0.4
    for mirror, before in zip(built.mirrors, designed.mirrors, strict=True):
        assert mirror.thickness_mm - before.thickness_mm == pytest.approx(thicker_mm)  # cut from one sheet
        assert seat_distance_mm(mirror, HARDWARE) == pytest.approx(seat_distance_mm(before, HARDWARE), abs=1e-9)
        nearer_mm = before.distance_mm - mirror.distance_mm
        assert nearer_mm == pytest.approx(thicker_mm if surface == "first" else 0.0, abs=1e-9)


def test_a_camera_out_of_place_sees_the_mirrors_it_was_given_from_there(default_layout: Layout) -> None:
    tolerances = Tolerances.none().replaced(camera_offset_mm=2.0)
    pupil = draw_perturbations(tolerances, 9, 1, np.random.default_rng(5)).camera_shifts_mm[0]
    assert np.linalg.norm(pupil) > 0.5
    built = draw_as_built(default_layout, tolerances, np.random.default_rng(5))
    np.testing.assert_array_equal(built.view_from_rig, default_layout.view_from_rig)
    for mirror, before in zip(built.mirrors, default_layout.mirrors, strict=True):
        np.testing.assert_allclose(mirror.outline_in_rig_mm, before.outline_in_rig_mm - pupil, atol=1e-9)
        # As seen from the pupil, its image in the mirror moves by twice the pupil's shift along the normal.
        normal = before.normal_in_rig
        expected = before.virtual_centre_in_rig_mm - 2.0 * (normal @ pupil) * normal
        np.testing.assert_allclose(mirror.virtual_centre_in_rig_mm, expected, atol=1e-9)


def test_a_turned_camera_sees_everything_turned(default_layout: Layout) -> None:
    tolerances = Tolerances.none().replaced(camera_turn_deg=1.0)
    vector = draw_perturbations(tolerances, 9, 1, np.random.default_rng(6)).camera_rotations_rad[0]
    turn = Rotation.from_rotvec(vector).as_matrix()
    built = draw_as_built(default_layout, tolerances, np.random.default_rng(6))
    expected = default_layout.virtual_centres_in_rig_mm @ turn
    np.testing.assert_allclose(built.virtual_centres_in_rig_mm, expected, atol=1e-9)
    # The view axes stay the holder's, so that the grid of views is the same.
    np.testing.assert_allclose(built.virtual_centres_in_view_mm, default_layout.virtual_centres_in_view_mm, atol=1e-9)
