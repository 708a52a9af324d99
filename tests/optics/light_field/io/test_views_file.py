"""The geometry of views as fields by name: from lists, arrays and MATLAB's shapes, and what is refused."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from mirrorcam.optics.base.values import InputError
from mirrorcam.optics.light_field.io.views_file import fields_of_views, parallel_views, views_of_fields
from mirrorcam.optics.light_field.light_field import Views
from tests.optics.light_field.depth.surfaces import grid_views


def assert_same(found: Views, expected: Views) -> None:
    for field in fields(Views):
        assert np.array_equal(getattr(found, field.name), getattr(expected, field.name)), field.name


@pytest.mark.parametrize("reference_depth_mm", [375.25, np.inf])
def test_views_come_back_from_json_to_the_bit(reference_depth_mm: float) -> None:
    views = grid_views(2, 3, reference_depth_mm=reference_depth_mm)
    text = json.dumps(fields_of_views(views), allow_nan=False)
    assert_same(views_of_fields(json.loads(text), "a.json"), views)


def test_vectors_of_matlab_have_two_dimensions() -> None:
    views = grid_views(2, 2, layout_identity="")
    given: dict[str, Any] = {name: np.array(value) for name, value in fields_of_views(views).items()}
    given |= {"centre_px": given["centre_px"][:, None], "layout_identity": np.zeros(0, "<U1")}
    given |= {name: np.atleast_2d(given[name]) for name in ("focal_px", "width_px", "height_px")}
    assert_same(views_of_fields(given, "a.mat"), views)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"focal_px": "long"}, "a.json: does not describe views: could not convert"),
        ({"positions_mm": [[1.0]]}, r"does not describe views: shape \(1, 1\)"),
        ({"width_px": [3, 4]}, "a.json: does not describe views"),
        ({"reference_depth_mm": "nan"}, "expected a number or infinity"),
    ],
)
def test_fields_that_are_no_views_are_refused_in_one_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        views_of_fields(fields_of_views(grid_views()) | change, "a.json")
    assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match="does not describe views: has no 'focal_px'"):
        views_of_fields({"positions_mm": [[[0.0, 0.0, 0.0]]]}, "a.json")


def test_parallel_views_share_the_middle_of_the_middle_view() -> None:
    places = np.stack(np.meshgrid([0.0, 10.0, 20.0], [5.0, 15.0]), axis=-1)
    views = parallel_views(places, (7, 5), 100.0, 400.0)
    assert views.positions_mm[1, 1].tolist() == [0.0, 0.0, 0.0]
    assert views.positions_mm[0, 2].tolist() == [10.0, -10.0, 0.0]
    assert views.centre_px.tolist() == [3.0, 2.0]
    # The point of the reference plane ahead of the middle view is in the same pixel of all.
    assert np.allclose(views.project_in_view(np.array([0.0, 0.0, 400.0])), [3.0, 2.0])
