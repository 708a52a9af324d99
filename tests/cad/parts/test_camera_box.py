"""The nest: forces in equilibrium, a leaf against a beam in closed form, and motion by its definition.

A camera's body in the rig frame: the pupil at the origin.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.parts.camera_box import (
    CONTACT_TURNS,
    LEAF_TOLERANCE_MM,
    TURN_ERROR,
    Leaf,
    Nest,
    body_box,
    error_jacobian,
    min_contact_n,
    reactions,
    required_forces_n,
    wrenches,
)
from mirrorcam.cad.parts.clip import plan_clip
from mirrorcam.cad.plan.dimension import GENERAL_MM
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.camera_library import camera_names, read_body

MPA = 2300.0
MIDDLE = np.array([1.0, 2.0, -8.0])


@pytest.fixture
def nest() -> Nest:
    found = plan_clip(HARDWARE).nest
    assert found is not None
    return found


def test_a_leaf_bends_by_the_integrated_beam_equation() -> None:
    """Bent by a load at its end: curvature F (l - x) / (E I) up to its stiff part, integrated twice."""
    leaf = Leaf(30.0, 8.0, 20.0, 2.5, 1.0, 0.5, root=0.0)
    force = leaf.force_n(MPA)
    x = np.linspace(0.0, 30.0, 300_001)
    curvature = np.where(x < 22.0, force * (30.0 - x) / (MPA * 20.0 * 2.5**3 / 12.0), 0.0)
    step = x[1]
    slope = np.cumsum(curvature) * step
    assert float(np.sum(slope) * step) == pytest.approx(CONTACT_TURNS * leaf.pitch_mm, rel=1e-3)
    assert curvature[0] * 2.5 / 2.0 == pytest.approx(leaf.strain(MPA), rel=1e-9)


def test_an_oblique_screw_bends_its_leaf_more_and_presses_harder_than_a_normal_one() -> None:
    """By virtual work: the force along the screw is that of a straight one over the cosine squared."""
    straight, oblique = Leaf(30.0, 8.0, 20.0, 2.5, 1.0, 0.5), Leaf(30.0, 8.0, 20.0, 2.5, np.sqrt(0.5), 0.5)
    assert oblique.force_n(MPA) == pytest.approx(2.0 * straight.force_n(MPA))


def test_a_leaf_for_a_least_force_has_it() -> None:
    leaf = Leaf(30.0, 8.0, 20.0, 2.5, np.sqrt(0.5), 0.5, 2.1).with_least_force(7.0, MPA, 0.5)
    assert leaf.least_force_n(MPA, 0.5) == pytest.approx(7.0)
    # New, as drawn, and turned as far as stated, it presses about twice as hard.
    assert 1.5 * 0.5 / 0.375 * 7.0 < leaf.force_n(MPA) < 2.5 * 7.0


def test_a_leaf_within_its_tolerances_presses_at_least_as_stated() -> None:
    leaf = Leaf(17.3, 8.0, 20.0, 3.4, 1.0, 0.5)
    forces = [
        replace(
            leaf, thickness_mm=3.4 + thicker * LEAF_TOLERANCE_MM, length_mm=17.3 + longer, width_mm=20.0 + wider
        ).force_n(MPA, CONTACT_TURNS - TURN_ERROR)
        for thicker in (-1.0, 1.0)
        for longer in (-GENERAL_MM, GENERAL_MM)
        for wider in (-GENERAL_MM, GENERAL_MM)
    ]
    assert leaf.least_force_n(MPA, 0.5) == pytest.approx(min(forces) / 1.5)


def test_the_roots_rotation_adds_its_lever_arm_to_the_deflection() -> None:
    """The additional deflection is that of O'Donnell's rotation under F l."""
    leaf = Leaf(30.0, 8.0, 20.0, 2.5, 1.0, 0.5)
    rigid = replace(leaf, root=0.0)
    force = leaf.force_n(MPA)
    bent = CONTACT_TURNS * leaf.pitch_mm * force / rigid.force_n(MPA)
    rotation = 16.67 / np.pi * (1.0 - 0.35**2) * force * 30.0 / (MPA * 20.0 * 2.5**2)
    assert bent + 30.0 * rotation == pytest.approx(CONTACT_TURNS * leaf.pitch_mm)


def test_the_six_forces_hold_any_load_in_equilibrium(nest: Nest) -> None:
    loads = np.random.default_rng(1).normal(size=(4, 3))
    places = np.random.default_rng(2).normal(size=(4, 3)) * 20.0
    held = reactions(nest, places, loads)
    assert held.shape == (6, 4)
    np.testing.assert_allclose(wrenches(nest.points, nest.normals) @ held, -wrenches(places, loads), atol=1e-9)


def test_at_the_required_forces_a_point_is_about_to_lose_contact(nest: Nest) -> None:
    """At the required forces, each screw's points stay in contact, one of them without reserve."""
    weight = 3.0
    forces = required_forces_n(nest, MIDDLE, weight)
    tips, axes = np.array([s.tip for s in nest.screws]), np.array([s.axis for s in nest.screws])
    pressed = reactions(nest, tips, axes)
    strongest = pressed.argmax(axis=1)
    pulls = weight * reactions(nest, np.tile(MIDDLE, (500, 1)), directions(500))
    for screw, force in enumerate(forces):
        mine = strongest == screw
        left = force * pressed[mine, screw][:, None] + pulls[mine]
        assert -0.02 * force < left.min() < 0.05 * force


