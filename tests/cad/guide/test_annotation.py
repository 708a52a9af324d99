"""Annotations: an oblique length gets an aligned dimension beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from mirrorcam.cad.guide.drawing import draw
from mirrorcam.cad.plan.dimension import Hole, Length
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan


@dataclass(frozen=True)
class Dimensions:
    """A plan of which nothing is known but its dimensions."""

    dimensions: tuple[Length | Hole, ...]


def test_what_lies_askew_has_its_line_beside_it_off_the_part(block: Callable[..., PartPlan]) -> None:
    part = block()
    ends = np.array([(-30.0, -15.0, 5.0), (10.0, 15.0, 5.0)])
    askew, level = Length(ends, "askew"), Length(ends, "across", np.array([1.0, 0.0, 0.0]))
    plan = Dimensions((askew, level))
    sheet = draw(part.make(part.plan), replace(part, plan=plan), HARDWARE.printer)
    said = {words.text: words.corners for words in sheet.words}
    assert {"50 askew", "40 across"} <= set(said)
    base = said["50 askew"][1] - said["50 askew"][0]
    assert np.degrees(np.arctan2(base[1], base[0])) == pytest.approx(np.degrees(np.arctan2(30.0, 40.0)), abs=0.1)
    assert said["40 across"][1, 1] == pytest.approx(said["40 across"][0, 1])
