"""Sizes of rectangular mirrors: their text, and the nearest allowed size."""

from __future__ import annotations

import re

import numpy as np
import pytest

from mirrorcam.core.values import InvalidValue
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.optics.geometry.rectangle_sizes import RectangleSizes, canonical_shape


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("free", "free"),
        ("rectangles", "rectangles"),
        ("stock:15x25", "stock:25x15"),
        ("stock:30.0x20, 25x15.5,20x30", "stock:25x15.5,30x20"),
    ],
)
def test_one_shape_has_one_text(text: str, expected: str) -> None:
    assert canonical_shape(text) == expected
    assert canonical_shape(expected) == expected


@pytest.mark.parametrize("text", ["", "squares", "stock:", "stock:25", "stock:25x", "stock:25x15x3", "stock:0x15"])
def test_any_other_text_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(InvalidValue, match=r"shape.*expected"):
        DesignSpec(shape=text)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"shape": "rectangles", "sides": 5}, "sides is 5 with shape rectangles, expected 4"),
        ({"same_size": True, "shape": "free"}, "same_size is given with free outlines"),
        ({"shape": "stock:25x2"}, "shape has the size 25x2, expected sides above min_edge_mm = 3"),
    ],
)
def test_fields_that_contradict_a_shape_are_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValue, match=re.escape(message)):
        DesignSpec.model_validate(fields)


def test_a_mirror_of_stock_may_lie_on_either_side() -> None:
    sizes = RectangleSizes.of("stock:20x20,25x15", 1.0)
    assert sizes is not None
    assert sizes.options_mm.tolist() == [[15.0, 25.0], [20.0, 20.0], [25.0, 15.0]]
    assert sizes.error_mm(np.array([15.0, 24.0])) == 1.0
    assert sizes.error_mm(np.array([25.0, 15.0])) == 0.0


def test_a_side_of_a_cut_rectangle_is_a_multiple_of_the_step() -> None:
    sizes = RectangleSizes.of("rectangles", 0.5)
    assert sizes is not None
    assert sizes.error_mm(np.array([12.5, 7.1])) == pytest.approx(0.1)
    assert sizes.error_mm(np.array([0.1, 7.0])) == pytest.approx(0.4)


def test_a_shape_survives_its_file() -> None:
    spec = DesignSpec(shape="stock:30x20", size_step_mm=0.5, same_size=True)
    assert DesignSpec.model_validate_json(spec.model_dump_json()) == spec


@pytest.mark.parametrize(("sides", "shape"), [(4, "rectangles"), (5, "free"), (6, "free")])
def test_the_default_shape_suits_the_number_of_sides(sides: int, shape: str) -> None:
    assert DesignSpec(sides=sides).shape == shape
