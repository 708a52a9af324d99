"""Messages of one line: the first finding with its place, the others by their number."""

from __future__ import annotations

from typing import Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mirrorcam.core.messages import LONGEST_MESSAGE, one_line, shortened


class Side(BaseModel):
    model_config = ConfigDict(extra="forbid")
    width_mm: float
    height_mm: float = 1.0


class Sides(BaseModel):
    sides: dict[str, Side]


def message(fields: object) -> str:
    with pytest.raises(ValidationError) as caught:
        Sides.model_validate({"sides": fields})
    return one_line(caught.value, Sides)


def test_a_finding_states_its_location_and_the_number_of_others() -> None:
    assert message({"a": {}}) == "sides.a.width_mm: Field required"
    assert message({"a": {}, "b": {}}) == "sides.a.width_mm: Field required (and 1 more)"


def test_an_unknown_key_comes_first_with_the_closest_known_one() -> None:
    assert message({"a": {"widht_mm": 1.0}}) == "sides.a.widht_mm: not known, did you mean width_mm? (and 1 more)"
    assert message({"a": {"width_mm": 1.0, "zzz": 1.0}}) == "sides.a.zzz: not known"


def test_a_key_without_its_unit_is_completed() -> None:
    assert message({"a": {"width": 1.0}}) == "sides.a.width: not known, did you mean width_mm? (and 1 more)"


def test_another_schema_comes_first_and_alone() -> None:
    class File(BaseModel):
        model_config = ConfigDict(extra="forbid")
        schema_id: Literal["sides/1"] = Field(alias="schema")
        sides: Sides

    with pytest.raises(ValidationError) as caught:
        File.model_validate({"schema": "poses/1", "poses": []})
    assert one_line(caught.value, File) == "schema: 'poses/1', expected 'sides/1'"


def test_a_long_text_loses_its_middle() -> None:
    assert shortened("short") == "short"
    long = shortened("a" * 1000 + "b" * 1000)
    assert len(long) <= LONGEST_MESSAGE
    assert long.startswith("aaa") and long.endswith("bbb") and " ... " in long
    assert len(message({"x" * 1000: {}})) <= LONGEST_MESSAGE
