"""Specifications of designs: refusals, and the view axes of a fold."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mirrorcam.core.errors import InputError
from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.arrangement import Arrangement, Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec, InfeasibleDesign
from mirrorcam.optics.geometry.layout import FOLD_90_VIEW_FROM_RIG

NAN = float("nan")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"rows": 1, "cols": 1}, "rows x cols is 1, expected at least two mirrors"),
        ({"depths_mm": (300.0, -1.0)}, "greater than or equal to 0.001"),
        ({"depths_mm": (300.0, 300.0)}, "a depth twice"),
        ({"depths_mm": ()}, "at least 1 item"),
        ({"depths_mm": (NAN,)}, "finite number"),
        ({"tradeoff": 1.1}, "less than or equal to 1"),
        ({"spacing_mm": -0.1}, "greater than or equal to 0"),
        ({"scale_mm": 0.0}, "greater than or equal to 0.001"),
        ({"scale": 80.0}, "not known"),
    ],
)
def test_requests_that_mean_nothing_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DesignSpec(**fields)


def test_a_fold_turns_the_camera_axis_to_the_views_axis() -> None:
    np.testing.assert_array_equal(DesignSpec(fold_deg=90.0).view_from_rig, FOLD_90_VIEW_FROM_RIG)
    for fold_deg in (60.0, 105.0, 150.0):
        turn = DesignSpec(fold_deg=fold_deg).view_from_rig
        assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)
        assert np.degrees(np.arccos(turn[2] @ [0.0, 0.0, 1.0])) == pytest.approx(fold_deg)
        assert_allclose(turn[0], [1.0, 0.0, 0.0])


def test_the_reflecting_surface_is_requested_by_name() -> None:
    assert not DesignSpec().is_second_surface
    assert DesignSpec(surface="second").is_second_surface


def test_a_refusal_names_its_constraint() -> None:
    refusal = InfeasibleDesign("spacing", "mirrors come 3 mm too close")
    assert isinstance(refusal, InputError)
    assert str(refusal) == "infeasible design, spacing constraint: mirrors come 3 mm too close"


def test_a_pattern_replaces_rows_and_columns() -> None:
    spec = DesignSpec(pattern=Pattern.ring(8))
    assert (spec.arrangement.rows, spec.arrangement.cols, spec.arrangement.text) == (1, 8, "ring8")
    written = spec.model_dump(mode="json")
    assert not {"rows", "cols"} & set(written)
    assert DesignSpec.model_validate(written) == spec
    assert DesignSpec().arrangement == Arrangement(3, 3)
    assert "pattern" not in DesignSpec().model_dump()
    with pytest.raises(InvalidValue, match="rows or cols are given with a pattern"):
        DesignSpec(rows=2, pattern=Pattern.ring(8))
