"""The geometry of views as named fields: from lists, arrays and MATLAB's shapes, and refusals."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.light_field.io.views_file import (
    check_weights,
    fields_of_views,
    read_views,
    views_of_fields,
)
from mirrorcam.optics.light_field.light_field import Views
from tests.optics.light_field.depth.surfaces import grid_views


def assert_same(found: Views, expected: Views) -> None:
    for field in fields(Views):
        assert np.array_equal(getattr(found, field.name), getattr(expected, field.name)), field.name


@pytest.mark.parametrize("reference_depth_mm", [375.25, np.inf])
def test_views_survive_json_bit_by_bit(reference_depth_mm: float) -> None:
    views = grid_views(2, 3, reference_depth_mm=reference_depth_mm)
    text = json.dumps(fields_of_views(views), allow_nan=False)
    assert_same(views_of_fields(json.loads(text), "a.json"), views)


def test_matlab_vectors_have_two_dimensions() -> None:
    views = grid_views(2, 2, layout_identity="")
    given: dict[str, Any] = {name: np.array(value) for name, value in fields_of_views(views).items()}
    given |= {"centre_px": given["centre_px"][:, None], "layout_identity": np.zeros(0, "<U1")}
    given |= {name: np.atleast_2d(given[name]) for name in ("focal_px", "width_px", "height_px")}
    assert_same(views_of_fields(given, "a.mat"), views)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"focal_px": "long"}, "a.json: does not describe views: focal_px is 'long', expected numbers"),
        ({"positions_mm": [[1.0]]}, r"does not describe views: positions_mm: shape \(1, 1\)"),
        ({"width_px": [3, 4]}, "a.json: does not describe views"),
        ({"reference_depth_mm": "nan"}, "expected numbers"),
    ],
)
def test_invalid_fields_are_refused_in_one_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        views_of_fields(fields_of_views(grid_views()) | change, "a.json")
    assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match="does not describe views: has no 'focal_px'"):
        views_of_fields({"positions_mm": [[[0.0, 0.0, 0.0]]]}, "a.json")


def test_parallel_views_share_the_centre_of_the_middle_view() -> None:
    places = np.stack(np.meshgrid([0.0, 10.0, 20.0], [5.0, 15.0]), axis=-1)
    views = Views.parallel(places, (7, 5), 100.0, 400.0)
    assert views.positions_mm[1, 1].tolist() == [0.0, 0.0, 0.0]
    assert views.positions_mm[0, 2].tolist() == [10.0, -10.0, 0.0]
    assert views.centre_px.tolist() == [3.0, 2.0]
    # The point of the reference plane ahead of the middle view has the same pixel in all views.
    assert np.allclose(views.project_in_view(np.array([0.0, 0.0, 400.0])), [3.0, 2.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width_px": True}, "expected numbers"),
        ({"width_px": 3.5}, "expected a whole number from 1"),
        ({"height_px": 10**400}, "expected numbers"),
        ({"focal_px": "700"}, "focal_px is '700', expected numbers"),
        ({"centre_px": ["1", "2"]}, "expected numbers"),
        ({"centre_px": [1e300, 0.0]}, "a length is more than 1e"),
        (
            {"view_from_rig": [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]},
            "view_from_rig is not a rotation matrix",
        ),
        (
            {"view_from_rig": [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]},
            "view_from_rig is not a rotation matrix",
        ),
        ({"positions_mm": [[[1.0, 0.0, 0.0]]]}, "must be zero for exactly one view"),
        ({"layout_identity": "<img>"}, "expected letters and digits"),
        ({"layout_identity": 3}, "does not describe views"),
    ],
)
def test_impossible_views_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        views_of_fields(fields_of_views(grid_views()) | change, "a.json")


@pytest.mark.parametrize("value", [np.nan, -0.5, 1.5, np.inf])
def test_weights_outside_0_to_1_are_refused(value: float) -> None:
    weights = np.ones((1, 1, 2, 2), np.float32)
    check_weights(weights)
    weights[0, 0, 0, 0] = value
    with pytest.raises(InputError, match="weights must lie within 0 to 1"):
        check_weights(weights)
    with pytest.raises(InputError, match="all weights are zero"):
        check_weights(np.zeros((1, 1, 2, 2), np.float32))


@pytest.mark.parametrize("schema", ["mirrorcam.device_views/1", "mirrorcam.views/1"])
def test_views_of_a_device_are_refused_by_their_kind(tmp_path: Path, schema: str) -> None:
    """`evaluate` also writes a `views.json` for calibrators, which once had the same schema."""
    described = {"schema": schema, "width_px": 4, "height_px": 3, "flip_code": 0, "views": []}
    (tmp_path / "views.json").write_text(json.dumps(described), encoding="utf-8")
    with pytest.raises(InputError, match=r"views\.json: describes a device's views for calibrators, expected"):
        read_views(tmp_path / "views.json")
