"""The inputs of a part's files: its plan, the printer, the date, our code and the programs that write them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from build123d import Part

from mirrorcam.cad import part_files
from mirrorcam.cad.plan.hardware import HARDWARE, Printer
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.core.disk.fingerprint import differing_keys


def make_wedge(plan: object) -> Part:
    raise NotImplementedError(plan)


PART = PartPlan("wedge", "Wedge", "7", (1.0, 2.0), make_wedge, np.eye(4), np.zeros(3), (0.5, 0.5, 0.5))


def test_different_numbers_dates_and_programs_make_a_different_part(monkeypatch: pytest.MonkeyPatch) -> None:
    screw = HARDWARE.screw
    made_of = part_files._inputs(PART, Printer(), screw)
    assert {"code", "build123d", "cadquery-ocp-novtk", "ezdxf"} <= made_of.keys()
    assert part_files._inputs(replace(PART), Printer(), screw) == made_of
    for part, printer, other in (
        (replace(PART, plan=(1.0, 2.5)), Printer(), screw),
        (PART, Printer(plastic_g_per_cm3=1.0), screw),
        (PART, Printer(), screw.replaced(kind="nut")),
    ):
        assert differing_keys(part_files._inputs(part, printer, other), made_of) == ["parameters"]
    monkeypatch.setattr(part_files, "slicer_version", lambda: "PrusaSlicer-99.0")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert differing_keys(part_files._inputs(PART, Printer(), screw), made_of) == ["date", "slicer"]
