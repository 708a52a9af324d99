"""Requests are solved ahead in their order, while nobody waits; one that cannot be worked on does not end that."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Iterator
from queue import Queue

import pytest

from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.design_values import DesignResult, RefusedDesign
from mirrorcam.studio.look_ahead import LookAhead, nearby_requests

FAILS, ENDS, LONG = DesignSpec(rows=4), DesignSpec(rows=5), DesignSpec(rows=6)
ONE, TWO, THREE = (DesignSpec(rows=rows) for rows in (1, 2, 3))


def answer(spec: DesignSpec) -> DesignResult:
    """What the process does for a request."""
    if spec == FAILS:
        raise ValueError("no such mirror")
    if spec == ENDS:
        os._exit(7)
    if spec == LONG:
        time.sleep(60.0)
    return RefusedDesign("", f"{spec.rows} rows")


class Ahead:
    """A look ahead that is told what is known, and what it kept."""

    def __init__(self) -> None:
        self.known: set[DesignSpec] = set()
        self.kept: Queue[tuple[DesignSpec, DesignResult]] = Queue()
        self.looking = LookAhead(self.known.__contains__, lambda spec, found: self.kept.put((spec, found)), answer)
        self.looking.start()

    def next(self) -> DesignSpec:
        spec, found = self.kept.get(timeout=60.0)
        assert found == RefusedDesign("", f"{spec.rows} rows")
        return spec


@pytest.fixture
def ahead() -> Iterator[Ahead]:
    made = Ahead()
    yield made
    made.looking.close()


def test_requests_are_solved_in_order_except_solved_ones(ahead: Ahead) -> None:
    ahead.known.add(TWO)
    ahead.looking.solve_next([THREE, TWO, ONE])
    assert [ahead.next(), ahead.next()] == [THREE, ONE]


@pytest.mark.parametrize(("fails", "why"), [(FAILS, "no such mirror"), (ENDS, "with exit code 7")])
def test_a_failing_request_is_logged_and_the_next_is_solved(
    ahead: Ahead, fails: DesignSpec, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    ahead.looking.solve_next([fails, ONE])
    assert ahead.next() == ONE
    assert [record.levelno for record in caplog.records] == [logging.ERROR]
    assert f"rows={fails.rows}" in caplog.text
    assert why in caplog.text


def test_what_keeps_a_solution_may_fail_too(caplog: pytest.LogCaptureFixture) -> None:
    kept = threading.Event()

    def keep(spec: DesignSpec, found: DesignResult) -> None:
        if spec == ONE:
            raise RuntimeError("the previewer cannot work")
        kept.set()

    looking = LookAhead(set[DesignSpec]().__contains__, keep, answer)
    looking.start()
    looking.solve_next([ONE, TWO])
    assert kept.wait(60.0)
    assert "the previewer cannot work" in caplog.text
    looking.close()


def test_nothing_starts_during_a_pause_nor_afterwards_until_the_next_request(ahead: Ahead) -> None:
    with ahead.looking.paused():
        ahead.looking.solve_next([ONE])
        time.sleep(0.3)
        assert ahead.kept.empty()
    ahead.looking.solve_next([TWO])
    assert ahead.next() == TWO
    assert ahead.kept.empty()


def test_the_end_is_immediate_and_not_an_error(ahead: Ahead, caplog: pytest.LogCaptureFixture) -> None:
    ahead.looking.solve_next([ONE, LONG, TWO])
    assert ahead.next() == ONE
    time.sleep(0.3)
    ahead.looking.close()
    thread = next((each for each in threading.enumerate() if each.name == "look ahead"), None)
    if thread is not None:
        thread.join(30.0)
        assert not thread.is_alive()
    assert ahead.kept.empty()
    assert not caplog.records


def test_counts_come_first_then_the_other_steps_and_then_pairs_of_them() -> None:
    found = nearby_requests(DesignSpec())
    assert [(spec.rows, spec.cols) for spec in found][:4] == [(4, 3), (3, 4), (2, 3), (3, 2)]
    steps = [step for step in found.values() if step]
    assert list(found.values()) == steps + [""] * (len(found) - len(steps))
    for other, step in found.items():
        differing = {name for name in DesignSpec.model_fields if getattr(other, name) != getattr(DesignSpec(), name)}
        assert differing == {step} if step else "scale_mm" in differing and len(differing) <= 2
    assert DesignSpec() not in found


def test_what_no_request_can_hold_is_left_out() -> None:
    assert all(spec.rows * spec.cols > 1 for spec in nearby_requests(DesignSpec(rows=1, cols=2)))
    assert all(0 <= spec.tradeoff <= 1 for spec in nearby_requests(DesignSpec(tradeoff=0.1)))
    assert max(len(spec.arrangement.steps) for spec in nearby_requests(DesignSpec(rows=5, cols=5))) == 25
    assert "fold_deg" not in nearby_requests(DesignSpec(fold_deg="auto")).values()


def test_a_pattern_keeps_its_count() -> None:
    found = nearby_requests(DesignSpec(pattern=Pattern.hexagonal(1)))
    assert set(found.values()) == {"scale_mm", "tradeoff", "fold_deg", ""}
    assert {spec.arrangement.text for spec in found} == {"hex7"}
