"""A queue of pages for a process that makes one call at a time, in order of request."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from itertools import count

_ARRIVALS = count()


class Superseded(Exception):
    """A superseded request: its page has requested something else, or is closed."""


class Asker:
    """One request of a page, later than those made before it.

    Parameters
    ----------
    page
        Name of the page; of its requests only the newest is worked on.
    """

    def __init__(self, page: Hashable = "") -> None:
        self.page, self.gone = page, False
        self.arrival = next(_ARRIVALS)
        self.subject: Hashable = None


class Turns:
    """Gives turns in the order of requests, and each page one place; any thread may call.

    A page with a new request goes to the end of the queue, so that no page can keep the others waiting.

    Parameters
    ----------
    end
        Ends the call that is being made.
    """

    def __init__(self, end: Callable[[], None]) -> None:
        self._end, self._changed = end, threading.Condition()
        self._queue: list[Asker] = []
        """Those who wait, after the one whose turn it is."""
        self._at_work: Asker | None = None

    @contextmanager
    def turn(self, asker: Asker, subject: Hashable) -> Iterator[None]:
        """Wait for the turn of a request, and take it within the block.

        The page's earlier request is dropped, unless it has its turn and the same subject. Raises
        Superseded where this one is dropped.
        """
        with self._changed:
            asker.subject = subject
            self._give_up_earlier(asker)
            asker.gone |= any(each.page == asker.page and each.arrival > asker.arrival for each in self._queue)
            self._queue.append(asker)
            self._changed.wait_for(lambda: asker.gone or self._queue[0] is asker)
            if asker.gone:
                self._queue.remove(asker)
                self._changed.notify_all()
                raise Superseded
            self._at_work = asker
        try:
            yield
        finally:
            with self._changed:
                self._at_work = None
                self._queue.remove(asker)
                self._changed.notify_all()

    def give_up_earlier(self, asker: Asker, subject: Hashable) -> None:
        """Give up the earlier request of a page, as `turn` does, for a request that needs no turn."""
        with self._changed:
            asker.subject = subject
            self._give_up_earlier(asker)

    def leave(self, asker: Asker) -> None:
        """Give up a request, whose page is closed, or has ended the request."""
        with self._changed:
            self._give_up(asker)

    @property
    def working(self) -> Hashable | None:
        """The subject of the request whose turn it is."""
        with self._changed:
            return None if self._at_work is None else self._at_work.subject

    def _give_up_earlier(self, asker: Asker) -> None:
        for other in list(self._queue):
            same_work = other is self._at_work and other.subject == asker.subject
            if other.page == asker.page and other.arrival < asker.arrival and not same_work:
                self._give_up(other)

    def _give_up(self, asker: Asker) -> None:
        if asker.gone:
            return
        asker.gone = True
        if self._at_work is asker:
            self._end()
        self._changed.notify_all()
