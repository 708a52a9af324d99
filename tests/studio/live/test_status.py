"""Counts, rates and messages of a session."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from mirrorcam.studio.live.status import LINES_KEPT, LiveMeters, quantile, rate
from mirrorcam.studio.live.values import Answer, FrameResults


def answer(shown: FrameResults | None, *, over: bool = False, lines: tuple[str, ...] = ()) -> Answer:
    return Answer(
        shown, ended=over, dropped=3, lost=2, outages=1, recorded=7, not_recorded=2, memory_mb=50.0, lines=lines
    )


def shown(done_s: float, latency_ms: float, **more: object) -> FrameResults:
    return FrameResults(0, 0.0, arrived_s=done_s - 1e-3 * latency_ms, done_s=done_s, jpegs={}, **more)  # type: ignore[arg-type]


def test_before_the_first_frame_nothing_is_known() -> None:
    found = LiveMeters().status
    assert (found.frames, found.rate_hz, found.depth_hz, found.latency_ms, found.sharpness) == (0, 0.0, 0.0, None, ())
    assert not found.ended


def test_rates_and_latencies_are_of_the_last_frames() -> None:
    meters, now = LiveMeters(), time.monotonic()
    for k in range(21):
        meters.note(answer(shown(now - 1.0 + 0.05 * k, 10.0 + k)))
    found = meters.status
    assert found.frames == 21 and found.rate_hz == pytest.approx(20.0)
    assert found.latency_ms == pytest.approx(20.0) and found.latency_p95_ms == pytest.approx(29.0)
    assert (found.dropped, found.lost, found.outages, found.memory_mb) == (3, 2, 1, 50.0)
    assert (found.recorded, found.not_recorded) == (7, 2)
    old = LiveMeters()
    for k in range(21):
        old.note(answer(shown(now - 60.0 + 0.05 * k, 10.0)))
    assert old.status.rate_hz == 0.0


def test_what_was_not_measured_stays_as_it_was() -> None:
    meters, now = LiveMeters(), time.monotonic()
    meters.note(answer(shown(now, 1.0, sharpness=(0.5, 1.0), taken=Path("a.png"))))
    meters.note(answer(shown(now, 1.0)))
    meters.note(answer(None))
    found = meters.status
    assert found.sharpness == (0.5, 1.0) and found.frames == 2 and found.pictures == 1
    assert found.taken == Path("a.png")


def test_the_last_frame_once_more_is_no_other_frame() -> None:
    meters, now = LiveMeters(), time.monotonic()
    meters.note(answer(shown(now, 10.0)))
    meters.note(answer(shown(now, 500.0, repeated=True), over=True))
    found = meters.status
    assert found.frames == 1 and found.latency_p95_ms == pytest.approx(10.0) and found.over


def test_a_part_that_fails_does_not_end_the_session() -> None:
    meters = LiveMeters()
    meters.fail_part("depth", "views share no field")
    found = meters.status
    assert found.failed_parts == {"depth": "views share no field"} and found.lines == ("views share no field",)
    assert not meters.status.ended


def test_depth_has_its_own_rate_and_is_not_known_everywhere() -> None:
    meters = LiveMeters()
    for _ in range(3):
        meters.note_depth(shown(time.monotonic(), 30.0), 412.0)
        time.sleep(0.01)
    found = meters.status
    assert found.depth_median_mm == 412.0 and found.depth_hz > 0.0 and found.frames == 0
    assert found.depth_latency_ms is not None and found.depth_latency_ms >= 30.0
    meters.note_depth(shown(time.monotonic(), 30.0), float("nan"))
    assert meters.status.depth_median_mm is None


def test_a_session_ends_with_its_source_or_by_a_failure() -> None:
    over, failed = LiveMeters(), LiveMeters()
    assert not over.status.ended
    over.note(answer(None, over=True))
    assert over.status.ended and over.status.over and over.status.failed is None
    failed.say("one")
    failed.fail("gone")
    assert failed.status.ended and failed.status.failed == "gone" and failed.status.lines == ("one", "gone")


def test_the_last_messages_are_kept_in_order() -> None:
    meters = LiveMeters()
    meters.note(answer(None, lines=tuple(f"line {k}" for k in range(LINES_KEPT))))
    meters.say("last")
    assert meters.status.lines == (*(f"line {k}" for k in range(1, LINES_KEPT)), "last")


def test_rates_and_quantiles_of_few_values() -> None:
    assert rate([]) == rate([1.0]) == rate([1.0, 1.0]) == 0.0 and rate([1.0, 1.5, 2.0]) == 2.0
    assert quantile([], 0.5) is None and quantile([4.0], 0.95) == 4.0
    assert quantile([1.0, 2.0, 3.0], 0.5) == 2.0 and quantile([1.0, 2.0, 3.0], 1.0) == 3.0
