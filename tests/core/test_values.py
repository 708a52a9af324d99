"""Frozen values: what they refuse, and that equal ones are equal everywhere."""

from __future__ import annotations

import copy
import json
import math
import pickle
from collections.abc import Callable
from typing import Any, Literal, Self

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from mirrorcam.core.command_text import command_text
from mirrorcam.core.errors import InputError
from mirrorcam.core.values import (
    NOT_FINITE,
    InvalidValue,
    Metric,
    Points3,
    Shaped,
    SquareMatrix,
    Value,
    Vector3,
    with_tuples,
)


class Thing(Value):
    """A value with one of everything."""

    point: Vector3
    size_mm: float = Field(default=1.0, gt=0)
    notes: dict[str, float] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("shape", "value", "message"),
    [
        ((3,), [1.0, 2.0], r"shape \(2,\), expected \(3\)"),
        ((3,), [[1.0, 2.0, 3.0]], r"shape \(1, 3\), expected \(3\)"),
        ((None, 3), [[1.0, 2.0]], r"shape \(1, 2\), expected \(n, 3\)"),
        ((None, 3), [], r"shape \(0,\), expected \(n, 3\)"),
        ((3,), 4.0, r"shape \(\), expected \(3\)"),
        ((3,), None, r"not an array of numbers, expected shape \(3\)"),
        ((3,), [1.0, float("nan"), 3.0], "NaN or infinite, expected finite numbers"),
        ((3,), [1.0, float("inf"), 3.0], "NaN or infinite, expected finite numbers"),
        ((3,), ["a", "b", "c"], r"not an array of numbers, expected shape \(3\)"),
        ((None, 3), [[1.0, 2.0, 3.0], [4.0]], r"not an array of numbers, expected shape \(n, 3\)"),
        ((3,), {"x": 1}, r"not an array of numbers"),
        ((3,), [10**400, 0, 0], r"not an array of numbers, expected shape \(3\)"),
        ((3,), [1j, 0, 0], r"not an array of numbers"),
    ],
)
def test_arrays_of_another_shape_or_content_are_refused(shape: Any, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Shaped(shape).check(value)


def test_arrays_are_copied_and_read_only() -> None:
    given_array = np.array([1.0, 2.0, 3.0])
    thing = Thing(point=given_array)
    given_array[0] = 9
    assert thing.point.tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="read-only"):
        thing.point[0] = 5
    assert thing.point.dtype == np.float64


