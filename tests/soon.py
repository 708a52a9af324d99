"""A bound on the work that a hostile file can cause."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

LIMIT_S = 10.0


@contextmanager
def soon() -> Iterator[None]:
    """Fail if the block takes ten seconds of this thread's processor time.

    A refusal takes less than a second even on a busy machine; the attack that it refuses takes minutes.
    """
    begun = time.thread_time()
    yield
    assert time.thread_time() - begun < LIMIT_S
