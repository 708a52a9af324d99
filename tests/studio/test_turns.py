"""Turns are in the order of requests; each page has one place."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable

import pytest

from mirrorcam.studio.turns import PageRequest, Superseded, Turns

LONG_S = 20.0


class Works:
    """A process that makes one call at a time, each until it is let go of or ended, and those who ask for it."""

    def __init__(self) -> None:
        self.turns = Turns(self._end)
        self.done: list[object] = []
        self.given_up: list[object] = []
        self._go, self._threads = threading.Semaphore(0), list[threading.Thread]()
        self._ended = threading.Event()
        self.at_work = 0

    def ask(self, page_request: PageRequest, subject: object) -> None:
        def run() -> None:
            try:
                with self.turns.turn(page_request, subject):
                    self.at_work += 1
                    assert self.at_work == 1
                    while not (let_go := self._go.acquire(timeout=0.01)) and not self._ended.is_set():
                        pass
                    self.at_work -= 1
                    ended = self._ended.is_set()
                    self._ended.clear()
                    if ended and let_go:
                        self._go.release()
                    (self.given_up if ended else self.done).append(subject)
            except Superseded:
                self.given_up.append(subject)

        thread = threading.Thread(target=run, daemon=True)
        self._threads.append(thread)
        thread.start()
        until(lambda: page_request.subject == subject)

    def finish(self, count: int) -> None:
        self._go.release(count)
        for thread in self._threads:
            thread.join(LONG_S)
            assert not thread.is_alive()

    def _end(self) -> None:
        self._ended.set()


def until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + LONG_S
    while not done():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_turns_are_in_the_order_of_requests() -> None:
    works = Works()
    for number in range(10):
        works.ask(PageRequest(number), number)
    until(lambda: works.turns.working == 0)
    works.finish(10)
    assert works.done == list(range(10)) and works.given_up == [] and works.turns.working is None


def test_the_newest_request_of_a_page_replaces_the_earlier_and_no_other_page_s() -> None:
    works = Works()
    works.ask(PageRequest("a"), "a1")
    works.ask(PageRequest("b"), "b1")
    works.ask(PageRequest("c"), "c1")
    works.ask(PageRequest("b"), "b2")
    until(lambda: works.given_up == ["b1"])
    works.ask(PageRequest("a"), "a2")
    until(lambda: works.given_up == ["b1", "a1"] and works.turns.working == "c1")
    works.finish(3)
    assert works.done == ["c1", "b2", "a2"]


def test_the_newest_request_is_the_one_made_last_whichever_asks_for_its_turn_first() -> None:
    works, earlier, later = Works(), PageRequest("a"), PageRequest("a")
    works.ask(later, "later")
    until(lambda: works.turns.working == "later")
    works.ask(earlier, "earlier")
    until(lambda: works.given_up == ["earlier"])
    works.turns.drop_earlier(earlier, "other")
    works.finish(1)
    assert works.done == ["later"]


def test_work_on_the_same_subject_is_not_ended() -> None:
    works = Works()
    works.ask(PageRequest("a"), "same")
    works.ask(PageRequest("a"), "same")
    works.finish(2)
    assert works.done == ["same", "same"]
    works.ask(PageRequest("a"), "other")
    works.turns.drop_earlier(PageRequest("a"), "other")
    assert works.given_up == []
    works.turns.drop_earlier(PageRequest("a"), "new")
    until(lambda: works.given_up == ["other"])


def test_who_leaves_is_not_waited_for() -> None:
    works = Works()
    page_requests = [PageRequest(number) for number in range(4)]
    for number, page_request in enumerate(page_requests):
        works.ask(page_request, number)
    works.turns.leave(page_requests[2])
    works.turns.leave(page_requests[0])
    until(lambda: works.turns.working == 1 and sorted(map(str, works.given_up)) == ["0", "2"])
    works.finish(2)
    assert works.done == [1, 3]
    gone = PageRequest("late")
    works.turns.leave(gone)
    with pytest.raises(Superseded), works.turns.turn(gone, 5):
        pytest.fail("it has no turn")


def test_each_page_gets_its_newest_whatever_the_order() -> None:
    order = random.Random(0)
    works, newest = Works(), dict[int, int]()
    for number in range(40):
        page = order.randrange(10)
        newest[page] = number
        works.ask(PageRequest(page), number)
    works.finish(10)
    assert sorted(map(int, map(str, works.done))) == sorted(newest.values())
    assert len(works.done) + len(works.given_up) == 40
