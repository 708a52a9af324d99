"""Ctrl-C that a library swallows is remembered within the block, and only there."""

from __future__ import annotations

import signal
from contextlib import suppress

import pytest

from mirrorcam.console import interruption


def test_a_swallowed_interruption_is_raised_at_the_next_check() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interruption.remembered():
        interruption.check()
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interruption.check()
    assert signal.getsignal(signal.SIGINT) is before
    with interruption.remembered():
        interruption.check()


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruption.remembered():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