def test_the_minimum_contact_force_is_that_in_the_worst_of_many_directions(nest: Nest) -> None:
    tips, axes = np.array([s.tip for s in nest.screws]), np.array([s.axis for s in nest.screws])
    held = reactions(nest, tips, axes) @ [screw.leaf.least_force_n(MPA, 0.5) for screw in nest.screws]
    worst = (held[:, None] + 3.0 * reactions(nest, np.tile(MIDDLE, (20_000, 1)), directions(20_000))).min()
    assert min_contact_n(nest, MIDDLE, 3.0, MPA, 0.5) == pytest.approx(worst, abs=0.05)


def directions(count: int) -> np.ndarray:
    found = np.random.default_rng(3).normal(size=(count, 3))
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def test_a_body_that_moves_as_the_jacobian_says_follows_the_errors(nest: Nest) -> None:
    """After a small shift and rotation, the body's points have moved by these errors along their normals."""
    errors = np.array([3.0, -1.0, 2.0, 1.0, -2.0, 0.5]) * 1e-3
    motion = error_jacobian(nest) @ errors
    gone = motion[:3] + np.cross(motion[3:], nest.points)
    np.testing.assert_allclose((gone * nest.normals).sum(axis=1), errors, atol=1e-12)


def test_a_nest_without_its_far_pad_does_not_fix_the_body(nest: Nest) -> None:
    points = nest.points.copy()
    points[0] = (points[1] + points[2]) / 2.0
    with pytest.raises(np.linalg.LinAlgError):
        error_jacobian(replace(nest, points=points))


def test_the_body_of_the_c920_is_that_of_its_camera() -> None:
    box = body_box(read_body("c920"))
    np.testing.assert_allclose(np.array(Camera.c920().body_mm), [box.low, box.high])


@pytest.mark.parametrize("name", camera_names())
def test_the_body_stands_with_the_pupil_in_the_origin(name: str) -> None:
    camera, body = read_body(name), body_box(read_body(name))
    lens_from_middle = np.array([camera.lens_x_mm, camera.lens_y_mm, camera.depth_mm / 2.0])
    pupil = body.centre + lens_from_middle - np.array([0.0, 0.0, camera.pupil_behind_front_mm])
    np.testing.assert_allclose(pupil, 0.0, atol=1e-12)
