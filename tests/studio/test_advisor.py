"""What can be asked for instead of a refused request: found by a process, until another request comes."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from mirrorcam.optics.geometry.design_spec import DesignSpec
from mirrorcam.studio import design_work
from mirrorcam.studio.advisor import Advisor
from mirrorcam.studio.design_values import RefusedDesign, SuggestedRequest
from mirrorcam.studio.turns import Asker

NARROW = DesignSpec(rows=1, cols=2, seen_gap_mm=120.0)
MANY = DesignSpec(seen_gap_mm=200.0)


@pytest.fixture
def advisor() -> Iterator[Advisor]:
    made = Advisor()
    yield made
    made.close()


def refused(spec: DesignSpec) -> RefusedDesign:
    found = design_work.solve(spec)
    assert isinstance(found, RefusedDesign)
    return found


def test_each_can_be_met_and_says_what_differs(advisor: Advisor) -> None:
    found = list(advisor.suggestions(NARROW, refused(NARROW), Asker()))
    assert found
    for each in found:
        spec = DesignSpec.model_validate(each.spec)
        assert spec != NARROW
        assert each.text
    smaller = next(spec for each in found if (spec := DesignSpec.model_validate(each.spec)).seen_gap_mm < 120.0)
    assert not isinstance(design_work.solve(smaller), RefusedDesign)


def test_another_request_ends_a_search_and_the_next_one_works(advisor: Advisor) -> None:
    got: list[list[SuggestedRequest]] = []
    refusal = refused(MANY)
    searching = threading.Thread(target=lambda: got.append(list(advisor.suggestions(MANY, refusal, Asker()))))
    searching.start()
    time.sleep(0.5)
    advisor.end_search(Asker())
    searching.join(60.0)
    assert got == [[]]
    assert list(advisor.suggestions(NARROW, refused(NARROW), Asker()))


def test_a_search_that_is_not_read_to_its_end_is_over(advisor: Advisor) -> None:
    refusal = refused(NARROW)
    search = advisor.suggestions(NARROW, refusal, Asker())
    first = next(search)
    advisor.end_search(Asker())
    assert list(search) == []
    again = list(advisor.suggestions(NARROW, refusal, Asker()))
    assert again[0] == first
    assert len(again) > 1


def test_pages_that_search_at_the_same_time_find_all(advisor: Advisor) -> None:
    refusal, got = refused(NARROW), dict[str, list[SuggestedRequest]]()

    def search(page: str) -> None:
        got[page] = list(advisor.suggestions(NARROW, refusal, Asker(page)))

    threads = [threading.Thread(target=search, args=(page,)) for page in ("one", "two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(120.0)
    assert len(got["one"]) > 1 and got["one"] == got["two"]


def test_a_search_that_its_page_drops_frees_the_process(advisor: Advisor) -> None:
    refusal = refused(NARROW)
    search = advisor.suggestions(NARROW, refusal, Asker("one"))
    first = next(search)
    del search
    assert next(advisor.suggestions(NARROW, refusal, Asker("two"))) == first
