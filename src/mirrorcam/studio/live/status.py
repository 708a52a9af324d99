"""State of a live session: frames, meters and calibration pictures."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mirrorcam.optics.alignment.meters import Exposure
from mirrorcam.studio.live.setup import Aligning, AlignmentReport, PoseHint
from mirrorcam.studio.live.values import Answer, FrameResults

RATE_FRAMES = 120
"""Frames over which rates and latencies are measured."""
RECENT_S = 3.0
LINES_KEPT = 50
COUNTS = ("dropped", "lost", "outages", "recorded", "not_recorded", "memory_mb")
"""Fields that `Answer` and `LiveStatus` share."""


@dataclass(frozen=True)
class LiveStatus:
    """State of a session.

    Attributes
    ----------
    frames
        Number of frames shown.
    rate_hz, depth_hz
        Pictures per second, over the last RECENT_S.
    latency_ms, latency_p95_ms
        Time from the arrival of a frame to its encoded pictures: median and 95th percentile; None before the first.
    depth_latency_ms
        Median latency of depth.
    dropped, lost, outages
        Frames skipped for newer ones, frames that could not be read, and number of disconnections.
    over
        Whether the source has ended.
    memory_mb
        Memory of the process that decodes.
    sharpness
        Sharpness of each mirror, relative to its best so far; NaN if unknown.
    exposure
        Exposure.
    aligning
        Whether mirrors are compared with the layout.
    alignment
        Alignment by the last frames; None before the first result since it was switched on.
    hint
        The board in the last calibration picture, and the recommendation for the next.
    pictures, taken
        Number of calibration pictures taken, and the last of them.
    pictures_kept
        Number of pictures that a calibration would use, earlier sessions included.
    recording, recorded, not_recorded
        File of the recording, and numbers of recorded and lost frames.
    depth_median_mm
        Depth at the centre of the picture.
    lines
        The last messages.
    failed
        Why the session ended before its source; None if it did not.
    failed_parts
        Why "depth" or "setup" ended, if so.
    """

    frames: int = 0
    rate_hz: float = 0.0
    depth_hz: float = 0.0
    latency_ms: float | None = None
    latency_p95_ms: float | None = None
    depth_latency_ms: float | None = None
    dropped: int = 0
    lost: int = 0
    outages: int = 0
    over: bool = False
    memory_mb: float = 0.0
    sharpness: tuple[float, ...] = ()
    exposure: Exposure | None = None
    aligning: Aligning = "off"
    alignment: AlignmentReport | None = None
    hint: PoseHint | None = None
    pictures: int = 0
    taken: Path | None = None
    pictures_kept: int = 0
    recording: Path | None = None
    recorded: int = 0
    not_recorded: int = 0
    depth_median_mm: float | None = None
    lines: tuple[str, ...] = ()
    failed: str | None = None
    failed_parts: Mapping[str, str] = field(default_factory=dict)

    @property
    def ended(self) -> bool:
        """Whether the source or the session has ended."""
        return self.over or self.failed is not None


class LiveMeters:
    """Counts, rates and messages of a session, reported by its processes; thread-safe.

    `on_note` is called with each message.
    """

    def __init__(self, on_note: Callable[[str], None] = lambda line: None) -> None:
        self._on_note, self._lock = on_note, threading.RLock()
        self._status = LiveStatus()
        self._arrivals: deque[float] = deque(maxlen=RATE_FRAMES)
        self._latencies: deque[float] = deque(maxlen=RATE_FRAMES)
        self._depths: deque[tuple[float, float]] = deque(maxlen=RATE_FRAMES)

    def note(self, answer: Answer) -> None:
        """Count an answer of the decoding process."""
        for line in answer.lines:
            self.say(line)
        counts: dict[str, Any] = {name: getattr(answer, name) for name in COUNTS}
        with self._lock:
            results = answer.results
            if results is not None and not results.repeated:
                counts["frames"] = self._status.frames + 1
                self._arrivals.append(results.done_s)
                self._latencies.append(1e3 * (results.done_s - results.arrived_s))
            if results is not None:
                measured = {"sharpness": results.sharpness, "exposure": results.exposure, "taken": results.taken}
                counts |= {name: value for name, value in measured.items() if value is not None}
                counts["pictures"] = self._status.pictures + (results.taken is not None)
            self._change(over=answer.ended, **counts)

    def note_depth(self, results: FrameResults, median_mm: float) -> None:
        """Count a depth estimate of a frame; the median is NaN if unknown."""
        done_s = time.monotonic()
        with self._lock:
            self._depths.append((done_s, 1e3 * (done_s - results.arrived_s)))
            self._change(depth_median_mm=median_mm if np.isfinite(median_mm) else None)

    def say(self, line: str) -> None:
        """Add a message."""
        self._on_note(line)
        with self._lock:
            self._change(lines=(*self._status.lines, line)[-LINES_KEPT:])

    def fail(self, reason: str) -> None:
        """Report why the session has ended before its source."""
        self.say(reason)
        self._change(failed=reason)

    def fail_part(self, part: str, reason: str) -> None:
        """Report why "depth" or "setup" has ended; the session continues."""
        self.say(reason)
        with self._lock:
            self._change(failed_parts={**self._status.failed_parts, part: reason})

    def _change(self, **changes: Any) -> None:
        with self._lock:
            self._status = replace(self._status, **changes)

    @property
    def status(self) -> LiveStatus:
        """The state of the session, without alignment, hint and files."""
        now = time.monotonic()
        with self._lock:
            latencies = sorted(self._latencies)
            depths = [(done, latency) for done, latency in self._depths if now - done < RECENT_S]
            return replace(
                self._status,
                rate_hz=rate([arrival for arrival in self._arrivals if now - arrival < RECENT_S]),
                depth_hz=rate([done for done, _ in depths]),
                latency_ms=quantile(latencies, 0.5),
                latency_p95_ms=quantile(latencies, 0.95),
                depth_latency_ms=quantile(sorted(latency for _, latency in depths), 0.5),
            )


def rate(times_s: Sequence[float]) -> float:
    """Return the rate of events at ascending times; 0 for fewer than two."""
    return (len(times_s) - 1) / (times_s[-1] - times_s[0]) if len(times_s) > 1 and times_s[-1] > times_s[0] else 0.0


def quantile(ordered: Sequence[float], fraction: float) -> float | None:
    """Return a quantile of ascending values; None without values."""
    return ordered[min(int(fraction * len(ordered)), len(ordered) - 1)] if ordered else None