def test_any_length_stands_where_none_is_given() -> None:
    assert Shaped((None, None)).check([[1, 2, 3]]).shape == (1, 3)
    assert Shaped((None, 2)).check(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(
    ("fields", "where"),
    [
        ({"point": [0, 0, 0], "colour": "red"}, "colour"),
        ({"point": [0, 0, 0], "size_mm": float("nan")}, "size_mm"),
        ({"point": [0, 0, 0], "size_mm": float("inf")}, "size_mm"),
        ({"point": [0, 0, 0], "size_mm": 0}, "size_mm"),
        ({"point": [0, 0, 0], "notes": {"a": float("nan")}}, "notes"),
        ({}, "point"),
    ],
)
def test_values_refuse_by_name(fields: dict[str, Any], where: str) -> None:
    with pytest.raises(InvalidValue) as caught:
        Thing(**fields)
    assert caught.value.first is not None
    assert caught.value.first["loc"][0] == where


def test_values_are_frozen_and_copies_check_themselves() -> None:
    thing = Thing(point=[1, 2, 3])
    with pytest.raises(AttributeError, match=r"^size_mm: a Thing is frozen, expected value\.replaced"):
        thing.size_mm = 3.0  # type: ignore[misc]  # the very thing that must fail
    assert thing.replaced(size_mm=2.0).size_mm == 2.0
    assert thing.replaced(size_mm=2.0).point.tolist() == [1, 2, 3]
    assert thing.size_mm == 1.0
    with pytest.raises(InvalidValue, match="greater than 0"):
        thing.replaced(size_mm=-1.0)
    with pytest.raises(InvalidValue, match="length: not known"):
        thing.replaced(length=1.0)


def test_one_finding_is_counted_once() -> None:
    class Plan(Value):
        rows: int = 1
        angle: float | Literal["auto"] = 1.0
        cols: int = Field(default_factory=lambda fields: fields["rows"])

    for wrong in ({"rows": "x"}, {"angle": "x"}):
        with pytest.raises(InvalidValue) as caught:
            Plan(**wrong)
        assert str(caught.value).startswith(f"{next(iter(wrong))}: ")
        assert "more)" not in str(caught.value)


def test_text_and_truth_values_are_no_numbers() -> None:
    class Plan(Value):
        rows: int = Field(default=1, ge=1)
        sizes_mm: tuple[float, ...] = ()
        angle: float | Literal["auto"] = "auto"
        inner: Thing | None = None

    for name, value in [("rows", "2"), ("rows", True), ("rows", np.True_), ("sizes_mm", (1.0, "2")), ("angle", "2")]:
        with pytest.raises(InvalidValue, match=rf"^{name}.*expected"):
            Plan(**{name: value})
    with pytest.raises(InvalidValue, match=r"^inner.size_mm: str, expected a number"):
        Plan.model_validate_json('{"inner": {"point": [0, 0, 0], "size_mm": "1"}}')
    plan = Plan(rows=np.int64(3), sizes_mm=(np.float32(0.5), 2), angle=np.float64(1.0))
    assert (plan.rows, plan.sizes_mm, plan.angle) == (3, (0.5, 2.0), 1.0)
    assert Metric(value=np.True_, unit="1").value == 1.0
    with command_text():
        assert Plan(rows="2", angle="0.5").rows == 2
        with pytest.raises(InvalidValue, match=r"^rows: bool"):
            Plan(rows=True)


def test_fields_are_described_in_the_docstring_and_given_ones_shown() -> None:
    class Described(Thing):
        """A thing."""

        width_mm: float = Field(default=1.0, description="extent along x")

    fields = "point\nsize_mm\n    default 1.0\nnotes\nwidth_mm\n    extent along x, default 1.0"
    assert Described.__doc__ == f"A thing.\n\nAttributes\n----------\n{fields}"
    assert repr(Described(point=[0, 0, 0])).endswith("Described(point=array([0., 0., 0.]))")


def test_equal_values_are_equal_and_have_equal_hashes() -> None:
    first = Thing(point=[0.0, 1.0, 2.0], notes={"a": 1.0, "b": 2.0})
    same = Thing(point=[-0.0, 1.0, 2.0], notes={"b": 2.0, "a": 1.0})
    assert first == same
    assert hash(first) == hash(same)
    assert len({first, same}) == 1
    assert first != Thing(point=[0.0, 1.0, 2.5], notes=first.notes)
    assert first != "thing"


def test_values_of_another_type_are_never_equal() -> None:
    class Other(Thing):
        pass

    assert Thing(point=[0, 0, 0]) != Other(point=[0, 0, 0])


@given(arrays(np.float64, (4, 3), elements=st.floats(allow_nan=False, allow_infinity=False)))
def test_arrays_survive_json_to_the_bit(points: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    class Cloud(Value):
        points: Points3

    text = Cloud(points=points).model_dump_json()
    assert Cloud.model_validate_json(text).points.tobytes() == points.tobytes()


def test_a_square_matrix_may_have_any_size() -> None:
    class Holder(Value):
        matrix: SquareMatrix

    assert Holder(matrix=np.eye(5)).matrix.shape == (5, 5)
    assert Holder.model_json_schema()["properties"]["matrix"]["type"] == "array"


def test_bad_input_is_a_value_error() -> None:
    assert issubclass(InputError, ValueError)
    assert issubclass(InvalidValue, InputError)


class Pair(Value):
    """A value that holds values, checks them, and makes another while it is made."""

    first: Thing
    others: tuple[Thing, ...] = ()

    @model_validator(mode="after")
    def _check(self) -> Self:
        Thing(point=self.first.point, size_mm=self.first.size_mm - 1.0)
        return self


MAKERS: dict[str, Callable[[dict[str, Any]], Pair]] = {
    "constructor": lambda fields: Pair(**fields),
    "table": Pair.model_validate,
    "strict table": lambda fields: Pair.model_validate(with_tuples(fields), strict=True),
    "JSON": lambda fields: Pair.model_validate_json(json.dumps(fields)),
    "strict JSON": lambda fields: Pair.model_validate_json(json.dumps(fields), strict=True),
    "copy": lambda fields: Pair(first={"point": [0, 0, 0], "size_mm": 2.0}).replaced(**fields),
}


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"first": {"point": [0, 0, 0], "size_mm": -2.0}}, "first.size_mm: Input should be greater than 0"),
        ({"first": {"point": [0, 0], "size_mm": 2.0}}, "first.point: shape (2,), expected (3)"),
        ({"first": {"point": [0, 0, 0], "size": 2.0}}, "first.size: not known, did you mean size_mm?"),
        ({"first": 3}, "first: "),
        (
            {"first": {"point": [0, 0, 0], "size_mm": 2.0}, "others": [{"point": [0, 0, 0]}, {}]},
            "others.1.point: Field required",
        ),
        ({"first": {"point": [0, 0, 0], "size_mm": 1.0}}, "size_mm: Input should be greater than 0"),
    ],
)
def test_fields_are_refused_in_one_line_however_a_value_is_made(
    make: Callable[[dict[str, Any]], Pair], fields: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError) as caught:
        make(fields)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_values_in_values_are_made_however_a_value_is_made(make: Callable[[dict[str, Any]], Pair]) -> None:
    fields = {"first": {"point": [0, 0, 0], "size_mm": 2.0}, "others": [{"point": [1, 2, 3]}]}
    assert make(fields) == Pair(first=Thing(point=[0, 0, 0], size_mm=2.0), others=(Thing(point=[1, 2, 3]),))
    assert make(fields).model_copy() == make(fields)


