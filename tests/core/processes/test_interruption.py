"""Ctrl-C that a library swallows is remembered within the block, and only there."""

from __future__ import annotations

import signal
from contextlib import suppress

import pytest

from mirrorcam.core.processes import interruption


def test_a_swallowed_interruption_is_raised_at_the_next_check() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interruption.remembered():
        interruption.check()
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            interruption.check()
    assert signal.getsignal(signal.SIGINT) is before
    interruption.check()
    with interruption.remembered():
        interruption.check()


@pytest.mark.parametrize("number", interruption.SIGNALS)
def test_signals_are_distinguished_and_one_sent_twice_counts_once(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with interruption.remembered():
        assert interruption.requested() is None
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
        signal.raise_signal(number)
    assert interruption.requested() == number
    assert signal.getsignal(number) is before


def test_work_that_must_not_stop_half_way_is_done_before_it_is_interrupted() -> None:
    done = []
    with interruption.remembered(), pytest.raises(KeyboardInterrupt), interruption.deferred():
        with interruption.deferred():
            signal.raise_signal(signal.SIGTERM)
            done.append("inner")
        done.append("outer")
    assert done == ["inner", "outer"]
    with interruption.remembered(), interruption.deferred():
        pass


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruption.remembered():
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_what_a_library_makes_of_an_interruption_is_one() -> None:
    def error() -> RuntimeError:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as cause:
            raised = RuntimeError("a loop ended early")
            raised.__cause__ = cause
        return raised

    with interruption.remembered():
        assert not interruption.caused(ValueError("bad")) and interruption.caused(KeyboardInterrupt())
        assert interruption.caused(error()) and not interruption.caused(ValueError("bad"))
