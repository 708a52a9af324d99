"""Violations of a spec: pairs, segments and sizes, against closed forms."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from mirrorcam.core.values import FloatArray
from mirrorcam.optics.design.least_violation import least_violation, past_the_pupil
from mirrorcam.optics.design.program.seeds import Seed, seed_of
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.mirror_gaps import closest_points, edges_mm, hull_distance
from mirrorcam.optics.geometry.violation import LeastViolation, Violation

ROW = DesignSpec(rows=1, cols=3, fold_deg=90.0)


def seed(spec: DesignSpec) -> Seed:
    return seed_of(spec, 400.0)


def found(spec: DesignSpec, constraint: str, regions: FloatArray | None = None) -> LeastViolation:
    at = least_violation(spec, constraint, (seed(spec).centres, seed(spec).corners), regions)
    assert at is not None
    assert at.constraint == constraint
    assert len(at.mirrors) == len(spec.arrangement.names)
    missing = [violation.missing_mm for violation in at.violations]
    assert missing == sorted(missing, reverse=True)
    return at


def length(violation: Violation) -> float:
    return float(np.linalg.norm(violation.place_in_rig_mm[1] - violation.place_in_rig_mm[0]))


def test_mirrors_too_close_are_named_with_the_segment_between_them() -> None:
    wide = ROW.replaced(spacing_mm=10.0)
    # The seed's tiles are for the smaller spacing, so that mirrors are too close for the larger one.
    at = least_violation(wide, "spacing", (seed(ROW).centres, seed(ROW).corners))
    assert at is not None
    assert {violation.mirrors for violation in at.violations} == {(0, 1), (1, 2)}
    for violation in at.violations:
        assert violation.missing_mm == pytest.approx(10.0 - length(violation), abs=1e-6)
        first, second = (at.mirrors[k].solid.corners_in_rig_mm for k in violation.mirrors)
        assert length(violation) == pytest.approx(hull_distance(first, second), abs=1e-6)


def test_what_meets_the_limit_is_no_violation() -> None:
    near = least_violation(ROW.replaced(spacing_mm=0.5), "spacing", (seed(ROW).centres, seed(ROW).corners))
    assert near is not None
    assert near.violations == ()
    assert found(ROW, "size").violations == ()


def test_sub_images_too_close_are_joined_from_mirror_to_mirror() -> None:
    wide = ROW.replaced(seen_gap_mm=20.0)
    at = least_violation(wide, "seen gap", (seed(ROW).centres, seed(ROW).corners))
    assert at is not None
    assert {violation.mirrors for violation in at.violations} == {(0, 1), (1, 2)}
    for violation in at.violations:
        for k, end in zip(violation.mirrors, violation.place_in_rig_mm, strict=True):
            assert end @ at.mirrors[k].normal_in_rig == pytest.approx(-at.mirrors[k].distance_mm, abs=1e-6)
        ends = violation.place_in_rig_mm[:, :2] / violation.place_in_rig_mm[:, 2:]
        assert violation.missing_mm == pytest.approx(20.0 - 80.0 * np.linalg.norm(ends[1] - ends[0]), abs=1e-6)


def test_an_edge_that_is_too_short_is_the_reported_segment() -> None:
    at = found(ROW.replaced(min_edge_mm=1000.0), "size")
    for violation in at.violations:
        (k,) = violation.mirrors
        assert length(violation) == pytest.approx(edges_mm(at.mirrors[k]).min())
        assert violation.missing_mm == pytest.approx(1000.0 - length(violation))
    assert len(found(ROW.replaced(min_area_mm2=1e5), "size").violations) == 3


def test_mirrors_past_the_depth_reach_back_to_it() -> None:
    spec = ROW.replaced(depths_mm=(5.0, 500.0))
    for violation in found(spec, "depth").violations:
        depths = violation.place_in_rig_mm @ spec.view_from_rig[2]
        assert depths[1] == pytest.approx(5.0)
        assert depths[0] - depths[1] == pytest.approx(violation.missing_mm) == pytest.approx(length(violation))


def test_a_mirror_in_the_light_of_another_is_met_where_it_stands() -> None:
    spec = DesignSpec(rows=1, cols=2, fold_deg=90.0)
    assert found(spec, "occlusion").violations == ()
    centres = seed(spec).centres * np.array([[1.0], [0.6]])
    at = least_violation(spec, "occlusion", (centres, seed(spec).corners))
    assert at is not None
    assert {violation.mirrors for violation in at.violations} == {(0, 1)}
    assert all(length(violation) < 1e-6 for violation in at.violations)


def test_mirrors_in_the_box_around_the_camera_are_met_in_it() -> None:
    spec = ROW.replaced(body_clearance_mm=70.0)
    at = found(spec, "body")
    assert {violation.mirrors for violation in at.violations} == {(0,), (1,), (2,)}
    low, high = spec.keep_outs_in_rig_mm[0].min(axis=0), spec.keep_outs_in_rig_mm[0].max(axis=0)
    for violation in at.violations:
        assert (violation.place_in_rig_mm >= low - 1e-6).all()
        assert (violation.place_in_rig_mm <= high + 1e-6).all()
    assert found(spec.replaced(body_clearance_mm=0.0), "body").violations == ()


def test_a_region_that_a_mirror_does_not_show_lies_beyond_its_edge() -> None:
    wide = np.array([[[-50.0, -60.0], [50.0, -60.0], [50.0, 40.0], [-50.0, 40.0]]] * 2)
    at = found(ROW, "overlap", wide)
    assert len(at.violations) == 6
    small = 0.001 * np.array([[[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]] * 2) + [0.0, -1.0]
    assert {violation.mirrors for violation in found(ROW, "overlap", small).violations} < {(0,), (1,), (2,)}


def test_a_plate_past_the_pupil_is_drawn_from_there() -> None:
    spec = ROW.replaced(surface="second", thickness_mm=200.0)
    assert least_violation(spec, "occlusion", (seed(spec).centres, seed(spec).corners)) is None
    (violation,) = past_the_pupil(spec, seed(spec), 53.6).violations
    assert violation.mirrors == (1,)
    assert np.abs(violation.place_in_rig_mm[0]).max() == 0.0


def test_the_refusal_keeps_it_between_processes() -> None:
    refusal = InfeasibleDesign("size", "too small", found(ROW.replaced(min_edge_mm=1000.0), "size"))
    again = pickle.loads(pickle.dumps(refusal))
    assert (str(again), again.constraint, again.finding) == (str(refusal), "size", "too small")
    assert again.violation == refusal.violation
    assert LeastViolation.model_validate_json(refusal.violation.model_dump_json()) == refusal.violation


def test_closest_points_are_as_far_apart_as_the_hulls() -> None:
    generator = np.random.default_rng(3)
    for _ in range(20):
        first, second = generator.normal(size=(6, 3)), generator.normal([3.0, 0.0, 0.0], size=(7, 3))
        p, q = closest_points(first, second)
        assert np.linalg.norm(q - p) == pytest.approx(hull_distance(first, second), abs=1e-9)
        if hull_distance(first, second) > 1e-6:
            # No point of either hull lies beyond the planes through the two points, normal to their connection.
            assert (first @ (q - p)).max() <= p @ (q - p) + 1e-9
            assert (second @ (q - p)).min() >= q @ (q - p) - 1e-9
    p, q = closest_points(np.eye(3) - 1.0 / 3.0, 1.0 / 3.0 - np.eye(3))
    assert np.abs(q - p).max() < 1e-9