def test_pydantic_still_places_findings_in_unions_of_values() -> None:
    class Other(Value):
        name: str

    union: TypeAdapter[Thing | Other] = TypeAdapter(Thing | Other)
    assert union.validate_python({"name": "a"}) == Other(name="a")
    with pytest.raises(ValidationError) as caught:
        union.validate_python({"name": 1})
    assert {str(each["loc"][0]) for each in caught.value.errors()} == {"Thing", "Other"}


@pytest.mark.parametrize(
    ("value", "limit", "lower_is_better", "passed"),
    [
        (1.0, None, True, True),
        (1.0, 1.0, True, True),
        (1.1, 1.0, True, False),
        (1.0, 1.0, False, True),
        (0.9, 1.0, False, False),
    ],
)
def test_metrics_pass_at_their_limit(value: float, limit: float | None, lower_is_better: bool, passed: bool) -> None:
    assert Metric(value=value, unit="px", limit=limit, lower_is_better=lower_is_better).passed is passed


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf"), np.float64("nan"), np.float32("inf")])
@pytest.mark.parametrize(("given", "reason"), [({}, NOT_FINITE), ({"reason": "no view shows it"}, "no view shows it")])
def test_a_metric_without_a_finite_value_is_none_with_a_reason(
    value: float, given: dict[str, str], reason: str
) -> None:
    metric = Metric(value=value, unit="px", limit=1.0, **given)
    assert not metric.known
    assert not metric.passed
    assert not metric.replaced(lower_is_better=False).passed
    assert json.loads(metric.model_dump_json(exclude_none=True), parse_constant=pytest.fail) == {
        **{"value": None, "unit": "px", "limit": 1.0, "lower_is_better": True, "reason": reason}
    }
    again = Metric.model_validate_json(metric.model_dump_json(), strict=True)
    assert again == metric
    assert hash(again) == hash(metric)


def test_a_metric_with_a_value_has_no_reason() -> None:
    assert "reason" not in Metric(value=1.0, unit="px").model_dump()
    with pytest.raises(ValueError, match="for being unknown, expected none"):
        Metric(value=1.0, unit="px", reason="none")


def test_a_metric_in_a_value_is_none_as_well() -> None:
    class Holder(Value):
        metrics: dict[str, Metric]

    holder = Holder(metrics={"a": Metric(value=math.nan, unit="px"), "b": Metric(value=1.0, unit="px")})
    text = holder.model_dump_json(exclude_none=True)
    assert json.loads(text)["metrics"]["a"] == {
        **{"value": None, "unit": "px", "lower_is_better": True, "reason": NOT_FINITE}
    }
    assert Holder.model_validate_json(text, strict=True) == holder


@pytest.mark.parametrize(
    "copied", [lambda error: pickle.loads(pickle.dumps(error)), copy.copy, copy.deepcopy, lambda error: error]
)
def test_a_refusal_may_be_copied_and_sent_to_another_process(copied: Callable[[InvalidValue], InvalidValue]) -> None:
    with pytest.raises(InvalidValue) as caught:
        Thing(point=[1, 2, 3], size_mm="x")
    found = copied(caught.value)
    assert type(found) is InvalidValue
    assert str(found) == str(caught.value)
    assert found.reason in str(found)
    assert found.title in ("Thing", "")


def test_a_refusal_is_one_line_whatever_the_names_of_fields() -> None:
    with pytest.raises(InvalidValue, match=r"^a b: not known$"):
        Thing(point=[1, 2, 3], **{"a\nb": 1})
