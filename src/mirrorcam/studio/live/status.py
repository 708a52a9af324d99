"""State of a live session: frames, meters and calibration pictures."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirrorcam.optics.alignment.meters import Exposure
from mirrorcam.studio.live.setup import Aligning, AlignmentReport, PoseHint
from mirrorcam.studio.live.values import Answer, FrameResults

RATE_FRAMES = 120
"""Frames over which rates and latencies are measured."""
RECENT_S = 3.0
LINES_KEPT = 50


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
    recording
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

    frames: int
    rate_hz: float
    depth_hz: float
    latency_ms: float | None
    latency_p95_ms: float | None
    depth_latency_ms: float | None
    dropped: int
    lost: int
    outages: int
    over: bool
    memory_mb: float
    sharpness: tuple[float, ...]
    exposure: Exposure | None
    aligning: Aligning
    alignment: AlignmentReport | None
    hint: PoseHint | None
    pictures: int
    taken: Path | None
    pictures_kept: int
    recording: tuple[Path, int, int] | None
    depth_median_mm: float | None
    lines: tuple[str, ...]
    failed: str | None
    failed_parts: dict[str, str]


class LiveMeters:
    """Counts, rates and messages of a session, reported by its processes; thread-safe.

    `on_note` is called with each message.
    """

    def __init__(self, on_note: Callable[[str], None] = lambda line: None) -> None:
        self._on_note, self._lock = on_note, threading.Lock()
        self._arrivals: deque[float] = deque(maxlen=RATE_FRAMES)
        self._latencies: deque[float] = deque(maxlen=RATE_FRAMES)
        self._depths: deque[tuple[float, float]] = deque(maxlen=RATE_FRAMES)
        self._answer: Answer | None = None
        self._frames = self._pictures = 0
        self._sharpness: tuple[float, ...] = ()
        self._exposure: Exposure | None = None
        self._depth_median_mm: float | None = None
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)
        self._failed: str | None = None
        self._taken: Path | None = None
        self._failed_parts: dict[str, str] = {}

    @property
    def ended(self) -> bool:
        """Whether the source or the session has ended."""
        with self._lock:
            return self._failed is not None or (self._answer is not None and self._answer.ended)

    def note(self, answer: Answer) -> None:
        """Count an answer of the decoding process."""
        for line in answer.lines:
            self.say(line)
        with self._lock:
            self._answer = answer
            results = answer.results
            if results is None:
                return
            if not results.repeated:
                self._frames += 1
                self._arrivals.append(results.done_s)
                self._latencies.append(1e3 * (results.done_s - results.arrived_s))
            self._sharpness = self._sharpness if results.sharpness is None else results.sharpness
            self._exposure = self._exposure if results.exposure is None else results.exposure
            if results.taken is not None:
                self._pictures, self._taken = self._pictures + 1, results.taken

    def note_depth(self, results: FrameResults, median_mm: float) -> None:
        """Count a depth estimate of a frame; the median is NaN if unknown."""
        done_s = time.monotonic()
        with self._lock:
            self._depths.append((done_s, 1e3 * (done_s - results.arrived_s)))
            self._depth_median_mm = median_mm if np.isfinite(median_mm) else None

    def say(self, line: str) -> None:
        """Add a message."""
        self._on_note(line)
        with self._lock:
            self._lines.append(line)

    def fail(self, reason: str) -> None:
        """Report why the session has ended before its source."""
        self.say(reason)
        with self._lock:
            self._failed = reason

    def fail_part(self, part: str, reason: str) -> None:
        """Report why "depth" or "setup" has ended; the session continues."""
        self.say(reason)
        with self._lock:
            self._failed_parts[part] = reason

    def status(
        self,
        *,
        alignment: AlignmentReport | None,
        hint: PoseHint | None,
        aligning: Aligning = "off",
        pictures_kept: int = 0,
        recording: Path | None,
    ) -> LiveStatus:
        """Return the state of the session; `recording` is the file of the recording."""
        now = time.monotonic()
        with self._lock:
            answer, latencies = self._answer, sorted(self._latencies)
            depths = [(done, latency) for done, latency in self._depths if now - done < RECENT_S]
            recorded = (0, 0) if answer is None else (answer.recorded, answer.not_recorded)
            return LiveStatus(
                frames=self._frames,
                rate_hz=rate([arrival for arrival in self._arrivals if now - arrival < RECENT_S]),
                depth_hz=rate([done for done, _ in depths]),
                latency_ms=quantile(latencies, 0.5),
                latency_p95_ms=quantile(latencies, 0.95),
                depth_latency_ms=quantile(sorted(latency for _, latency in depths), 0.5),
                dropped=0 if answer is None else answer.dropped,
                lost=0 if answer is None else answer.lost,
                outages=0 if answer is None else answer.outages,
                over=answer is not None and answer.ended,
                memory_mb=0.0 if answer is None else answer.memory_mb,
                sharpness=self._sharpness,
                exposure=self._exposure,
                aligning=aligning,
                alignment=alignment,
                hint=hint,
                pictures=self._pictures,
                taken=self._taken,
                pictures_kept=pictures_kept,
                recording=None if recording is None else (recording, *recorded),
                depth_median_mm=self._depth_median_mm,
                lines=tuple(self._lines),
                failed=self._failed,
                failed_parts=dict(self._failed_parts),
            )


def rate(times_s: Sequence[float]) -> float:
    """Return the rate of events at ascending times; 0 for fewer than two."""
    return (len(times_s) - 1) / (times_s[-1] - times_s[0]) if len(times_s) > 1 and times_s[-1] > times_s[0] else 0.0


def quantile(ordered: Sequence[float], fraction: float) -> float | None:
    """Return a quantile of ascending values; None without values."""
    return ordered[min(int(fraction * len(ordered)), len(ordered) - 1)] if ordered else None
