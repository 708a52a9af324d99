"""Designs are solved once, newest first, and what may come next is solved ahead."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mirrorcam.core.errors import InputError
from mirrorcam.optics.geometry.arrangement import Pattern
from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio import design_work
from mirrorcam.studio.design_values import (
    DesignDrawing,
    DesignResult,
    RefusedDesign,
    SolvedDesign,
    SuggestedRequest,
    TargetResult,
)
from mirrorcam.studio.designer import Designer, Search
from mirrorcam.studio.turns import PageRequest

SMALL = DesignSpec(rows=1, cols=2, depths_mm=(300.0,))
LONG = DesignSpec(rows=5, cols=5)
PAIR = DesignSpec(pattern=Pattern(name="pair", positions=np.array([[0.0, 0.0], [1.0, 0.0]])))
"""A pattern, whose number of mirrors a target does not vary."""


def solved(designer: Designer, spec: DesignSpec, page_request: PageRequest | None = None) -> DesignResult | None:
    """The result of a request; None if it was superseded."""
    return next((found for found in designer.solve(spec, page_request) if not isinstance(found, float)), None)


@pytest.fixture
def designer() -> Iterator[Designer]:
    made = Designer()
    made.start()
    yield made
    made.close()


@pytest.mark.slow
def test_what_was_solved_is_kept_and_previews_lie_near_it(designer: Designer) -> None:
    found = solved(designer, SMALL)
    assert isinstance(found, SolvedDesign)
    assert solved(designer, SMALL) is found
    assert designer.preview(SMALL) == found.drawing.model_dump_json()
    preview = DesignDrawing.model_validate_json(designer.preview(SMALL.replaced(scale_mm=85.0)) or "")
    assert preview.kind == "preview"
    bars = designer.studied(design_work.tolerance, SMALL, PageRequest())
    assert "200 devices" in bars.assumed
    assert found.layout.identity in designer.studied(design_work.report, SMALL, PageRequest())


def test_a_newer_request_ends_the_older_one(designer: Designer) -> None:
    ended: list[DesignResult | None] = []
    waiting = threading.Thread(target=lambda: ended.append(solved(designer, LONG)))
    waiting.start()
    while designer._solver.turns.working is None:
        time.sleep(0.01)
    assert isinstance(solved(designer, SMALL), SolvedDesign)
    waiting.join(30.0)
    assert ended == [None]


@pytest.mark.slow
def test_pages_get_their_designs_one_after_another(designer: Designer) -> None:
    specs = [SMALL.replaced(scale_mm=80.0 + number) for number in range(4)]
    found: dict[int, object] = {}

    def ask(number: int) -> None:
        found[number] = solved(designer, specs[number], PageRequest(number))

    threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120.0)
    assert len(found) == 4
    for number, spec in enumerate(specs):
        design = found[number]
        assert isinstance(design, SolvedDesign) and design.layout.spec == spec


@pytest.mark.slow
def test_a_page_that_leaves_frees_the_solver_for_the_others(designer: Designer) -> None:
    ended: list[DesignResult | None] = []
    leaving = PageRequest("a")
    waiting = threading.Thread(target=lambda: ended.append(solved(designer, LONG, leaving)))
    waiting.start()
    while designer._solver.turns.working is None:
        time.sleep(0.01)
    time.sleep(0.5)
    designer.leave(leaving)
    waiting.join(5.0)
    assert ended == [None]
    assert isinstance(solved(designer, SMALL, PageRequest("b")), SolvedDesign)


@pytest.mark.slow
def test_a_solver_that_dies_is_reported_and_replaced(designer: Designer) -> None:
    killed = threading.Timer(0.5, designer._solver.process.kill)
    killed.start()
    found = solved(designer, LONG)
    assert isinstance(found, RefusedDesign) and "ended by signal 9" in found.finding
    assert isinstance(solved(designer, SMALL), SolvedDesign)


@pytest.mark.slow
def test_what_is_near_is_solved_ahead(designer: Designer) -> None:
    solved(designer, SMALL)
    ahead = SMALL.replaced(rows=2)
    for _ in range(600):
        if ahead in designer._results:
            break
        time.sleep(0.1)
    assert isinstance(designer._results[ahead], SolvedDesign)


def test_a_refusal_is_kept_too(designer: Designer) -> None:
    found = solved(designer, SMALL.replaced(seen_gap_mm=500.0))
    assert isinstance(found, RefusedDesign)
    assert found.constraint == "seen gap"
    with pytest.raises(InputError, match="not solved"):
        designer.solved(SMALL.replaced(seen_gap_mm=500.0))


def test_a_stored_layout_is_read_instead_of_solved(designer: Designer, tmp_path: Path) -> None:
    found = solved(designer, SMALL)
    assert isinstance(found, SolvedDesign)
    # Kept under another request: were it solved, it would be another design.
    other = SMALL.replaced(scale_mm=200.0)
    found.layout.save(tmp_path / "layout.json")
    designer.offer({other: tmp_path / "layout.json"})
    again = solved(designer, other)
    assert isinstance(again, SolvedDesign)
    assert again.layout.identity == found.layout.identity
    gone = SMALL.replaced(scale_mm=201.0)
    designer.offer({gone: tmp_path / "gone.json"})
    refused = solved(designer, gone)
    assert isinstance(refused, RefusedDesign) and "gone.json" in refused.finding


@pytest.mark.slow
def test_designs_for_a_target_come_with_progress_and_are_kept(designer: Designer) -> None:
    *steps, last = designer.target("1mm@300mm 500g", PAIR)
    assert isinstance(last, TargetResult)
    shares = [step for step in steps if isinstance(step, float)]
    assert shares == steps == sorted(shares) and steps[0] == 0.0
    for found in last.designs:
        assert [term.label for term in found.terms] == ["1mm@300mm", "500g"]
        assert all(term.passed for term in found.terms)
    for design in last.solved:
        assert design.layout.spec is not None and solved(designer, design.layout.spec) is design
    assert len(last.designs) == len(last.solved) > 0


def test_a_target_that_is_none_is_refused_in_words(designer: Designer) -> None:
    (only,) = designer.target("3 apples", SMALL)
    assert isinstance(only, TargetResult) and only.designs == () and "'3'" in only.refusal


@pytest.mark.slow
def test_a_cancelled_search_for_a_target_ends(designer: Designer) -> None:
    leaving = PageRequest("a")
    search = designer.target("0.3mm@400mm", SMALL, leaving)
    next(search)
    designer.leave(leaving)
    assert len(list(search)) <= 1
    assert next(designer.target("0.3mm@400mm", SMALL)) == 0.0


NARROW = DesignSpec(rows=1, cols=2, seen_gap_mm=120.0)
MANY = DesignSpec(seen_gap_mm=200.0)


@pytest.fixture
def advisor() -> Iterator[Search]:
    made = Search()
    yield made
    made.process.close()


def suggestions(
    advisor: Search, spec: DesignSpec, refusal: RefusedDesign, page: str = ""
) -> Iterator[SuggestedRequest]:
    begin, why = design_work.begin_suggestions, (refusal.constraint, refusal.finding)
    return advisor.results(PageRequest(page), begin, spec, *why)


def refused(spec: DesignSpec) -> RefusedDesign:
    found = design_work.solve(spec)
    assert isinstance(found, RefusedDesign)
    return found


@pytest.mark.slow
def test_each_can_be_met_and_says_what_differs(advisor: Search) -> None:
    found = list(suggestions(advisor, NARROW, refused(NARROW)))
    assert found
    for each in found:
        spec = DesignSpec.model_validate(each.spec)
        assert spec != NARROW
        assert each.text
    smaller = next(spec for each in found if (spec := DesignSpec.model_validate(each.spec)).seen_gap_mm < 120.0)
    assert not isinstance(design_work.solve(smaller), RefusedDesign)


@pytest.mark.slow
def test_another_request_ends_a_search_and_the_next_one_works(advisor: Search) -> None:
    got: list[list[SuggestedRequest]] = []
    refusal = refused(MANY)
    searching = threading.Thread(target=lambda: got.append(list(suggestions(advisor, MANY, refusal))))
    searching.start()
    time.sleep(0.5)
    advisor.turns.drop_earlier(PageRequest(), None)
    searching.join(60.0)
    assert got == [[]]
    assert list(suggestions(advisor, NARROW, refused(NARROW)))


@pytest.mark.slow
def test_a_search_that_is_not_read_to_its_end_is_over(advisor: Search) -> None:
    refusal = refused(NARROW)
    search = suggestions(advisor, NARROW, refusal)
    first = next(search)
    advisor.turns.drop_earlier(PageRequest(), None)
    assert list(search) == []
    again = list(suggestions(advisor, NARROW, refusal))
    assert again[0] == first
    assert len(again) > 1


@pytest.mark.slow
def test_pages_that_search_at_the_same_time_find_all(advisor: Search) -> None:
    refusal, got = refused(NARROW), dict[str, list[SuggestedRequest]]()

    def search(page: str) -> None:
        got[page] = list(suggestions(advisor, NARROW, refusal, page))

    threads = [threading.Thread(target=search, args=(page,)) for page in ("one", "two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120.0)
    assert len(got["one"]) > 1 and got["one"] == got["two"]


@pytest.mark.slow
def test_a_search_that_its_page_drops_frees_the_process(advisor: Search) -> None:
    refusal = refused(NARROW)
    search = suggestions(advisor, NARROW, refusal, "one")
    first = next(search)
    del search
    assert next(suggestions(advisor, NARROW, refusal, "two")) == first
