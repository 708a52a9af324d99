"""What decides about the files of a part: its plan, the printer, our code and the libraries that write it."""

from __future__ import annotations

from dataclasses import replace
from importlib import metadata

import numpy as np
import pytest

from mirrorcam.cad import part_files
from mirrorcam.cad.plan.hardware import Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.optics.base.fingerprint import distributions

PART = PartPlan("wedge", "Wedge", "7", (1.0, 2.0), repr, np.eye(4), np.zeros(3), (0.5, 0.5, 0.5))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def key() -> str:
    return part_files._key(PART, Printer())


@pytest.mark.parametrize("name", distributions("cad"))
def test_another_version_of_a_library_is_another_part(name: str, key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    now = metadata.version
    monkeypatch.setattr(metadata, "version", lambda other: "999" if other == name else now(other))
    assert part_files._key(PART, Printer()) != key


def test_a_slicer_that_is_installed_later_is_another_part(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(part_files, "slicer_version", lambda: "PrusaSlicer-99.0")
    assert part_files._key(PART, Printer()) != key


def test_other_numbers_are_another_part_and_the_same_numbers_the_same(key: str) -> None:
    assert part_files._key(replace(PART), Printer()) == key
    assert part_files._key(replace(PART, plan=(1.0, 2.5)), Printer()) != key
    assert part_files._key(PART, Printer(plastic_g_per_cm3=1.0)) != key
