"""Sizes of threads by their names, against the rules that the standards follow."""

from __future__ import annotations

import pytest

from mirrorcam.cad.plan.hardware import HARDWARE
from mirrorcam.cad.plan.threads import COUNTERSUNK, SUNK_HEAD, THREADS, diameter_mm, thread_of


def test_metric_sizes_are_their_names() -> None:
    for name, thread in THREADS.items():
        if name.startswith("M"):
            assert float(name[1:]) == thread.diameter_mm == thread.head_height_mm
        assert thread.diameter_mm < thread.clearance_mm < thread.nut_flats_mm
        assert thread.nut_height_mm > 3.5 * thread.pitch_mm


def test_the_inch_thread_has_twenty_turns_to_the_inch() -> None:
    thread = thread_of("1/4-20 UNC")
    assert thread.pitch_mm == pytest.approx(25.4 / 20)
    assert thread.diameter_mm == pytest.approx(25.4 / 4)
    assert thread.nut_flats_mm == pytest.approx(25.4 * 7 / 16, abs=0.01)
    assert thread.nut_height_mm == pytest.approx(25.4 * 7 / 32, abs=0.01)


def test_the_table_of_screws_agrees_with_that_of_threads() -> None:
    screw, thread = HARDWARE.screw, thread_of("M3")
    assert (screw.clearance_hole_mm, screw.nut_flats_mm, screw.nut_height_mm, screw.head_height_mm) == (
        thread.clearance_mm,
        thread.nut_flats_mm,
        thread.nut_height_mm,
        thread.head_height_mm,
    )


def test_a_size_begins_with_its_thread() -> None:
    assert thread_of(f"M3{COUNTERSUNK}") == thread_of("M3")
    assert diameter_mm("M2 thread-forming") == 2.0
    assert diameter_mm("3") == 3.0
    assert diameter_mm("1/4-20 UNC") == 6.35
    assert SUNK_HEAD * thread_of("M3").diameter_mm == pytest.approx(6.72)  # ISO 10642
    with pytest.raises(ValueError, match="size='M33' names no thread, expected one of M1"):
        thread_of("M33")
