"""Ranges hold at both ends, and are stated in the description of their fields."""

from __future__ import annotations

import math

import pytest

from mirrorcam.core.bounds import DEPTH_MM, DEPTH_OR_INF_MM, SEED, Bounds
from mirrorcam.core.values import DepthOrInf, InvalidValue, Value


class Numbers(Value):
    share: float = Bounds(0.0, 1.0).field(0.5, "a share")
    seed: int = SEED.field(0)
    depth_mm: float = DEPTH_MM.field()
    focus_mm: DepthOrInf = 300.0


@pytest.mark.parametrize(
    "fields",
    [
        {"share": 0.0, "seed": 0, "depth_mm": DEPTH_MM.min},
        {"share": 1.0, "seed": 2**63 - 1, "depth_mm": DEPTH_MM.max, "focus_mm": math.inf},
        {"depth_mm": 300.0, "focus_mm": DEPTH_MM.max},
    ],
)
def test_both_ends_belong_to_a_range(fields: dict[str, float]) -> None:
    assert Numbers.model_validate(fields).model_dump(include=set(fields)) == fields


@pytest.mark.parametrize(
    "changed",
    [
        *({"share": -0.1}, {"share": 1.1}, {"seed": -1}, {"seed": 2**63}, {"depth_mm": 0.0}, {"depth_mm": 1e308}),
        *(
            {"depth_mm": math.inf},
            {"focus_mm": math.nan},
            {"focus_mm": 1e7},
            {"focus_mm": -math.inf},
            {"focus_mm": 0.0},
        ),
    ],
)
def test_what_is_beyond_is_refused(changed: dict[str, float]) -> None:
    with pytest.raises(InvalidValue, match=f"^{next(iter(changed))}[:.]"):
        Numbers.model_validate({"depth_mm": 300.0} | changed)


def test_a_field_without_default_is_required() -> None:
    with pytest.raises(InvalidValue, match="Field required"):
        Numbers.model_validate({})


def test_the_range_is_part_of_the_description() -> None:
    fields = Numbers.model_fields
    assert fields["share"].description == "a share, 0 to 1"
    assert fields["seed"].description == "0 to 2^63 - 1"
    assert fields["depth_mm"].description == "0.001 to 1000000"
    assert str(DEPTH_OR_INF_MM) == f"{DEPTH_MM} or inf"


def test_a_range_can_be_cut() -> None:
    assert str(Bounds(1, 65536).narrowed(min=4)) == "4 to 65536"
    assert Bounds(0.0, 1.0).narrowed(max=0.5) == Bounds(0.0, 0.5)
