"""Designs are solved once, newest first, and what may come next is solved ahead."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mirrorcam.core.values import InputError
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio.design_values import DesignDrawing, RefusedDesign, SolvedDesign
from mirrorcam.studio.designer import Designer
from mirrorcam.studio.turns import Asker, Superseded

SMALL = DesignSpec(rows=1, cols=2, depths_mm=(300.0,))
LONG = DesignSpec(rows=5, cols=5)


@pytest.fixture
def designer() -> Iterator[Designer]:
    made = Designer()
    made.start()
    yield made
    made.close()


def test_what_was_solved_is_kept_and_previews_lie_near_it(designer: Designer) -> None:
    found = designer.solve(SMALL)
    assert isinstance(found, SolvedDesign)
    assert designer.solve(SMALL) is found
    assert designer.preview(SMALL) == found.drawing.model_dump_json()
    preview = DesignDrawing.model_validate_json(designer.preview(SMALL.replaced(scale_mm=85.0)) or "")
    assert preview.kind == "preview"
    bars = designer.tolerance(SMALL)
    assert "200 devices" in bars.assumed
    assert found.layout.identity in designer.report(SMALL)


def test_a_newer_request_ends_the_older_one(designer: Designer) -> None:
    ended: list[str] = []

    def solve_long() -> None:
        try:
            designer.solve(LONG)
        except Superseded:
            ended.append("superseded")

    waiting = threading.Thread(target=solve_long)
    waiting.start()
    while designer._solutions.working is None:
        time.sleep(0.01)
    assert isinstance(designer.solve(SMALL), SolvedDesign)
    waiting.join(30.0)
    assert ended == ["superseded"]


def test_pages_get_their_designs_one_after_another(designer: Designer) -> None:
    specs = [SMALL.replaced(scale_mm=80.0 + number) for number in range(4)]
    found: dict[int, object] = {}

    def ask(number: int) -> None:
        found[number] = designer.solve(specs[number], Asker(number))

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120.0)
    assert len(found) == 4
    for number, spec in enumerate(specs):
        design = found[number]
        assert isinstance(design, SolvedDesign) and design.layout.spec == spec


def test_a_page_that_leaves_frees_the_solver_for_the_others(designer: Designer) -> None:
    ended: list[str] = []
    leaving = Asker("a")

    def solve_long() -> None:
        try:
            designer.solve(LONG, leaving)
        except Superseded:
            ended.append("superseded")

    waiting = threading.Thread(target=solve_long)
    waiting.start()
    while designer._solutions.working is None:
        time.sleep(0.01)
    time.sleep(0.5)
    designer.leave(leaving)
    waiting.join(5.0)
    assert ended == ["superseded"]
    assert isinstance(designer.solve(SMALL, Asker("b")), SolvedDesign)


def test_a_solver_that_dies_is_said_and_replaced(designer: Designer) -> None:
    killed = threading.Timer(0.5, designer._solver.kill)
    killed.start()
    with pytest.raises(InputError, match="ended by signal 9"):
        designer.solve(LONG)
    assert isinstance(designer.solve(SMALL), SolvedDesign)


def test_what_is_near_is_solved_ahead(designer: Designer) -> None:
    designer.solve(SMALL)
    ahead = SMALL.replaced(rows=2)
    for _ in range(600):
        if ahead in designer._kept:
            break
        time.sleep(0.1)
    assert isinstance(designer._kept[ahead], SolvedDesign)


def test_a_refusal_is_kept_too(designer: Designer) -> None:
    found = designer.solve(SMALL.replaced(seen_gap_mm=500.0))
    assert isinstance(found, RefusedDesign)
    assert found.constraint == "seen gap"
    with pytest.raises(InputError, match="not solved"):
        designer.tolerance(SMALL.replaced(seen_gap_mm=500.0))


def test_a_stored_layout_is_read_instead_of_solved(designer: Designer, tmp_path: Path) -> None:
    found = designer.solve(SMALL)
    assert isinstance(found, SolvedDesign)
    # Kept under another request: were it solved, it would be another design.
    other = SMALL.replaced(scale_mm=200.0)
    found.layout.save(tmp_path / "layout.json")
    designer.offer({other: tmp_path / "layout.json"})
    again = designer.solve(other)
    assert isinstance(again, SolvedDesign)
    assert again.layout.identity == found.layout.identity
