"""Searches that end in a refusal: the constraint that cannot be met, and the violation."""

from __future__ import annotations

import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.design.optimise import design
from mirrorcam.optics.design.search import check_obvious_infeasibility
from mirrorcam.optics.geometry.camera import Camera
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from tests.nightly import a_few

TELE = Camera.c920().replaced(fx_px=40000.0, fy_px=40000.0)


@pytest.mark.parametrize(
    ("constraint", "spec", "message"),
    a_few(
        2,
        [
            (
                "depth",
                DesignSpec(depths_mm=(10.0, 500.0), fold_deg=90.0),
                r"10 mm is nearer than the mirrors: they reach [\d.]+ mm past it",
            ),
            (
                "overlap",
                DesignSpec(rows=1, cols=2, camera=TELE, depths_mm=(100.0, 1e5), spacing_mm=0.0),
                r"no region at 100, 100000 mm that \d+% of the sensor sees",
            ),
            (
                "size",
                DesignSpec(rows=1, cols=2, min_edge_mm=200.0),
                r"mirrors cannot have edges of 200 mm",
            ),
            (
                "spacing",
                DesignSpec(rows=2, cols=2, spacing_mm=100.0),
                r"mirrors cannot be 100 mm apart: they come [\d.]+ mm too close",
            ),
            (
                "seen gap",
                DesignSpec(scale_mm=0.001),
                r"sub-images cannot be 0.5 mm apart: they come 0.498 mm too close",
            ),
            (
                "seen gap",
                DesignSpec(rows=2, cols=2, seen_gap_mm=100.0),
                r"sub-images cannot be 100 mm apart: they come \d+(\.\d)? mm too close",
            ),
            (
                "body",
                DesignSpec(rows=1, cols=2, body_clearance_mm=150.0),
                r"mirrors or their ray cones come [\d.]+ mm too close to the camera's body, .* 150 mm",
            ),
            (
                # 65.5 mm from pupil to plane; for light at 35 degrees, the glass brings the coating 119.1 mm nearer.
                "occlusion",
                DesignSpec(rows=1, cols=2, surface="second", thickness_mm=200.0, fold_deg=110.0),
                r"mirrors of 200 mm reach 50\.9 mm past the pupil",
            ),
        ],
    ),
    ids=["depth", "overlap", "size", "spacing", "gap beyond the sensor", "seen gap", "body", "occlusion"],
)
def test_infeasible_specs_are_refused_by_constraint(constraint: str, spec: DesignSpec, message: str) -> None:
    with pytest.raises(InfeasibleDesign, match=f"^infeasible design, {constraint} constraint: .*{message}") as refusal:
        design(spec)
    assert refusal.value.constraint == constraint
    where = refusal.value.violation
    if spec.scale_mm > 1.0:  # mirrors at a micrometre cannot be drawn
        assert where is not None
        assert where.constraint == constraint
        assert where.violations
        assert len(where.mirrors) == len(spec.arrangement.names)
    assert isinstance(refusal.value, InputError)
    assert "\n" not in str(refusal.value)


@pytest.mark.slow
def test_tolerances_that_no_design_survives_are_refused() -> None:
    with pytest.raises(InfeasibleDesign, match="mirrors tilted by 20°"):
        design(DesignSpec(rows=1, cols=2, robust_tilt_deg=20.0))
    with pytest.raises(InfeasibleDesign, match="and 3 sigma of tilts of 0° and offsets of 100 mm apart") as refused:
        design(DesignSpec(rows=1, cols=2, robust_offset_mm=100.0))
    assert refused.value.constraint == "seen gap"


def test_depths_in_metres_are_refused() -> None:
    metres = DesignSpec(depths_mm=(0.25, 0.4))
    with pytest.raises(InfeasibleDesign, match=r"depth constraint: 0\.25, 0\.4 mm is less than 5% of the scale, 80 mm"):
        design(metres)
    check_obvious_infeasibility(metres.replaced(depths_mm=(250.0, 400.0)))
