"""A queue of page requests for a process that makes one call at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from itertools import count

_ARRIVALS = count()


class Superseded(Exception):
    """The page has sent a newer request, or is closed."""


class PageRequest:
    """One request of a page, later than those made before it.

    Parameters
    ----------
    page
        Name of the page; only its newest request is worked on.
    """

    def __init__(self, page: Hashable = "") -> None:
        self.page, self.dropped = page, False
        self.arrival = next(_ARRIVALS)
        self.subject: Hashable = None


class Turns:
    """Gives turns in the order of requests, with one request of each page in the queue; thread-safe.

    A page with a new request goes to the end of the queue: no page can block the others.

    Parameters
    ----------
    end
        Ends the current call.
    """

    def __init__(self, end: Callable[[], None]) -> None:
        self._end, self._changed = end, threading.Condition()
        self._queue: list[PageRequest] = []
        """The request whose turn it is, then waiting ones."""
        self._at_work: PageRequest | None = None

    @contextmanager
    def turn(self, page_request: PageRequest, subject: Hashable) -> Iterator[None]:
        """Wait for the turn of a request, and take it within the block.

        An earlier request of the page is dropped, unless it has its turn and the same subject. Raises Superseded if
        this one is dropped.
        """
        with self._changed:
            page_request.subject = subject
            self._drop_earlier(page_request)
            page_request.dropped |= any(
                other.page == page_request.page and other.arrival > page_request.arrival for other in self._queue
            )
            self._queue.append(page_request)
            self._changed.wait_for(lambda: page_request.dropped or self._queue[0] is page_request)
            if page_request.dropped:
                self._queue.remove(page_request)
                self._changed.notify_all()
                raise Superseded
            self._at_work = page_request
        try:
            yield
        finally:
            with self._changed:
                self._at_work = None
                self._queue.remove(page_request)
                self._changed.notify_all()

    def drop_earlier(self, page_request: PageRequest, subject: Hashable) -> None:
        """Drop the earlier request of a page, as `turn` does, for a request that needs no turn."""
        with self._changed:
            page_request.subject = subject
            self._drop_earlier(page_request)

    def leave(self, page_request: PageRequest) -> None:
        """Drop a request that its page has cancelled."""
        with self._changed:
            self._drop(page_request)

    @property
    def working(self) -> Hashable | None:
        """The subject of the request whose turn it is."""
        with self._changed:
            return None if self._at_work is None else self._at_work.subject

    def _drop_earlier(self, page_request: PageRequest) -> None:
        for other in list(self._queue):
            same_work = other is self._at_work and other.subject == page_request.subject
            if other.page == page_request.page and other.arrival < page_request.arrival and not same_work:
                self._drop(other)

    def _drop(self, page_request: PageRequest) -> None:
        if page_request.dropped:
            return
        page_request.dropped = True
        if self._at_work is page_request:
            self._end()
        self._changed.notify_all()
