"""The printer's bed: which way a part lies on it, when it is too high, and how far cuts may be moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirrorcam.cad.plan.bed import MOVED_MM, bed_lengths_mm, cut_slack_mm, require_height, turned_onto_bed
from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.part_plan import PartPlan
from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.transforms import transform

LONG_BED = HARDWARE.replaced(printer=HARDWARE.printer.replaced(bed_mm=(200.0, 300.0, 250.0)))


def test_the_longer_side_of_a_part_lies_along_the_longer_side_of_the_bed() -> None:
    assert bed_lengths_mm((250.0, 100.0), LONG_BED) == (300.0, 200.0)
    assert bed_lengths_mm((100.0, 250.0), LONG_BED) == (200.0, 300.0)


def test_a_part_is_turned_by_a_quarter_only_where_it_fits_only_so(block: PartPlan) -> None:
    assert turned_onto_bed(block, 190.0, 300.0, LONG_BED) is block
    assert turned_onto_bed(block, 250.0, 200.0, LONG_BED) is block
    turned = turned_onto_bed(replace(block, print_from_rig=np.eye(4)), 250.0, 300.0, LONG_BED)
    np.testing.assert_allclose(transform(turned.print_from_rig, np.array([250.0, 100.0, 5.0])), [-100.0, 250.0, 5.0])
    assert np.linalg.det(turned.print_from_rig) == pytest.approx(1.0)


@pytest.mark.parametrize(("length", "count"), [(300.0, 2), (500.0, 3), (800.0, 4)])
def test_cuts_moved_by_their_slack_leave_pieces_that_fit(length: float, count: int) -> None:
    slack = cut_slack_mm(length, count, 220.0)
    longest = length / count + (slack if count == 2 else 2.0 * slack)
    assert longest + MOVED_MM == pytest.approx(220.0)
    # No piece is longer than the bed, so cuts of pieces that just fit cannot be moved at all.
    assert cut_slack_mm(440.0, 2, 220.0) == 0.0


def test_what_is_higher_than_the_printer_is_refused() -> None:
    require_height("bar", 250.0, HARDWARE)
    with pytest.raises(InputError, match=r"^bar is 250\.1 mm high, expected at most 250 mm \(printer bed\)$"):
        require_height("bar", 250.1, HARDWARE)
